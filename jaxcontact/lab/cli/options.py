"""Options of several commands, checked on entry; results as JSON, and output files."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import pathlib
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ...extend import is_special

if TYPE_CHECKING:
    import numpy as np

    from ... import Drag


class InputError(ValueError):
    """Invalid input of the user; the message is shown to the user."""


@contextlib.contextmanager
def input_errors(said: Callable[[str], str] = str) -> Iterator[None]:
    """Make each ValueError of a block one of the input, with its text as `said` here."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(said(str(error))) from error


def positive(text: str) -> float:
    """Return a positive, finite number; for argparse, whose message then names the option."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"must be positive, but is {text}")
    return value


def number(text: str) -> float:
    """Return a finite number; for argparse."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def assignment(text: str, read: Callable[[str], Any], form: str) -> tuple[str, Any]:
    """Parse `NAME=VALUE`, with the value by `read`; for argparse. `form` is VALUE in the help."""
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME={form}")
    return name, read(value)


def span(text: str) -> float | np.ndarray:
    """Return a number, or the numbers of FROM:TO:COUNT or FROM:TO:COUNT:log; for argparse."""
    import numpy as np

    parts = text.split(":")
    if len(parts) == 1:
        return number(text)
    if len(parts) not in (3, 4) or (len(parts) == 4 and parts[3] != "log"):
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a number nor of the form FROM:TO:COUNT or FROM:TO:COUNT:log"
        )
    low, high = number(parts[0]), number(parts[1])
    if not parts[2].isdecimal() or int(parts[2]) < 1:
        raise argparse.ArgumentTypeError(f"{parts[2]!r} in {text!r} is not a count")
    if len(parts) == 3:
        return np.linspace(low, high, int(parts[2]))
    if low <= 0 or high <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be positive to be spaced by a factor")
    return np.geomspace(low, high, int(parts[2]))


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Add `--columns`, `--decimal` and `--sheet`."""
    parser.add_argument(
        "--columns",
        metavar="NAME=COLUMN,...",
        help="columns by number or heading: speed=2,e=5; a unit may follow the name: "
        "'speed [mm/s]=2'",
    )
    parser.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, if the file is ambiguous"
    )
    parser.add_argument(
        "--sheet", metavar="NAME", help="sheet of a spreadsheet, by name or number from 1"
    )


def table_asked(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of a reader for these options."""
    return {name: getattr(arguments, name) for name in ("columns", "decimal", "sheet")}


def in_options(text: str) -> str:
    """Return the error of a reader, with options in place of arguments."""
    text = re.sub(r'`(columns|decimal)="([^"]*)"`', r'--\1 "\2"', text)
    text = re.sub(r"Argument `(columns|decimal|layout|ball|rate|sheet)`", r"--\1", text)
    return re.sub(r"`(rate|ball|sheet)=?`", r"--\1", text)


def add_air_options(parser: argparse.ArgumentParser, *, mass: str | None = None) -> None:
    """Add `--gravity` and the drag options; `--mass` with these words, if it is not yet defined."""
    air = parser.add_argument_group(
        "air drag", "quadratic drag; corrected in the flights if all three are given"
    )
    parser.add_argument(
        "--gravity", metavar="M/S2", type=positive, help="gravity in m/s² (default: 9.81)"
    )
    if mass is not None:
        air.add_argument("--mass", metavar="KG", type=positive, help=mass)
    for name, metavar, words in (
        ("--radius", "M", "radius of the ball in m"),
        ("--drag-coefficient", "CD", "0.4 to 0.5 for a sphere"),
        ("--air-density", "KG/M3", "in kg/m³ (default: 1.204)"),
    ):
        air.add_argument(name, metavar=metavar, type=positive, help=words)


def gravity_asked(arguments: argparse.Namespace) -> float:
    from ...extend import STANDARD_GRAVITY

    return STANDARD_GRAVITY if arguments.gravity is None else arguments.gravity


def drag_asked(arguments: argparse.Namespace) -> Drag | None:
    """Return the drag if mass, radius and coefficient are given, otherwise None.

    Raises InputError for a coefficient or a density of air without the others.
    """
    from ... import Drag
    from ...extend import AIR_DENSITY

    missing = _missing(arguments)
    if not missing:
        density = AIR_DENSITY if arguments.air_density is None else arguments.air_density
        return Drag(arguments.mass, arguments.radius, arguments.drag_coefficient, density)
    own = {
        "--drag-coefficient": arguments.drag_coefficient,
        "--air-density": arguments.air_density,
    }
    useless = [name for name, value in own.items() if value is not None]
    if useless:
        raise InputError(
            f"{' and '.join(useless)} alone cannot correct for drag: "
            f"also give {' and '.join(missing)}"
        )
    return None


def drag_notes(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the note that drag is left out, if only a mass or a radius is given."""
    missing = _missing(arguments)
    if not missing or (arguments.mass is None and arguments.radius is None):
        return ()
    return (f"air drag is left out: its correction also needs {' and '.join(missing)}",)


def _missing(arguments: argparse.Namespace) -> list[str]:
    named = {
        "--mass": arguments.mass,
        "--radius": arguments.radius,
        "--drag-coefficient": arguments.drag_coefficient,
    }
    return [name for name, value in named.items() if value is None]


def print_json(result: Any) -> None:
    """Print a result of dicts, lists, texts, numbers and arrays."""
    print(json.dumps(plain(result), indent=1, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Convert arrays to lists, numbers to Python's, and non-finite ones to None."""
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    import numpy as np

    # The remaining values are arrays and numbers of NumPy and JAX.
    return plain(np.asarray(value).tolist())


def output_path(option: str, name: str, suffixes: Sequence[str]) -> pathlib.Path:
    """Return the file to write; raise InputError unless its name ends in one of `suffixes`."""
    path = pathlib.Path(name)
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise InputError(f"{option} {name}: the name must end in {allowed}")
    if is_special(path):
        kind = "folder" if path.is_dir() else "pipe or a device"
        raise InputError(f"{option} {name}: is a {kind}")
    return path
