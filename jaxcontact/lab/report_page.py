"""A calibration as a file whose extension selects the format, and its page: one self-contained file
without scripts or fonts.
"""

from __future__ import annotations

import base64
import html
import os
import pathlib
import string
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import Export, export
from ..engines import engines
from ..extend import (
    POSITIVE,
    counted,
    quantity,
    refusal,
    require_kind,
    require_number,
    require_path,
    stages_of,
    write_all,
)
from .calibration import report as sections
from .calibration.calibrate import Calibration
from .calibration.report_parts import (
    Fact,
    Html,
    Listing,
    Part,
    Rows,
    element,
    joined,
    paragraphs,
)
from .calibration.summary import CalibrationSummary
from .calibration.verdict import bounces, headlines, stiffness_said, title, verdict
from .recordings import tracks_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
code { display: inline-block; max-width: 100%; }
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


def page_of(
    calibration: Calibration, radius: float | None, tell: Callable[[str], None], command: str
) -> str:
    """Return the page of a calibration, with the `command` that made it if there was one."""
    s = calibration
    by = f", by `{command}`" if command else ""
    tell("drawing")
    drawings = pictures(calibration)
    first, *rest = headlines(s)
    # The notes on reading stand in full below.
    facts = [fact.html() for fact in verdict(s) if fact.head != "Read as"]
    gravity = Fact("Gravity", f"{s.gravity:g} m/s²")
    compared = [*sections.choice(s), *sections.by_speed(s), *sections.equivalents(s)]
    treated = [*sections.data(s), gravity, *sections.marked(s), *sections.side_by_side(s)]
    versions = ", ".join(f"{name} {number}" for name, number in s.versions.items() if number)
    body = [
        element("h1", title(s)),
        element(
            "section",
            *(element("h2", first), paragraphs(*rest), bounces(s).html(), *facts),
            class_=f"verdict {_mood(s)}",
        ),
        section("Pictures", drawings),
        section("Impacts one by one", *sections.impacts(s)),
        section("Parameters", *sections.fits(s)),
        section("For your simulator", simulators(s, radius, tell)),
        section("The laws compared", *compared, *sections.open_questions(s)),
        section("Data processing", *treated),
        section("Data", _every_pair(s)),
        element("footer", paragraphs(f"made with {versions}{by}")),
    ]
    return _PAGE.substitute(title=html.escape(title(s)), body=joined(body))


def _every_pair(s: CalibrationSummary) -> Html:
    """Return all pairs, hidden until they are asked for."""
    rows = [
        (
            ", ".join(map(str, pair.rows)),
            f"{pair.velocity:.4g}",
            f"{pair.restitution:.4f}",
            "left out" if pair.marked else "",
        )
        for pair in s.pairs
    ]
    table = Rows(("rows", "v (m/s)", "e", ""), rows, "<>><").html()
    summary = element("summary", counted(len(rows), ("pair", "pairs")))
    return element("details", summary, table)


def section(title: str, *content: Html | Part) -> Html:
    """Return a section with a heading; empty without content."""
    parts = [part if isinstance(part, Html) else part.html() for part in content]
    return element("section", element("h2", title), *parts) if any(parts) else Html("")


def _mood(s: CalibrationSummary) -> str:
    """Return whether the verdict is good, open or bad."""
    law = s.chosen
    if law is None or law.adequate is False:
        return "bad"
    return "good" if s.choice.sure and s.choice.best == law.kind else "open"


_WIDTH, _HEIGHT = 4.4, 3.9
"""In inches: the width of a phone, so that text is shown at its own size."""


def pictures(calibration: Calibration) -> Html:
    """Return the curves with bands, the choice among laws, and the residuals of the best law."""
    from .. import plot
    from ..extend import render

    def picture(words: str, draw: Callable[[Any], object], rows: int = 1) -> Html:
        """Return a picture embedded in the page, with its caption; `draw` takes its axes."""

        def fill(figure: Figure) -> None:
            draw(figure.subplots(rows))

        size = _WIDTH, _HEIGHT * min(rows, 2)
        svg = base64.b64encode(render(fill, size, pathlib.Path("picture.svg"))).decode()
        source = f"data:image/svg+xml;base64,{svg}"
        image = Html(f'<img src="{source}" alt="{html.escape(words)}">')
        return element("figure", image, element("figcaption", words))

    parts = [
        picture(
            "Measured e over the closing speed, and the law ± 2 standard errors",
            lambda ax: plot.calibration(calibration, ax=ax),
        ),
        picture(
            "The laws, the best one thickest; the broad grey line is a free curve",
            lambda ax: plot.choice(calibration.choice, show="all", ax=ax),
        ),
    ]
    if calibration.impacts:
        words = "The record, its impacts and their fits"
        parts.append(picture(words, lambda ax: plot.record(calibration, ax=ax), 2))
    if tracks_of(one for pair in calibration.recorded_pairs.records for one in pair):
        words = "The track, with the parabolas between impacts"
        parts.append(picture(words, lambda ax: plot.track(calibration, ax=ax)))
    best = calibration.choice.best
    if best is not None:
        words = f"Residuals of {best}: over the speed, in order, and against normal noise"
        fit = calibration.choice.fits[best]
        parts.append(picture(words, lambda ax: plot.residuals(fit, ax=ax), 3))
    return element("div", *parts, class_="pictures")


