"""Tracks from video: positions of a ball over time; parabolas give e, scale and tilt."""

from __future__ import annotations

import dataclasses
import itertools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from ...extend import STANDARD_GRAVITY, Flight, Words, counted, span, too_long, with_error
from ..tables.heading import Meaning
from ..tables.sheet import Row, Sheet
from ..track.model import Drop, Frames, Track
from .intervals import ratios_of
from .layout import LABELS, Layout, Paired, ReadingError, Record

_FEWEST = 10
_SHOWN = 6

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
            "x, x position, position x, pos x, x pos, x coordinate, cx, center x, centre x, "
            "x center, x centre, ball x, horizontal position",
            "m",
            or_unit="px",
        ),
        "y": Meaning(
            "y, height, height m, h, z, y position, position y, pos y, y pos, y coordinate, cy, "
            "center y, centre y, y center, y centre, ball y, vertical position",
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
        names: dict[tuple[str, str], list[Row]] = {}
        for row in rows:
            names.setdefault((row.place[0], row.text("trial", "1")), []).append(row)
        column, step = clock_of(rows, self.rate)
        records: list[Flown] = []
        empty: list[tuple[Frames, Track | None]] = []
        for (ball, trial), own in names.items():
            frames = frames_of(own, column, step)
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
        if why := _wrong_lengths(drops_of(records)):
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
            "e": _shown_e(drops),
        }

    def notes(self, records: Sequence[Flown]) -> tuple[str, ...]:
        drops, tracks = drops_of(records), tracks_of(records)
        rate = () if self.rate is None else (f"times by frames, {self.rate:g} per second",)
        return (*rate, *_camera_notes(drops), *_skipped_notes(tracks))

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
    return list({id(one.drop): one.drop for one in records}.values())


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


def clock_of(rows: Sequence[Row], rate: float | None) -> tuple[str, float]:
    """Return the column that gives the time of a frame, in which steps in s: frames with a `rate`.

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
        return "time", 1.0
    if "frame" in there:
        return "frame", 1 / rate
    if rows[0].has_unit("time") or not _is_count(rows, "time"):
        rows[0].refuse("time", f"gives times already; leave `rate` out, which is {rate:g}")
    return "time", 1 / rate


def _unit(rows: Sequence[Row]) -> str:
    """Return the unit of positions, "" if unwritten; raise RecordingError for two units."""
    there = [name for name in ("y", "x") if name in rows[0].headings]
    units = {name: unit.si if (unit := rows[0].headings[name].unit) else "" for name in there}
    if len(set(units.values())) > 1:
        told = " and ".join(f"{name} in {unit or 'no unit'}" for name, unit in units.items())
        rows[0].refuse("x", f"must have the unit of y, but the units are {told}")
    return units.get("y", "")


def frames_of(rows: Sequence[Row], column: str, step: float) -> Frames:
    """Return the frames in which the ball was detected, in order."""
    along = "x" in rows[0].values
    found = []
    for row in rows:
        y = _place(row, "y")
        x = _place(row, "x") if along else 0.0
        if math.isnan(x + y):
            continue
        t = row.real(column)
        if math.isnan(t):
            row.refuse(column, "is empty")
        found.append((t * step, x, y, row.number))
    found.sort()
    values = np.array(found).reshape(-1, 4)
    same = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if same.size:
        number = int(values[same[0] + 1, 3])
        row = next(one for one in rows if one.number == number)
        row.refuse(
            column,
            f"has two positions at {row.text(column)}; name several balls in a column "
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


_MOST_WRONG = 1.5
"""Factor by which heights in m contradict g; a misplaced length reference cannot explain it."""

_SURE = 3.0


def _mean(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Return the mean weighted by errors, and its standard error."""
    weight = np.array(errors) ** -2.0
    return float(weight @ np.array(values) / weight.sum()), float(weight.sum() ** -0.5)


def _fall(drops: Sequence[Drop]) -> tuple[float, float]:
    return _mean([d.camera.fall for d in drops], [d.camera.fall_error for d in drops])


