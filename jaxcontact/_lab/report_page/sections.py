"""The sections of the page, in reading order."""

from __future__ import annotations

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
from ..recordings import LAYOUTS
from .html import Html, definitions, element, joined, paragraphs, section, table

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
