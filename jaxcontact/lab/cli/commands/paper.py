"""`jaxcontact paper`: the figures and numbers of Hu & Guo (2015)."""

from __future__ import annotations

import argparse
import csv
import io
import pathlib
from typing import TYPE_CHECKING

from ....extend import Stages, write_all
from ..options import InputError, print_json

if TYPE_CHECKING:
    from ....paper import Reproduction

SUMMARY = "the figures and numbers of Hu & Guo (2015), reproduced"

DESCRIPTION = """\
Regenerate the results of Hu & Guo (2015): figures (PNG), the numbers behind them (CSV), and a table
of the published numbers beside ours (numbers.md, and on stdout).
"""

EPILOG = """\
example: jaxcontact paper --out results fig6 fig10

Without names, everything: fig3 to fig6, fig8 to fig10, and `bouncing`, the ball followed to rest.

exit codes: 0 done; 1 a published number differs for no stated reason; 2 bad input, nothing written.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("figures", metavar="FIGURE", nargs="*", help="names, such as fig6")
    parser.add_argument(
        "--out", metavar="DIR", default="paper", help="where to write (default: paper)"
    )


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Make the requested figures and write them. Raises InputError, OSError."""
    from .... import paper
    from ....extend import did_you_mean

    names = arguments.figures or list(paper.FIGURES)
    for name in names:
        if name not in paper.FIGURES:
            raise InputError(
                f"{name!r} is not a figure; the figures are {', '.join(paper.FIGURES)}."
                f"{did_you_mean(name, paper.FIGURES)}"
            )
    folder = pathlib.Path(arguments.out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {arguments.out}: is a file")
    files: dict[pathlib.Path, bytes] = {}
    for name in names:
        progress(f"making {name}")
        files |= _files_of(folder, name, paper.FIGURES[name]())
    progress("comparing the published numbers")
    numbers = paper.numbers()
    table = paper.markdown(numbers)
    files[folder / "numbers.md"] = table.encode()
    write_all(files)
    if arguments.json:
        print_json(
            [
                {
                    **number.published._asdict(),
                    "ours": number.ours,
                    "difference": number.difference,
                    "agrees": number.agrees,
                }
                for number in numbers
            ]
        )
    else:
        print(table, end="")
        print(f"\n{len(files)} files in {folder}")
    return 0 if all(number.agrees or number.published.differs for number in numbers) else 1


def _files_of(folder: pathlib.Path, name: str, result: Reproduction) -> dict[pathlib.Path, bytes]:
    from ....extend import image_of

    files = {folder / f"{name}.png": image_of(result.figure, "png")}
    for title, table in result.tables.items():
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        files[folder / f"{name}_{title}.csv"] = text.getvalue().encode()
    return files
