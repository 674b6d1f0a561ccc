"""A calibration as a file whose extension selects the format, and its page: one self-contained file
without scripts or fonts.
"""

from __future__ import annotations

import os
import pathlib
import string
from collections.abc import Callable

from ...extend import (
    POSITIVE,
    rendered,
    require_kind,
    require_number,
    require_path,
    stages_of,
    write_all,
)
from ..calibration.calibrate import Calibration
from ..calibration.short_report import title
from .sections import (
    compared,
    element,
    footer,
    impacts,
    joined,
    parameters,
    pictures,
    section,
    simulators,
    text,
    treatment,
    verdict,
)

_PAGE = string.Template("""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>$title</title>
<style>
:root { color-scheme: light; }
body { margin: 0 auto; padding: 1rem; max-width: 62rem; color: #1a1a1a; background: #fff;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.4rem; line-height: 1.25; margin: .5rem 0 1rem; }
h2 { font-size: 1.2rem; line-height: 1.3; margin: 2rem 0 .5rem; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
p { margin: .4rem 0; }
.verdict { border-left: .4rem solid #999; background: #f4f4f4; padding: .6rem 1rem; }
.verdict h2 { margin-top: 0; }
.good { border-color: #009e73; } .open { border-color: #e69f00; } .bad { border-color: #d55e00; }
.pictures { columns: 2; column-gap: 1.5rem; }
figure { margin: 0 0 1rem; break-inside: avoid; }
figure img { width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #444; }
.wide { overflow-x: auto; margin: .5rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid #ddd; overflow-wrap: normal; }
th.number, td.number { text-align: right; white-space: nowrap; }
th { font-weight: 600; }
dl { margin: .5rem 0; } dt { font-weight: 600; } dd { margin: 0 0 .5rem; }
pre { background: #f4f4f4; padding: .6rem; overflow-x: auto; font-size: .85rem;
  overflow-wrap: normal; }
footer { margin-top: 2rem; font-size: .85rem; color: #444; }
@media (max-width: 40rem) { .pictures { columns: 1; } }
@page { size: A4; margin: 15mm; }
@media print { body { max-width: none; padding: 0; font-size: 9.5pt; }
  .verdict { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  .verdict, figure, tr, pre { break-inside: avoid; } h2, h3 { break-after: avoid; }
  .pictures { columns: 2; } figure img { max-height: 22cm; object-fit: contain; }
  .wide, pre { overflow: visible; } table { font-size: 8.5pt; }
  th, td { padding-right: .5rem; overflow-wrap: anywhere; }
  th.number, td.number { white-space: normal; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; } }
</style>
</head>
<body>
$body
</body>
</html>
""")


def page_of(calibration: Calibration, radius: float | None, tell: Callable[[str], None]) -> str:
    """Return the page of a calibration."""
    s = calibration
    tell("drawing")
    drawings = pictures(calibration)
    head = title(s)
    body = joined(
        [
            element("h1", head),
            verdict(s),
            section("Pictures", drawings),
            impacts(s),
            parameters(s),
            section("For your simulator", simulators(s, radius, tell)),
            compared(s),
            treatment(s),
            footer(s),
        ]
    )
    return _PAGE.substitute(title=text(head), body=body)


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
