"""Times of bounces, as given by stopwatches and labels of an audio editor; and of a drop until the
ball rests: e = (r - 1)/(r + 1), r = t/√(2h/g).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ...extend import (
    STANDARD_GRAVITY,
    Flight,
    Floats,
    Words,
    counted,
    duration,
    landing_speed,
    span,
    speed_after_drop,
    time_to_fall,
)
from ..signals import CLOCK
from ..tables.heading import Meaning, words
from ..tables.match import Match
from ..tables.sheet import Row, Sheet
from .intervals import Group, Interval, Intervals, interval_groups
from .layout import DROP_HEIGHT, LABELS, Layout, Paired, ReadingError, Record, bounces_of

_PAUSE = 3.0
"""Ratio to the previous interval above which an interval separates two drops.

Even three merged flights of a ball without loss are not longer.
"""

_BOUNCE = re.compile(r"\W*(bounce|impact|hit|touch|contact|click|knock|new point|b)?[\W\d_]*")
"""Labels of a bounce, including "" and numbers."""


@dataclasses.dataclass(frozen=True)
class NotedInterval(Interval):
    """The time between two bounces, and a note on the `others`, which are not bounces."""

    others: str


class Instants(Intervals):
    """Times of successive bounces; each two in succession bound an interval."""

    name = "instants"
    columns: ClassVar[tuple[str, ...]] = (
        "ball",
        "drop_height_m",
        "trial",
        "bounce",
        "label",
        "bounce_time_s",
    )
    measured: ClassVar[tuple[str, ...]] = ("bounce_time_s",)
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
        {
            **LABELS,
            "drop_height_m": DROP_HEIGHT,
            "label": Meaning(words("label, event, marker, mark, annotation, description")),
            "bounce_time_s": Meaning(
                (
                    *words(
                        "bounce time, bounce time s, time of bounce, impact time, time of impact, "
                        "hit time, touch time, contact at, instant, onset, onset time, event time, "
                        "total time, total, split time, split, overall time, overall, "
                        "cumulative time, cumulative, race time, start, start time, begin"
                    ),
                    *CLOCK.words,
                ),
                "s",
            ),
        }
    )
    made_of = "intervals between the instants of bounces"
    pair_rule = (
        "three instants make a pair if ball, drop height and trial agree and `bounce` is "
        "consecutive"
    )

    def fits(self, made: Match, sheet: Sheet) -> bool:
        """Return False for a generic word for time beside headings that are not recognised."""
        heading = made.headings.get("bounce_time_s")
        if heading is None or CLOCK.heading(heading.text) is None:
            return True
        others = [t for k, t in enumerate(sheet.names) if t and k not in made.places.values()]
        return all(Intervals.is_step(text) for text in others)

    def read(self, rows: Sequence[Row]) -> list[Interval]:
        rows, others = _bounces_in(rows)
        groups = interval_groups(rows)
        instants: dict[Group, list[tuple[int, float, Row]]] = {}
        for row, group, bounce in zip(rows, groups, bounces_of(rows, groups), strict=True):
            time = row.real("bounce_time_s")
            if math.isnan(time):
                row.refuse("bounce_time_s", "is empty")
            instants.setdefault(group, []).append((bounce, time, row))
        records = []
        for (ball, height, trial), own in instants.items():
            drop, last = 1, math.inf
            for (one, start, _), (two, end, row) in itertools.pairwise(sorted(own, key=_number)):
                seconds = end - start
                if seconds <= 0:
                    row.refuse(
                        "bounce_time_s",
                        f"{end:g} s is not later than {start:g} s; if these are the intervals "
                        'between bounces, give `columns="interval=..."`',
                    )
                if seconds > _PAUSE * last:
                    drop, last = drop + 1, math.inf
                    continue
                if two == one + 1:
                    name = trial if drop == 1 else f"{trial}, {drop}"
                    records.append(
                        NotedInterval(ball, row.number, height, name, one, seconds, others)
                    )
                last = seconds
        if rows:
            self.check(rows, records, "bounce_time_s")
        return records

    def notes(self, records: Sequence[Interval]) -> tuple[str, ...]:
        told = {one.others for one in records if isinstance(one, NotedInterval) and one.others}
        paused = len({one.trial for one in records if ", " in one.trial})
        return (
            *told,
            *[f"{counted(paused + 1, ('drop', 'drops'))} separated by pauses"] * bool(paused),
        )


def _number(one: tuple[int, float, Row]) -> int:
    return one[0]


def _bounces_in(rows: Sequence[Row]) -> tuple[Sequence[Row], str]:
    """Return the rows labelled as bounces (all if no label is), and a note on the others."""
    if not rows or "label" not in rows[0].values:
        return rows, ""
    labels = [str(row.values["label"] or "").strip().casefold() for row in rows]
    mine = [row for row, text in zip(rows, labels, strict=True) if _BOUNCE.fullmatch(text)]
    if not mine:
        return rows, ""
    others = dict.fromkeys(text for text in labels if not _BOUNCE.fullmatch(text))
    shown = ", ".join(f"'{text}'" for text in itertools.islice(others, 6))
    return mine, f"labels other than bounces left out: {shown}" * bool(others)


_BOUNCES = 200
"""Bounces computed with air drag; the slow remainder is that in vacuum."""

_STEPS, _SAME = 40, 1e-12


@dataclasses.dataclass(frozen=True)
class Stop(Record):
    """The time in s from the release at `drop_height` m until the ball rests."""

    trial: str
    drop_height: float
    seconds: float


class Stops(Layout[Stop]):
    """Drops and total times to rest: t = √(2h/g)(1 + e)/(1 - e), including the fall.

    This holds in vacuum with the same e at every bounce. If e depends on the speed, the result is e
    at v₀ e^(e/(1-e)), v₀ = √(2 g h), to first order. Bounce k = 0, 1, ... contributes the share (1
    - e) e^k to ln t, and has the closing speed v₀ e^k.
    """

    name = "stops"
    columns: ClassVar[tuple[str, ...]] = ("ball", "trial", "drop_height_m", "rest_time_s")
    measured: ClassVar[tuple[str, ...]] = ("drop_height_m", "rest_time_s")
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
        {
            "ball": LABELS["ball"],
            "trial": LABELS["trial"],
            "drop_height_m": DROP_HEIGHT,
            "rest_time_s": Meaning(
                words(
                    "rest time, rest time s, time to rest, time until rest, total time to rest, "
                    "total time, total bounce time, total bouncing time, total duration, "
                    "bouncing time, stop time, time to stop, stopping time, settling time, "
                    "time until it stops, t total, t tot, t rest, t stop, t end"
                ),
                "s",
            ),
        }
    )
    reading_error: ClassVar[ReadingError | None] = ReadingError("s", "ms", 1e3, "each total time")
    uses_flight = True
    made_of = "drop heights and total times to rest"
    pair_words: ClassVar[Words] = ("drop until rest", "drops until rest")
    cluster_words: ClassVar[Words] = ("drop height", "drop heights")
    errors_words = "by drop height (cluster-robust sandwich): drops from one height share its error"

    def read(self, rows: Sequence[Row]) -> list[Stop]:
        records = [
            Stop(*row.place, row.text("trial", "1"), *map(row.positive, self.measured))
            for row in rows
        ]
        for row, one in zip(rows, records, strict=True):
            fall = math.sqrt(2 * one.drop_height / STANDARD_GRAVITY)
            if one.seconds <= fall:
                row.refuse(
                    "rest_time_s",
                    f"{one.seconds:g} s does not exceed the time of a fall from "
                    f"{one.drop_height:g} m, {fall:.3g} s; rest times count from the release "
                    "until the ball rests",
                )
        return records

    def facts(self, records: Sequence[Stop]) -> Mapping[str, str]:
        dropped = [record.drop_height for record in records]
        return {
            "drop heights": f"{len(set(dropped))}, {span(dropped, 'm')}",
            "times": span([record.seconds for record in records], "s"),
        }

    def notes(self, records: Sequence[Stop]) -> tuple[str, ...]:
        return ("times count from the release; e is one value for all bounces of a drop",)

    def pair(self, records: Sequence[Stop], flight: Flight) -> Paired[Stop]:
        height, time = np.array([(one.drop_height, one.seconds) for one in records]).T
        landing, _ = flight.evaluate(speed_after_drop, height)
        fall, _ = flight.evaluate(time_to_fall, height)
        ratio = time / fall
        e = (ratio - 1) / (ratio + 1)
        if flight.drag is not None:
            e = _in_air(e, landing, time - fall, flight)
        # As for heights, the noise is computed at the expected time.
        usual = float(np.median(e))
        expected = (1 + usual) / (1 - usual)
        return Paired(
            velocity=landing * e ** (e / (1 - e)),
            restitution=e,
            reading_factor=(2 / ((expected**2 - 1) * fall)) ** 2,
            clusters=[f"drop {record.drop_height:g} m" for record in records],
            records=[(record,) for record in records],
        )


def _in_air(e: Floats, landing: Floats, bouncing: Floats, flight: Flight) -> Floats:
    """Return the e (n,) for which the bounces after a landing take the time `bouncing` (n,)."""

    def lasts(e: Floats) -> Floats:
        total, speed = np.zeros_like(e), landing
        for _ in range(_BOUNCES):
            speed = e * speed
            total = total + flight.evaluate(duration, speed)[0]
            speed = flight.evaluate(landing_speed, speed)[0]
        return total + 2 * e * speed / flight.gravity / (1 - e)

    # ln((1-e)/e) is nearly linear in the logarithm of the time.
    def place(e: Floats) -> Floats:
        return np.log(e / (1 - e))

    one = e
    last, off = place(one) - 0.1, None
    here = place(one)
    off_last = np.log(lasts(1 / (1 + np.exp(-last))) / bouncing)
    for _ in range(_STEPS):
        off = np.log(lasts(1 / (1 + np.exp(-here))) / bouncing)
        if np.all(np.abs(off) < _SAME):
            break
        slope = np.where(here != last, (off - off_last) / np.where(here != last, here - last, 1), 1)
        last, off_last, here = here, off, here - off / np.where(slope > 0, slope, 1)
    return 1 / (1 + np.exp(-here))