def _camera_notes(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return notes on impacts and frames, and on scale and tilt of the camera."""
    impacts = sum(drop.impact.size for drop in drops)
    off = sum(int(drop.off.sum()) for drop in drops)
    errors = [1e3 * one for drop in drops for one in drop.error]
    notes = [
        f"{counted(impacts, ('impact', 'impacts'))} in {counted(len(drops), ('drop', 'drops'))}, "
        f"timed to {span(errors, 'ms')}",
        f"{counted(off, ('frame', 'frames'))} off the parabolas left out",
    ]
    if any(drop.frames.sign < 0 for drop in drops):
        notes.append("heights are counted downwards, as the ball falls to larger ones")
    return (*notes, _scale(drops), _tilt(drops), *_nearer(drops), *_air(drops))


def _scale(drops: Sequence[Drop]) -> str:
    """Return the scale of lengths implied by the known g."""
    fall, error = _fall(drops)
    unit = drops[0].frames.unit
    known = f"at g = {STANDARD_GRAVITY:g} m/s²"
    if unit == "m":
        off, spread = fall / STANDARD_GRAVITY - 1, error / STANDARD_GRAVITY
        told = f"the ball falls with {with_error(fall, error)} m/s²"
        if abs(off) <= _SURE * spread:
            return f"{told}, which agrees with g = {STANDARD_GRAVITY:g}"
        word = "long" if off > 0 else "short"
        return (
            f"{told}, but g is {STANDARD_GRAVITY:g}: lengths are {100 * abs(off):.2g} % too "
            f"{word}; speeds do not use them, but times and g"
        )
    scale = 1e3 * STANDARD_GRAVITY / fall
    word = "a pixel" if unit == "px" else "a unit of height"
    return f"{word} is {with_error(scale, scale * error / fall)} mm, {known}"


def _tilt(drops: Sequence[Drop]) -> str:
    tilts = [
        (math.degrees(d.camera.tilt), math.degrees(d.camera.tilt_error))
        for d in drops
        if d.camera.tilt is not None and d.camera.tilt_error is not None
    ]
    if not tilts:
        return "without x a rolled camera cannot be detected, and biases e of a drifting ball"
    tilt, error = _mean(*zip(*tilts, strict=True))
    side = "left" if tilt > 0 else "right"
    return f"the vertical leans to the {side} by {with_error(abs(tilt), error)}°, corrected"


def _nearer(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return whether the floor rises in the picture, and whether e could be separated from it."""
    several = [drop for drop in drops if drop.impact.size > 1]
    notes = []
    if len(several) < len(drops):
        notes.append("with one impact e cannot be separated from a floor that rises in the picture")
    if several:
        rise, error = _mean(*zip(*map(operator.attrgetter("rise"), several), strict=True))
        growth, spread = _mean(*zip(*map(operator.attrgetter("growth"), several), strict=True))
        unit = f" {drops[0].frames.unit}".rstrip()
        if abs(rise) > _SURE * error:
            word = "rises" if rise > 0 else "sinks"
            notes.append(
                f"the floor {word} in the picture by {with_error(abs(rise), error)}{unit} in a "
                "second (floor not level, or ball nearer): corrected"
            )
        if abs(growth) > _SURE * spread:
            word = "nearer" if growth > 0 else "farther away"
            shown = with_error(100 * abs(growth), 100 * spread)
            notes.append(f"the ball comes {word}, by {shown} % in a second: corrected")
    return tuple(notes)


def _air(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return the drag if significant; with drag, the way down takes longer than up."""
    beta, error = _mean(*zip(*[drop.air for drop in drops if drop.air], strict=True))
    if beta <= _SURE * error:
        return ()
    speed = STANDARD_GRAVITY / math.sqrt(beta)
    told = with_error(speed, speed * error / beta / 2)
    return (f"air drag in the flights: terminal speed {told} m/s",)


def _skipped_notes(tracks: Sequence[Track]) -> tuple[str, ...]:
    """Return the impacts that are not used, and why."""
    skipped = [one for track in tracks for one in track.skipped]
    if not skipped:
        return ()
    told = "; ".join(f"at {one.time:.3f} s, {one.why}" for one in skipped[:_SHOWN])
    more = f" and {len(skipped) - _SHOWN} more" if len(skipped) > _SHOWN else ""
    return (f"doubtful and not used: {len(skipped)} ({told}{more})",)


def _wrong_lengths(drops: Sequence[Drop]) -> str:
    """Return why heights in m contradict g, with a guess; "" if they agree."""
    fall, _ = _fall(drops)
    ratio = fall / STANDARD_GRAVITY
    if drops[0].frames.unit != "m" or 1 / _MOST_WRONG < ratio < _MOST_WRONG:
        return ""
    slow = f"are times of slow motion, {ratio**-0.5:.3g} times too long? or " if ratio < 1 else ""
    return (
        f"falls with {fall:.3g} m/s², but g is {STANDARD_GRAVITY:g}; {slow}are lengths in another "
        "unit? then write it in the heading, 'y [px]' if unknown"
    )


def _shown_e(drops: Sequence[Drop]) -> str:
    """Return e of the first impacts in vacuum, with standard errors."""
    told = []
    for drop in drops:
        seconds = drop.seconds
        for k in range(drop.impact.size):
            slope = np.zeros(seconds.size)
            slope[k], slope[k + 1] = -1 / seconds[k], 1 / seconds[k + 1]
            e = float(seconds[k + 1] / seconds[k])
            told.append(with_error(e, e * math.sqrt(float(slope @ drop.covariance @ slope))))
    more = ", ..." if len(told) > _SHOWN else ""
    return ", ".join(told[:_SHOWN]) + more
