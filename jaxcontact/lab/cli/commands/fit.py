"""`jaxcontact fit`: one ready-made problem on the columns of a file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ....extend import Stages
from ..law import (
    AIR,
    GRAVITY,
    IN_AIR,
    TABLE,
    contact_asked,
    drag_asked,
    drag_notes,
    exponent_asked,
    law_options,
    law_parameters,
)
from ..options import READ, InputError, Output, fields, input_errors, naming, refuse, table_asked

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

_ONLY = {
    "bounces": ("rate", "gravity", "radius", "drag_coefficient", "air_density"),
    "record": ("start_time", "low_pass"),
}
"""Options of one problem."""

_OUTCOMES = ("e", "duration", "max_force")


class _FitInput(NamedTuple):
    """The columns of a problem, and those that it needs: all, and one of some.

    A problem without columns reads a recording.
    """

    columns: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()


_PROBLEMS = {
    "impacts": _FitInput(("velocity", *_OUTCOMES, "sigma", "ball"), ("velocity",), _OUTCOMES),
    "damping": _FitInput(("velocity", "e", "sigma", "ball"), ("velocity", "e")),
    "energy_loss": _FitInput(("e_in", "e_out"), ("e_in", "e_out")),
    "record": _FitInput(("time", "force", "indentation"), ("time",), ("force", "indentation")),
    "bounces": _FitInput(),
}


def _fit(arguments: argparse.Namespace, columns: Mapping[str, Any]) -> Fit:
    """Call the public function of the problem with its law, its contact and its columns."""
    from .... import Contact, Huber, fit_damping, fit_energy_loss, fit_impacts
    from ....extend import STANDARD_GRAVITY
    from ...bounces import fit_bounces
    from ...records.fit_record import fit_record

    how: dict[str, Any] = {"throw": False} | ({"loss": Huber()} if arguments.robust else {})
    how |= columns
    if arguments.problem == "energy_loss":
        return fit_energy_loss(**how)
    if arguments.problem == "damping":
        sigmas = _sigmas(arguments, ["e"])
        how |= {"sigma": sigmas["e"]} if sigmas else {}
        return fit_damping(contact_asked(arguments, arguments.exponent or 1.5), **how)
    law, exponent = _law(arguments)
    if arguments.problem == "bounces":
        # e(v) of most laws does not depend on them.
        contact = Contact(arguments.mass or 1.0, arguments.stiffness or 1.0, exponent)
        how |= {"gravity": arguments.gravity or STANDARD_GRAVITY, "drag": drag_asked(arguments)}
        return fit_bounces(law, contact, **how)
    sigma, weights = how.pop("sigma", None), how.pop("weights", None)
    sigmas = _sigmas(arguments, [name for name in columns if name in how])
    how |= {f"sigma_{name}": value for name, value in sigmas.items()}
    how |= {"fixed": ("mass", *arguments.hold)} if arguments.hold else {}
    contact = contact_asked(arguments, exponent)
    if arguments.problem == "record":
        if arguments.velocity is None:
            raise InputError("--velocity is needed, as the closing speed at which the fit starts")
        how |= {"start_time": arguments.start_time, "velocity": arguments.velocity}
        return fit_record(law, contact, **how, **_low_pass(arguments, columns))
    if not sigmas and sigma is not None:
        how["sigma_e"] = sigma
    elif not sigmas and weights is not None:
        how["weights"] = {"e": weights}
    return fit_impacts(law, contact, **how)


def _low_pass(arguments: argparse.Namespace, columns: Mapping[str, Any]) -> dict[str, Any]:
    import numpy as np

    from ...records.low_pass import LowPass

    cutoff: Any = arguments.low_pass
    if cutoff is None:
        return {}
    if math.isinf(cutoff):  # without HZ
        cutoff = 0.1 / float(np.median(np.diff(columns["time"])))
    return {f"low_pass_{'force' if 'force' in columns else 'indentation'}": LowPass(cutoff)}


def _sigmas(arguments: argparse.Namespace, columns: Sequence[str]) -> dict[str, float]:
    from ....extend import did_you_mean

    sigmas = dict(arguments.sigma)
    for name in sigmas:
        if name not in columns:
            raise InputError(
                f"--sigma {name}: the columns are {', '.join(columns)}."
                f"{did_you_mean(name, columns)}"
            )
    return sigmas


OPTIONS = f"""
PROBLEM | choice {" ".join(_PROBLEMS)} | see below
FILE | | text, spreadsheet or parquet, with columns
{law_options(required=False)}
--sigma COLUMN=NUMBER ... | positive | standard deviation of a column in SI units, of duration and
    max_force relative; for all columns or none; may be repeated
