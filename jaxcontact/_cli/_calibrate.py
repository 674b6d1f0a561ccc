"""`jaxcontact calibrate`: laws from a recording of bounces."""

from __future__ import annotations

import argparse
import io
import json
import pathlib
from typing import TYPE_CHECKING, Any

from ._files import write_all
from ._options import InputError, positive
from ._progress import Progress

if TYPE_CHECKING:
    from .._calibration import Calibration
    from .._flight import Drag

FIGURE = "calibration.png"
NUMBERS = "calibration.json"
REPORT = "calibration.md"

_DESCRIPTION = """\
Turns a recording of bounces into pairs (approach speed, e), finds spurious and missed triggers by
a robust rule, fits a constant e and speed-dependent laws (Kuwabara-Kono, constant damping) by
gradient, compares them, and writes calibration.png and calibration.json. Without FILE it uses the
bounce intervals of a small rubber ball that ship with the package.
"""

_EPILOG = """\
FILE is a CSV file with a header and one of these sets of columns:
  ball, drop_height_m, trial, bounce, interval_s     seconds between successive impacts; `bounce`
                                                     counts the intervals of a trial
  ball, drop_height_m, trial, rebound_height_m       a drop and the height of its first rebound
  velocity, restitution                              approach speed in m/s and e; a column `ball`
                                                     is optional
Other columns are ignored. Rows in messages are lines of the file; the header is row 1.

e from two intervals of a trial with successive bounces: e = T2/T1 at approach speed g T1/2, or with
drag by its flight times; from heights: e = sqrt(h1/h0) at sqrt(2 g h0), or with drag. A pair is
marked only for lying far off the trend of all pairs; e above 1 is no reason. Marked pairs are
listed with their rows and left out; the result with them is shown as well.

--law NAME: `kuwabara_kono` or `constant_damping` is compared with a constant e; a law with
parameter e (see `jaxcontact laws`) gives the constant e, as that law delivers it, and is compared
with both. With --law all, the default, the exact constant e is compared with both. All laws of
parameter e deliver a constant one; what each of them is to be asked for is listed.

e(v) alone fixes only A (K/m)^(2/5) of Kuwabara-Kono and only c/K of constant damping. With
--stiffness c follows, with --mass and --stiffness A does.

exit codes: 0 done; 1 a fit did not converge (everything is written); 2 bad input, nothing written.
"""


def add_parser(commands: Any) -> None:
    """Add `calibrate` to the subparsers of argparse."""
    parser = commands.add_parser(
        "calibrate",
        help="fit laws to a recording of bounces",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("file", nargs="?", metavar="FILE", help="recording (default: the shipped)")
    parser.add_argument(
        "--law", metavar="NAME", default="all", help="law to fit (default: all, of three kinds)"
    )
    parser.add_argument(
        "--ball",
        metavar="NAME",
        help="ball to use where the file holds several (default for the shipped file: blue)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        default=".",
        help=f"folder for {FIGURE} and {NUMBERS}, made if missing (default: the current one)",
    )
    parser.add_argument(
        "--gravity", metavar="M/S2", type=positive, help="gravity in m/s² (default: 9.81)"
    )
    air = parser.add_argument_group(
        "drag of the air", "quadratic drag, taken out of the flights if all three are given"
    )
    air.add_argument(
        "--mass", metavar="KG", type=positive, help="mass of the ball in kg (also used for A)"
    )
    air.add_argument("--radius", metavar="M", type=positive, help="radius of the ball in m")
    air.add_argument(
        "--drag-coefficient", metavar="CD", type=positive, help="0.4 to 0.5 for a sphere"
    )
    air.add_argument(
        "--air-density", metavar="KG/M3", type=positive, help="in kg/m³ (default: 1.204)"
    )
    parser.add_argument(
        "--stiffness",
        metavar="K",
        type=positive,
        help="Hertz stiffness in N/m^(3/2); reports the c, and with --mass the A, that follow",
    )
    parser.add_argument(
        "--report", action="store_true", help=f"also write {REPORT}, a page with the figure"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate as asked; return 0, or 1 if a fit did not converge. Raises InputError, OSError."""
    progress = Progress(quiet=arguments.quiet)
    progress("reading the recording")
    from .._calibration import calibrate, choose_curves, report, to_dict
    from .._flight import STANDARD_GRAVITY
    from .._measurements import RecordingError, read_recording

    out = pathlib.Path(arguments.out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is not a folder")
    try:
        choose_curves(arguments.law)
    except ValueError as error:
        raise InputError(f"--law: {error}") from error
    drag = _drag(arguments)
    try:
        recording = read_recording(arguments.file, ball=arguments.ball)
        result = calibrate(
            recording,
            law=arguments.law,
            gravity=STANDARD_GRAVITY if arguments.gravity is None else arguments.gravity,
            drag=drag,
            mass=arguments.mass,
            stiffness=arguments.stiffness,
            progress=progress,
        )
    except RecordingError as error:
        raise InputError(str(error)) from error
    progress("drawing and writing")
    options = {key: value for key, value in vars(arguments).items() if key != "run"}
    numbers = json.dumps(to_dict(result, options), indent=1, allow_nan=False) + "\n"
    said = report(result)
    files = {out / FIGURE: _figure(result), out / NUMBERS: numbers.encode()}
    if arguments.report:
        files[out / REPORT] = _page(said).encode()
    write_all(files)
    print(said)
    print(f"Written    {', '.join(map(str, files))}")
    return 0 if result.converged else 1


def _drag(arguments: argparse.Namespace) -> Drag | None:
    from .._flight import AIR_DENSITY, Drag

    named = {
        "--mass": arguments.mass,
        "--radius": arguments.radius,
        "--drag-coefficient": arguments.drag_coefficient,
    }
    missing = [name for name, value in named.items() if value is None]
    if not missing:
        density = AIR_DENSITY if arguments.air_density is None else arguments.air_density
        return Drag(arguments.mass, arguments.radius, arguments.drag_coefficient, density)
    useless = [
        name
        for name, value in {**named, "--air-density": arguments.air_density}.items()
        if value is not None
    ]
    if arguments.mass is not None and arguments.stiffness is not None:
        useless.remove("--mass")  # wanted for A
    if useless:
        hint = " (or --stiffness, for A)" if useless == ["--mass"] else ""
        raise InputError(
            f"{' and '.join(useless)} alone cannot correct for drag: "
            f"also give {' and '.join(missing)}{hint}"
        )
    return None


def _page(said: str) -> str:
    """The report as a page of Markdown."""
    return f"# Calibration\n\n![e over the approach speed]({FIGURE})\n\n```text\n{said}\n```\n"


def _figure(result: Calibration) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..plot import calibration

    # Its own canvas: no display is needed, and the user's choice of backend is left alone.
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    calibration(result, ax=figure.add_subplot())
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=200)
    return stream.getvalue()
