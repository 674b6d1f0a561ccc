"""The verdict of a calibration in words: e with its speeds, the law, the data, and the doubts."""

from __future__ import annotations

import math
import statistics

from ...extend import counted, listed, span, with_error
from ..choice.law_choice import ChoiceData, LawFit
from ..recordings import LAYOUTS
from .report_parts import Fact, Rows
from .summary_data import AtSpeed, SummaryData, contact_note

_EVEN = 0.2
"""Largest relative difference of the halves of an interval that is printed as one ±."""

_FEW_ROWS = 12
"""Largest number of bounces that are listed one by one."""

_READ_AS, _CAUTION = 3, 4
"""Numbers of lines after which a short report is cut."""


def title(s: SummaryData) -> str:
    """Return the title with source and ball."""
    return "Calibration of " + source(s)


def source(s: SummaryData) -> str:
    """Return source and ball of the recording."""
    return s.recording.source + (f", ball {s.recording.ball}" if s.recording.ball else "")


def verdict(s: SummaryData) -> list[Fact]:
    """Return the law, the data, what may be wrong, and the next step."""
    return [
        Fact("Law", law_sentence(s)),
        Fact("Held out", held_out_sentence(s)),
        Fact("In Python", law_in_python(s)),
        Fact("Data", data_sentence(s)),
        Fact("Read as", "; ".join(s.recording.notes), _READ_AS),
        Fact("Caution", "; ".join(cautions(s)), _CAUTION),
        Fact("Next", s.choice.next_measurement),
    ]


def headlines(s: SummaryData) -> list[str]:
    """Return the verdict in sentences: e with its speeds, and the meaning of its interval."""
    kept = [pair for pair in s.pairs if not pair.marked]
    if not s.at:
        measured = [pair.restitution for pair in kept]
        return [
            f"e = {statistics.median(measured):.3g}, the median of "
            f"{counted(len(kept), ('pair', 'pairs'))} from {span(measured)}; no law could be fitted"
        ]
    slow, fast, *asked = s.at
    wrong = _wrong(s)
    first = f"e = {_shown(slow, wrong and not s.only_mean)}"
    if s.only_mean:
        speeds = span([pair.velocity for pair in kept], "m/s")
        lines = [f"{first}, the mean of {len(kept)} pairs at {speeds}"]
        if len(kept) == 1:
            e = first if slow.known else f"e = {kept[0].restitution:.4g}"
            lines = [f"{e} at {speeds}, from one pair"]
    else:
        first += f" at {slow.velocity:.3g}"
        if slow.velocity != fast.velocity:
            same = math.isclose(slow.restitution, fast.restitution, rel_tol=1e-12)
            first += f"{' to' if same else f' m/s, {_shown(fast, wrong)} at'} {fast.velocity:.3g}"
        unknown = " (no 95 % interval: the law does not describe the data)" if wrong else ""
        lines = [f"{first} m/s{unknown}"]
    for point in asked:
        doubts = []
        if not point.measured:
            side = "slow" if point.velocity < slow.velocity else "fast"
            doubts.append(f"extrapolated: no pair is so {side}")
        if _spread(point) > 0:
            doubts.append(f"laws that are not ruled out: {_range(point.least, point.most)}")
        end = f" ({'; '.join(doubts)})" if doubts else ""
        lines.append(f"e = {_shown(point, wrong)} at {point.velocity:.4g} m/s{end}")
    if stiffness := stiffness_said(s):
        lines.append(f"{stiffness}, of F = K δ^n (1 + α δ'/v0)")
    return [*lines, *_meaning(s)]


def _wrong(s: SummaryData) -> bool:
    return s.chosen is not None and s.chosen.adequate is False


def _shown(point: AtSpeed, wrong: bool) -> str:
    """Return e to the digits of its interval, with the interval unless the law is `wrong`.

    An interval is `± 0.0017`, or `0.70 to 0.93` if asymmetric.
    """
    if point.low is None or point.high is None:
        return f"{point.restitution:.3g}"
    e, _, error = with_error(point.restitution, point.half).split()
    if wrong:
        return e
    up, down = point.high - point.restitution, point.restitution - point.low
    if abs(up - down) > _EVEN * point.half:
        return f"{e} (95 %: {_range(point.low, point.high)})"
    return f"{e} ± {error} (95 %)"


def _range(low: float, high: float) -> str:
    """Return two numbers, each to two digits of their difference."""
    places = min(max(1 - math.floor(math.log10(high - low)), 2), 6) if high > low else 4
    return f"{low:.{places}f} to {high:.{places}f}"


def _spread(point: AtSpeed) -> float:
    """Return the spread of e over laws not ruled out, or 0 if within the half interval."""
    off = max(point.restitution - point.least, point.most - point.restitution)
    return off if off > point.half else 0.0


def _meaning(s: SummaryData) -> list[str]:
    """Return, as one paragraph, what the interval refers to and how single readings scatter."""
    said, wrong = [], _wrong(s)
    if not wrong and any(one.known for one in s.at):
        what = "for the mean e at a speed, given the law"
        if s.choice.count == 1:
            what = "from the known error of the reading"
        elif s.only_mean:
            what = "for the mean e, if e does not depend on speed"
        said.append(f"The 95 % interval is {what}.")
    if s.scatter is not None:
        said.append(f"A single reading of e scatters by {scatter_said(s.scatter)}.")
    off = max(map(_spread, s.at[:2]))
    if not wrong and off > 0:
        said.append(f"Laws that are not ruled out differ by up to {off:.1g} at these speeds.")
    return [" ".join(said)] if said else []


