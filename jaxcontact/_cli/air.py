"""Gravity and air drag on bouncing balls, as options."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from .options import InputError, positive

if TYPE_CHECKING:
    from .._flight import Drag


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
    from .._flight import STANDARD_GRAVITY

    return STANDARD_GRAVITY if arguments.gravity is None else arguments.gravity


def drag_asked(arguments: argparse.Namespace) -> Drag | None:
    """Return the drag if mass, radius and coefficient are given, otherwise None.

    Raises InputError for a coefficient or a density of air without the others.
    """
    from .._flight import AIR_DENSITY, Drag

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
