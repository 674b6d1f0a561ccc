"""Times between successive impacts: e = launch(T₂)/landing(T₁)."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from .._flight import Flight, landing_speed, launch_speed
from ._layout import Layout, Paired, ReadingError, Record, span
from ._rows import Row
from ._triggers import trigger_fault

Group = tuple[str, float | None, str]


@dataclasses.dataclass(frozen=True)
class Interval(Record):
    """Time in s between impacts `bounce` and `bounce + 1` of one trial.

    `drop_height` in m is None where it was not given.
    """

    drop_height: float | None
    trial: str
    bounce: int
    seconds: float

    @property
    def group(self) -> Group:
        """What names the trial: intervals of one group with successive bounces make a pair."""
        return self.ball, self.drop_height, self.trial

    @property
    def trial_name(self) -> str:
        """The trial in words."""
        drop = "" if self.drop_height is None else f"drop {self.drop_height:g} m, "
        return f"{drop}trial {self.trial}"


class Intervals(Layout[Interval]):
    """Successive bounce intervals: in vacuum e = T₂/T₁ at approach speed g T₁/2."""

    name = "intervals"
    columns = ("ball", "drop_height_m", "trial", "bounce", "interval_s")
    measured = ("interval_s",)
    reading_error = ReadingError("s", "ms", 1e3, "each trigger time")
    uses_flight = True
    made_of = "successive bounce intervals"
    pair_words = ("pair of successive intervals", "pairs of successive intervals")
    cluster_words = ("trial", "trials")
    pair_rule = (
        "two intervals make a pair where ball, drop height and trial are equal and `bounce` counts "
        "on by one"
    )
    errors_words = (
        "by trial (cluster-robust sandwich): successive ratios share an interval and are "
        "correlated within a trial, which this allows for"
    )

    def read(self, rows: Sequence[Row]) -> list[Interval]:
        counts: collections.Counter[Group] = collections.Counter()
        seen: dict[tuple[Group, int], int] = {}
        records = []
        for row in rows:
            record = Interval(
                ball=row.text("ball", ""),
                row=row.number,
                drop_height=row.positive("drop_height_m") if row.has("drop_height_m") else None,
                trial=row.text("trial", "1"),
                bounce=row.count("bounce") if row.has("bounce") else 0,
                seconds=row.positive("interval_s"),
            )
            counts[record.group] += 1
            if not row.has("bounce"):
                record = dataclasses.replace(record, bounce=counts[record.group])
            place = (record.group, record.bounce)
            if place in seen:
                problem = f"bounce {record.bounce} of this trial is in row {seen[place]} already"
                row.refuse("bounce", problem)
            seen[place] = row.number
            records.append(record)
        return records

    def facts(self, records: Sequence[Interval]) -> Mapping[str, str]:
        return {
            "trials": str(len({record.group for record in records})),
            "intervals": span([record.seconds for record in records], "s"),
        }

    def pair(self, records: Sequence[Interval], flight: Flight) -> Paired[Interval]:
        at = {(record.group, record.bounce): record for record in records}
        couples = [
            (first, at[after])
            for first in records
            if (after := (first.group, first.bounce + 1)) in at
        ]
        t1 = np.array([first.seconds for first, _ in couples])
        t2 = np.array([second.seconds for _, second in couples])
        # The size of the noise is taken from the interval that is expected, not from the one that
        # was read: otherwise an interval read too short would get less weight than one read too
        # long, and the fit would be biased.
        expected = t1 * (np.median(t2 / t1) if len(t1) else 1.0)
        launch, slope = flight.evaluate(launch_speed, np.concatenate([t1, t2, expected]))
        (u1, u2, _), (slope1, _, expected_slope) = np.split(launch, 3), np.split(slope, 3)
        landing, landing_slope = flight.evaluate(landing_speed, u1)
        # Three trigger times n₁, n₂, n₃ make two intervals. With independent errors of the
        # triggers, ln e = (n₃ - n₂) p - (n₂ - n₁) q, whose variance over σ² is 2 (p² + q² + p q).
        p, q = expected_slope / expected, slope1 * landing_slope / t1
        used = {record.row for couple in couples for record in couple}
        return Paired(
            velocity=landing,
            restitution=u2 / landing,
            reading_factor=2 * (p**2 + q**2 + p * q),
            clusters=[first.trial_name for first, _ in couples],
            records=couples,
            unpaired=sum(record.row not in used for record in records),
        )

    def guess(
        self, records: Sequence[tuple[Interval, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """Spurious, missed and shifted triggers, from the intervals around each flagged pair."""
        at = {(r.group, r.bounce): r.seconds for couple in records for r in couple}
        guesses = {}
        for k in map(int, np.flatnonzero(flagged)):
            first = records[k][0]
            near = [at.get((first.group, first.bounce + step)) for step in range(-2, 4)]
            guesses[k] = trigger_fault(near, e)
        return guesses
