"""The report of a calibration: its sections, and the short and the full report as text."""

from __future__ import annotations

import textwrap

from ...extend import counted
from ..choice.kind import Estimate
from ..choice.law_choice import ChoiceData, LawFit
from ..recordings import FROM_FILE, LAYOUTS
from .report_parts import Fact, Listing, Part, Row, Rows
from .summary_data import SummaryData
from .verdict import (
    bounces,
    data_sentence,
    headlines,
    judged_by,
    scatter_said,
    source,
    title,
    verdict,
)

_MORE = "--details (in Python `report()`) prints all tables; --report ball.html writes a page"


def short(s: SummaryData) -> str:
    """Return the calibration in at most 25 lines, verdict first, and where to find more."""
    return "\n".join([*_verdict_lines(s), *Fact("More", _MORE).text()])


def report(s: SummaryData) -> str:
    """Return the calibration as text, verdict first.

    Then follow data, marked pairs, fits, comparison, and what e(v) leaves open.
    """
    sections = (
        *(data(s), impacts(s), marked(s), fits(s), by_speed(s), choice(s), equivalents(s)),
        *(side_by_side(s), open_questions(s)),
    )
    texts = [[line for part in parts for line in part.text()] for parts in sections]
    return "\n\n".join("\n".join(lines) for lines in [_verdict_lines(s), *texts] if lines) + "\n"


def _verdict_lines(s: SummaryData) -> list[str]:
    lines = [*textwrap.wrap(title(s), 100, break_on_hyphens=False), ""]
    for one in headlines(s):
        lines += textwrap.wrap(one, 100, subsequent_indent="    ", break_on_hyphens=False)
    each = bounces(s).text()
    lines += ["", *each, ""] if each else [""]
    return lines + [line for fact in verdict(s) for line in fact.text()]


def data(s: SummaryData) -> list[Fact]:
    """Return the data and how they were processed."""
    layout, r = LAYOUTS[s.recording.layout], s.recording
    facts = [
        Fact("Recording", source(s)),
        Fact("Read as", "; ".join(r.notes)),
        Fact("Pairs", data_sentence(s)),
        Fact("", f"from {counted(len(r.trials), layout.cluster_words)}"),
    ]
    if r.unpaired:
        unused = counted(r.unpaired, ("reading", "readings"))
        facts.append(Fact("", f"{unused} without a successor not used"))
    facts.append(Fact("Air drag", _drag_sentence(s)))
    if s.scatter is not None:
        said = f"{scatter_said(s.scatter)} of e in a typical pair"
        if (error := layout.reading_error) is not None:
            said += (
                f": {scatter_said(s.noise.relative)} from bounce to bounce, and "
                f"{error.factor * s.noise.reading:.2g} {error.shown} in {error.of}"
            )
        origin = "fitted to the kept pairs"
        if FROM_FILE in r.notes:
            origin = "the standard deviations in the file"
        elif any(law.errors_by == "readings" for law in s.choice.laws):
            origin = layout.known_errors[0]
        facts.append(Fact("Scatter", f"{said} ({origin})"))
    return facts


def _drag_sentence(s: SummaryData) -> str:
    """Return whether and how air drag was removed from the flights."""
    if not LAYOUTS[s.recording.layout].uses_flight:
        return "no correction needed: the speeds are those at the impact"
    if s.drag is None:
        return (
            "not corrected: e includes the loss in flight, which often causes the trend of e "
            "with speed of a light ball; to correct, give --mass --radius --drag-coefficient (in "
            "Python `drag`)"
        )
    return (
        "corrected in the flights: quadratic, terminal speed "
        f"{s.drag.terminal_speed(s.gravity):.3g} m/s (mass {s.drag.mass:g} kg, radius "
        f"{s.drag.radius:g} m, coefficient {s.drag.coefficient:g}, air {s.drag.air_density:g} "
        "kg/m³; the standard errors exclude errors of these)"
    )


