"""Tracks from video: positions of a ball over time; parabolas give e, scale and tilt."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...extend import Flight, Words, counted, span, too_long
from ..tables.heading import Meaning
from ..tables.sheet import Row, Sheet
from ..track.model import Drop, Frames, Track
from .intervals import ratios_of
from .layout import LABELS, Layout, Paired, ReadingError, Record
from .track_words import camera_notes, shown_e, skipped_notes, wrong_lengths

_FEWEST = 10

_Name = tuple[str, str]
"""Names of a ball and of a trial."""

_MISSING = ("nan", "none", "na", "n/a", "null", "-")


@dataclasses.dataclass(frozen=True, eq=False)
class Flown(Record):
    """One flight in a track: its `number` in the `drop`, the `trial`, and the `track` of the ball.

    Flight 0 is the first; the track holds only part of it.
    """

    trial: str
    number: int
    drop: Drop
    track: Track

    @property
    def seconds(self) -> float:
        """The duration of the flight in s."""
        return float(self.drop.seconds[self.number])


@dataclasses.dataclass(frozen=True)
class Tracks(Layout[Flown]):
    """Positions of a ball over time, from video trackers; `rate` is frames per second."""

    rate: float | None = None

    name = "track"
    measured: ClassVar[tuple[str, ...]] = ("time", "y")
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": Meaning(f"{LABELS['ball'].names}, particle, track, track id"),
        "trial": LABELS["trial"],
        "time": Meaning("time, t, timestamp, time stamp, elapsed time", "s"),
        "frame": Meaning(
            "frame, frame number, frame no, frame nr, frame index, frame id, frame idx"
        ),
        "x": Meaning(
            "x, x position, position x, pos x, x pos, x coordinate, cx, center x, "
            "centre x, x center, x centre, ball x, horizontal position",
            "m",
            or_unit="px",
        ),
        "y": Meaning(
            "y, height, height m, h, z, y position, position y, pos y, y pos, "
            "y coordinate, cy, center y, centre y, y center, y centre, ball y, "
            "vertical position",
            "m",
            or_unit="px",
        ),
    }
    reading_error: ClassVar[ReadingError | None] = ReadingError("s", "ms", 1e3, "each flight time")
    uses_flight = True
    flight: ClassVar[tuple[str, str, str] | None] = ("intervals", "seconds", "seconds")
    instead: ClassVar[Mapping[str, str]] = {
        "time": "; or give the `rate` in frames per second: rows are frames"
    }
    made_of = "flight times between the impacts of a track"
    pair_words: ClassVar[Words] = ("impact between two flights", "impacts between two flights")
    cluster_words: ClassVar[Words] = ("drop", "drops")
    pair_rule = "an impact counts if the track shows the flights before and after it"
    errors_words = (
        "by drop (cluster-robust sandwich): successive ratios share a flight, which correlates "
        "them within a drop"
    )

    def at_rate(self, rate: float | None) -> Tracks:
        return Tracks(rate)

    def lacking(self, there: Iterable[str]) -> list[str]:
        """Return the missing columns; frame numbers replace times."""
        missing = super().lacking(there)
        return [one for one in missing if one != "time" or "frame" not in there]

    def read(self, rows: Sequence[Row]) -> list[Flown]:
        from ..track.finding import follow

        if not rows:
            return []
        names: dict[_Name, list[Row]] = {}
        for row in rows:
            names.setdefault((row.place[0], row.text("trial", "1")), []).append(row)
        clock = clock_of(rows, self.rate)
        records: list[Flown] = []
        empty: list[tuple[Frames, Track | None]] = []
        for (ball, trial), own in names.items():
            frames = frames_of(own, clock)
            track = follow(frames) if frames.time.size >= _FEWEST else None
            if track is None or not track.drops:
                empty.append((frames, track))
                continue
            records += _flights_of(ball, trial, track)
        if not records:
            frames, track = max(empty, key=lambda one: one[0].time.size)
            rows[0].refuse("y", _nothing(frames, track))
        self._check(rows, records)
        return records

    def _check(self, rows: Sequence[Row], records: Sequence[Flown]) -> None:
        if why := too_long([record.seconds for record in records]):
            rows[0].refuse("time", f"{why}, or write the unit in the heading, 'time [ms]'")
        if why := wrong_lengths(drops_of(records)):
            rows[0].refuse("y", why)

    def facts(self, records: Sequence[Flown]) -> Mapping[str, str]:
        drops = drops_of(records)
        frames = sum(track.frames.time.size for track in tracks_of(records))
        used = sum(int(drop.used.sum()) for drop in drops)
        return {
            "rows": f"{frames} frames, {used} of them in flights",
            "drops": str(len(drops)),
            "impacts": str(sum(drop.impact.size for drop in drops)),
            "flights": span([record.seconds for record in records], "s"),
            "e": shown_e(drops),
        }

    def notes(self, records: Sequence[Flown]) -> tuple[str, ...]:
        drops, tracks = drops_of(records), tracks_of(records)
        rate = () if self.rate is None else (f"times by frames, {self.rate:g} per second",)
        return (*rate, *camera_notes(drops), *skipped_notes(tracks))

    def pair(self, records: Sequence[Flown], flight: Flight) -> Paired[Flown]:
        of: dict[int, list[Flown]] = {}
        for record in records:
            of.setdefault(id(record.drop), []).append(record)
        drops = [_in_air(own[0].drop, flight) for own in of.values()]
        couples = [couple for own in of.values() for couple in itertools.pairwise(own)]
        seconds = [drop.seconds for drop in drops]
        t1 = np.concatenate([one[:-1] for one in seconds] or [np.zeros(0)])
        t2 = np.concatenate([one[1:] for one in seconds] or [np.zeros(0)])
        velocity, restitution, p, q = ratios_of(t1, t2, flight)
        covariance, start = np.zeros((t1.size, t1.size)), 0
        for drop in drops:
            at = start + np.arange(drop.impact.size)
            slope = np.zeros((at.size, at.size + 1))
            slope[at - start, at - start], slope[at - start, at - start + 1] = -q[at], p[at]
            covariance[np.ix_(at, at)] = slope @ drop.covariance @ slope.T
            start += at.size
        variance = [np.diag(drop.covariance) for drop in drops]
        # The flight cut off by the end of the track has a far larger error than the others.
        square = float(np.median(np.concatenate(variance))) if variance else 1.0
        return Paired(
            velocity=velocity,
            restitution=restitution,
            reading_factor=np.diag(covariance) / square,
            clusters=[f"drop {first.trial}" for first, _ in couples],
            records=couples,
            covariance=covariance,
            reading=math.sqrt(square),
        )


def counts_frames(headings: Iterable[str]) -> bool:
    """Return whether a table is a track with numbered frames, not an instrument record."""
    known = Tracks.meanings
    return any(known[name].heading(text) for name in ("frame", "y") for text in headings)


def with_frames(sheet: Sheet, rate: float) -> Sheet:
    """Return the sheet with a column of frame numbers, if it has neither these nor times.

    The rows of one ball are its frames; in a table of several they are not.
    """
    labels = [Tracks.meanings[name] for name in ("frame", "time", "ball", "trial")]
    own = [text for text in sheet.names if any(one.heading(text) for one in labels)]
    note = f"rows are frames, {rate:g} per second"
    return sheet if own else sheet.beside("frame", lambda k, _: k, note)


def drops_of(records: Iterable[Any]) -> list[Drop]:
    """Return the drops of flights, each once."""
    return list({id(one.drop): one.drop for one in records if isinstance(one, Flown)}.values())


def tracks_of(records: Iterable[Any]) -> tuple[Track, ...]:
    """Return the tracks of flights, each once; empty for other records."""
    return tuple({id(one.track): one.track for one in records if isinstance(one, Flown)}.values())


def _in_air(drop: Drop, flight: Flight) -> Drop:
    if flight.drag is None:
        return drop
    from ..track.fitting import refit, shape_of

    beta = (flight.gravity / flight.drag.terminal_speed(flight.gravity)) ** 2
    return refit(drop, shape_of(flight), beta)


def _flights_of(ball: str, trial: str, track: Track) -> list[Flown]:
    several = len(track.drops) > 1
    records = []
    for k, drop in enumerate(track.drops, 1):
        name = f"{trial}, {k}" if several else trial
        time, row = drop.frames.time, drop.frames.row
        places = [float(time[drop.used][0]), *drop.impact]
        for number, at in enumerate(places):
            frame = min(int(np.searchsorted(time, at)), time.size - 1)
            records.append(Flown(ball, int(row[frame]), name, number, drop, track))
    return records


def _nothing(frames: Frames, track: Track | None) -> str:
    """Return why a track holds no bounces, and what to do."""
    count = counted(frames.time.size, ("frame", "frames"))
    peaks = '; if these are heights of successive flights, say so with `columns="height_m=..."`'
    if track is None:
        return f"is a track of {count}, too few for an impact between two flights{peaks}"
    seconds = float(frames.time[-1] - frames.time[0])
    whole = f"is a track of {count} in {seconds:.3g} s"
    if not track.skipped:
        return (
            f"{whole} without a fall followed by a rise: no bounce, or fewer than 4 frames in a "
            f"flight{peaks}"
        )
    first = "; ".join(f"at {one.time:.3f} s {one.why}" for one in track.skipped[:6])
    more = ", ..." if len(track.skipped) > 6 else ""
    return (
        f"{whole} without a usable bounce between two flights ({first}{more}); each flight needs "
        "at least 4 frames besides those of the impact: film faster, or drop higher"
    )


class Clock(NamedTuple):
    """The `column` that gives the time of a frame, in steps of `step` s."""

    column: str
    step: float


def clock_of(rows: Sequence[Row], rate: float | None) -> Clock:
    """Return the clock of a track: frame numbers with a `rate`, otherwise times.

    A column of times that counts 0, 1, 2, ... numbers frames. Raises RecordingError for frame
    numbers without a rate, and for times with one.
    """
    there = rows[0].values
    if rate is None:
        if "time" not in there:
            rows[0].refuse("frame", "counts frames; give the frames per second as `rate`")
        if not rows[0].has_unit("time") and _is_count(rows, "time"):
            rows[0].refuse(
                "time",
                "counts 0, 1, 2, ...; are these frames? then give the frames per second as "
                "`rate`, or write the unit in the heading, 'time [s]'",
            )
        return Clock("time", 1.0)
    if "frame" in there:
        return Clock("frame", 1 / rate)
    if rows[0].has_unit("time") or not _is_count(rows, "time"):
        rows[0].refuse("time", f"gives times already; leave `rate` out, which is {rate:g}")
    return Clock("time", 1 / rate)


def _unit(rows: Sequence[Row]) -> str:
    """Return the unit of positions, "" if unwritten; raise RecordingError for two units."""
    there = [name for name in ("y", "x") if name in rows[0].headings]
    units = {name: unit.si if (unit := rows[0].headings[name].unit) else "" for name in there}
    if len(set(units.values())) > 1:
        told = " and ".join(f"{name} in {unit or 'no unit'}" for name, unit in units.items())
        rows[0].refuse("x", f"must have the unit of y, but the units are {told}")
    return units.get("y", "")


def frames_of(rows: Sequence[Row], clock: Clock) -> Frames:
    """Return the frames in which the ball was detected, in order."""
    along = "x" in rows[0].values
    found = []
    for row in rows:
        y = _place(row, "y")
        x = _place(row, "x") if along else 0.0
        if math.isnan(x + y):
            continue
        t = row.real(clock.column)
        if math.isnan(t):
            row.refuse(clock.column, "is empty")
        found.append((t * clock.step, x, y, row.number))
    found.sort()
    values = np.array(found).reshape(-1, 4)
    same = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if same.size:
        number = int(values[same[0] + 1, 3])
        row = next(one for one in rows if one.number == number)
        row.refuse(
            clock.column,
            f"has two positions at {row.text(clock.column)}; name several balls in a column "
            "`particle`, and choose one with `ball=`",
        )
    x = values[:, 1] if along else None
    return Frames(values[:, 0], values[:, 2], x, values[:, 3], unit=_unit(rows))


def _place(row: Row, column: str) -> float:
    """Return a position; NaN if the ball was not detected."""
    value = row.values[column]
    missing = isinstance(value, str) and value.strip().casefold() in _MISSING
    return math.nan if missing else row.real(column)


def _is_count(rows: Sequence[Row], column: str) -> bool:
    """Return whether a column counts 0, 1, 2, ..., possibly with gaps."""
    values = np.sort([row.real(column) for row in rows])
    whole = bool(np.all(values == np.round(values)))
    return whole and values.size > 1 and float(np.median(np.diff(np.unique(values)))) == 1
