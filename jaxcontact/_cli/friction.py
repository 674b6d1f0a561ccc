"""`jaxcontact calibrate` of a table of oblique impacts."""

from __future__ import annotations

import argparse
import pathlib

from .._text.files import write_all
from .._text.progress import Stages
from .._text.table import wrapped
from .options import InputError, input_errors
from .table import in_options, table_asked

NUMBERS = "calibration.json"

_OWN = "restitution", "tangential_ratio"
_BOUNCES = (
    *("law", "mass", "stiffness", "rate", "exponent", "report", "at", "gravity"),
    *("drag_coefficient", "air_density"),
)
"""Options that do not apply to oblique impacts."""


def is_friction(arguments: argparse.Namespace) -> bool:
    """Return whether the file holds oblique impacts; InputError for their options beside others."""
    from .._lab.oblique.rebounds import is_oblique

    if arguments.file is not None and is_oblique(arguments.file, **table_asked(arguments)):
        return True
    for name in _OWN:
        if getattr(arguments, name) is not None:
            raise InputError(
                f"--{name.replace('_', '-')} is for oblique impacts only: a table with an angle or "
                "a tangential velocity, and an outcome"
            )
    return False


def run_friction(arguments: argparse.Namespace, progress: Stages) -> int:
    """Fit friction laws; return 0, or 1 if a fit did not converge. Raises InputError, OSError."""
    from .._lab.oblique.calibrate_friction import calibrate_friction

    for name in _BOUNCES:
        if getattr(arguments, name) not in (None, "all", []):
            raise InputError(f"--{name.replace('_', '-')} does not apply to oblique impacts")
    out = pathlib.Path(arguments.out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is not a folder")
    with input_errors(_in_options):
        result = calibrate_friction(
            arguments.file,
            restitution=arguments.restitution,
            tangential_ratio=arguments.tangential_ratio,
            radius=arguments.radius,
            ball=arguments.ball,
            progress=progress,
            **table_asked(arguments),
        )
    numbers = result.to_json()
    write_all({out / NUMBERS: numbers.encode()})
    if arguments.json:
        print(numbers, end="")
    else:
        print(result)
        print("\n".join(wrapped("Written", str(out / NUMBERS))))
    return 0 if result.converged else 1


def _in_options(text: str) -> str:
    """Return an error with options in place of arguments."""
    for name in (*_OWN, "radius"):
        text = text.replace(f"Argument `{name}`", f"--{name.replace('_', '-')}")
    return in_options(text)
