"""The full report of a calibration."""

from __future__ import annotations

from typing import Any

from ...extend import AT_BOUND, counted, text_table, wrapped
from ..choice.kind import Estimate
from ..choice.law_choice import ChoiceData
from ..recordings import FROM_FILE, LAYOUTS, Layout
from .short_report import about, data_sentence, scatter_said, verdict_lines
from .summary_data import SummaryData

Row = tuple[str, ...]


def noise_note(s: SummaryData) -> str:
    """Return what a reduced chi² near 1 means; "" if the noise was not estimated from the pairs."""
    if s.few:
        return ""
    if FROM_FILE in s.recording.notes:
        return (
            "the standard deviations are those in the file: a reduced chi² far above 1 means "
            "that a law does not describe the pairs or that the standard deviations are too small"
        )
    return (
        "the scatter was fitted to the same pairs about a free trend: a reduced chi² near 1 "
        "means that a law describes them as well as that trend; it does not test the noise"
    )


def report(summary: SummaryData) -> str:
    """Return the calibration as text, verdict first.

    Then follow data, marked pairs, fits, comparison, and what e(v) leaves open.
    """
    layout = LAYOUTS[summary.recording.layout]
    parts = [
        verdict_lines(summary),
        _data(summary, layout),
        _impacts(summary),
        _marked(summary),
        _fits(summary, layout),
        _by_speed(summary),
        _choice(summary),
        wrapped("Law's e", equivalents_sentence(summary.choice)),
        _side_by_side(summary),
        _open_questions(summary),
    ]
    return "\n\n".join("\n".join(lines) for lines in parts if lines) + "\n"


def _data(s: SummaryData, layout: Layout[Any]) -> list[str]:
    words = data_words(s, layout)
    return [line for head, text in words for line in wrapped(head, text)]


def data_words(s: SummaryData, layout: Layout[Any]) -> list[tuple[str, str]]:
    """Return rows (heading, sentence) on the data and how they were processed."""
    r = s.recording
    words = [("Recording", r.source + (f", ball {r.ball}" if r.ball else ""))]
    if r.notes:
        words.append(("Read as", "; ".join(r.notes)))
    words.append(("Pairs", data_sentence(s)))
    words.append(("", f"from {counted(len(r.trials), layout.cluster_words)}"))
    if r.unpaired:
        unused = counted(r.unpaired, ("reading", "readings"))
        words.append(("", f"{unused} without a successor not used"))
    words.append(("Air drag", drag_sentence(s, layout)))
    if s.scatter is not None:
        words.append(("Scatter", _scatter(s, s.scatter, layout)))
    return words


def _scatter(s: SummaryData, scatter: float, layout: Layout[Any]) -> str:
    """Return the scatter of a usual pair and its components."""
    said = f"{scatter_said(scatter)} of e in a typical pair"
    error = layout.reading_error
    if error is not None:
        said += (
            f": {scatter_said(s.noise.relative)} from bounce to bounce, and "
            f"{error.factor * s.noise.reading:.2g} {error.shown} in {error.of}"
        )
    return f"{said} ({_scatter_of(s)})"


def _scatter_of(s: SummaryData) -> str:
    if FROM_FILE in s.recording.notes:
        return "the standard deviations in the file"
    if any(law.errors_by == "readings" for law in s.choice.laws):
        return LAYOUTS[s.recording.layout].known_errors[0]
    return "fitted to the kept pairs"


def drag_sentence(s: SummaryData, layout: Layout[Any]) -> str:
    """Return whether and how air drag was removed from the flights."""
    if not layout.uses_flight:
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


def impact_rows(s: SummaryData) -> tuple[Row, list[Row]]:
    """Return header and rows of a table of the impacts in a record."""
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
    return header, rows


def _impacts(s: SummaryData) -> list[str]:
    title = "Impacts    one by one, ± standard error; K of F = K δ^n (1 + α δ'/v0), n = "
    return _titled([f"{title}{float(s.contact.exponent):g}"], *impact_rows(s), ">>>>>>>>")


def _titled(title: list[str], header: Row, rows: list[Row], align: str = "") -> list[str]:
    """Return a table below its title; nothing without rows."""
    return [*title, *text_table(rows, header=header, align=align, indent=2)] if rows else []


def marking_rule(s: SummaryData) -> str:
    """Return the rule by which pairs are marked."""
    rule = f"more than {s.threshold:g} robust standard deviations from {about(s)}"
    # A table may be steep and curved.
    smooth = about(s) == "the trend" and not LAYOUTS[s.recording.layout].uses_flight
    return f"{rule} and from a smooth curve" if smooth else rule


def none_marked_sentence(s: SummaryData) -> str:
    """Return the sentence for a recording without marked pairs."""
    if s.few:
        return "no pair: too few to identify a wrong one"
    return f"0 of {len(s.pairs)} pairs are {marking_rule(s)}"


def marked_rows(s: SummaryData) -> tuple[Row, list[Row]]:
    """Return header and rows of a table of the marked pairs."""
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
    return ("rows", "v (m/s)", "e", "deviation", "may be"), rows


def _marked(s: SummaryData) -> list[str]:
    header, rows = marked_rows(s)
    if not rows:
        return wrapped("Marked", none_marked_sentence(s))
    verb = "is" if len(rows) == 1 else "are"
    text = f"{len(rows)} of {len(s.pairs)} pairs {verb} {marking_rule(s)}: left out of the fits"
    title = wrapped("Marked", f"{text} (results with them: below)")
    return _titled(title, header, rows, "<>>><")


