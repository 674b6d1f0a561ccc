"""A law and a contact on the command line: the options, and checks of their values."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .options import InputError, assignment, positive

if TYPE_CHECKING:
    from ... import Contact


def add_law_and_contact(
    parser: argparse.ArgumentParser,
    *,
    number: Callable[[str], Any],
    size: Callable[[str], Any],
    form: tuple[str, str],
    defaults: dict[str, float] | None = None,
    needed: bool = True,
    velocity: bool = True,
) -> None:
    """Add the options of a law, a contact and a closing speed.

    `number` reads a parameter of the law, and `size` a number of the contact. `form` holds the
    VALUE that help shows for NAME=VALUE, and an example. Without `defaults` the contact numbers are
    required, and a law always is, unless not `needed`. `velocity`: whether there is a closing
    speed.
    """
    value, example = form
    parser.add_argument(
        "--law", metavar="NAME", required=needed, help="name of the law; see `jaxcontact laws`"
    )
    parser.add_argument("--e", metavar="E", type=number, help="parameter e of the law")
    parser.add_argument(
        "--param",
        metavar=f"NAME={value}",
        type=functools.partial(assignment, read=number, form=value),
        action="append",
        default=[],
        help=f"another parameter of the law, in SI units (such as {example}); may be repeated",
    )
    for name, metavar, words in (
        ("mass", "KG", "effective mass in kg"),
        ("stiffness", "K", "K of K δⁿ, in N/mⁿ"),
        ("velocity", "V", "closing speed in m/s"),
    ):
        if name == "velocity" and not velocity:
            continue
        default = f" (default: {defaults[name]:g})" if defaults else ""
        must = needed and not defaults
        parser.add_argument(
            f"--{name}", metavar=metavar, type=size, required=must, help=words + default
        )
    parser.add_argument(
        "--exponent", metavar="N", type=positive, help="n of K δⁿ (default: the law's own, or 1.5)"
    )


def law_parameters(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the law's parameters, from `--e` and `--param`; raise InputError unless complete."""
    from ... import list_laws
    from ...extend import did_you_mean, parameters_of

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
    wanted = parameters_of(arguments.law)
    for name in parameters:
        if name not in wanted:
            takes = ", ".join(wanted) or "none"
            raise InputError(
                f"{arguments.law} has no parameter {name}; its parameters: {takes}."
                f"{did_you_mean(name, wanted)}"
            )
    missing = [name for name in wanted if name not in parameters]
    if missing:
        how = ", ".join("--e E" if name == "e" else f"--param {name}=NUMBER" for name in missing)
        raise InputError(f"{arguments.law} also needs {how}")
    return parameters


def contact_asked(arguments: argparse.Namespace, exponent: float) -> Contact:
    """Return the contact of `--mass` and `--stiffness`; raise InputError if one is missing."""
    from ... import Contact

    missing = [name for name in ("mass", "stiffness") if getattr(arguments, name) is None]
    if missing:
        options = " and ".join(f"--{name}" for name in missing)
        raise InputError(f"{options} is needed" if len(missing) == 1 else f"{options} are needed")
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
