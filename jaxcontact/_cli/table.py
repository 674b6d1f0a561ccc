"""Options of commands that read a table, and its errors in terms of options."""

from __future__ import annotations

import argparse
import re


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


def in_options(text: str) -> str:
    """Return the error of a reader, with options in place of arguments."""
    text = re.sub(r'`(columns|decimal)="([^"]*)"`', r'--\1 "\2"', text)
    text = re.sub(r"Argument `(columns|decimal|layout|ball|rate)`", r"--\1", text)
    return text.replace("`rate`", "--rate").replace("`ball=`", "--ball")
