"""`jaxcontact fit`: one ready-made problem on the columns of a file."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ....extend import Stages
from ..law import add_law_and_contact, contact_asked, exponent_asked, law_parameters
from ..options import (
    InputError,
    add_air_options,
    add_table_options,
    assignment,
    drag_asked,
    drag_notes,
    gravity_asked,
    in_options,
    input_errors,
    number,
    positive,
    print_json,
    table_asked,
)

if TYPE_CHECKING:
    from .... import AbstractLaw, Fit
    from ...recordings import TableColumns

SUMMARY = "parameters from a file of columns"

DESCRIPTION = """\
Fit one ready-made problem to the columns of a file. Print the parameters with standard errors,
whether the model describes the data, and what the data do not determine.
"""

EPILOG = """\
PROBLEM, the columns that it reads, and what it fits:
  impacts      velocity, and e, duration or max_force     a law and a contact
               [sigma, of e alone; ball]
  damping      velocity, e [sigma; ball]                  the factor c of K δⁿ + c δⁿ δ'
  energy_loss  e_in, e_out                                the power β of the energy-loss family
  record       time, and force or indentation             a law and a contact, from one impact
  bounces      as `jaxcontact calibrate`                  a law, from intervals or heights

Headings may be any usual name; units in them are converted ("t_c / ms", "peak force (kN)").
--columns assigns other headings. For impacts with e alone, the fit agrees with `jaxcontact
calibrate`: rows that it marks are left out, and without standard deviations the errors are the same
fraction of each e.

The fit starts from --law, its parameters, --mass and --stiffness. The mass is held. --hold NAME
holds another number by its printed name: contact.stiffness, law.c (or stiffness, c), or velocity.

--gravity and air drag apply to bounces. --mass, --radius and --drag-coefficient together correct
the flights for drag. Without --e a law with that parameter starts at 0.7.

example: jaxcontact fit impacts table.csv --law hu_guo --mass 0.05 --stiffness 1e6

