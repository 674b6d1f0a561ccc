"""Instants of bounces, as given by stopwatches and labels of an audio editor."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...extend import counted
from ..signals import CLOCK
from ..tables.heading import Meaning
from ..tables.match import Match
from ..tables.sheet import Row, Sheet
from .intervals import Interval, Intervals
from .layout import DROP_HEIGHT, LABELS, Group, bounces_of

_PAUSE = 3.0
"""Ratio to the previous interval above which an interval separates two drops.

Even three merged flights of a ball without loss are not longer.
"""

_BOUNCE = re.compile(r"\W*(bounce|impact|hit|touch|contact|click|knock|new point|b)?[\W\d_]*")
"""Labels of a bounce, including "" and numbers."""


class Instants(Intervals):
    """Times of successive bounces; each two in succession bound an interval."""

    name = "instants"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "drop_height_m": DROP_HEIGHT,
        "trial": LABELS["trial"],
        "bounce": LABELS["bounce"],
        "label": Meaning("label, event, marker, mark, annotation, description"),
        "bounce_time_s": Meaning(
            "bounce time, bounce time s, time of bounce, impact time, time of impact, hit time, "
            "touch time, contact at, instant, onset, onset time, event time, total time, total, "
            "split time, split, overall time, overall, cumulative time, cumulative, race time, "
            f"start, start time, begin, {CLOCK.names}",
            "s",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("bounce_time_s",)
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
        trials: dict[Group, list[tuple[int, float, Row]]] = {}
        for row, group, bounce in bounces_of(rows):
            time = row.real("bounce_time_s")
            if math.isnan(time):
                row.refuse("bounce_time_s", "is empty")
            trials.setdefault(group, []).append((bounce, time, row))
        records = []
        for (ball, height, trial), own in trials.items():
            own.sort(key=lambda one: one[0])
            drop, last = 1, math.inf
            for (one, start, _), (two, end, row) in itertools.pairwise(own):
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
                    place = ball, row.number, name, one
                    records.append(
                        Interval(*place, drop_height=height, told=others, seconds=seconds)
                    )
                last = seconds
        self.check(rows, records, "bounce_time_s")
        return records

    def notes(self, records: Sequence[Interval]) -> tuple[str, ...]:
        paused = len({one.trial for one in records if ", " in one.trial})
        drops = f"{counted(paused + 1, ('drop', 'drops'))} separated by pauses"
        return (*super().notes(records), *[drops] * bool(paused))


def _bounces_in(rows: Sequence[Row]) -> tuple[Sequence[Row], tuple[str, ...]]:
    """Return the rows labelled as bounces (all if no label is), and a note on the others."""
    if not rows or "label" not in rows[0].values:
        return rows, ()
    labels = [str(row.values["label"] or "").strip().casefold() for row in rows]
    mine = [row for row, text in zip(rows, labels, strict=True) if _BOUNCE.fullmatch(text)]
    others = dict.fromkeys(itertools.filterfalse(_BOUNCE.fullmatch, labels))
    if not mine or not others:
        return rows, ()
    shown = ", ".join(f"'{text}'" for text in itertools.islice(others, 6))
    return mine, (f"labels other than bounces left out: {shown}",)
