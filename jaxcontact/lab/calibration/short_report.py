"""A calibration in at most 25 lines: e with its speeds, the law, the data, and the next step."""

from __future__ import annotations

import math
import statistics
import textwrap
from collections.abc import Callable

from ...extend import counted, listed, span, text_table, with_error, wrapped
from ..recordings import LAYOUTS
from .summary_data import AtSpeed, SummaryData, contact_note

_WIDTH = 100
_EVEN = 0.2
"""Largest relative difference of the halves of an interval that is printed as one ±."""

_FEW_ROWS = 12
"""Largest number of bounces that are listed one by one."""

MORE = "--details (in Python `report()`) prints all tables; --report ball.html writes a page"


def short(s: SummaryData) -> str:
    """Return the calibration in a few lines, verdict first, and where to find more."""
    return "\n".join([*verdict_lines(s), *wrapped("More", MORE, width=_WIDTH)])


def verdict_lines(s: SummaryData) -> list[str]:
    """Return the verdict, the law, the data, and the next step."""
    lines = textwrap.wrap(title(s), _WIDTH, break_on_hyphens=False)
    lines += ["", *(line for one in headlines(s) for line in _item(one))]
    header, rows = bounce_rows(s)
    if rows:
        lines += ["", *text_table(rows, header=header, align="<>>", indent=2)]
    lines.append("")
    for head, said in (
        ("Law", law_sentence(s)),
        ("In Python", law_in_python(s)),
        ("Data", data_sentence(s)),
    ):
        lines += wrapped(head, said, width=_WIDTH)
    if s.recording.notes:
        lines += _cut_lines("Read as", "; ".join(s.recording.notes), 3)
    cautions_said = cautions(s)
    if cautions_said:
        lines += _cut_lines("Caution", "; ".join(cautions_said), 4)
    if s.choice.next_measurement:
        lines += wrapped("Next", s.choice.next_measurement, width=_WIDTH)
    return lines


def _item(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)


def _cut_lines(head: str, text: str, most: int) -> list[str]:
    """Wrap as `wrapped` does, and cut after `most` lines."""
    lines = wrapped(head, text, width=_WIDTH)
    if len(lines) <= most:
        return lines
    placeholder = " ... (--details)"
    last = textwrap.shorten(
        " ".join(line.strip() for line in lines[most - 1 :]),
        _WIDTH - 11,
        placeholder=placeholder,
        break_on_hyphens=False,
    )
    return [*lines[: most - 1], " " * 11 + last]


def title(s: SummaryData) -> str:
    """Return the title with source and ball."""
    ball = f", ball {s.recording.ball}" if s.recording.ball else ""
    return f"Calibration of {s.recording.source}{ball}"


def headlines(s: SummaryData) -> list[str]:
    """Return the verdict in sentences: e with its speeds, and the meaning of its interval."""
    if not s.at:
        kept = [pair.restitution for pair in s.pairs if not pair.marked]
        return [
            f"e = {statistics.median(kept):.3g}, the median of "
            f"{counted(len(kept), ('pair', 'pairs'))} from {span(kept)}; no law could be fitted"
        ]
    slow, fast, *asked = s.at
    wrong = s.chosen is not None and s.chosen.adequate is False
    shown = _number if wrong else _with_interval
    said = _mean(s, slow) if s.only_mean else _where(slow, fast, shown)
    if wrong and not s.only_mean:
        said += " (no 95 % interval: the law does not describe the data)"
    lines = [said]
    for point in asked:
        about = []
        if not point.measured:
            about.append("extrapolated: no pair is so " + _beyond(point, slow))
        if _spread(point) > 0:
            about.append(f"laws that are not ruled out: {_range(point.least, point.most)}")
        end = f" ({'; '.join(about)})" if about else ""
        lines.append(f"e = {shown(point)} at {point.velocity:.4g} m/s{end}")
    return [*lines, *meaning(s)]


def _mean(s: SummaryData, law: AtSpeed) -> str:
    """Return the e of one pair, or the mean of a few."""
    kept = [pair for pair in s.pairs if not pair.marked]
    speeds = span([pair.velocity for pair in kept], "m/s")
    if len(kept) > 1:
        return f"e = {_with_interval(law)}, the mean of {len(kept)} pairs at {speeds}"
    e = _with_interval(law) if _interval(law) else f"{kept[0].restitution:.4g}"
    return f"e = {e} at {speeds}, from one pair"


def _where(slow: AtSpeed, fast: AtSpeed, shown: Callable[[AtSpeed], str]) -> str:
    first = f"e = {shown(slow)} at {slow.velocity:.3g}"
    if slow.velocity == fast.velocity:
        return f"{first} m/s"
    if _level(slow, fast):
        return f"{first} to {fast.velocity:.3g} m/s"
    return f"{first} m/s, {shown(fast)} at {fast.velocity:.3g} m/s"


def _level(slow: AtSpeed, fast: AtSpeed) -> bool:
    """Return whether the law has the same e at both speeds."""
    return math.isclose(slow.restitution, fast.restitution, rel_tol=1e-12)


def _beyond(point: AtSpeed, slow: AtSpeed) -> str:
    return "slow" if point.velocity < slow.velocity else "fast"


def _half(point: AtSpeed) -> float | None:
    return None if point.low is None or point.high is None else (point.high - point.low) / 2