def errors_sentence(s: SummaryData, layout: Layout[Any]) -> str:
    """Return how the standard errors were computed and what they account for."""
    if any(law.errors_by == "point" for law in s.choice.laws):
        return (
            f"treat pairs as independent: fewer than 8 {layout.cluster_words[1]} do not determine "
            "their correlation"
        )
    if any(law.errors_by == "readings" for law in s.choice.laws):
        return layout.known_errors[1]
    return layout.errors_words


def _fits(s: SummaryData, layout: Layout[Any]) -> list[str]:
    lines = wrapped("Fits", f"standard errors {errors_sentence(s, layout)}")
    if noise_note(s):
        lines += wrapped("", noise_note(s))
    aicc = {c.name: c.aicc for c in s.choice.candidates}
    for law in s.choice.laws:
        lines.append(f"  {law.kind}")
        lines += [f"    {e.name + ' ':<16}{e}" for e in law.estimates]
        lines.append(
            f"    {'residual':<16}rms of e {law.rms:.4f}; reduced chi² {law.reduced_chi2:.2f}; "
            f"AICc {aicc[law.kind]:.1f}"
        )
        if law.converged:
            word = {True: "yes", False: "NO", None: "undecided"}[law.adequate]
            lines += wrapped("describes them", f"{word}: {law.grounds}", indent=20, lead="    ")
        answer = "yes" if law.converged else "NO"
        lines.append(f"    {'converged':<16}{answer}, in {law.steps} steps: {law.reason}")
        if law.converged and not law.identifiable and not s.few:
            why = "the data do not determine every parameter"
            if law.reason.endswith(AT_BOUND):
                why = "the best value lies at the edge of the law's range"
            lines.append(f"    {why}: not identifiable")
            if law.reduced_to:
                lines.append(f"    the fit is that of {law.reduced_to}, its special case")
    return lines


def speed_rows(s: SummaryData) -> tuple[Row, list[Row]]:
    """Return header and rows of a table of medians by speed, with a row for each fit there."""
    if not s.by_speed:
        return (), []
    rows: list[Row] = [
        ("pairs", *(str(band.pairs) for band in s.by_speed)),
        ("e", *(f"{band.restitution:.4f}" for band in s.by_speed)),
    ]
    rows += [
        (law.kind, *(f"{band.fits[law.kind]:.4f}" for band in s.by_speed)) for law in s.choice.laws
    ]
    return ("v (m/s)", *(f"{band.velocity:.3f}" for band in s.by_speed)), rows


def _by_speed(s: SummaryData) -> list[str]:
    header, rows = speed_rows(s)
    title = ["By speed   medians of the kept pairs, and the fits there"]
    return _titled(title, header, rows, "<" + ">" * len(header))


def _choice(s: SummaryData) -> list[str]:
    lines = wrapped(
        "Choice",
        "lower is better; held out: root mean square of residual over noise, at speeds left out",
    )
    lines += ["  " + line for line in s.choice.table().splitlines()]
    for sentence in (s.choice.verdict, s.choice.yardstick, line_sentence(s.choice)):
        if sentence:
            lines += wrapped("", sentence)
    return lines


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
    return (
        f"a straight line (no law) has d ln e/dv = {line.slope:+.4f} ± {line.slope_error:.4f} "
        "per m/s"
    )


def side_by_side_rows(s: SummaryData) -> tuple[Row, list[Row]]:
    """Return header and rows of a table of the laws without and with the marked pairs."""
    rows: list[Row] = []
    # The larger set may include laws with too many parameters for the kept pairs alone.
    kept = {one.kind: one for one in s.choice.laws}
    for everything in s.with_marked.laws:
        if everything.kind not in kept:
            continue
        without = kept[everything.kind]
        first: tuple[Estimate, Estimate] = (without.estimates[0], everything.estimates[0])
        rows.append((f"{without.kind}: {first[0].name}", str(first[0]), str(first[1])))
        chi2 = (f"{without.reduced_chi2:.2f}", f"{everything.reduced_chi2:.3g}")
        rows.append(("  reduced chi²", *chi2))
    return ("", f"without ({s.choice.count})", f"with ({s.with_marked.count})"), rows


def _side_by_side(s: SummaryData) -> list[str]:
    if not any(pair.marked for pair in s.pairs):
        return []
    bad = [law.kind for law in s.with_marked.laws if not law.converged]
    last = [f"  NOT converged with the marked pairs: {', '.join(bad)}"] if bad else []
    return _titled(["With and without the marked pairs"], *side_by_side_rows(s)) + last


def open_questions(s: SummaryData) -> list[str]:
    """Return what e(v) does not determine, law by law, and what would determine it."""
    lines = [f"{law.kind}: {law.unidentified}" for law in s.choice.laws]
    if len(s.given) < 2:
        lines.append("--stiffness determines c, and with --mass also A (in Python: arguments)")
    return lines


def _open_questions(s: SummaryData) -> list[str]:
    if s.impacts:  # the forces determine K, and c and A with it
        return []
    return ["Not determined by e(v) alone", *(f"  {line}" for line in open_questions(s))]
