"""Limits of an instrument: a low-pass filter before its readings, and a largest value."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ... import Fit
from ...extend import POSITIVE, AbstractErrors, parameter, require_count

_HIGHEST = 8
"""Highest order; beyond it the poles lie too close for sums over modes."""

_NODES, _WEIGHTS = ((np.polynomial.legendre.leggauss(4)[i] + 1 - i) / 2 for i in (0, 1))
"""Gauss's rule on [0, 1], for each interval of a contact."""


class Course(NamedTuple):
    """A signal over the time since touch.

    A straight line through zero with the rate `before`. `inside(t)` is added until the `end` of the
    contact, then a straight line with the value and the rate `after`.
    """

    before: Float[Array, ""]
    inside: Callable[[Array], Array]
    end: Float[Array, ""]
    after: tuple[Float[Array, ""] | float, Float[Array, ""] | float]

    def read(self, since: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the signal without a filter."""
        value, rate = self.after
        on_top = self.inside(jnp.clip(since, 0, self.end))
        on_top = jnp.where(since < self.end, on_top, value + rate * (since - self.end))
        return self.before * since + jnp.where(since > 0, on_top, 0)


def _order(given: int) -> int:
    order = require_count("order", given, 1)
    if order > _HIGHEST:
        raise ValueError(f"Argument `order` must be at most {_HIGHEST}, but is {order}.")
    return order


class LowPass(eqx.Module):
    """A sensor that reads through a Butterworth low-pass filter, |H(f)|² = 1/(1 + (f/f_c)^(2N)).

    `cutoff` f_c in Hz is the half-power frequency, and `order` N is 1 to 8. The filter is causal,
    like that of an amplifier: it delays (by 0.23/f_c at N = 2) and correlates noise. It does not
    describe a filter that was run forwards and backwards over a record. Raises ValueError unless
    f_c is positive and N is such a count.

    Source: Butterworth (1930), Wireless Engineer 7:536.
    """

    cutoff: Float[Array, ""] = parameter("cutoff", POSITIVE, "Hz")
    order: int = eqx.field(static=True, default=2, converter=_order)

    @property
    def delay(self) -> Float[Array, ""]:
        """The delay in s of slow signals, Σ Re (-1/p_k) over the poles."""
        return np.sum(-1 / _modes(self.order)[0]).real / (2 * jnp.pi * self.cutoff)

    def read(self, course: Course, since: Float[Array, " n"], parts: int) -> Float[Array, " n"]:
        """Return the filtered signal, Σ Re r_k ∫ exp(p_k (t - u)) signal(u) du over the poles.

        The contact is integrated in `parts` intervals, exactly for polynomials up to degree 7.
        """
        rate = 2 * jnp.pi * self.cutoff
        width = course.end / parts
        starts = jnp.arange(parts) * width
        there = course.inside(starts[:, None] + (width * _NODES)[None, :])
        # Continue from the start of the interval that contains each time.
        t = jnp.clip(since, 0, course.end)
        part = jnp.clip(jnp.floor(jax.lax.stop_gradient(t / width)).astype(int), 0, parts - 1)
        rest = (t - starts[part])[:, None]
        late = course.inside(starts[part][:, None] + rest * _NODES[None, :])
        # From the end of one interval to the start of a later one, never an earlier one.
        steps = np.arange(parts + 1)[:, None] - 1 - np.arange(parts)
        # After the contact: response to a constant and a ramp.
        value, slope = course.after
        beyond = jnp.maximum(since - course.end, 0)
        on_top, delay = jnp.zeros_like(since), jnp.zeros_like(rate)
        for pole, residue in zip(*_half(self.order), strict=True):
            p, r = rate * pole, rate * residue
            gained = jnp.exp(p * width * (1 - _NODES)) * (width * _WEIGHTS)
            gained = jnp.sum(gained[None, :] * there, axis=1)
            decay = jnp.where(steps >= 0, jnp.exp(p * width * np.maximum(steps, 0)), 0)
            kernel = jnp.exp(p * rest * (1 - _NODES)[None, :]) * (rest * _WEIGHTS[None, :])
            state = jnp.exp(p * rest[:, 0]) * (decay @ gained)[part] + jnp.sum(
                kernel * late, axis=1
            )
            grown = jnp.expm1(p * beyond)
            state = jnp.exp(p * beyond) * state + (value * grown + slope * (grown / p - beyond)) / p
            on_top, delay = on_top + (r * state).real, delay + (r / p**2).real
        return course.before * (since - delay) + jnp.where(since > 0, on_top, 0)

    def correlation(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """Return the correlation of filtered white noise between reading times in s."""
        poles, residues = _modes(self.order)
        # Σ r_k H(-p_k) exp(p_k |τ|).
        power = residues / np.prod(-poles[:, None] - poles, axis=1)
        lag = 2 * math.pi * float(self.cutoff) * np.abs(time[:, None] - time)
        whole = sum((c * np.exp(p * lag)).real for c, p in zip(power, poles, strict=True))
        return whole / power.real.sum()


def _modes(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return poles and residues at a cut-off of 1 rad/s; the response is Σ r_k exp(p_k t)."""
    poles = np.exp(1j * np.pi * (2 * np.arange(order) + order + 1) / (2 * order))
    return poles, 1 / np.prod(poles[:, None] - poles + np.eye(order), axis=1)


def _half(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return one pole of each conjugate pair, with twice its residue."""
    poles, residues = _modes(order)
    kept = np.arange(order) < (order + 1) // 2
    alone = 2 * np.arange(order) + 1 == order
    return poles[kept], (residues * np.where(alone, 1, 2))[kept]


Column = Float[np.ndarray, " n"]

_RUN = 3
"""Least number of equal readings in a row for a plateau."""

_STEPS, _TIMES, _LONGER = 4.0, 4, 8
"""A plateau is a limit if one of three conditions holds.

The readings beside it rise to it by more than 4 resolution steps; or it is 4 times as long as there
are readings of the value beside it; or it is 8 times as long as any other run. A peak in coarse
steps is flat too, but it is reached slowly: a parabola has at most 1 + √2 times as many readings
there as of the value beside it. Noise shortens the runs beside it; where it also cuts the peak, it
cuts all other runs as well.
"""


class Limits(NamedTuple):
    """The limits of an instrument, and which readings (n,) are at one of them.

    A limit that does not occur is infinite.
    """

    low: float
    high: float
    at_limit: Bool[np.ndarray, " n"]


def limits_of(readings: Float[np.ndarray, " n"], *, two_sided: bool) -> Limits:
    """Return the limits that a column of readings shows; the low one only if `two_sided`."""
    at_high = _plateau(readings)
    at_low = _plateau(-readings) if two_sided else np.zeros_like(at_high)
    high = float(readings.max()) if at_high.any() else np.inf
    low = float(readings.min()) if at_low.any() else -np.inf
    return Limits(low, high, at_high | at_low)


def _plateau(y: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return the mask of readings in a plateau at the maximum."""
    at_top = y == y.max()
    begin = np.concatenate([[0], np.flatnonzero(np.diff(y)) + 1])
    length, level = np.diff(np.append(begin, y.size)), y[begin]
    values = np.unique(y)
    step = float(np.min(np.diff(values))) if values.size > 1 else 0.0
    for i in np.flatnonzero((level == y.max()) & (length >= _RUN)):
        beside = [j for j in (i - 1, i + 1) if 0 <= j < level.size]
        rise = min((y.max() - level[j] for j in beside), default=0.0)
        most = max((np.count_nonzero(y == level[j]) for j in beside), default=y.size)
        others = max(length[level < y.max()], default=y.size)
        if rise > _STEPS * step or length[i] > min(_TIMES * most, _LONGER * others):
            # One long plateau shows the limit; other readings at that value are limited too.
            return at_top
    return np.zeros_like(at_top)


class BeyondLimits(AbstractErrors[Fit, dict[str, Any]]):
    """Readings at a limit that the fit puts beyond it, which have no residual and are left out."""

    rounds = 1

    def __init__(self, limits: Mapping[str, Limits], sizes: Mapping[str, Mapping[str, Column]]):
        self._limits, self._sizes, self._met = limits, sizes, False

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the sizes, with no weight for the readings beyond a limit."""
        self._met = found.converged and any(one.at_limit.any() for one in self._limits.values())
        if not self._met:
            return None
        expected = found.predict()
        beyond = {
            name: one.at_limit & ((expected[name] <= one.low) | (expected[name] >= one.high))
            for name, one in self._limits.items()
        }
        nothing = {"sigma": np.inf, "weights": 0.0}
        return {
            kind: {name: np.where(beyond[name], nothing[kind], own) for name, own in sizes.items()}
            for kind, sizes in self._sizes.items()
        }

    def finish(self, found: Fit) -> Fit:
        """Return the fit with notes on the limits."""
        said = [
            f"{np.count_nonzero(one.at_limit)} of {one.at_limit.size} readings of {name} are at a "
            "limit of the instrument and count as at or beyond it"
            for name, one in self._limits.items()
            if self._met and one.at_limit.any()
        ]
        return dataclasses.replace(found, notes=(*found.notes, *said))