exit codes: 0 done; 1 the fit did not converge; 2 bad input.
"""

_START = 0.7
"""Start of the parameter e of a law, if it is not given."""

_FAST = math.inf
"""A low-pass filter without a cut-off, which then starts at a tenth of the readings per second."""

_ONLY = {
    "bounces": ("rate", "gravity", "radius", "drag_coefficient", "air_density"),
    "record": ("start_time", "low_pass"),
}
"""Options of one problem."""


@dataclasses.dataclass(frozen=True)
class _Problem:
    """The columns of a problem, the required ones among them, and its fit."""

    columns: tuple[str, ...]
    needed: tuple[str, ...]
    fit: Callable[[argparse.Namespace, Mapping[str, Any]], Fit]
    one_of: tuple[str, ...] = ()


def _impacts(arguments: argparse.Namespace, data: Mapping[str, Any]) -> Fit:
    import numpy as np

    from .... import fit_impacts
    from ...pairs.outliers import marked_in

    law, exponent = _law(arguments)
    data = dict(data)
    sigma = data.pop("sigma", None)
    sigmas = {f"sigma_{name}": value for name, value in _sigmas(arguments, data).items()}
    how = _fixed(arguments) | _robust(arguments)
    if sigma is not None and not sigmas:
        sigmas = {"sigma_e": sigma}
    if not sigmas and data.keys() == {"velocity", "e"}:
        # Errors are the same fraction of each e, as in `calibrate`, to third order in ln e.
        product = data["e"] * marked_in(data["velocity"], data["e"])[1]
        how["weights"] = {"e": np.where(product > 0, product, np.inf) ** -1.0}
    return fit_impacts(law, contact_asked(arguments, exponent), **data, **sigmas, **how)


def _damping(arguments: argparse.Namespace, data: Mapping[str, Any]) -> Fit:
    from .... import fit_damping

    sigma = {"e": data["sigma"]} if "sigma" in data else {}
    sigma |= _sigmas(arguments, {"e": data["e"]})
    how: dict[str, Any] = {"sigma": sigma["e"]} if sigma else {}
    how |= _robust(arguments)
    contact = contact_asked(arguments, arguments.exponent or 1.5)
    return fit_damping(contact, data["velocity"], data["e"], **how)


def _energy_loss(arguments: argparse.Namespace, data: Mapping[str, Any]) -> Fit:
    from .... import fit_energy_loss

    return fit_energy_loss(data["e_in"], data.get("e_out"), **_robust(arguments))


def _record(arguments: argparse.Namespace, data: Mapping[str, Any]) -> Fit:
    import numpy as np

    from ...records.fit_record import fit_record
    from ...records.low_pass import LowPass

    law, exponent = _law(arguments)
    if arguments.velocity is None:
        raise InputError("--velocity is needed, as the closing speed at which the fit starts")
    sigmas = {f"sigma_{name}": value for name, value in _sigmas(arguments, data).items()}
    contact = contact_asked(arguments, exponent)
    columns = {name: values for name, values in data.items() if name != "time"}
    how = _fixed(arguments) | _robust(arguments) | {"start_time": arguments.start_time}
    if (cutoff := arguments.low_pass) is not None:
        tenth = 0.1 / float(np.median(np.diff(data["time"])))
        filtered = "force" if "force" in columns else "indentation"
        start: Any = cutoff if cutoff < _FAST else tenth
        how[f"low_pass_{filtered}"] = LowPass(start)
    return fit_record(law, contact, data["time"], arguments.velocity, **columns, **sigmas, **how)


def _bounces(arguments: argparse.Namespace, data: Mapping[str, Any]) -> Fit:
    import numpy as np

    from .... import Contact
    from ...bounces import fit_bounces

    law, exponent = _law(arguments)
    # e(v) of most laws does not depend on them.
    contact = Contact(arguments.mass or 1.0, arguments.stiffness or 1.0, exponent)
    first, second = (np.array(data[name]) for name in ("first", "second"))
    drag = drag_asked(arguments)
    how = {"gravity": gravity_asked(arguments), "drag": drag} | _robust(arguments)
    how |= {name: data[name] for name in ("sigma", "correlation") if name in data}
    return fit_bounces(law, contact, first, second, kind=str(data["kind"]), **how)


_PROBLEMS = {
    "impacts": _Problem(
        ("velocity", "e", "duration", "max_force", "sigma", "ball"),
        ("velocity",),
        _impacts,
        ("e", "duration", "max_force"),
    ),
    "damping": _Problem(("velocity", "e", "sigma", "ball"), ("velocity", "e"), _damping),
    "energy_loss": _Problem(("e_in", "e_out"), ("e_in", "e_out"), _energy_loss),
    "record": _Problem(
        ("time", "force", "indentation"), ("time",), _record, ("force", "indentation")
    ),
    "bounces": _Problem((), (), _bounces),
}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("problem", metavar="PROBLEM", choices=tuple(_PROBLEMS), help="see below")
    parser.add_argument("file", metavar="FILE", help="text, spreadsheet or parquet, with columns")
    form = "NUMBER", "c=1e6"
    add_law_and_contact(parser, number=number, size=positive, form=form, needed=False)
    parser.add_argument(
        "--sigma",
        metavar="COLUMN=NUMBER",
        type=functools.partial(assignment, read=positive, form="NUMBER"),
        action="append",
        default=[],
        help="standard deviation of a column in SI units, of duration and max_force relative; for "
        "all columns or none; may be repeated",
    )
    parser.add_argument(
        "--hold", metavar="NAME", action="append", help="hold a number; may be repeated"
    )
    parser.add_argument(
        "--robust",
        action="store_true",
        help="Huber's loss: outliers such as wrong triggers count less",
    )
    parser.add_argument("--ball", metavar="NAME", help="ball to use where the file holds several")
    for name, metavar, read, words in (
        ("--rate", "HZ", positive, "frames of a video per second, for bounces"),
        ("--start-time", "S", number, "time of touch in s at which the fit of a record starts"),
    ):
        parser.add_argument(name, metavar=metavar, type=read, help=words)
    parser.add_argument(
        "--low-pass",
        metavar="HZ",
        type=positive,
        nargs="?",
        const=_FAST,
        help="low-pass filter of the instrument of a record: its cut-off is fitted from HZ "
        "(default: a tenth of the readings per second); left out if it does not lower AICc",
    )
    add_air_options(parser)
    add_table_options(parser)


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Fit and print; return 0, or 1 if the fit did not converge. Raises InputError, OSError."""
    progress("reading the file")
    problem = _PROBLEMS[arguments.problem]
    for only, names in _ONLY.items():
        for name in names if arguments.problem != only else ():
            if getattr(arguments, name) is not None:
                raise InputError(f"--{name.replace('_', '-')} is for {only} only")
    source, data, notes = _read_data(arguments, problem)
    progress("compiling and fitting")
    with input_errors(lambda text: f"{source}: {text}"):
        result = problem.fit(arguments, data)
    if arguments.json:
        print_json(_dict(arguments, source, result, notes))
    else:
        print(f"{arguments.problem} of {source}")
        if notes:
            print(f"  read as: {'; '.join(notes)}")
        print(result.summary())
    return 0 if result.converged else 1


