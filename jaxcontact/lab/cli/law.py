"""The options of a law, a contact, air and a table of numbers, and checks of their values."""

from __future__ import annotations

import argparse
import itertools
from typing import TYPE_CHECKING, Any

from .options import InputError

if TYPE_CHECKING:
    from ... import Contact, Drag

TABLE = """
--columns NAME=COLUMN,... | | columns by number or heading: speed=2,e=5; a unit may follow the name:
    'speed [mm/s]=2'
--decimal | choice . , | decimal mark, if the file is ambiguous
--sheet NAME | | sheet of a spreadsheet, by name or number from 1
"""

AIR = """
--radius M | positive | radius of the ball in m
--drag-coefficient CD | positive | 0.4 to 0.5 for a sphere
--air-density KG/M3 | positive | in kg/m³ (default: 1.204)
"""
GRAVITY = "--gravity M/S2 | positive | gravity in m/s² (default: 9.81)\n"
IN_AIR = "# air drag: quadratic drag; corrected in the flights if all three are given\n"


def law_options(*, required: bool = True, velocity: bool = True) -> str:
    """Return the options of a law, a contact and, if asked for, a closing speed."""
    must = ", required" if required else ""
    speed = f"--velocity V | positive{must} | closing speed in m/s\n" if velocity else ""
    return f"""
--law NAME | {must} | name of the law; see `jaxcontact laws`
--e E | number | parameter e of the law
--param NAME=NUMBER ... | number | another parameter of the law, in SI units (such as c=1e6); may be
    repeated
--mass KG | positive{must} | effective mass in kg
--stiffness K | positive{must} | K of K δⁿ, in N/mⁿ
{speed}--exponent N | positive | n of K δⁿ (default: the law's own, or 1.5)
"""


def law_parameters(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the law's parameters, from `--e` and `--param`; raise InputError unless complete."""
    from ... import list_laws
    from ...extend import describe, did_you_mean

    if arguments.law not in list_laws():
        raise InputError(
            f"--law: {arguments.law!r} is not a law; the laws are {', '.join(list_laws())}."
            f"{did_you_mean(arguments.law, list_laws())}"
        )
    parameters = dict(arguments.param)
    if len(parameters) < len(arguments.param):
        raise InputError("--param: a parameter is given twice")
    if arguments.e is not None:
        if "e" in parameters:
            raise InputError("--param: e is already given by --e")
        parameters["e"] = arguments.e
    wanted = describe(arguments.law).parameters
    for name in itertools.filterfalse(wanted.__contains__, parameters):
        raise InputError(
            f"{arguments.law} has no parameter {name}; its parameters: "
            f"{', '.join(wanted) or 'none'}.{did_you_mean(name, wanted)}"
        )
    missing = [*itertools.filterfalse(parameters.__contains__, wanted)]
    if missing:
        how = ", ".join("--e E" if name == "e" else f"--param {name}=NUMBER" for name in missing)
        raise InputError(f"{arguments.law} also needs {how}")
    return parameters


def contact_asked(arguments: argparse.Namespace, exponent: float) -> Contact:
    """Return the contact of `--mass` and `--stiffness`; raise InputError if one is missing."""
    from ... import Contact

    missing = [f"--{name}" for name in ("mass", "stiffness") if getattr(arguments, name) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise InputError(f"{' and '.join(missing)} {verb} needed")
    return Contact(arguments.mass, arguments.stiffness, exponent)


def exponent_asked(arguments: argparse.Namespace) -> float:
    """Return `--exponent`, or the law's own; raise InputError if the law does not support it."""
    from ...extend import describe

    exponents = describe(arguments.law).cls.exponents
    exponent = arguments.exponent or (exponents[0] if exponents else 1.5)
    if exponents is not None and exponent not in exponents:
        raise InputError(
            f"--exponent: {arguments.law} is made for {', '.join(map(str, exponents))}, "
            f"but got {exponent:g}"
        )
    return exponent


def drag_asked(arguments: argparse.Namespace) -> Drag | None:
    """Return the drag if mass, radius and coefficient are given, otherwise None.

    Raises InputError for a coefficient or a density of air without the others.
    """
    from ... import Drag

    missing, air = _missing(arguments), (arguments.drag_coefficient, arguments.air_density)
    if not missing:
        return Drag(arguments.mass, arguments.radius, air[0], air[1] or Drag.air_density)
    names = ("--drag-coefficient", "--air-density")
    useless = [name for name, value in zip(names, air, strict=True) if value is not None]
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
    names = ("mass", "radius", "drag_coefficient")
    given = vars(arguments)
    return [f"--{name.replace('_', '-')}" for name in names if given[name] is None]
