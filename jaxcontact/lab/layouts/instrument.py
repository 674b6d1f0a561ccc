"""Instrument records: force, acceleration or indentation over time, with impacts in them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from ...extend import Flight, Words, counted, span
from ..signals import CLOCK, Doubtful, Floats, Trace, column_of, even, hum_of, noise_of
from ..tables.heading import Meaning
from ..tables.sheet import RecordingError, Row
from .layout import Layout, Paired, Record

_SHOWN = 6

HALF = 0.6
"""Approximate fraction of a contact during which its force exceeds half of its maximum."""

LEAST_READINGS = 8
"""Least readings of a contact from which its shape can be fitted."""

_FEWEST = 3 * LEAST_READINGS

_CLEAR = 6.0
"""Standard deviations of the noise by which a contact rises, after a mean over a fifth of it."""

_DIP = 5.0, 0.1
"""Depth of the dip between two contacts, in deviations and as a fraction of their height."""

_AROUND = 16.0
"""Widths at half height over which the level without contact is a running median."""

_MARGIN, _BESIDE = 0.3, 1.0
"""Contact durations that must be free before and after a contact, and that are kept if free."""

_BELOW, _BETWEEN, _STEP = 0.35, 4.0, 5.0
"""Limits of a contact that can be fitted.

A swing below the level by the first fraction of the height is not a pushing contact. Levels before
and after agree within the second number of errors. Contacts differ in length by less than the third
factor.
"""

_EDGES = 0.1, 0.3
"""Contact durations before the touch and after the end that may belong to a contact."""


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedImpact(Record):
    """One impact in a record: its `number`, from 1, and the `trace` that holds it.

    `touch`, `end` (both approximate) and the window [start, stop) are in numbers of readings.
    """

    number: int
    trace: Trace
    touch: float
    end: float
    start: int
    stop: int

    @property
    def time(self) -> Floats:
        """The times (n,) in s of the window."""
        return self.trace.time[self.start : self.stop]

    @property
    def reading(self) -> Floats:
        """The readings (n,) of the window relative to the level without contact."""
        value = self.trace.value[self.start : self.stop]
        if self.trace.quantity == "indentation":
            return value
        inside = np.arange(self.start, self.stop)
        free = (inside < self.touch) | (inside > self.end)
        return value - float(np.median(value[free]))

    @property
    def duration(self) -> float:
        """The approximate contact time in s."""
        return (self.end - self.touch) * self.trace.step


class Records(Layout[RecordedImpact]):
    """Readings of an instrument over time while bodies collide.

    Impacts are separated, and each is fitted with its time of touch and zero level. A subclass
    gives the measured `quantity`, its `headings` and `unit`, and `must_say` as in `Meaning`.
    """

    quantity: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    measured: ClassVar[tuple[str, ...]]
    meanings: ClassVar[Mapping[str, Meaning]]
    made_of: ClassVar[str]
    fitted = True
    instead: ClassVar[Mapping[str, str]] = {"time": "; or give `rate`, the readings per second"}
    pair_words: ClassVar[Words] = ("impact", "impacts")
    cluster_words: ClassVar[Words] = ("impact", "impacts")
    pair_rule = "each impact found in the record is one"
    errors_words = "by impact (sandwich), valid if the scatter differs between impacts"
    known_errors: ClassVar[Words] = (
        "errors from the noise of the readings of each impact, scatter fitted",
        "from the noise of the readings of each impact, and the scatter between impacts",
    )

    def __init_subclass__(cls, quantity: str, headings: str, unit: str, must_say: str = "") -> None:
        cls.name = cls.quantity = quantity
        cls.measured = ("time", quantity)
        cls.meanings = {"time": CLOCK, quantity: Meaning(headings, unit, must_say=must_say)}
        cls.made_of = f"impacts in a record of {quantity}"
        super().__init_subclass__()

    def read(self, rows: Sequence[Row]) -> list[RecordedImpact]:
        clock, value = column_of(rows, "time"), column_of(rows, self.quantity)
        time, notes = even(rows, clock)
        if time.size < _FEWEST:
            problem = f"holds {time.size} readings, too few for an impact: its contact takes 8"
            raise RecordingError(problem, rows[0].source, rows[0].number)
        if np.ptp(value) == 0:
            rows[0].refuse(self.quantity, f"is {value[0]:g} everywhere")
        trace, cuts = self.cut(time, value)
        trace = dataclasses.replace(trace, notes=(*notes, *trace.notes))
        if not cuts:
            self._refuse(rows, trace)
        return [
            RecordedImpact("", rows[round(one.touch)].number, k, trace, *one[:2], *one[3:])
            for k, one in enumerate(cuts, 1)
        ]

    def cut(self, time: Floats, value: Floats) -> tuple[Trace, list[Cut]]:
        """Return the trace and the impacts in it."""
        return cut(self.quantity, time, value)

    def _refuse(self, rows: Sequence[Row], trace: Trace) -> None:
        noise = shown(self.quantity, trace.noise)
        if not trace.doubtful:
            problem = (
                f"no impact was found: nothing exceeds the noise of {noise} in "
                f"{trace.time[-1] - trace.time[0]:.3g} s"
            )
        else:
            problem = f"no usable impact was found: {_doubts(trace)}"
            if any("readings of the contact" in one.why for one in trace.doubtful):
                problem += (
                    f"; a contact needs at least {LEAST_READINGS} readings, better 50: sample "
                    f"faster than {1 / trace.step:.3g} Hz"
                )
        rows[0].refuse(self.quantity, problem)

    def facts(self, records: Sequence[RecordedImpact]) -> Mapping[str, str]:
        trace, durations = records[0].trace, [1e3 * one.duration for one in records]
        return {
            "rows": str(trace.time.size),
            "rate": f"{1 / trace.step:.6g} Hz, {trace.time[-1] - trace.time[0]:.4g} s",
            "impacts": f"{len(records)}, of about {span(durations, 'ms')}",
            "largest": shown(self.quantity, max(float(r.reading.max()) for r in records)),
        }

    def notes(self, records: Sequence[RecordedImpact]) -> tuple[str, ...]:
        trace = records[0].trace
        per = span([one.duration / trace.step for one in records], "readings each")
        times = ", ".join(f"{one.time[0]:.4g}" for one in records[:_SHOWN])
        more = f" and {len(records) - _SHOWN} more" if len(records) > _SHOWN else ""
        found = counted(len(records), self.pair_words)
        notes = [
            *trace.notes,
            f"{found} found, at {times}{more} s, of about {per}; noise of one reading "
            f"{shown(self.quantity, trace.noise)}",
        ]
        if trace.doubtful:
            left = len(trace.doubtful) - _SHOWN
            more = f" and {left} more" if left > 0 else ""
            notes.append(f"doubtful and not used: {len(trace.doubtful)} ({_doubts(trace)}{more})")
        return tuple(notes)

    def pair(self, records: Sequence[RecordedImpact], flight: Flight) -> Paired[RecordedImpact]:
        raise RecordingError(
            "holds records of impacts, whose e needs a fit; use `calibrate(recording, mass=...)`",
            "the recording",
        )


def _doubts(trace: Trace) -> str:
    return "; ".join(f"at {one.time:.4g} s {one.why}" for one in trace.doubtful[:_SHOWN])


class Forces(
    Records,
    quantity="force",
    headings="force, f, fz, f z, normal force, vertical force, contact force, force z, fn, f n, "
    "fy up, vgrf, grf, ground reaction force, load, load cell",
    unit="N",
):
    """A force over time, as read by a force plate or a load cell."""


class Accelerations(
    Records,
    quantity="acceleration",
    headings="acceleration, accel, acc, a, ax, ay, az, a x, a y, a z, acceleration x, "
    "acceleration y, acceleration z, linear acceleration x, linear acceleration y, "
    "linear acceleration z, deceleration",
    unit="m/s^2",
    must_say="m/s² or g",
):
    """The acceleration of the body over time, as read by an accelerometer on it."""


class Indentations(
    Records,
    quantity="indentation",
    headings="indentation, penetration, deformation, compression, displacement, deflection, "
    "approach, δ, delta",
    unit="m",
):
    """The indentation of one impact over time; its zero is approximately at touch."""

    def cut(self, time: Floats, value: Floats) -> tuple[Trace, list[Cut]]:
        """Return the trace and the one contact around the largest indentation."""
        top = int(np.argmax(value))
        out = np.flatnonzero(value <= 0)
        before, after = out[out < top], out[out > top]
        trace = Trace("indentation", time, value, np.zeros_like(value), noise_of(value))
        if value[top] <= 0 or not before.size or not after.size:
            why = "its indentation does not pass zero, which must be about that of touch, on both "
            return dataclasses.replace(
                trace, doubtful=(Doubtful(float(time[top]), why + "sides"),)
            ), []
        touch, end = float(before[-1]), float(after[0])
        margin = round(end - touch)
        window = max(int(touch) - margin, 0), min(int(end) + margin, value.size)
        return trace, [Cut(touch, end, float(value[top]), *window)]


class Cut(NamedTuple):
    """A contact in numbers of readings: approximate touch and end, and the window [start, stop).

    `height` is its height. The window includes free readings beside the contact.
    """

    touch: float
    end: float
    height: float
    start: int
    stop: int


def cut(quantity: str, time: Floats, value: Floats) -> tuple[Trace, list[Cut]]:
    """Return the record, with its noise and without hum, and its contacts that can be fitted."""
    from scipy.ndimage import median_filter, uniform_filter1d

    notes = []
    middle = float(np.median(value))
    smooth = median_filter(value, 3)
    if smooth.max() - middle < middle - smooth.min():
        value, smooth, middle = -value, -smooth, -middle
        notes.append("sign reversed, since contacts are negative in the file")
    noise, width = noise_of(value), _width(smooth, middle)
    level = _level(value, width)
    hum = hum_of(time, value, _quiet(smooth - level, noise, width), noise)
    if hum is not None:
        value = value - hum.value
        noise, width = noise_of(value), _width(median_filter(value, 3), float(np.median(value)))
        level = _level(value, width)
        size = shown(quantity, hum.amplitude)
        notes.append(f"hum of {hum.frequency:.1f} Hz subtracted, {size} in amplitude")
    mean = uniform_filter1d(value - level, max(width // 5, 1))
    found, good, doubtful = _contacts(mean, noise), [], []
    for k, one in enumerate(found):
        before = found[k - 1].end if k else -math.inf
        after = found[k + 1].touch if k + 1 < len(found) else math.inf
        made = _add_window(one, before, after, value.size)
        why = made if isinstance(made, str) else _doubt(made, found, mean, value, noise)
        if why:
            doubtful.append(Doubtful(float(time[min(max(int(one.touch), 0), time.size - 1)]), why))
        else:
            good.append(made)
    doubtful.sort()
    return Trace(quantity, time, value, level, noise, tuple(doubtful), tuple(notes)), good


def shown(quantity: str, number: float) -> str:
    """Return a reading with its unit."""
    unit = {"force": "N", "acceleration": "m/s²", "indentation": "m"}[quantity]
    return f"{number:.3g} {unit}"


def _width(smooth: Floats, middle: float) -> int:
    """Return the width in readings of the largest excursion at half height."""
    top = int(np.argmax(smooth))
    left, right = _half(smooth - middle, top)
    return max(int(right - left), 1)


def _half(height: Floats, top: int) -> tuple[float, float]:
    """Return the positions at half height around a peak, in numbers of readings."""
    half = height[top] / 2

    def crossing(side: Floats) -> float:
        """Return the distance from the peak, the first of `side`, to half of its height."""
        below = np.flatnonzero(side < half)
        if not below.size:
            return side.size - 1.0
        k = int(below[0])
        return k - float((half - side[k]) / (side[k - 1] - side[k]))

    return top - crossing(height[top::-1]), top + crossing(height[top:])


def _level(value: Floats, width: int) -> Floats:
    """Return a running median, long compared with a contact, which follows steps of the level."""
    from scipy.ndimage import median_filter

    block = max(width // 4, 1)
    count = max(value.size // block, 1)
    means = np.median(value[: count * block].reshape(count, -1), axis=1)
    size = min(int(_AROUND * width / block) // 2 * 2 + 1, 2 * count - 1)
    found = median_filter(means, size, mode="nearest")
    at = (np.arange(count) + 0.5) * block - 0.5
    return np.interp(np.arange(value.size), at, found)


def _quiet(height: Floats, noise: float, width: int) -> np.ndarray:
    """Return the mask (n,) of readings far from contacts; hum may exceed the noise."""
    from scipy.ndimage import uniform_filter1d

    most = max(5 * noise, 6 * float(np.median(np.abs(height))))
    return uniform_filter1d((np.abs(height) > most).astype(float), 2 * width + 1) < 1e-9


def _contacts(mean: Floats, noise: float) -> list[Cut]:
    """Return the peaks that exceed the noise and the adjacent dips."""
    from scipy.signal import find_peaks, peak_prominences

    # SciPy does not find a plateau at the edge of a record.
    low = float(mean.min()) - noise
    within = np.concatenate([[low], mean, [low]])
    tops = find_peaks(within, height=_CLEAR * noise)[0]
    prominence = peak_prominences(within, tops)[0]
    tops = tops[prominence >= np.maximum(_DIP[0] * noise, _DIP[1] * within[tops])] - 1
    found = []
    for top in tops:
        left, right = _half(mean, int(top))
        beside = (1 - HALF) / HALF / 2 * (right - left)
        found.append(Cut(left - beside, right + beside, float(mean[top]), 0, 0))
    return found


def _add_window(one: Cut, before: float, after: float, size: int) -> Cut | str:
    """Return the contact with the free readings around it, or why there are too few."""
    long = one.end - one.touch
    if one.touch - before < 0 or after - one.end < 0:
        return "a double contact"
    if one.touch - before < _MARGIN * long or after - one.end < _MARGIN * long:
        return "another contact is too near"
    if one.touch < _MARGIN * long:
        return "cut off by the beginning of the record"
    if size - one.end < _MARGIN * long:
        return "cut off by the end of the record"
    start = max(one.touch - _BESIDE * long, before + 0.1 * long, 0)
    stop = min(one.end + _BESIDE * long, after - 0.1 * long, size)
    return one._replace(start=math.ceil(start), stop=math.floor(stop))


def _doubt(one: Cut, found: list[Cut], mean: Floats, value: Floats, noise: float) -> str:
    """Return why a contact cannot be fitted, "" if it can."""
    long = one.end - one.touch
    if long < LEAST_READINGS:
        return f"only {long:.0f} readings of the contact"
    usual = float(np.median([other.end - other.touch for other in found]))
    if not usual / _STEP < long < usual * _STEP:
        return f"lasts {long / usual:.2g} times as long as the others"
    if mean[one.start : one.stop].min() < -max(_BELOW * one.height, _CLEAR * noise):
        return "swings below zero, as the ringing of an instrument does"
    # A contact with loss ends slowly, later than its width at half height implies.
    last_before, first_after = one.touch - _EDGES[0] * long, one.end + _EDGES[1] * long
    sides = value[one.start : math.floor(last_before)], value[math.ceil(first_after) : one.stop]
    if min(map(len, sides)) < 2:
        return ""
    error = noise * math.sqrt(sum(1 / side.size for side in sides))
    first, last = (float(side.mean()) for side in sides)
    if abs(last - first) > max(_BETWEEN * error, 0.05 * one.height):
        return "the level after it differs from that before"
    return ""
