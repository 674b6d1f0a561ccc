"""The sections of the page, in reading order; the figures, small enough to read on a phone; and the
settings for each simulator, or why it cannot take the law.
"""

from __future__ import annotations

import base64
import html
import pathlib
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import Export, export
from ...engines import engines
from ...extend import quantity
from ..calibration.calibrate import Calibration
from ..calibration.full_report import (
    data_words,
    equivalents_sentence,
    errors_sentence,
    impact_rows,
    line_sentence,
    marked_rows,
    marking_rule,
    noise_note,
    none_marked_sentence,
    open_questions,
    side_by_side_rows,
    speed_rows,
)
from ..calibration.short_report import bounce_rows, cautions, headlines, law_in_python, law_sentence
from ..calibration.summary import CalibrationSummary
from ..recordings import LAYOUTS, tracks_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ADEQUATE = {True: "yes", False: "no", None: "undecided"}


def verdict(s: CalibrationSummary) -> Html:
    """Return the verdict section, with the same content as `print`."""
    first, *rest = headlines(s)
    ask = s.choice.next_measurement
    return element(
        "section",
        element("h2", first),
        paragraphs(*rest),
        table(*bounce_rows(s)),
        paragraphs(law_sentence(s), *cautions(s), f"in Python: {law_in_python(s)}"),
        paragraphs(f"next: {ask}") if ask else Html(""),
        class_=f"verdict {_mood(s)}",
    )


def _mood(s: CalibrationSummary) -> str:
    """Return whether the verdict is good, open or bad."""
    law = s.chosen
    if law is None or law.adequate is False:
        return "bad"
    return "good" if s.choice.sure and s.choice.best == law.kind else "open"


def parameters(s: CalibrationSummary) -> Html:
    """Return the parameters of every law, with standard errors and units."""
    rows: list[tuple[str, ...]] = []
    for law in s.choice.laws:
        rows.append((law.kind,))
        rows += [(estimate.name, str(estimate)) for estimate in law.estimates]
    layout = LAYOUTS[s.recording.layout]
    bad = [law.kind for law in s.choice.laws if not law.converged]
    return section(
        "Parameters",
        table(("parameter", "value ± standard error"), rows),
        paragraphs(
            f"standard errors {errors_sentence(s, layout)}",
            f"not converged, do not use: {', '.join(bad)}" if bad else "",
        ),
    )


def impacts(s: CalibrationSummary) -> Html:
    """Return the table of the single impacts in a record."""
    if not s.impacts:
        return Html("")
    return section(
        "Impacts one by one",
        table(*impact_rows(s), left=0),
        paragraphs("± standard error; K is that of F = K δ^n (1 + α δ'/v0)"),
    )


def compared(s: CalibrationSummary) -> Html:
    """Return the comparison of the laws."""
    best = min(candidate.aicc for candidate in s.choice.candidates)
    by_kind = {law.kind: law for law in s.choice.laws}
    rows = [
        (
            one.name,
            _ADEQUATE[one.adequate],
            str(one.k),
            f"{one.aicc - best:.1f}",
            "-" if one.held_out is None else f"{one.held_out:.3f}",
            f"{by_kind[one.name].rms:.4f}",
            f"{by_kind[one.name].reduced_chi2:.2f}",
        )
        for one in s.choice.candidates
    ]
    head = ("law", "describes the data", "k", "ΔAICc", "held out", "rms of e", "χ²/dof")
    grounds = [(law.kind, law.grounds) for law in s.choice.laws if law.converged]
    return section(
        "The laws compared",
        table(head, rows, left=2),
        paragraphs(
            "lower is better; k counts parameters; held out is the root mean square of residual "
            "over noise at speeds left out",
            noise_note(s),
            s.choice.verdict,
            s.choice.yardstick,
            line_sentence(s.choice),
        ),
        element("h3", "Tests of the laws"),
        definitions(grounds),
        element("h3", "e by speed") if s.by_speed else Html(""),
        table(*speed_rows(s)),
        element("h3", "Parameter e of laws with constant e"),
        paragraphs(equivalents_sentence(s.choice)),
        *(
            ()
            if s.impacts
            else (element("h3", "Not determined by e(v) alone"), paragraphs(*open_questions(s)))
        ),
    )


