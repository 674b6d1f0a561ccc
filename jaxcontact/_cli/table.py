"""Options of commands that read a table, and its errors in terms of options."""

from __future__ import annotations

import argparse
import re
from typing import Any


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
