"""`jaxcontact paper`: the figures and numbers of Hu & Guo (2015)."""

from __future__ import annotations

import argparse
import csv
import io
import pathlib
from typing import TYPE_CHECKING

from ....extend import Stages
from ..options import InputError, Output, fields, output_folder

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

OPTIONS = """
[FIGURE ...] | | names, such as fig6
--out DIR | = paper | where to write (default: paper)
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the published numbers beside ours, and the files of the requested figures."""
    from .... import paper
    from ....extend import did_you_mean

    names = arguments.figure or list(paper.FIGURES)
    for name in names:
        if name not in paper.FIGURES:
            raise InputError(
                f"{name!r} is not a figure; the figures are {', '.join(paper.FIGURES)}."
                f"{did_you_mean(name, paper.FIGURES)}"
            )
    folder = output_folder(arguments.out)
    files: dict[pathlib.Path, bytes] = {}
    for name in names:
        progress(f"making {name}")
        files |= _files_of(folder, name, paper.FIGURES[name]())
    progress("comparing the published numbers")
    numbers = paper.numbers()
    table = paper.markdown(numbers)
    files[folder / "numbers.md"] = table.encode()
    rows = [one.published._asdict() | fields(one, "ours difference agrees") for one in numbers]
    good = all(one.agrees or one.published.differs for one in numbers)
    return Output([table, f"{len(files)} files in {folder}"], rows, files, 0 if good else 1)


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
