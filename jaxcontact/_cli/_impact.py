"""`jaxcontact impact`: one impact in numbers, and as a figure."""

from __future__ import annotations

import argparse
import io
import json
import math
from typing import TYPE_CHECKING, Any

from ._files import FIGURES, output_path, write_all
from ._law import exponent_asked, parameters_asked
from ._options import InputError, assignment, number, positive
from ._progress import Progress

if TYPE_CHECKING:
    from .._contact import Contact
    from .._impact import Impact
    from .._laws import AbstractLaw

UNITS = {
    "restitution": "",
    "rebound_velocity": "m/s",
    "duration": "s",
    "compression_time": "s",
    "max_indentation": "m",
    "max_force": "N",
    "energy_loss": "J",
}

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
    parser = commands.add_parser(
        "impact",
        help="one impact in numbers, and as a figure",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--law", metavar="NAME", required=True, help="name of the law; see `jaxcontact laws`"
    )
    parser.add_argument("--e", metavar="E", type=number, help="restitution the law is asked for")
    parser.add_argument(
        "--param",
        metavar="NAME=NUMBER",
        type=assignment,
        action="append",
        default=[],
        help="another parameter of the law, in SI units (c=1e6, say); may be repeated",
    )
    parser.add_argument(
        "--mass", metavar="KG", type=positive, required=True, help="effective mass in kg"
    )
    parser.add_argument(
        "--stiffness", metavar="K", type=positive, required=True, help="K of K δⁿ, in N/mⁿ"
    )
    parser.add_argument(
        "--exponent",
        metavar="N",
        type=positive,
        help="n of K δⁿ (default: the law's own, 1.5 where it has none)",
    )
    parser.add_argument(
        "--velocity", metavar="V", type=positive, required=True, help="closing speed in m/s"
    )
    parser.add_argument("--json", action="store_true", help="as JSON instead of text")
    parser.add_argument(
        "--plot",
        metavar="FILE",
        help="draw force against indentation and time; .png, .pdf or .svg",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Solve the impact asked for and print it. Raises InputError, OSError."""
    progress = Progress(quiet=arguments.quiet)
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
    return {name: float(getattr(hit, name)) for name in UNITS}


def _text(arguments: argparse.Namespace, hit: Impact, status: Any) -> str:
    lines = [f"{arguments.law} at {arguments.velocity:g} m/s (method {hit.method})"]
    if arguments.e is not None:
        lines.append(f"  {'asked for e':<18}{arguments.e:.9g}")
    for name, value in _numbers(hit).items():
        lines.append(f"  {name.replace('_', ' '):<18}{value:.9g} {UNITS[name]}".rstrip())
    lines.append(f"  {'status':<18}{status.name.lower().replace('_', ' ')}")
    return "\n".join(lines)


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
            "mass": "kg",
            "stiffness": "N/m^n",
            "velocity": "m/s",
            **{name: unit for name, unit in UNITS.items() if unit},
        },
    }


def _figure(
    law: AbstractLaw, contact: Contact, arguments: argparse.Namespace, suffix: str
) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from .._impact import trajectory
    from ..plot import trajectory as draw

    path = trajectory(law, contact, arguments.velocity, samples=_SAMPLES)
    # Its own canvas: no display is needed, and the user's choice of backend is left alone.
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    loop, course = figure.subplots(1, 2)
    draw(path, x="indentation", y="force", ax=loop)
    draw(path, x="time", y="force", ax=course)
    for ax in (loop, course):
        # Milliseconds in seconds would write their zeros into each other.
        ax.ticklabel_format(style="sci", scilimits=(-2, 4), useMathText=True)
    asked = "" if arguments.e is None else f", e = {arguments.e:g}"
    figure.suptitle(f"{arguments.law}{asked}, {arguments.velocity:g} m/s", fontsize="medium")
    stream = io.BytesIO()
    figure.savefig(stream, format=suffix, dpi=200)
    return stream.getvalue()
