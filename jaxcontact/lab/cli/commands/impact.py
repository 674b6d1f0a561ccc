"""`jaxcontact impact`: one impact in numbers, and as a figure."""

from __future__ import annotations

import argparse
import math
import pathlib
import sys
from typing import TYPE_CHECKING, Any

from ....extend import FIGURES, Stages, meaning, quantity, text_table, write_all
from ..law import add_law_and_contact, exponent_asked, law_parameters
from ..options import InputError, input_errors, number, output_path, positive, print_json

if TYPE_CHECKING:
    from .... import AbstractLaw, Contact, Impact, Status

_SAMPLES = 400

SUMMARY = "one impact in numbers, and as a figure"

DESCRIPTION = """\
One free impact, from touch to separation: restitution, rebound speed, duration, compression time,
largest indentation and force, and the energy lost.
"""

EPILOG = """\
example: jaxcontact impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2

exit codes: 0 done; 1 the impact or its picture could not be solved to accuracy; 2 bad input,
nothing written.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    add_law_and_contact(parser, number=number, size=positive, form=("NUMBER", "c=1e6"))
    words = "draw force over indentation and time, and speed over time; .png, .pdf or .svg"
    parser.add_argument("--plot", metavar="FILE", help=words)


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Solve the impact and print it. Raises InputError, OSError."""
    plot = output_path("--plot", arguments.plot, FIGURES) if arguments.plot else None
    progress("compiling and solving the impact")
    from .... import Contact, Status, get_law, impact

    parameters = law_parameters(arguments)
    exponent = exponent_asked(arguments)
    with input_errors():
        law = get_law(arguments.law, **parameters)
        contact = Contact(arguments.mass, arguments.stiffness, exponent)
        hit = impact(law, contact, arguments.velocity, throw=False)
    status = Status(int(hit.status))
    if status == Status.INVALID_INPUT:
        raise InputError("a parameter is out of its range")
    if beyond := _beyond(hit, status):
        raise InputError(f"{', '.join(beyond)}: too large to be written in double precision")
    complete = status != Status.NOT_CONVERGED
    if plot is not None:
        progress("compiling and drawing the trajectory")
        try:
            picture = _figure(law, contact, hit, arguments, plot)
        except ValueError as error:
            # The trajectory comes from another solve than the numbers, which may not converge.
            print(f"no picture: {error}", file=sys.stderr)
            complete = False
        else:
            write_all({plot: picture})
    if arguments.json:
        print_json(_dict(arguments, parameters, exponent, hit, status))
    else:
        print(_text(arguments, hit, status))
    return 0 if complete else 1


def _numbers(hit: Impact) -> dict[str, float]:
    from ....extend import NUMBERS

    return {name: float(getattr(hit, name)) for name in NUMBERS}


def _beyond(hit: Impact, status: Status) -> list[str]:
    """Return the non-finite numbers of a separated contact, caused by extreme arguments."""
    from .... import Status

    if status != Status.SEPARATED:
        return []
    return [name.replace("_", " ") for name, x in _numbers(hit).items() if not math.isfinite(x)]


def _text(arguments: argparse.Namespace, hit: Impact, status: Status) -> str:
    rows = [] if arguments.e is None else [("parameter e", f"{arguments.e:.9g}")]
    for name, value in _numbers(hit).items():
        rows.append((name.replace("_", " "), quantity(name, f"{value:.9g}")))
    rows.append(("status", status.name.lower().replace("_", " ")))
    head = f"{arguments.law} at {arguments.velocity:g} m/s (method {hit.method})"
    return "\n".join([head, *text_table(rows, indent=2)])


def _dict(
    arguments: argparse.Namespace,
    parameters: dict[str, Any],
    exponent: float,
    hit: Impact,
    status: Status,
) -> dict[str, Any]:
    contact = {name: getattr(arguments, name) for name in ("mass", "stiffness")}
    numbers = _numbers(hit)
    return {
        "law": arguments.law,
        "parameters": parameters,
        "contact": {**contact, "exponent": exponent},
        "velocity": arguments.velocity,
        **numbers,
        "status": status.name,
        "method": hit.method,
        "units": {
            name: unit for name in (*contact, "velocity", *numbers) if (unit := meaning(name)[1])
        },
    }


def _figure(
    law: AbstractLaw,
    contact: Contact,
    hit: Impact,
    arguments: argparse.Namespace,
    file: pathlib.Path,
) -> bytes:
    from .... import trajectory
    from ....extend import render
    from ....plot import impact as draw

    path = trajectory(law, contact, arguments.velocity, samples=_SAMPLES)
    ending = "" if arguments.e is None else f", e = {arguments.e:g}"
    label = f"{arguments.law}{ending}, {arguments.velocity:g} m/s"
    return render(
        lambda figure: draw(path, hit, ax=figure.subplots(1, 3), label=label), (10.0, 3.4), file
    )
