"""A calibration as a file whose extension selects the format."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Callable

from ..._entry import POSITIVE, rendered, require_kind, require_number, require_path
from ..._text.files import write_all
from ..._text.progress import stages_of
from ..calibration.calibrate import Calibration
from .page import page_of

SUFFIXES = (".html", ".md", ".txt", ".json")
"""Formats of a report."""

PDF = (
    "write it as .html, open that in a browser and print to PDF (Ctrl+P), or run `chromium "
    "--headless --no-pdf-header-footer --print-to-pdf={0}.pdf {0}.html`"
)
"""Advice on converting a page to PDF."""


def report(
    calibration: Calibration,
    file: str | os.PathLike[str],
    *,
    radius: float | None = None,
    progress: bool | Callable[[str], None] | None = None,
) -> None:
    """Write a calibration report to one file; its extension selects the format.

    `.html` is a page to read, print (on A4, or to PDF from the browser) and send, without scripts
    or external content. It contains: verdict, plots, parameters with standard errors, settings for
    each simulator, the comparison of laws, and the processing of the data. `.txt` is
    `calibration.report()`, `.md` the same as Markdown, and `.json` what `calibration.save` writes.

    Arguments: `calibration`, the result of `calibrate`. `file` is written completely or not at all.
    `radius` of the ball in m, by default that of the drag, for simulators that need it. `progress`
    as in `calibrate`.

    The settings for simulators need mass and stiffness in the calibration; the page says so if they
    are missing. Raises ValueError for another extension and arguments out of range, OSError if
    writing fails.
    """
    require_kind("calibration", calibration, Calibration, "a `Calibration` (see `calibrate`)")
    path = require_path("file", file)
    if path.suffix.lower() == ".pdf":
        raise ValueError(f"Argument `file` must not end in .pdf: {PDF.format(path.stem)}.")
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"Argument `file` must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, but is "
            f"{rendered(file)}."
        )
    if radius is not None:
        radius = require_number("radius", radius, POSITIVE)
    write_all({path: content_of(calibration, path, radius, stages_of(progress))})


def content_of(
    calibration: Calibration,
    file: pathlib.Path,
    radius: float | None,
    tell: Callable[[str], None],
    picture: str = "",
) -> bytes:
    """Return the content of a report with this name; Markdown links the `picture` beside it."""
    kind = file.suffix.lower()
    if kind == ".json":
        return calibration.to_json().encode()
    if kind == ".txt":
        return calibration.report().encode()
    if kind == ".md":
        shown = f"![e over the approach speed]({picture})\n\n" if picture else ""
        head, _, rest = calibration.report().partition("\n\n")
        title = " ".join(head.split())
        return f"# {title}\n\n```text\n{rest.rstrip()}\n```\n\n{shown}".rstrip().encode() + b"\n"
    drag = calibration.drag
    if radius is None and drag is not None:
        radius = float(drag.radius)
    return page_of(calibration, radius, tell).encode()