def treatment(s: CalibrationSummary) -> Html:
    """Return how the data were read, converted and marked."""
    words = [*data_words(s, LAYOUTS[s.recording.layout]), ("Gravity", f"{s.gravity:g} m/s²")]
    header, rows = marked_rows(s)
    if rows:
        marked = f"{len(rows)} of {len(s.pairs)} pairs are {marking_rule(s)} and were left out"
    else:
        marked = none_marked_sentence(s)
    both = table(*side_by_side_rows(s), left=1) if rows else Html("")
    return section(
        "Data processing",
        definitions(_merge([*words, ("Marked", marked)])),
        table(header, rows, left=1),
        element("h3", "With and without the marked pairs") if rows else Html(""),
        both,
    )


def _merge(words: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Append sentences without a heading to the one before."""
    found: list[tuple[str, str]] = []
    for head, said in words:
        if head or not found:
            found.append((head, said))
        else:
            found[-1] = (found[-1][0], f"{found[-1][1]}; {said}")
    return found


def footer(s: CalibrationSummary) -> Html:
    """Return the versions of the packages used."""
    versions = ", ".join(f"{name} {number}" for name, number in s.versions.items() if number)
    return element("footer", joined([paragraphs(f"made with {versions}")]))


_WIDTH, _HEIGHT = 4.4, 3.9
"""In inches: the width of a phone, so that text is shown at its own size."""

_SVG = pathlib.Path("picture.svg")


def pictures(calibration: Calibration) -> Html:
    """Return the curves with bands, the choice among laws, and the residuals of the best law."""
    from ...plot import calibration as curves
    from ...plot import choice, residuals

    parts = [
        picture(
            _one(lambda ax: curves(calibration, ax=ax)),
            "Measured e over the approach speed, and each law ± 2 standard errors",
        ),
        picture(
            _one(lambda ax: choice(calibration.choice, ax=ax)),
            "The laws by AICc, the best one thickest; the broad grey line is a free curve",
        ),
    ]
    if calibration.impacts:
        from ...plot import record

        parts.append(
            picture(
                _drawn(lambda f: record(calibration, ax=f.subplots(2)), 2 * _HEIGHT),
                "The record, its impacts and their fits",
            )
        )
    if tracks_of(one for pair in calibration.recorded_pairs.records for one in pair):
        from ...plot import track

        parts.append(
            picture(
                _one(lambda ax: track(calibration, ax=ax)),
                "The track, with the parabolas between impacts",
            )
        )
    best = calibration.choice.best
    if best is not None:
        fit = calibration.choice.fits[best]
        parts.append(
            picture(
                _drawn(lambda f: residuals(fit, ax=f.subplots(3)), 2 * _HEIGHT),
                f"Residuals of {best}: over the speed, in order, and against normal noise",
            )
        )
    return element("div", *parts, class_="pictures")


def _one(draw: Callable[[Any], object]) -> bytes:
    return _drawn(lambda figure: draw(figure.add_subplot()), _HEIGHT)


def _drawn(draw: Callable[[Figure], object], height: float) -> bytes:
    from ...extend import render

    return render(draw, (_WIDTH, height), _SVG)


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
            "a simulator also needs the mass and the stiffness of the contact, which e(v) does "
            f"not determine: give {words} (in Python {' and '.join(missing)} of calibrate); this "
            f"section then lists the settings for {', '.join(engines())}, and e(v) does not change"
        )
    parts, refused = [], []
    for engine in engines():
        tell(f"inverting the law of {engine}")
        try:
            parts.append(_engine(_exported(s, engine, radius)))
        except ValueError as error:
            refused.append((engine, _reason(str(error))))
    return joined(
        [
            paragraphs(
                "for each simulator, the parameters with the least maximum error of e over the "
                "measured speeds"
            ),
            *parts,
            element("h3", "Not possible") if refused else "",
            table(("simulator", "why"), refused, left=2),
        ]
    )


def _exported(s: CalibrationSummary, engine: str, radius: float | None) -> Export:
    """Return the export, with the radius for the engines that take one."""
    if radius is not None:
        try:
            return export(s, engine=engine, radius=radius)
        except ValueError as error:
            if "Argument `radius`" not in str(error):
                raise
    return export(s, engine=engine)


def _reason(message: str) -> str:
    if "`radius` is needed" in message:
        return "needs the radius of the ball: give --radius (in Python radius of report)"
    return message


def _engine(found: Export) -> Html:
    speeds, error = np.atleast_1d(found.velocity), np.atleast_1d(found.error)
    rows: list[Any] = [
        (name, f"{value:.6g} {found.units[name]}".rstrip())
        for name, value in found.parameters.items()
    ]
    largest = float(np.max(np.abs(error)))
    range_of = f"{speeds.min():.3g} to {speeds.max():.3g} m/s"
    off = "below 0.0001" if largest < _EXACT else f"{largest:.4f}"
    rows.append((f"largest error of e, {range_of}", off))
    rows.append(("duration of contact", quantity("duration", f"{found.duration:.3g}")))
    if found.time_step is not None and found.expected_error is not None:
        words = f"time step, for e within {found.expected_error:.1%}"
        rows.append((words, f"{found.time_step:.2g} s"))
    else:
        rows.append(("time step", "not known"))
    return element(
        "article",
        element("h3", found.engine),
        element("p", found.model),
        element("pre", found.snippet),
        table(("", ""), rows),
        paragraphs(found.limit),
    )


class Html(str):
    """A text that is already HTML; any other text is escaped when inserted."""

    __slots__ = ()


def text(content: str) -> Html:
    """Return the HTML of a text."""
    return content if isinstance(content, Html) else Html(html.escape(content))


def joined(parts: Iterable[str]) -> Html:
    """Join parts, each on its own line."""
    return Html("\n".join(text(part) for part in parts if part))


def element(name: str, *content: str, **attributes: str) -> Html:
    """Return an element with its content; `class_` is the attribute `class`."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for key, value in attributes.items()
    )
    inside = "".join(text(part) for part in content)
    return Html(f"<{name}{given}>{inside}</{name}>")