def scatter_said(scatter: float) -> str:
    """Return a standard deviation of ln e in percent of e."""
    return f"{100 * scatter:.2g} %"


def bounces(s: SummaryData) -> Rows:
    """Return a table of each bounce, without rows if there are many pairs."""
    listed_pairs = s.pairs if s.few and len(s.pairs) <= _FEW_ROWS else ()
    rows = [
        (
            ", ".join(map(str, pair.rows)),
            f"{pair.velocity:.3f}",
            f"{pair.restitution:.4f}"
            if pair.error is None
            else with_error(pair.restitution, pair.error),
            "left out" if pair.marked else "",
        )
        for pair in listed_pairs
    ]
    error = " ± standard error" if any(pair.error is not None for pair in s.pairs) else ""
    return Rows(("rows", "v (m/s)", f"e{error}", ""), rows, "<>>")


def law_sentence(s: SummaryData) -> str:
    """Return the law, whether it describes the data, and which other laws may."""
    law, choice = s.chosen, s.choice
    if law is None:
        return "no fit converged"
    said = [f"{law.kind}, {law.said}" + (" (± standard error)" if "±" in law.said else "")]
    if s.only_mean:
        count = counted(choice.count, LAYOUTS[s.recording.layout].pair_words)
        said.append(f"A trend of e with speed cannot be tested with {count}")
        return ". ".join(said) + "."
    if choice.best is not None and choice.best != law.kind:
        said.append(f"This law was requested; the best of the compared laws is {choice.best}")
    said.append(_describes(law, choice))
    if choice.best == law.kind and choice.sure:
        said.append("The choice is sure: every other law is ruled out or contains this one")
    elif choice.best == law.kind and choice.rivals:
        said.append(f"Not ruled out: {listed(choice.rivals)}")
    return ". ".join(said) + "."


def stiffness_said(s: SummaryData) -> str:
    """Return K with its 95 % interval and unit, "" unless it was fitted."""
    if s.stiffness_error is None or not math.isfinite(s.stiffness_error):
        return ""
    value = with_error(float(s.contact.stiffness), 1.96 * s.stiffness_error)
    return f"K = ({value}) N/m^{float(s.contact.exponent):g} (95 %)"


def held_out_sentence(s: SummaryData) -> str:
    """Return what a law fitted to most trials predicts for the others, and what was measured."""
    one = s.check
    if one is None:
        return ""
    words = LAYOUTS[s.recording.layout].cluster_words
    off = "within" if one.agrees else "NOT within"
    return (
        f"without {len(one.held)} of {counted(one.trials, words)} the law predicts a mean e of "
        f"{with_error(one.predicted, one.error)} (95 %) for them; measured was "
        f"{one.measured:.4f}, {off} the error"
    )


def _describes(law: LawFit, choice: ChoiceData) -> str:
    if law.adequate is None:
        return f"It could not be tested: {law.grounds}"
    if law.adequate:
        return "It describes the data"
    good = [one.kind for one in choice.laws if one.adequate is True]
    others = ", and no other law does" if len(choice.laws) > 1 else ""
    if good:
        others = f"; {listed(good)} {'does' if len(good) == 1 else 'do'}"
    return f"It does not describe the data ({law.grounds}){others}"


def law_in_python(s: SummaryData) -> str:
    """Return law and contact as Python objects, and which contact numbers were not given."""
    if s.law is None:
        return "no law"
    note = f" ({contact_note(s.given)})" if len(s.given) < 2 else ""
    return f"{s.law!r}, {s.contact!r}{note}"


def data_sentence(s: SummaryData) -> str:
    """Return the number of pairs, their origin, their speeds, and how many were left out."""
    marked = sum(pair.marked for pair in s.pairs)
    out = f"; {marked} far off {judged_by(s)} left out" if marked else ""
    return (
        f"{counted(len(s.pairs), ('pair', 'pairs'))} of closing speed and e, from "
        f"{LAYOUTS[s.recording.layout].made_of}, "
        f"{span([pair.velocity for pair in s.pairs], 'm/s')}{out}"
    )


def judged_by(s: SummaryData) -> str:
    """Return the curve from which pairs were judged: the law, if one describes the data."""
    return s.trend if s.trend in {law.kind for law in s.choice.laws} else "the trend"


def cautions(s: SummaryData) -> list[str]:
    """Return short warnings on what may be wrong."""
    failed = [one.kind for one in (*s.choice.laws, *s.with_marked.laws) if not one.converged]
    in_air = LAYOUTS[s.recording.layout].uses_flight and s.drag is None
    above = s.few and any(pair.restitution > 1 and not pair.marked for pair in s.pairs)
    better = s.choice.better_possible
    warnings = {
        f"NOT converged, do not use: {', '.join(dict.fromkeys(failed))}": failed,
        "e is above 1 in a pair: a trigger may be missing": above,
        "a free smooth curve fits better than every law: a better law is possible": better,
        "air drag is not corrected and may cause the decrease of e with speed": (
            in_air and s.choice.line.falls
        ),
    }
    return [text for text, holds in warnings.items() if holds]
