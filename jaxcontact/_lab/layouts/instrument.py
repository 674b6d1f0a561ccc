"""Instrument records: force, acceleration or indentation over time, with impacts in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ..._flight import Flight
from ..._text.words import counted, span
from ..signals.clock import CLOCK, column_of, even
from ..signals.cut import LEAST_READINGS, Cut, cut, shown
from ..signals.trace import Doubtful, Floats, Trace, noise_of
from ..tables.fault import RecordingError
from ..tables.heading import Meaning, words
from ..tables.sheet import Row
from .layout import Layout, Paired, Record

_SHOWN = 6
_FEWEST = 3 * LEAST_READINGS


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
    fitted = True
    instead = MappingProxyType({"time": "; or give `rate`, the readings per second"})
    pair_words = ("impact", "impacts")
    cluster_words = ("impact", "impacts")
    pair_rule = "each impact found in the record is one"
    errors_words = "by impact (sandwich), valid if the scatter differs between impacts"
    known_errors = (
        "errors from the noise of the readings of each impact, scatter fitted",
        "from the noise of the readings of each impact, and the scatter between impacts",
    )

    def __init_subclass__(cls, quantity: str, headings: str, unit: str, must_say: str = ""):
        cls.name = cls.quantity = quantity
        cls.columns = cls.measured = ("time", quantity)
        meaning = Meaning(words(headings), unit, must_say=must_say)
        cls.meanings = MappingProxyType({"time": CLOCK, quantity: meaning})
        cls.made_of = f"impacts in a record of {quantity}"

    def at_rate(self, rate: float | None) -> Records:
        return self  # its times already include the rate

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
            told = "; ".join(f"at {one.time:.4g} s {one.why}" for one in trace.doubtful[:_SHOWN])
            problem = f"no usable impact was found: {told}"
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
            told = "; ".join(f"at {one.time:.4g} s {one.why}" for one in trace.doubtful[:_SHOWN])
            left = len(trace.doubtful) - _SHOWN
            more = f" and {left} more" if left > 0 else ""
            notes.append(f"doubtful and not used: {len(trace.doubtful)} ({told}{more})")
        return tuple(notes)

    def pair(self, records: Sequence[RecordedImpact], flight: Flight) -> Paired[RecordedImpact]:
        raise RecordingError(
            "holds records of impacts, whose e needs a fit; use `calibrate(recording, mass=...)`",
            "the recording",
        )


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