def impacts(s: SummaryData) -> list[Part]:
    """Return the table of the single impacts in a record."""
    if not s.impacts:
        return []
    rows = [
        (
            f"{one.number}",
            f"{one.time:.5g}",
            *(
                str(Estimate("", factor * value, factor * error, ""))
                for value, error, factor in (
                    (one.velocity, one.velocity_error, 1.0),
                    (one.restitution, one.restitution_error, 1.0),
                    (one.duration, one.duration_error, 1e3),
                    (one.max_force, one.max_force_error, 1.0),
                    (one.stiffness, one.stiffness_error, 1.0),
                )
            ),
            {True: "yes", False: "NO", None: "?"}[one.adequate],
        )
        for one in s.impacts
    ]
    header = ("", "at (s)", "v (m/s)", "e", "contact (ms)", "peak (N)", "K (N/m^n)", "described")
    force = f"K of F = K δ^n (1 + α δ'/v0), n = {float(s.contact.exponent):g}"
    title = Fact("Impacts", f"one by one, ± standard error; {force}")
    return [title, Rows(header, rows, ">>>>>>>>")]


def marking_rule(s: SummaryData) -> str:
    """Return the rule by which pairs are marked."""
    trend = judged_by(s)
    # A table may be steep and curved.
    smooth = trend == "the trend" and not LAYOUTS[s.recording.layout].uses_flight
    curve = " and from a smooth curve" if smooth else ""
    return f"more than {s.threshold:g} robust standard deviations from {trend}{curve}"


def marked(s: SummaryData) -> list[Part]:
    """Return the rule and the table of the marked pairs."""
    rows = [
        (
            ", ".join(map(str, pair.rows)),
            f"{pair.velocity:.3f}",
            f"{pair.restitution:.3f}",
            f"{pair.deviation:+.1f}",
            pair.may_be or "",
        )
        for pair in s.pairs
        if pair.marked
    ]
    verb = "is" if len(rows) == 1 else "are"
    said = f"{len(rows)} of {len(s.pairs)} pairs {verb} {marking_rule(s)}"
    if rows:
        said += ": left out of the fits (results with them: below)"
    elif s.few:
        said = "no pair: too few to identify a wrong one"
    return [
        Fact("Marked", said),
        Rows(("rows", "v (m/s)", "e", "deviation", "may be"), rows, "<>>><"),
    ]


def fits(s: SummaryData) -> list[Part]:
    """Return how the errors were computed, and each law with its parameters and tests."""
    layout = LAYOUTS[s.recording.layout]
    errors, errors_by = layout.errors_words, {law.errors_by for law in s.choice.laws}
    if "point" in errors_by:
        errors = (
            f"treat pairs as independent: fewer than 8 {layout.cluster_words[1]} do not determine "
            "their correlation"
        )
    elif "readings" in errors_by:
        errors = layout.known_errors[1]
    parts: list[Part] = [Fact("Fits", f"standard errors {errors}")]
    if FROM_FILE in s.recording.notes:
        note = (
            "the standard deviations are those in the file: a reduced chi² far above 1 means "
            "that a law does not describe the pairs or that the standard deviations are too small"
        )
    else:
        note = (
            "the scatter was fitted to the same pairs about a free trend: a reduced chi² near 1 "
            "means that a law describes them as well as that trend; it does not test the noise"
        )
    parts.append(Fact("", "" if s.few else note))
    aicc = {one.name: one.aicc for one in s.choice.candidates}
    return parts + [Listing(law.kind, _fit(law, aicc[law.kind], s.few)) for law in s.choice.laws]


def _fit(law: LawFit, aicc: float, few: bool) -> list[tuple[str, str]]:
    rows = [(one.name, str(one)) for one in law.estimates]
    chi2 = f"reduced chi² {law.reduced_chi2:.2f}"
    rows.append(("residual", f"rms of e {law.rms:.4f}; {chi2}; AICc {aicc:.1f}"))
    words = {True: "yes", False: "NO", None: "undecided"}
    if law.converged:
        rows.append(("describes them", f"{words[law.adequate]}: {law.grounds}"))
    rows.append(("converged", f"{words[law.converged]}, in {law.steps} steps: {law.reason}"))
    if law.converged and not law.identifiable and not few:
        why = "the data do not determine every parameter"
        if law.reason.endswith("at the bound"):
            why = "the best value lies at the edge of the law's range"
        rows.append(("identifiable", f"NO: {why}"))
        if law.reduced_to:
            rows.append(("", f"the fit is that of {law.reduced_to}, its special case"))
    return rows


