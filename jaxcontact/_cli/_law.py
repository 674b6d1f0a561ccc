"""The law and the exponent given on the command line, checked."""

from __future__ import annotations

import argparse
from typing import Any

from ._options import InputError


def parameters_asked(arguments: argparse.Namespace) -> dict[str, Any]:
    """The law's parameters, from `--e` and `--param`. Raises InputError unless all are there."""
    from .._laws import list_laws, parameters_of

    if arguments.law not in list_laws():
        raise InputError(
            f"--law: {arguments.law!r} is not a law; the laws are {', '.join(list_laws())}"
        )
    given = dict(arguments.param)
    if len(given) < len(arguments.param):
        raise InputError("--param: a parameter is given twice")
    if arguments.e is not None:
        if "e" in given:
            raise InputError("--param: e is given by --e already")
        given["e"] = arguments.e
    wanted = parameters_of(arguments.law)
    for name in given:
        if name not in wanted:
            takes = ", ".join(wanted) or "none"
            raise InputError(f"{arguments.law} has no parameter {name}; its parameters: {takes}")
    missing = [name for name in wanted if name not in given]
    if missing:
        how = ", ".join("--e E" if name == "e" else f"--param {name}=NUMBER" for name in missing)
        raise InputError(f"{arguments.law} also needs {how}")
    return given


def exponent_asked(arguments: argparse.Namespace) -> float:
    """`--exponent`, or the law's own. Raises InputError for one the law is not made for."""
    from .._laws import describe

    exponents = describe(arguments.law).cls.exponents
    exponent = arguments.exponent or (exponents[0] if exponents else 1.5)
    if exponents is not None and exponent not in exponents:
        raise InputError(
            f"--exponent: {arguments.law} is made for {', '.join(map(str, exponents))}, "
            f"but got {exponent:g}"
        )
    return exponent
