"""Times between successive impacts: e = launch(T₂)/landing(T₁)."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...extend import (
    EVEN,
    MEASURED_RESTITUTION,
    STANDARD_GRAVITY,
    Flight,
    Floats,
    Words,
    length_guess,
    not_shrinking,
    too_long,
)
from ..signals import CLOCK
from ..sound.audio import Sound
from ..tables.heading import Meaning, deviation_of
from ..tables.match import Match
from ..tables.sheet import Row, Sheet
from .layout import (
    DROP_HEIGHT,
    LABELS,
    Layout,
    Paired,
    ReadingError,
    TrialRecord,
    bounces_of,
    chains_of,
    couples_of,
    unpaired,
)

_TOLERANCE = 0.06
_LATE_TOLERANCE = 0.25  # fraction of the deviation that a late trigger would explain
_MOST_MERGED = 5
_ZERO = re.compile(r"\s*0+(\.0*)?\s*")

_CONTRADICTS = 30.0
"""Largest ratio of the fractions of height kept at the first and the second impact.

It is a factor of five in e. Bounces missing before the first record do not reach it.
"""


class Timing(NamedTuple):
    """Known standard deviations in s: of the start and end of an interval, and of the contact time.

    Every interval includes a contact.
    """

    start: float
    end: float
    contact: float


@dataclasses.dataclass(frozen=True)
class Interval(TrialRecord):
    """Time in s between impacts `bounce` and `bounce + 1` of one trial.

    `drop_height` in m is None if it was not given. `timing` is None if the errors of the times are
    unknown. `sigma` is the standard deviation in s of the interval, None if it was not given.
    `told` are notes on its origin, and `sound` is that in which it was detected, if any.
    """

    _: dataclasses.KW_ONLY
    drop_height: float | None = None
    timing: Timing | None = None
    sigma: float | None = None
    told: tuple[str, ...] = ()
    sound: Sound | None = dataclasses.field(default=None, compare=False, repr=False)
    seconds: float

    @property
    def group(self) -> tuple[str, float | None, str]:
        """Key of the trial; two successive intervals of a group make a pair."""
        return self.ball, self.drop_height, self.trial

    def errors(self, longest: float) -> Iterator[tuple[Hashable, float]]:
        """Yield the known errors in s by their sources, which intervals may share.

        The duration of contact is unknown but scales as v^(-1/5) (Hertz), with the speed of the
        `longest` interval in s; the sound of the impact is delayed with it.
        """
        if self.sigma is not None:
            yield (self.group, self.bounce), self.sigma
        elif self.timing is not None:
            yield (self.group, self.bounce), -self.timing.start
            yield (self.group, self.bounce + 1), self.timing.end
            yield self.group, (self.seconds / longest) ** -0.2 * self.timing.contact


_STEP = Meaning("dt, δt, delta t, time step, step", "s")


class Intervals(Layout[Interval]):
    """Successive bounce intervals: in vacuum e = T₂/T₁ at closing speed g T₁/2."""

    name = "intervals"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "drop_height_m": DROP_HEIGHT,
        "trial": LABELS["trial"],
        "bounce": LABELS["bounce"],
        "sigma": deviation_of(
            "interval_s", ("t", "dt", "interval", "interval s", "flight time", "time"), "s"
        ),
        "interval_s": Meaning(
            "interval, interval s, bounce interval, time between bounces, time between impacts, "
            f"flight time, time of flight, t flight, lap time, lap duration, {_STEP.names}",
            "s",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("interval_s",)
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {"intervals": ("seconds", "s")}
    flight: ClassVar[tuple[str, str, str] | None] = ("intervals", "seconds", "seconds")
    reading_error: ClassVar[ReadingError | None] = ReadingError("s", "ms", 1e3, "each trigger time")
    uses_flight = True
    made_of = "successive bounce intervals"
    pair_words: ClassVar[Words] = ("pair of successive intervals", "pairs of successive intervals")
    cluster_words: ClassVar[Words] = ("trial", "trials")
    pair_rule = (
        "two intervals make a pair if ball, drop height and trial agree and `bounce` is consecutive"
    )
    errors_words = (
        "by trial (cluster-robust sandwich): successive ratios share an interval, which "
        "correlates them within a trial"
    )

    @staticmethod
    def is_step(text: str) -> bool:
        """Return whether a heading may denote the steps of any clock."""
        return _STEP.heading(text) is not None

    def fits(self, made: Match, sheet: Sheet) -> bool:
        """Return False for a generic word for time steps beside a column of times."""
        heading = made.headings.get("interval_s")
        if heading is None or not self.is_step(heading.text):
            return True
        return not any(CLOCK.heading(text) for text in sheet.names)

    def select(self, rows: Sequence[Row]) -> tuple[Sequence[Row], tuple[str, ...]]:
        """Leave out the last intervals of trials that are 0: a stopwatch ends with these."""
        if not rows or "interval_s" not in rows[0].values:
            return rows, ()
        trials: dict[tuple[Any, Any], list[Row]] = {}
        for row in rows:
            trials.setdefault((row.values.get("ball"), row.values.get("trial")), []).append(row)
        gone = [
            own[-1].number
            for own in trials.values()
            if len(own) > 2 and _ZERO.fullmatch(str(own[-1].values["interval_s"]))
        ]
        note = f"row {', '.join(map(str, gone))} left out: the last interval is 0"
        return [row for row in rows if row.number not in gone], (note,) * bool(gone)

    def read(self, rows: Sequence[Row]) -> list[Interval]:
        records = [
            Interval(
                *(ball, row.number, trial, bounce),
                drop_height=height,
                seconds=row.positive("interval_s"),
                sigma=row.positive("sigma") if "sigma" in row.values else None,
            )
            for row, (ball, height, trial), bounce in bounces_of(rows)
        ]
        self.check(rows, records, "interval_s")
        return records

    def check(self, rows: Sequence[Row], records: Sequence[Interval], column: str) -> None:
        """Refuse intervals from a `column` that cannot be those of a bouncing ball."""
        if records and (why := too_long([record.seconds for record in records])):
            word = column.partition("_")[0]
            rows[0].refuse(column, why + f", or write the unit in the heading, '{word} [ms]'")
        if (factor := not_shrinking(chains_of(records, "seconds"))) is not None:
            rows[0].refuse(column, _no_ball(factor, records, column))
        self._check_drops(rows, records)

    def _check_drops(self, rows: Sequence[Row], records: Sequence[Interval]) -> None:
        """Refuse drop heights that contradict the flights after the first impact."""
        seconds = {(record.group, record.bounce): record.seconds for record in records}
        rises = [
            (STANDARD_GRAVITY * t1**2 / 8 / group[1], (t2 / t1) ** 2)
            for (group, bounce), t1 in seconds.items()
            if bounce == 1 and group[1] and (t2 := seconds.get((group, 2)))
        ]
        if not rises:
            return
        # Both are e², of the first impact and of the second.
        rise, usual = np.median(rises, axis=0)
        if rise > usual / _CONTRADICTS and rise <= MEASURED_RESTITUTION.high**2:
            return
        rows[0].refuse(
            "drop_height_m",
            f"after the first impact balls rise to {rise:.3g} of this height (the median), after "
            f"the second to {usual:.3g} of the one before{length_guess(usual / rise)}",
        )

    def facts(self, records: Sequence[Interval]) -> Mapping[str, str]:
        return {"trials": str(len({one.group for one in records})), **super().facts(records)}

    def notes(self, records: Sequence[Interval]) -> tuple[str, ...]:
        told = dict.fromkeys(note for one in records for note in one.told)
        return (*told, *super().notes(records))

    def pair(self, records: Sequence[Interval], flight: Flight) -> Paired[Interval]:
        couples = couples_of(records)
        t1, t2 = np.array([[one.seconds for one in couple] for couple in couples]).reshape(-1, 2).T
        landing, restitution, p, q = ratios_of(t1, t2, flight)
        # Three trigger times n₁, n₂, n₃ make two intervals. With independent errors of the
        # triggers, ln e = (n₃ - n₂) p - (n₂ - n₁) q, whose variance over σ² is 2 (p² + q² + p q).
        factor, square = 2 * (p**2 + q**2 + p * q), _mean_square(couples)
        covariance = None if square is None else _covariance(couples, p, q)
        if square is not None and covariance is not None:
            factor = np.diag(covariance) / square
        return Paired(
            velocity=landing,
            restitution=restitution,
            reading_factor=factor,
            clusters=[_trial(first) for first, _ in couples],
            records=couples,
            unpaired=unpaired(records, couples),
            covariance=covariance,
            reading=math.sqrt(square or 0.0),
            absolute=bool(couples) and couples[0][0].sigma is not None,
        )

    def guess(
        self, records: Sequence[tuple[Interval, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """Return probable trigger faults, from the intervals around each flagged pair."""
        at = {(r.group, r.bounce): r.seconds for couple in records for r in couple}
        guesses = {}
        for k in map(int, np.flatnonzero(flagged)):
            group, bounce = records[k][0].group, records[k][0].bounce
            near = [at.get((group, bounce + step), math.nan) for step in range(-2, 4)]
            guesses[k] = _trigger_fault(near, e)
        return guesses


def _no_ball(factor: float, records: Sequence[Interval], column: str) -> str:
    """Return why constant or growing intervals are not those of a ball, with a guess."""
    usual = float(np.median([record.seconds for record in records]))
    ball = "those of a bouncing ball shrink"
    if factor > 2 - EVEN:
        return (
            f"intervals grow, by the factor {factor:.3g} from one to the next (the median), where "
            f"{ball}; are they in reverse order?"
            + ' Or are these the times of bounces? Then say so with `columns="bounce time=..."`'
            * (column == "interval_s")
        )
    return (
        f"intervals stay the same, {usual:.3g} s (the median), where {ball}; they may be the "
        "steps of a clock, of frames or of samples: give the column measured at these times, "
        "such as a height, or more bounces"
    )


class Ratios(NamedTuple):
    """Speed, e and error propagation of n pairs of flights, all (n,).

    The closing speed is in m/s. Errors of the durations T₁ and T₂ enter as d ln e = p dT₂ - q dT₁.
    """

    velocity: Floats
    restitution: Floats
    p: Floats
    q: Floats


def ratios_of(t1: Floats, t2: Floats, flight: Flight) -> Ratios:
    """Return speed and e of impacts between flights of durations `t1` and `t2` (n,) in s."""
    # The noise is computed at the expected interval, not at the reading. Otherwise intervals read
    # too short would get less weight than those read too long, and the fit would be biased.
    expected = t1 * (np.median(t2 / t1) if len(t1) else 1.0)
    launch, slope = flight.evaluate(flight.launch_speed, np.concatenate([t1, t2, expected]))
    (u1, u2, _), (slope1, _, expected_slope) = np.split(launch, 3), np.split(slope, 3)
    landing, landing_slope = flight.evaluate(flight.landing_speed, u1)
    return Ratios(landing, u2 / landing, expected_slope / expected, slope1 * landing_slope / t1)


def _mean_square(couples: Sequence[tuple[Interval, Interval]]) -> float | None:
    """Return the mean square of the known errors of triggers, in s²; None if some are unknown.

    An interval has two triggers.
    """
    every = [*itertools.chain(*couples)]
    both = {(one.group, one.bounce): one.sigma for one in every}
    sigma = [one for one in both.values() if one is not None]
    times = [one.timing for one in every if one.timing is not None]
    if sigma:
        return float(np.mean(np.square(sigma))) / 2
    if not couples or len(times) < 2 * len(couples):
        return None
    return float(np.mean([(one.start**2 + one.end**2) / 2 for one in times]))


def _covariance(couples: Sequence[tuple[Interval, Interval]], p: Floats, q: Floats) -> Floats:
    """Return the covariance (n, n) of ln e = p T₂ - q T₁, with p and q (n,), from known errors."""
    longest: dict[Hashable, float] = {}
    for one, _ in couples:
        longest[one.group] = max(longest.get(one.group, 0.0), one.seconds)
    effects: dict[Hashable, Floats] = {}
    for k, couple in enumerate(couples):
        for one, slope in zip(couple, (-q[k], p[k]), strict=True):
            for source, error in one.errors(longest[one.group]):
                effects.setdefault(source, np.zeros(len(couples)))[k] += slope * error
    each = np.array(list(effects.values()))
    return each.T @ each


def _trial(interval: Interval) -> str:
    drop = "" if interval.drop_height is None else f"drop {interval.drop_height:g} m, "
    return f"{drop}trial {interval.trial}"


def _trigger_fault(near: Sequence[float], e: float) -> str:
    """Return the probable fault of the pair (k, k+1) of intervals.

    `near` are the intervals k-2 ... k+3 in s, NaN if missing; `e` is the usual ratio.
    """
    two_before, before, first, second, after, two_after = near
    # A flight cut in two: the sum of the parts fits the neighbours. This is checked first:
    # neighbours on both sides are better evidence than one ratio.
    for left, whole, right in (
        (before, first + second, after),
        (first, second + after, two_after),
        (two_before, before + first, second),
    ):
        ratios = [ratio for ratio in (whole / left, right / whole) if not math.isnan(ratio)]
        if ratios and all(_close(ratio, e) for ratio in ratios):
            return "spurious trigger (one flight cut in two)"
    # An interval that holds m flights is 1 + e + ... times as long.
    for m in range(2, _MOST_MERGED + 1):
        whole = sum(e**k for k in range(m))
        if _close(second / first, e * whole):
            return f"missed trigger ({m} flights in the second interval)"
        if _close(second / first, e**m / whole):
            return f"missed trigger ({m} flights in the first interval)"
    # A late or early trigger: one interval is too long, its neighbour too short. Their sum is
    # right, to a much smaller tolerance than the ratio.
    off = abs(math.log(second / first / e))
    tolerance = min(_LATE_TOLERANCE * off, _TOLERANCE)
    for reference, a, b in (
        (two_before, before, first),
        (before, first, second),
        (first, second, after),
    ):
        right = abs(math.log((a + b) / reference / (e + e * e))) < tolerance
        # Two correct intervals also have the right sum, so the ratio must be off between these two.
        if right and abs(math.log(b / a / e)) > off / 2:
            return "late or early trigger"
    return "unclear"


def _close(ratio: float, expected: float) -> bool:
    return abs(ratio / expected - 1) < _TOLERANCE