_EXACT = 5e-5
"""Largest error of e that is reported as negligible."""


def simulators(s: CalibrationSummary, radius: float | None, tell: Callable[[str], None]) -> Html:
    """Return the parameters for each simulator, or why they cannot be given."""
    if s.law is None:
        return paragraphs("no fit converged: there is no law to export")
    missing = [name for name in ("mass", "stiffness") if name not in s.given]
    if missing:
        words = " and ".join(f"--{name}" for name in missing)
        return paragraphs(
            "A simulator also needs the mass and the stiffness of the contact, which e(v) does "
            f"not determine: give {words} (in Python {' and '.join(missing)} of calibrate); this "
            f"section then lists the settings for {', '.join(engines())}, and e(v) does not change"
        )
    parts, refused = [], []
    for engine in engines():
        tell(f"inverting the law of {engine}")
        try:
            parts.append(_engine(_exported(s, engine, radius), _from_the_data(s)))
        except ValueError as error:
            why = str(error)
            if "`radius` is needed" in why:
                why = "needs the radius of the ball: give --radius (in Python radius of report)"
            refused.append((engine, why))
    words = "for each simulator, the parameters with the least maximum error of e over the "
    others = Listing("Not possible", refused).html() if refused else ""
    first = paragraphs(f"{words}measured speeds", stiffness_said(s))
    return joined([first, *parts, others])


def _from_the_data(s: CalibrationSummary) -> str:
    """Return the largest error of e, over the measured speeds, that the data leave in the law."""
    halves = [one.half for one in s.at if one.measured]
    return f"± {max(halves):.2g}" if any(halves) else "not known"


def _exported(s: CalibrationSummary, engine: str, radius: float | None) -> Export:
    """Return the export, with the radius for the engines that take one."""
    if radius is not None:
        try:
            return export(s, engine=engine, radius=radius)
        except ValueError as error:
            if "Argument `radius`" not in str(error):
                raise
    return export(s, engine=engine)


def _engine(found: Export, of_data: str) -> Html:
    speeds, error = np.atleast_1d(found.velocity), np.atleast_1d(found.error)
    rows = [
        (name, f"{value:.6g} {found.units[name]}".rstrip().replace(" ", "\xa0"))
        for name, value in found.parameters.items()
    ]
    largest = float(np.max(np.abs(error)))
    range_of = f"{speeds.min():.3g} to {speeds.max():.3g} m/s"
    off = "below 0.0001" if largest < _EXACT else f"{largest:.4f}"
    step = "time step", "not known"
    if found.time_step is not None and found.expected_error is not None:
        words = f"time step, for e within {100 * found.expected_error:.1f} %"
        step = words, f"{found.time_step:.2g} s"
    rows += [
        (f"largest error of e, {range_of}", off),
        ("error of the law's e, from the data (95 %)", of_data),
        ("duration of contact", quantity("duration", f"{found.duration:.3g}")),
        step,
    ]
    return element(
        "article",
        element("h3", found.engine),
        element("p", found.model),
        element("pre", found.snippet),
        Rows((), rows).html(),
        paragraphs(found.limit),
    )


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
    each simulator, the comparison of laws, the processing of the data, and all pairs. `.txt` is
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
        raise refusal("file", f"end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}", file)
    if radius is not None:
        radius = require_number("radius", radius, POSITIVE)
    write_all({path: content_of(calibration, path, radius, stages_of(progress))})


def content_of(
    calibration: Calibration,
    file: pathlib.Path,
    radius: float | None,
    tell: Callable[[str], None],
    picture: str = "",
    command: str = "",
) -> bytes:
    """Return the content of a report with this name; Markdown links the `picture` beside it.

    A page names the `command` that made it.
    """
    kind = file.suffix.lower()
    if kind == ".json":
        return calibration.to_json().encode()
    if kind == ".txt":
        return calibration.report().encode()
    if kind == ".md":
        shown = f"![e over the closing speed]({picture})\n" if picture else ""
        text = calibration.report().partition("\n\n")[2].rstrip()
        whole = f"# {title(calibration)}\n\n```text\n{text}\n```\n\n{shown}"
        return whole.rstrip().encode() + b"\n"
    drag = calibration.drag
    if radius is None and drag is not None:
        radius = float(drag.radius)
    return page_of(calibration, radius, tell, command).encode()
