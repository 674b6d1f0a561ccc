"""Layouts of heights: drops with their rebounds or their times to rest, and successive flights.

The time of a drop until the ball rests gives e = (r - 1)/(r + 1), r = t/√(2h/g).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, TypeVar

import numpy as np
from scipy.optimize import newton

from ...extend import (
    MEASURED_RESTITUTION,
    STANDARD_GRAVITY,
    Flight,
    Floats,
    Words,
    length_guess,
    not_shrinking,
)
from ..tables.heading import Meaning
from ..tables.sheet import RecordingError, Row
from .layout import (
    DROP_HEIGHT,
    LABELS,
    Layout,
    Paired,
    ReadingError,
    Record,
    TrialRecord,
    bounces_of,
    chains_of,
    couples_of,
    rows_as_pairs,
    unpaired,
)


@dataclasses.dataclass(frozen=True)
class Release(Record):
    """A drop in a trial, from `drop_height` m."""

    trial: str
    drop_height: float


D = TypeVar("D", bound=Release)


class Drops(Layout[D]):
    """Layouts whose rows are drops from known heights, each with one `record`."""

    record: ClassVar[type[Release]]
    uses_flight = True
    cluster_words: ClassVar[Words] = ("drop height", "drop heights")
    errors_words = "by drop height (cluster-robust sandwich): drops from one height share its error"

    def records_of(self, rows: Sequence[Row]) -> list[D]:
        """Return the drops in `rows`, before they are checked together."""
        return [
            self.record(*row.place, row.text("trial", "1"), *map(row.positive, self.measured))
            for row in rows
        ]  # pyright: ignore[reportReturnType]

    def facts(self, records: Sequence[D]) -> Mapping[str, str]:
        name, facts = "drop heights", super().facts(records)
        return {**facts, name: f"{len({one.drop_height for one in records})}, {facts[name]}"}


def _speeds(before: Floats, after: Floats, flight: Flight) -> tuple[Floats, Floats, Floats]:
    """Return landing speed and e between two heights (n,), and the expected second height.

    As for intervals, the noise is computed at the expected reading.
    """
    landing, _ = flight.evaluate(flight.speed_after_drop, before)
    launch, _ = flight.evaluate(flight.speed_to_reach, after)
    expected = before * (np.median(after / before) if len(before) else 1.0)
    return landing, launch / landing, expected


@dataclasses.dataclass(frozen=True)
class Rebound(Release):
    """Height in m of the first rebound after a drop."""

    height: float


class Heights(Drops[Rebound]):
    """Drop and rebound heights: in vacuum e = √(h₁/h₀) at closing speed √(2 g h₀)."""

    name = "heights"
    record: ClassVar[type[Release]] = Rebound
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "drop_height_m": DROP_HEIGHT,
        "trial": LABELS["trial"],
        "rebound_height_m": Meaning(
            "rebound height, rebound height m, bounce height, height of rebound, rebound, "
            "final height, height, h, h1, h 1",
            "m",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("drop_height_m", "rebound_height_m")
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {
        "drop heights": ("drop_height", "m"),
        "rebounds": ("height", "m"),
    }
    flight: ClassVar[tuple[str, str, str] | None] = ("heights", "drop_height", "height")
    reading_error: ClassVar[ReadingError | None] = ReadingError("m", "mm", 1e3, "each height")
    made_of = "drop and rebound heights"
    pair_words: ClassVar[Words] = ("pair of heights", "pairs of heights")

    def read(self, rows: Sequence[Row]) -> list[Rebound]:
        records = self.records_of(rows)
        rise = np.median([one.height / one.drop_height for one in records] or [0.0])
        if rise > MEASURED_RESTITUTION.high**2:
            told = f"balls rise to {rise:.3g} times the height they fell from (the median)"
            rows[0].refuse("rebound_height_m", told + length_guess(rise))
        return records

    def pair(self, records: Sequence[Rebound], flight: Flight) -> Paired[Rebound]:
        dropped, reached = np.array([(one.drop_height, one.height) for one in records]).T
        landing, e, expected = _speeds(dropped, reached, flight)
        # d ln(launch)/dh is 1/(2 h) in vacuum. Drag changes it by a few per cent, which does not
        # matter in a model of noise. All drops from one height share the error of that height.
        return rows_as_pairs(records, landing, e, (0.5 / expected) ** 2)


@dataclasses.dataclass(frozen=True)
class Stop(Release):
    """The time in s from the release of a drop until the ball rests."""

    seconds: float

    def too_short_for(self, fall: float) -> str:
        """Return why the time cannot include a fall of `fall` s."""
        return (
            f"{self.seconds:g} s does not exceed the time of a fall from {self.drop_height:g} m, "
            f"{fall:.3g} s; rest times count from the release until the ball rests"
        )


class Stops(Drops[Stop]):
    """Drops and total times to rest: t = √(2h/g)(1 + e)/(1 - e), including the fall.

    This holds in vacuum with the same e at every bounce. If e depends on the speed, the result is e
    at v₀ e^(e/(1-e)), v₀ = √(2 g h), to first order. Bounce k = 0, 1, ... contributes the share (1
    - e) e^k to ln t, and has the closing speed v₀ e^k.
    """

    name = "stops"
    record: ClassVar[type[Release]] = Stop
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "trial": LABELS["trial"],
        "drop_height_m": DROP_HEIGHT,
        "rest_time_s": Meaning(
            "rest time, rest time s, time to rest, time until rest, total time to rest, "
            "total time, total bounce time, total bouncing time, total duration, bouncing time, "
            "stop time, time to stop, stopping time, settling time, time until it stops, t total, "
            "t tot, t rest, t stop, t end",
            "s",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("drop_height_m", "rest_time_s")
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {
        "drop heights": ("drop_height", "m"),
        "times": ("seconds", "s"),
    }
    reading_error: ClassVar[ReadingError | None] = ReadingError("s", "ms", 1e3, "each total time")
    made_of = "drop heights and total times to rest"
    pair_words: ClassVar[Words] = ("drop until rest", "drops until rest")

    def read(self, rows: Sequence[Row]) -> list[Stop]:
        records = self.records_of(rows)
        for row, one in zip(rows, records, strict=True):
            fall = math.sqrt(2 * one.drop_height / STANDARD_GRAVITY)
            if one.seconds <= fall:
                row.refuse("rest_time_s", one.too_short_for(fall))
        return records

    def notes(self, records: Sequence[Stop]) -> tuple[str, ...]:
        return ("times count from the release; e is one value for all bounces of a drop",)

    def pair(self, records: Sequence[Stop], flight: Flight) -> Paired[Stop]:
        height, time = np.array([(one.drop_height, one.seconds) for one in records]).T
        landing, _ = flight.evaluate(flight.speed_after_drop, height)
        fall, _ = flight.evaluate(flight.time_to_fall, height)
        for one, own in zip(records, fall, strict=True):
            if one.seconds <= own:  # with this gravity, or in air
                raise RecordingError(one.too_short_for(own), "", one.row, "rest_time_s")
        e = (time - fall) / (time + fall)
        if flight.drag is not None:
            e = _in_air(e, landing, time - fall, flight)
        # As for heights, the noise is computed at the expected time.
        usual = float(np.median(e))
        expected = (1 + usual) / (1 - usual)
        factor = (2 / ((expected**2 - 1) * fall)) ** 2
        return rows_as_pairs(records, landing * e ** (e / (1 - e)), e, factor)


_BOUNCES = 200
"""Bounces computed with air drag; the slow remainder is that in vacuum."""


def _in_air(e: Floats, landing: Floats, bouncing: Floats, flight: Flight) -> Floats:
    """Return the e (n,) for which the bounces after a landing take the time `bouncing` (n,)."""

    def excess(place: Floats) -> Floats:
        e = 1 / (1 + np.exp(-place))
        total, speed = np.zeros_like(e), landing
        for _ in range(_BOUNCES):
            speed = e * speed
            total = total + flight.evaluate(flight.duration, speed)[0]
            speed = flight.evaluate(flight.landing_speed, speed)[0]
        return np.log((total + 2 * e * speed / flight.gravity / (1 - e)) / bouncing)

    # ln((1-e)/e) is nearly linear in the logarithm of the time.
    start = np.log(e / (1 - e))
    return 1 / (1 + np.exp(-newton(excess, start, x1=start - 0.1, tol=1e-12, maxiter=40)))


@dataclasses.dataclass(frozen=True)
class Peak(TrialRecord):
    """Height in m of one flight, or of the drop."""

    height: float


class Peaks(Layout[Peak]):
    """Heights of successive flights: in vacuum e = √(h₂/h₁) at closing speed √(2 g h₁)."""

    name = "peaks"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        **LABELS,
        "height_m": Meaning(
            "height, height m, h, peak, peak height, max height, maximum height, apex",
            "m",
            10.0,
            "flights higher than 10 m",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("height_m",)
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {"heights": ("height", "m")}
    flight: ClassVar[tuple[str, str, str] | None] = ("heights", "height", "height")
    reading_error: ClassVar[ReadingError | None] = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    made_of = "heights of successive flights"
    pair_words: ClassVar[Words] = ("pair of successive heights", "pairs of successive heights")
    cluster_words: ClassVar[Words] = ("trial", "trials")
    pair_rule = "two heights make a pair if ball and trial agree and `bounce` is consecutive"
    errors_words = (
        "by trial (cluster-robust sandwich): successive ratios share a height, which correlates "
        "them within a trial"
    )

    def read(self, rows: Sequence[Row]) -> list[Peak]:
        records = [
            Peak(ball, row.number, trial, bounce, row.positive("height_m"))
            for row, (ball, _, trial), bounce in bounces_of(rows)
        ]
        rises = [b.height / a.height for a, b in couples_of(records)]
        if rises and (rise := float(np.median(rises))) > MEASURED_RESTITUTION.high**2:
            told = f"balls rise to {rise:.3g} times the height before (the median)"
            rows[0].refuse("height_m", told + length_guess(rise))
        if (factor := not_shrinking(chains_of(records, "height"), 2.0)) is not None:
            rows[0].refuse(
                "height_m",
                f"each height is {factor:.4g} times the one before (the median), but those of a "
                "bouncing ball shrink; heights over time need a column `time`",
            )
        return records

    def facts(self, records: Sequence[Peak]) -> Mapping[str, str]:
        return {"trials": str(len({one.group for one in records})), **super().facts(records)}

    def pair(self, records: Sequence[Peak], flight: Flight) -> Paired[Peak]:
        couples = couples_of(records)
        before, after = np.array([(a.height, b.height) for a, b in couples]).reshape(-1, 2).T
        landing, e, expected = _speeds(before, after, flight)
        return Paired(
            velocity=landing,
            restitution=e,
            # d ln(speed)/dh is 1/(2 h) in vacuum, for either height.
            reading_factor=(0.5 / before) ** 2 + (0.5 / expected) ** 2,
            clusters=[f"trial {first.trial}" for first, _ in couples],
            records=couples,
            unpaired=unpaired(records, couples),
        )
