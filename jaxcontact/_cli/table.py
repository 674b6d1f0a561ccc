"""Options of commands that read a table, and its errors in terms of options."""

from __future__ import annotations

import argparse
import re

from .options import InputError


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Add `--columns` and `--decimal`."""
    parser.add_argument(
        "--columns",
        metavar="NAME=COLUMN,...",
        help="columns by number or heading: speed=2,e=5; a unit may follow the name: "
        "'speed [mm/s]=2'",
    )
    parser.add_argument(
        "--decimal", choices=(".", ","), help="decimal mark, if the file is ambiguous"
    )


def input_error(error: ValueError) -> InputError:
    """Return the error of a reader, with options in place of arguments."""
    text = re.sub(r'`(columns|decimal)="([^"]*)"`', r'--\1 "\2"', str(error))
    text = re.sub(r"Argument `(columns|decimal|layout|ball|rate)`", r"--\1", text)
    text = text.replace("`rate`", "--rate")
    return InputError(text.replace("`ball=`", "--ball"))
