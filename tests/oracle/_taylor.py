"""Taylor-series integration of one scaled impact in fixed-point integers.

``x'' = push - f(x, x')`` has fractional powers of ``x`` and therefore no Taylor series at touch.
With ``x = w**q`` and ``dt = w**(q-1) ds`` it becomes ``w' = v/q``, ``v' = w**(q-1) (push - f)``,
``t' = w**(q-1)``. This is a polynomial for every rational exponent, whose series follows from
convolutions alone. A number is a Python integer times ``2**-bits``. Integers are thirty times
faster than arbitrary-precision floats and cannot overflow.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import mul

from mpmath import mp, mpf

# A term (c, i, j) stands for c * w**i * v**j, with j in {0, 1}.
Term = tuple[mpf, int, int]

# Order and precision. With 60 terms a step may span 12 % of the radius of convergence. 340 bits
# leave some fifty digits in reserve for rebounds as slow as 1e-12 of the approach, and for second
# differences.
ORDER = 60
BITS = 340
TAIL_DIGITS = 56
MAX_STEPS = 20_000


@dataclass(frozen=True)
class Phase:
    """A stretch of motion under one smooth force; ``stops`` maps an event's name to its terms
    (crossed downwards).

    The event named "next" hands over to the phase that follows; any other ends the motion. An event
    is looked for only before those listed ahead of it, so that separation, where the series stops
    to mean anything, goes first.
    """

    force: Sequence[Term]
    stops: dict[str, Sequence[Term]]
    push: mpf | int = 0


@dataclass
class Trace:
    """What was met on the way, in scaled units; ``stopped`` names the event that ended the last
    phase, and ``last_max_force`` is the largest force in it.
    """

    velocity: mpf
    duration: mpf
    compression_time: mpf | None
    max_indentation: mpf | None
    max_force: mpf
    min_force: mpf
    last_max_force: mpf
    stopped: str


class _Series:
    """Taylor coefficients, in units of the step, of the state and of any polynomial of it."""

    def __init__(self, w: int, v: int, t: int, bits: int):
        self.bits = bits
        self.w, self.v, self.t = [w], [v], [t]
        self._powers: dict[int, list[int]] = {0: [1 << bits]}

    def power(self, i: int, k: int) -> list[int]:
        """Coefficients up to the k-th of w**i (extended on demand)."""
        if i == 1:
            return self.w
        known = self._powers.setdefault(i, [])
        if i == 0:
            known.extend([0] * (k + 1 - len(known)))
        while len(known) <= k:
            m = len(known)
            low, high = self.power(i // 2, m), self.power(i - i // 2, m)
            known.append(_convolve(low, high, m, self.bits))
        return known

    def polynomial(self, terms: Iterable[tuple[int, int, int]], k: int) -> int:
        """The k-th coefficient of a sum of terms whose factors are fixed-point integers."""
        total = 0
        for c, i, j in terms:
            w = self.power(i, k)
            total += c * (_convolve(w, self.v, k, self.bits) if j else w[k])
        return total >> self.bits


def _convolve(a: list[int], b: list[int], k: int, bits: int) -> int:
    return sum(map(mul, a[: k + 1], b[k::-1])) >> bits


def _horner(c: list[int], s: int, bits: int) -> int:
    total = 0
    for x in reversed(c):
        total = (total * s >> bits) + x
    return total


def _derivative(c: list[int]) -> list[int]:
    return [k * x for k, x in enumerate(c)][1:]


def _descent(c: list[int], end: int, bits: int) -> int | None:
    """The first place in (0, end] where a series falls from positive to zero or below."""
    # A step spans an eighth of the radius of convergence. A check at the end itself detects a force
    # that vanishes just before the indentation. Four checks find every pair of roots.
    places = [end * i // 4 for i in range(5)]
    for left, right in itertools.pairwise(places):
        if _horner(c, left, bits) > 0 >= _horner(c, right, bits):
            while right - left > 1:
                middle = (left + right) // 2
                if _horner(c, middle, bits) > 0:
                    left = middle
                else:
                    right = middle
            return right
    return None


def shoot(q: int, phases: Sequence[Phase], *, order: int = ORDER, bits: int = BITS) -> Trace:
    """Follows ``x = w**q`` from touch at unit speed by phases, each to the first of its stops."""
    one = 1 << bits

    def fix(x: mpf) -> int:
        return int(mp.floor(mp.ldexp(x, bits)))

    def unfix(x: int) -> mpf:
        return mp.ldexp(mpf(x), -bits)

    def fixed(terms: Iterable[Term]) -> list[tuple[int, int, int]]:
        return [(fix(c), i, j) for c, i, j in terms]

    w, v, t = 0, one, 0
    turn = indentation = None
    peak = last_peak = least = 0
    stopped = ""
    step = one // 16
    with mp.workprec(bits + 40):
        want = mp.power(10, -mpf(TAIL_DIGITS) / order)
        for phase in phases:
            force = fixed(phase.force)
            stops = {name: fixed(terms) for name, terms in phase.stops.items()}
            right_side = [(-c, i + q - 1, j) for c, i, j in force]
            if phase.push:
                right_side.append((fix(phase.push), q - 1, 0))
            stopped, last_peak = "", 0
            for _ in range(MAX_STEPS):
                while True:
                    series = _Series(w, v, t, bits)
                    for k in range(order):
                        acceleration = series.polynomial(right_side, k)
                        pace = series.power(q - 1, k)[k]
                        series.w.append((step * series.v[k] >> bits) // (q * (k + 1)))
                        series.v.append((step * acceleration >> bits) // (k + 1))
                        series.t.append((step * pace >> bits) // (k + 1))
                    # Each component is measured relative to the larger of itself and its change in
                    # the step, so that neither drops out where it crosses zero.
                    ratio = mpf(0)
                    for c in (series.w, series.v):
                        size = max(map(abs, c[:3])) or 1
                        for m in (order - 1, order):
                            ratio = max(ratio, mp.power(mpf(abs(c[m])) / size, mpf(1) / m))
                    grow = want / ratio if ratio else mpf(4)
                    if grow >= 1:
                        break
                    step = fix(unfix(step) * grow * mpf("0.97"))

                end, event = one, ""
                for name, terms in stops.items():
                    curve = [series.polynomial(terms, k) for k in range(order + 1)]
                    where = _descent(curve, end, bits)
                    if where is not None:
                        end, event = where, name
                where = _descent(series.v, end, bits)
                if turn is None and where is not None:
                    turn = _horner(series.t, where, bits)
                    indentation = mp.power(unfix(_horner(series.w, where, bits)), q)
                pressure = [series.polynomial(force, k) for k in range(order + 1)]
                slope = _derivative(pressure)
                crest = _descent(slope, end, bits)
                for place in (0, crest or 0, end):
                    last_peak = max(last_peak, _horner(pressure, place, bits))
                peak = max(peak, last_peak)
                trough = _descent([-c for c in slope], end, bits)
                for place in (0, trough or 0, end):
                    least = min(least, _horner(pressure, place, bits))
                w, v, t = (_horner(c, end, bits) for c in (series.w, series.v, series.t))
                if event:
                    stopped = event
                    break
                step = fix(unfix(step) * min(grow * mpf("0.97"), mpf(3)))
            if not stopped:
                raise RuntimeError(f"no event within {MAX_STEPS} steps")
            if stopped != "next":
                break
        return Trace(
            velocity=unfix(v), duration=unfix(t),
            compression_time=None if turn is None else unfix(turn), max_indentation=indentation,
            max_force=unfix(peak), min_force=unfix(least), last_max_force=unfix(last_peak),
            stopped=stopped,
        )  # fmt: skip