--hold NAME ... | | hold a number; may be repeated
--robust | flag | Huber's loss: outliers such as wrong triggers count less
--ball NAME | | ball to use where the file holds several
--rate HZ | positive | frames of a video per second, for bounces
--start-time S | number | time of touch in s at which the fit of a record starts
--low-pass [HZ] | positive | low-pass filter of the instrument of a record: its cut-off is fitted
    from HZ (default: a tenth of the readings per second); left out if it does not lower AICc
{GRAVITY}{TABLE}{IN_AIR}{AIR}"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the fit."""
    progress("reading the file")
    problem = _PROBLEMS[arguments.problem]
    for only, names in _ONLY.items():
        if arguments.problem != only:
            refuse(arguments, names, f"is for {only} only")
    with input_errors(naming(READ)):
        read = (_read_columns if problem.columns else _read_bounces)(arguments, problem)
    source, values, notes = read
    progress("compiling and fitting")
    with input_errors(lambda text: f"{source}: {text}"):
        result = _fit(arguments, values)
    shown = [f"{arguments.problem} of {source}", f"  read as: {'; '.join(notes)}"]
    data = {
        "problem": arguments.problem,
        "source": source,
        "read_as": notes,
        **fields(result, "converged reason"),
        "parameters": dict(zip(result.names, result.values.tolist(), strict=True)),
        "units": dict(zip(result.names, result.problem.space.units, strict=True)),
        "standard_errors": dict(result.standard_errors),
        "adequate": result.adequate if result.converged else None,
        "unidentified": [str(direction) for direction in result.unidentified],
        "at_bound": result.at_bound,
        "degrees_of_freedom": result.dof,
        "notes": result.notes,
    }
    shown = [*shown[: 2 if notes else 1], result.summary()]
    return Output(shown, data, code=0 if result.converged else 1)


_Read = tuple[str, Mapping[str, Any], tuple[str, ...]]
"""The source, the columns, and the notes on how they were read."""


def _read_columns(arguments: argparse.Namespace, problem: _FitInput) -> _Read:
    from ...recordings import FROM_FILE, read_columns

    how = table_asked(arguments) | {"ball": arguments.ball}
    read = read_columns(arguments.file, problem.columns, needed=problem.needed, **how)
    if problem.one_of and read.values.keys().isdisjoint(problem.one_of):
        raise InputError(
            f"{arguments.file}: one of the columns {', '.join(problem.one_of)} is needed; if a "
            f'column holds it, name it, as in --columns "{problem.one_of[0]}=2"'
        )
    values, notes = dict(read.values), read.notes
    if arguments.problem != "impacts":
        return read.source, values, notes
    lone = {*_OUTCOMES} & values.keys() == {"e"}
    if not lone and values.pop("sigma", None) is not None:
        notes = (
            *(note for note in notes if note != FROM_FILE),
            "the standard deviations are not used, since not all columns have them",
        )
    if "e" in values:
        values, notes = _without_marked(read, values, notes, lone)
    return read.source, values, notes


def _without_marked(
    read: TableColumns, values: dict[str, Any], notes: tuple[str, ...], lone: bool
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the columns without the rows that `calibrate` marks, and the notes.

    A `lone` e without standard deviations has weights: as in `calibrate`, errors are the same
    fraction of each e, to third order in ln e.
    """
    import numpy as np

    from ...pairs.outliers import marked_in

    marked, trend = marked_in(values["velocity"], values["e"], values.get("sigma"))
    values["e"] = np.where(marked, np.nan, values["e"])
    if lone and "sigma" not in values:
        product = values["e"] * trend
        values["weights"] = np.where(product > 0, product, np.inf) ** -1.0
    if marked.any():
        numbers = [str(row) for row, off in zip(read.rows, marked, strict=True) if off]
        left_out = f"e off the trend and left out, as in `calibrate`: row {', '.join(numbers)}"
        notes = (*notes, left_out)
    return values, notes


def _read_bounces(arguments: argparse.Namespace, problem: _FitInput) -> _Read:
    """Return the flights before and after each bounce; `calibrate` handles pairs off the trend."""
    import numpy as np

    from ....extend import Flight
    from ...recordings import make_pairs, read_recording

    how = table_asked(arguments) | {"ball": arguments.ball, "rate": arguments.rate}
    recording = read_recording(arguments.file, **how)
    pairs = make_pairs(recording, Flight())
    flights = recording.layout.flights(pairs.records)
    if flights is None:
        raise InputError(
            f"{arguments.file}: holds speeds and restitutions; fit them with `jaxcontact fit "
            "impacts` or `jaxcontact calibrate`"
        )
    kind, first, second = flights
    data: dict[str, Any] = {"first": np.array(first), "second": np.array(second), "kind": str(kind)}
    # The pairs of a track share errors of its floor and scale, which scatter cannot show.
    if pairs.covariance is not None and (pairs.absolute or recording.tracks):
        size = np.sqrt(np.diag(pairs.covariance))
        data |= {"sigma": size, "correlation": pairs.covariance / np.outer(size, size)}
    return recording.source, data, (*drag_notes(arguments), *recording.notes)


def _law(arguments: argparse.Namespace) -> tuple[AbstractLaw, float]:
    from .... import get_law, list_laws
    from ....extend import describe

    if arguments.law is None:
        raise InputError(
            "--law is needed, as the law from which the fit starts; see `jaxcontact laws`"
        )
    has_e = arguments.law in list_laws() and "e" in describe(arguments.law).parameters
    if has_e and arguments.e is None and "e" not in dict(arguments.param):
        arguments.e = _START
    parameters = law_parameters(arguments)
    exponent = exponent_asked(arguments)
    with input_errors():
        return get_law(arguments.law, **parameters), exponent