def _number(point: AtSpeed) -> str:
    """Return e with as many digits as its interval warrants."""
    half = _half(point)
    return (
        f"{point.restitution:.3g}" if not half else with_error(point.restitution, half).split()[0]
    )


def _with_interval(point: AtSpeed) -> str:
    """Return e with its 95 % interval, if known."""
    interval = _interval(point)
    if not interval:
        return _number(point)
    if interval.startswith("±"):
        return f"{_number(point)} {interval} (95 %)"
    return f"{_number(point)} (95 %: {interval})"


def _interval(point: AtSpeed) -> str:
    """Return `± 0.0017`, or `0.70 to 0.93` if asymmetric; "" if the interval is unknown."""
    half = _half(point)
    if half is None or point.low is None or point.high is None:
        return ""
    up, down = point.high - point.restitution, point.restitution - point.low
    if abs(up - down) > _EVEN * half:
        return _range(point.low, point.high)
    return f"± {with_error(point.restitution, half).split()[-1]}"


def _range(low: float, high: float) -> str:
    """Return two numbers, each to two digits of their difference."""
    places = min(max(1 - math.floor(math.log10(high - low)), 2), 6) if high > low else 4
    return f"{low:.{places}f} to {high:.{places}f}"


def _spread(point: AtSpeed) -> float:
    """Return the spread of e over laws not ruled out, or 0 if within the half interval."""
    off = max(point.restitution - point.least, point.most - point.restitution)
    return off if off > (_half(point) or 0.0) else 0.0


def meaning(s: SummaryData) -> list[str]:
    """Return, as one paragraph, what the interval refers to and how single readings scatter."""
    said = []
    wrong = s.chosen is not None and s.chosen.adequate is False
    if not wrong and any(one.low is not None for one in s.at):
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


def bounce_rows(s: SummaryData) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return header and rows of a table of each bounce, if there are few pairs."""
    if not s.few or len(s.pairs) > _FEW_ROWS:
        return (), []
    rows = [
        (
            ", ".join(map(str, pair.rows)),
            f"{pair.velocity:.3f}",
            f"{pair.restitution:.4f}"
            if pair.error is None
            else with_error(pair.restitution, pair.error),
            "left out" if pair.marked else "",
        )
        for pair in s.pairs
    ]
    error = " ± standard error" if any(pair.error is not None for pair in s.pairs) else ""
    return ("rows", "v (m/s)", f"e{error}", ""), rows


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
    if law.adequate is False:
        good = [one.kind for one in choice.laws if one.adequate is True]
        rest = f"; {listed(good)} {'does' if len(good) == 1 else 'do'}" if good else ""
        none = "" if good else ", and no other law does"
        if not good and len(choice.laws) == 1:
            none = ""
        said.append(f"It does not describe the data ({law.grounds}){rest}{none}")
    elif law.adequate is None:
        said.append(f"It could not be tested: {law.grounds}")
    else:
        said.append("It describes the data")
    if choice.best == law.kind:
        said += _certainty(s)
    return ". ".join(said) + "."


def _certainty(s: SummaryData) -> list[str]:
    choice = s.choice
    if choice.sure:
        return ["The choice is sure: every other law is ruled out or contains this one"]
    if choice.rivals:
        return [f"Not ruled out: {listed(choice.rivals)}"]
    return []


def law_in_python(s: SummaryData) -> str:
    """Return law and contact as Python objects, and which contact numbers were not given."""
    if s.law is None:
        return "no law"
    note = f" ({contact_note(s.given)})" if len(s.given) < 2 else ""
    return f"{s.law!r}, {s.contact!r}{note}"


def data_sentence(s: SummaryData) -> str:
    """Return the number of pairs, their origin, their speeds, and how many were left out."""
    layout = LAYOUTS[s.recording.layout]
    marked = sum(pair.marked for pair in s.pairs)
    out = ""
    if marked:
        out = f"; {marked} far off {about(s)} left out"
    return (
        f"{counted(len(s.pairs), ('pair', 'pairs'))} of approach speed and e, from "
        f"{layout.made_of}, {span([pair.velocity for pair in s.pairs], 'm/s')}{out}"
    )


def about(s: SummaryData) -> str:
    """Return the curve from which pairs were judged: the law, if one describes the data."""
    return s.trend if s.trend in {law.kind for law in s.choice.laws} else "the trend"


def cautions(s: SummaryData) -> list[str]:
    """Return short warnings on what may be wrong."""
    warnings = []
    failed = [one.kind for one in (*s.choice.laws, *s.with_marked.laws) if not one.converged]
    if failed:
        warnings.append(f"NOT converged, do not use: {', '.join(dict.fromkeys(failed))}")
    above = sum(pair.restitution > 1 and not pair.marked for pair in s.pairs)
    if above and s.few:
        warnings.append("e is above 1 in a pair: a trigger may be missing")
    if s.choice.better_possible:
        warnings.append("a free smooth curve fits better than every law: a better law is possible")
    caution = drag_caution(s)
    return [*warnings, caution] if caution else warnings


def drag_caution(s: SummaryData) -> str | None:
    """Return a warning if e falls with speed and air drag was not removed, otherwise None."""
    error, layout = s.choice.line.slope_error, LAYOUTS[s.recording.layout]
    if not layout.uses_flight or s.drag is not None or error is None:
        return None
    if s.choice.line.slope > -2 * error:
        return None
    return "air drag is not corrected and may cause the decrease of e with speed"
