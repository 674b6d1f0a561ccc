"""What the parsers of all commands have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from ._options import positive


def add_command(
    commands: Any,
    run: Callable[[argparse.Namespace], int],
    name: str,
    summary: str,
    description: str,
    epilog: str | None = None,
) -> argparse.ArgumentParser:
    """Add a command to the subparsers of argparse, with `--quiet`; its parser, for more options."""
    parser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    parser.set_defaults(run=run)
    return parser


def add_law_and_contact(
    parser: argparse.ArgumentParser,
    *,
    number: Callable[[str], Any],
    size: Callable[[str], Any],
    param: Callable[[str], Any],
    form: tuple[str, str],
    defaults: dict[str, float] | None = None,
) -> None:
    """Add the options of a law, a contact and a closing speed.

    `number` reads the e of the law, `size` a number of the contact, `param` a NAME=VALUE; `form`
    holds what help shows as that VALUE, and an example. Without `defaults` the numbers of the
    contact are required.
    """
    value, example = form
    parser.add_argument(
        "--law", metavar="NAME", required=True, help="name of the law; see `jaxcontact laws`"
    )
    parser.add_argument("--e", metavar="E", type=number, help="parameter e of the law")
    parser.add_argument(
        "--param",
        metavar=f"NAME={value}",
        type=param,
        action="append",
        default=[],
        help=f"another parameter of the law, in SI units ({example}, say); may be repeated",
    )
    for name, metavar, words in (
        ("mass", "KG", "effective mass in kg"),
        ("stiffness", "K", "K of K δⁿ, in N/mⁿ"),
        ("velocity", "V", "closing speed in m/s"),
    ):
        default = f" (default: {defaults[name]:g})" if defaults else ""
        parser.add_argument(
            f"--{name}", metavar=metavar, type=size, required=not defaults, help=words + default
        )
    parser.add_argument(
        "--exponent",
        metavar="N",
        type=positive,
        help="n of K δⁿ (default: the law's own, 1.5 where it has none)",
    )
