"""The fit of one impact in an instrument record: speed, e, contact time, force and K."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import Contact, Damped, Fit, impact
from ...extend import MEASURED_RESTITUTION
from ..recordings import RecordedImpact
from .fit_record import fit_record
from .low_pass import limits_of

_LENGTH = 512
"""Readings of every fit, so that all share one compiled program.

Longer windows are averaged, shorter ones padded with readings of zero weight.
"""

_LEAST_E, _MOST_E = 0.1, 0.99
_WRONG = 0.01
"""Probability below which the fitted force law does not describe the readings."""

OUTCOMES = "restitution", "duration", "max_force"


class FittedNumber(NamedTuple):
    """A number of one impact and its standard error."""

    value: float
    error: float


@dataclasses.dataclass(frozen=True, eq=False)
class ImpactFit:
    """One impact of a record, fitted by F = K δ^n (1 + α δ'/v₀).

    `impact` holds the readings. `fit` is the fit (see `fit_record`) of the `reading` (n,) over the
    `time` (n,) in s. Results are `velocity` in m/s, `restitution`, `duration` in s, `max_force` in
    N and `stiffness` in N/m^n. `covariance` (2, 2) is that of ln e and the logarithm of the largest
    force, at the fitted speed.
    """

    impact: RecordedImpact
    fit: Fit
    time: Float[np.ndarray, " n"]
    reading: Float[np.ndarray, " n"]
    velocity: FittedNumber
    restitution: FittedNumber
    duration: FittedNumber
    max_force: FittedNumber
    stiffness: FittedNumber
    covariance: Float[np.ndarray, "2 2"]

    @property
    def adequate(self) -> bool | None:
        """True if the fit describes the readings (false alarm rate 1 %); None if undecided."""
        p = self.fit.adequacy.p
        return None if p is None else p >= _WRONG

    @property
    def touch(self) -> float:
        """The time in s at which the contact begins."""
        return float(self.fit.params.start_time)


def fitted_impact(one: RecordedImpact, contact: Contact) -> ImpactFit | str:
    """Fit an impact with mass and exponent of `contact`; return the reason on failure."""
    time, reading = _shorten(one)
    mass = float(contact.mass)
    column, scale = _column(one, mass)
    reading = scale * reading
    start = _start(one, time, reading, contact)
    found = _fit_of(time, reading, column, start)
    if not found.converged:
        return f"its fit did not converge ({found.reason})"
    found_law: Any = found.params
    at = [found.names.index(name) for name in ("law.alpha", "contact.stiffness", "velocity")]
    covariance = found.covariance[np.ix_(at, at)]
    if not np.isfinite(covariance).all():
        return "its record does not determine speed, stiffness and damping"
    point = jnp.asarray(found.values[np.array(at)])
    with jax.enable_x64(True):
        logs, slope = _outcomes(point, jnp.asarray(mass), float(contact.exponent))
    logs, slope = np.asarray(logs), np.asarray(slope)
    errors = np.sqrt(np.diag(slope @ covariance @ slope.T))
    numbers = [
        FittedNumber(float(math.exp(a)), float(math.exp(a) * s))
        for a, s in zip(logs, errors, strict=True)
    ]
    if numbers[0].value > MEASURED_RESTITUTION.high:
        return f"its e would be {numbers[0].value:.3g}"
    end = float(found_law.start_time) + numbers[1].value
    if not time[0] < float(found_law.start_time) < end < time[-1]:
        return "its contact extends beyond the free part of the record"
    # At the fitted speed: an error of the speed moves the stiffness with it, but not the force.
    ahead = slope[[0, 2]].copy()
    ahead[:, 2] = 0
    error = np.sqrt(np.diag(covariance))
    return ImpactFit(
        one,
        found,
        time,
        reading / scale,
        velocity=FittedNumber(float(point[2]), float(error[2])),
        restitution=numbers[0],
        duration=numbers[1],
        max_force=numbers[2],
        stiffness=FittedNumber(float(point[1]), float(error[1])),
        covariance=ahead @ covariance @ ahead.T,
    )


@functools.partial(jax.jit, static_argnums=2)
def _outcomes(
    point: Float[Array, " 3"], mass: Float[Array, ""], exponent: float
) -> tuple[Float[Array, " 3"], Float[Array, "3 3"]]:
    """Return ln of e, contact time and largest force, and their slopes by α, K and v₀."""

    def logs(point: Float[Array, " 3"]) -> Float[Array, " 3"]:
        alpha, stiffness, velocity = point
        hit = impact(Damped(alpha=alpha), Contact(mass, stiffness, exponent), velocity)
        return jnp.log(jnp.stack([getattr(hit, name) for name in OUTCOMES]))

    return logs(point), jax.jacfwd(logs)(point)


def _shorten(one: RecordedImpact) -> tuple[np.ndarray, np.ndarray]:
    """Return the window of an impact, averaged down if it is longer than a fit takes."""
    time, reading = one.time, one.reading
    width = math.ceil(time.size / _LENGTH)
    if width == 1:
        return time, reading
    if limits_of(reading, two_sided=False).at_limit.any():
        # A mean across the edge of a plateau is not a reading.
        return time[::width], reading[::width]
    count = time.size // width
    means = (x[: count * width].reshape(count, width).mean(axis=1) for x in (time, reading))
    return tuple(means)  # pyright: ignore[reportReturnType]


def _column(one: RecordedImpact, mass: float) -> tuple[str, float]:
    """Return the argument of `fit_record` for the quantity, and the factor for the readings."""
    quantity = one.trace.quantity
    column = "indentation" if quantity == "indentation" else "force"
    return column, mass if quantity == "acceleration" else 1.0


class _Start(NamedTuple):
    law: Damped
    contact: Contact
    velocity: float
    time: float


def _start(one: RecordedImpact, time: np.ndarray, reading: np.ndarray, contact: Contact) -> _Start:
    """Return the start of a fit from the impulse and its centre.

    It uses m v₀ T = ∫ F (T - t) dt and e = t̄/(T - t̄).
    """
    touch, long = float(one.trace.time[0] + one.touch * one.trace.step), one.duration
    inside = (time >= touch) & (time <= touch + long)
    t, y, step = time[inside] - touch, reading[inside], float(time[1] - time[0])
    mass, n = float(contact.mass), float(contact.exponent)
    part = 1 / (n + 1)
    ratio = 2 * math.sqrt(math.pi) * part * math.gamma(part) / math.gamma(part + 0.5)
    if one.trace.quantity == "indentation":
        speed, e = ratio * float(y.max()) / long, 0.8
    else:
        impulse = max(float(y.sum()) * step, 1e-300)
        middle = min(max(float(t @ y) * step / impulse / long, 0.1), 0.499)
        e = middle / (1 - middle)
        speed = impulse * (1 - middle) / mass
    e = min(max(e, _LEAST_E), _MOST_E)
    stiffness = mass / (2 * part * speed ** (n - 1)) * (ratio / long) ** (n + 1)
    law = Damped(alpha=jnp.asarray(1.5 * (1 - e) / e))
    return _Start(law, Contact(mass, stiffness, contact.exponent), speed, touch)


def with_free_exponent(one: ImpactFit) -> Fit:
    """Fit the same readings with the exponent n free."""
    found = one.fit.params
    mass = found.contact.mass
    with jax.enable_x64(True):
        n = jnp.asarray(float(found.contact.exponent))
        free = Contact(mass, found.contact.stiffness, n)
    start = _Start(found.law, free, float(found.velocity), float(found.start_time))
    column, scale = _column(one.impact, float(mass))
    return _fit_of(one.time, scale * one.reading, column, start)


def _fit_of(time: np.ndarray, reading: np.ndarray, column: str, start: _Start) -> Fit:
    """Fit a window padded with readings of zero weight."""
    count = time.size
    step = float(time[-1] - time[0]) / (count - 1)
    time = np.concatenate([time, time[-1] + step * np.arange(1, _LENGTH - count + 1)])
    filled = np.zeros(_LENGTH)
    filled[:count] = reading
    weight = np.where(np.arange(_LENGTH) < count, float(np.abs(reading).max()) ** -2.0, 0.0)
    how: Any = {column: filled, "start_time": start.time, "weights": {column: weight}}
    return fit_record(start.law, start.contact, time, start.velocity, throw=False, **how)