def _read_data(
    arguments: argparse.Namespace, problem: _Problem
) -> tuple[str, Mapping[str, Any], tuple[str, ...]]:
    from ...recordings import FROM_FILE, read_columns

    how = table_asked(arguments)
    with input_errors(in_options):
        if not problem.columns:
            return _read_bounces(arguments, how)
        how["ball"] = arguments.ball
        read = read_columns(arguments.file, problem.columns, needed=problem.needed, **how)
    if problem.one_of and not any(name in read.values for name in problem.one_of):
        raise InputError(
            f"{arguments.file}: one of the columns {', '.join(problem.one_of)} is needed; if a "
            f'column holds it, name it, as in --columns "{problem.one_of[0]}=2"'
        )
    values, notes = read.values, read.notes
    lone = [name for name in ("e", "duration", "max_force") if name in values] == ["e"]
    if arguments.problem == "impacts" and "sigma" in values and not lone:
        values = {name: column for name, column in values.items() if name != "sigma"}
        notes = (
            *(note for note in notes if note != FROM_FILE),
            "the standard deviations are not used, since not all columns have them",
        )
        read = dataclasses.replace(read, values=values, notes=notes)
    if arguments.problem == "impacts" and "e" in values:
        values, notes = _without_marked(read)
    return read.source, values, notes


def _without_marked(read: TableColumns) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """Return the columns without the rows that `calibrate` marks, and the notes."""
    import numpy as np

    from ...pairs.outliers import marked_in

    columns = read.values
    marked, _ = marked_in(columns["velocity"], columns["e"], columns.get("sigma"))
    if not marked.any():
        return read.values, read.notes
    numbers = [str(row) for row, off in zip(read.rows, marked, strict=True) if off]
    note = f"e off the trend and left out, as in `calibrate`: row {', '.join(numbers)}"
    e = np.where(marked, np.nan, read.values["e"])
    return {**read.values, "e": e}, (*read.notes, note)


def _read_bounces(
    arguments: argparse.Namespace, how: Mapping[str, Any]
) -> tuple[str, Mapping[str, Any], tuple[str, ...]]:
    """Return the flights before and after each bounce; `calibrate` handles pairs off the trend."""
    import numpy as np

    from ....extend import Flight
    from ...recordings import make_pairs, read_recording

    recording = read_recording(arguments.file, ball=arguments.ball, rate=arguments.rate, **how)
    pairs = make_pairs(recording, Flight())
    flights = recording.layout.flights(pairs.records)
    if flights is None:
        raise InputError(
            f"{arguments.file}: holds speeds and restitutions; fit them with `jaxcontact fit "
            "impacts` or `jaxcontact calibrate`"
        )
    kind, first, second = flights
    data: dict[str, Any] = {"kind": kind, "first": first, "second": second}
    # The pairs of a track share errors of its floor and scale, which scatter cannot show.
    if pairs.covariance is not None and (pairs.absolute or recording.tracks):
        size = np.sqrt(np.diag(pairs.covariance))
        data |= {"sigma": size, "correlation": pairs.covariance / np.outer(size, size)}
    return recording.source, data, (*drag_notes(arguments), *recording.notes)


def _law(arguments: argparse.Namespace) -> tuple[AbstractLaw, float]:
    from .... import get_law, list_laws
    from ....extend import parameters_of

    if arguments.law is None:
        raise InputError(
            "--law is needed, as the law from which the fit starts; see `jaxcontact laws`"
        )
    registered = arguments.law in list_laws()
    if registered and arguments.e is None and "e" in parameters_of(arguments.law):
        arguments.e = None if "e" in dict(arguments.param) else _START
    parameters = law_parameters(arguments)
    exponent = exponent_asked(arguments)
    with input_errors():
        return get_law(arguments.law, **parameters), exponent


def _sigmas(arguments: argparse.Namespace, data: Mapping[str, Any]) -> dict[str, float]:
    from ....extend import did_you_mean

    sigmas = dict(arguments.sigma)
    for name in sigmas:
        if name not in data:
            raise InputError(
                f"--sigma {name}: the columns are {', '.join(data)}.{did_you_mean(name, data)}"
            )
    return sigmas


def _fixed(arguments: argparse.Namespace) -> dict[str, Any]:
    return {} if arguments.hold is None else {"fixed": ("mass", *arguments.hold)}


def _robust(arguments: argparse.Namespace) -> dict[str, Any]:
    from .... import Huber

    return {"throw": False} | ({"loss": Huber()} if arguments.robust else {})


def _dict(
    arguments: argparse.Namespace, source: str, result: Fit, notes: tuple[str, ...]
) -> dict[str, Any]:
    return {
        "problem": arguments.problem,
        "source": source,
        "read_as": notes,
        "converged": result.converged,
        "reason": result.reason,
        "parameters": dict(zip(result.names, result.values.tolist(), strict=True)),
        "units": dict(zip(result.names, result.problem.space.units, strict=True)),
        "standard_errors": dict(result.standard_errors),
        "adequate": result.adequate if result.converged else None,
        "unidentified": [str(direction) for direction in result.unidentified],
        "at_bound": result.at_bound,
        "degrees_of_freedom": result.dof,
        "notes": result.notes,
    }