def by_speed(s: SummaryData) -> list[Part]:
    """Return the medians by speed, with a row for each fit there."""
    if not s.by_speed:
        return []
    rows: list[Row] = [
        ("pairs", *(str(band.pairs) for band in s.by_speed)),
        ("e", *(f"{band.restitution:.4f}" for band in s.by_speed)),
    ]
    rows += [
        (law.kind, *(f"{band.fits[law.kind]:.4f}" for band in s.by_speed)) for law in s.choice.laws
    ]
    header = ("v (m/s)", *(f"{band.velocity:.3f}" for band in s.by_speed))
    title = Fact("By speed", "medians of the kept pairs, and the fits there")
    return [title, Rows(header, rows, "<" + ">" * len(s.by_speed))]


def choice(s: SummaryData) -> list[Part]:
    """Return the comparison of the laws, and its verdict."""
    least = min(one.aicc for one in s.choice.candidates)
    rows = [
        (
            one.name,
            {True: "yes", False: "no", None: "undecided"}[one.adequate],
            str(one.k),
            f"{one.aicc - least:.1f}",
            "-" if one.held_out is None else f"{one.held_out:.3f}",
        )
        for one in s.choice.candidates
    ]
    head = "lower is better; held out: root mean square of residual over noise, at speeds left out"
    verdicts = (s.choice.verdict, s.choice.yardstick, line_sentence(s.choice))
    return [
        Fact("Choice", head),
        Rows(
            ("law", "describes the data", "parameters", "ΔAICc", "held out"),
            *(rows, "<<>>>", s.choice.table().splitlines()),
        ),
        *(Fact("", said) for said in verdicts),
    ]


def equivalents(s: SummaryData) -> list[Fact]:
    """Return the e to set in each law of constant e."""
    return [Fact("Law's e", equivalents_sentence(s.choice))]


def equivalents_sentence(choice: ChoiceData) -> str:
    """Return the e to set in each law of constant e."""
    e = choice.constant.value
    able = [f"{a.law} {a.e:.4f}" for a in choice.asked if a.e is not None]
    unable = [f"{a.law} ({a.least:.3g} to {a.most:.3g})" for a in choice.asked if a.e is None]
    said = []
    if able:
        where = f"parameter e of each law that delivers a constant e of {e:.4f}"
        said.append(f"{where}: {', '.join(able)}")
    if unable:
        said.append(f"a constant e of {e:.4f} is out of range for {', '.join(unable)}")
    return "; ".join(said)


def line_sentence(choice: ChoiceData) -> str:
    """Return the slope of a straight line, for comparison with the laws."""
    line = choice.line
    if line.slope_error is None:
        if choice.count < 3:
            return "a trend with speed needs at least three pairs"
        return "there is only one speed, so a trend with speed is not identifiable"
    return f"straight line (no law): d ln e/dv = {line.slope:+.4f} ± {line.slope_error:.4f} per m/s"


def side_by_side(s: SummaryData) -> list[Part]:
    """Return the laws without and with the marked pairs."""
    if not any(pair.marked for pair in s.pairs):
        return []
    rows: list[Row] = []
    # The larger set may include laws with too many parameters for the kept pairs alone.
    kept = {one.kind: one for one in s.choice.laws}
    for every in s.with_marked.laws:
        if (law := kept.get(every.kind)) is not None:
            first = law.estimates[0]
            rows.append((f"{law.kind}: {first.name}", str(first), str(every.estimates[0])))
            chi2 = f"{law.reduced_chi2:.2f}", f"{every.reduced_chi2:.3g}"
            rows.append(("  reduced chi²", *chi2))
    bad = [law.kind for law in s.with_marked.laws if not law.converged]
    last = f"NOT converged with the marked pairs: {', '.join(bad)}" if bad else ""
    header = ("", f"without ({s.choice.count})", f"with ({s.with_marked.count})")
    title = Fact("Compared", "results without and with the marked pairs")
    return [title, Rows(header, rows), Fact("", last)]


def open_questions(s: SummaryData) -> list[Part]:
    """Return what e(v) does not determine, law by law, and what would determine it."""
    if s.impacts:  # the forces determine K, and c and A with it
        return []
    lines = [f"{law.kind}: {law.unidentified}" for law in s.choice.laws]
    if len(s.given) < 2:
        lines.append("--stiffness determines c, and with --mass also A (in Python: arguments)")
    title = Fact("Open", "what e(v) alone does not determine")
    return [title, *(Fact("", line) for line in lines)]
