"""`jaxcontact impact`: one impact in numbers, and as a figure."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

from .._impact._result import NUMBERS
from .._progress import Stages
from .._text_table import text_table
from .._units import meaning, quantity
from .._whole_files import write_all
from ._files import FIGURES, drawn, output_path
from ._law import exponent_asked, parameters_asked
from ._options import InputError, assignment, number, positive
from ._parser import add_command, add_law_and_contact

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .._contact import Contact
    from .._impact import Impact
    from .._laws import AbstractLaw

_SAMPLES = 400

_DESCRIPTION = """\
One free impact, from touch to separation: restitution, rebound speed, duration, compression time,
largest indentation and force, and the energy lost.
"""

_EPILOG = """\
example: jaxcontact impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2

exit codes: 0 done; 1 the impact could not be solved to accuracy; 2 bad input, nothing written.
"""


def add_parser(commands: Any) -> None:
    """Add `impact` to the subparsers of argparse."""
    summary = "one impact in numbers, and as a figure"
    parser = add_command(commands, run, "impact", summary, _DESCRIPTION, _EPILOG)
    add_law_and_contact(
        parser, number=number, size=positive, param=assignment, form=("NUMBER", "c=1e6")
    )
    parser.add_argument("--json", action="store_true", help="as JSON instead of text")
    parser.add_argument(
        "--plot",
        metavar="FILE",
        help="draw force against indentation and time; .png, .pdf or .svg",
    )


def run(arguments: argparse.Namespace) -> int:
    """Solve the impact and print it. Raises InputError, OSError."""
    progress = Stages(quiet=arguments.quiet)
    plot = output_path("--plot", arguments.plot, FIGURES) if arguments.plot else None
    progress("compiling and solving the impact")
    from .._impact import Status, impact

    law, contact = _problem(arguments)
    hit = impact(law, contact, arguments.velocity)
    status = Status(int(hit.status))
    if status == Status.INVALID_INPUT:
        raise InputError("a parameter is out of its range")
    if plot is not None:
        progress("compiling and drawing the trajectory")
        write_all({plot: _figure(law, contact, arguments, plot.suffix[1:].lower())})
    if arguments.json:
        print(json.dumps(_dict(arguments, law, contact, hit, status), indent=1, allow_nan=False))
    else:
        print(_text(arguments, hit, status))
    return 1 if status == Status.NOT_CONVERGED else 0


def _problem(arguments: argparse.Namespace) -> tuple[AbstractLaw, Contact]:
    from .._contact import Contact
    from .._laws import get_law

    given = parameters_asked(arguments)
    exponent = exponent_asked(arguments)
    try:
        return (
            get_law(arguments.law, **given),
            Contact(arguments.mass, arguments.stiffness, exponent),
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _numbers(hit: Impact) -> dict[str, float]:
    return {name: float(getattr(hit, name)) for name in NUMBERS}


def _text(arguments: argparse.Namespace, hit: Impact, status: Any) -> str:
    rows = [] if arguments.e is None else [("parameter e", f"{arguments.e:.9g}")]
    for name, value in _numbers(hit).items():
        rows.append((name.replace("_", " "), quantity(name, f"{value:.9g}")))
    rows.append(("status", status.name.lower().replace("_", " ")))
    head = f"{arguments.law} at {arguments.velocity:g} m/s (method {hit.method})"
    return "\n".join([head, *text_table(rows, indent=2)])


def _dict(
    arguments: argparse.Namespace, law: AbstractLaw, contact: Contact, hit: Impact, status: Any
) -> dict[str, Any]:
    numbers = {
        name: value if math.isfinite(value) else None for name, value in _numbers(hit).items()
    }
    parameters = dict(arguments.param)
    if arguments.e is not None:
        parameters["e"] = arguments.e
    return {
        "law": arguments.law,
        "parameters": parameters,
        "contact": {
            "mass": arguments.mass,
            "stiffness": arguments.stiffness,
            "exponent": float(contact.exponent),
        },
        "velocity": arguments.velocity,
        **numbers,
        "status": status.name,
        "method": hit.method,
        "units": {
            name: unit
            for name in ("mass", "stiffness", "velocity", *NUMBERS)
            if (unit := meaning(name)[1])
        },
    }


def _figure(law: AbstractLaw, contact: Contact, arguments: argparse.Namespace, form: str) -> bytes:
    from .._impact import trajectory
    from ..plot import trajectory as draw

    path = trajectory(law, contact, arguments.velocity, samples=_SAMPLES)
    asked = "" if arguments.e is None else f", e = {arguments.e:g}"

    def fill(figure: Figure) -> None:
        loop, course = figure.subplots(1, 2)
        draw(path, x="indentation", y="force", ax=loop)
        draw(path, x="time", y="force", ax=course)
        for ax in (loop, course):
            # Milliseconds in seconds have so many zeros that the labels would overlap.
            ax.ticklabel_format(style="sci", scilimits=(-2, 4), useMathText=True)
        title = f"{arguments.law}{asked}, {arguments.velocity:g} m/s"
        figure.suptitle(title, fontsize="medium")

    return drawn(fill, (8.0, 3.6), form)