def section(title: str, *content: str) -> Html:
    """Return a section with a heading; empty without content."""
    return element("section", element("h2", title), *content) if any(content) else Html("")


def paragraphs(*sentences: str) -> Html:
    """Return a paragraph for each sentence, with a capital and a full stop."""
    return joined(element("p", _sentence(one)) for one in sentences if one)


def _sentence(words: str) -> str:
    if isinstance(words, Html):
        return words
    end = "" if words.rstrip().endswith((".", ":", "?")) else "."
    first = words.split(maxsplit=1)[0]
    # A symbol or a name, such as e or interval_s, keeps its case.
    plain = len(first) > 1 and first.rstrip(",;:").isalpha()
    return (words[0].upper() + words[1:] if plain else words) + end


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> Html:
    """Return a table that scrolls sideways if it is too wide; empty without rows.

    The first `left` columns are words, the others numbers. A row of one cell is a heading.
    """
    if not rows:
        return Html("")

    def cells(row: Sequence[str], name: str) -> Html:
        if len(row) == 1:
            return element("tr", element("th", row[0], colspan=str(len(header)), scope="rowgroup"))
        marks = [{} if k < left else {"class_": "number"} for k in range(len(row))]
        both = zip(row, marks, strict=True)
        return element("tr", *(element(name, cell, **mark) for cell, mark in both))

    head = element("thead", cells(header, "th")) if any(header) else Html("")
    body = element("tbody", *(cells(row, "td") for row in rows))
    return element("div", element("table", head, body), class_="wide")


def definitions(rows: Iterable[tuple[str, str]]) -> Html:
    """Return a definition list of terms and sentences."""
    parts = (part for a, b in rows for part in (element("dt", a), element("dd", _sentence(b))))
    return element("dl", *parts)


def picture(svg: bytes, words: str) -> Html:
    """Return a picture embedded in the page, with its caption."""
    source = "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
    image = Html(f'<img src="{source}" alt="{html.escape(words)}">')
    return element("figure", image, element("figcaption", words))
