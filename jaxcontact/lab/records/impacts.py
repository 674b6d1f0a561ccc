"""The impacts in an instrument record: the fit of each, and all as pairs with their errors."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import AbstractLaw, Contact, Damped, Fit, impact
from ...extend import (
    MEASURED_RESTITUTION,
    STANDARD_GRAVITY,
    Flight,
    ranges,
    refusal,
    require_number,
)
from ..calibration.summary_data import ImpactSummary
from ..choice.table import Columns, PairErrors
from ..pairs.pairs import LEAST_PAIRS, Noise, scatter_beside
from ..recordings import RecordedImpact, RecordedPairs, Recording, RecordingError
from .fit_record import duration_ratio, fit_record, stiffness_of
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
    found = _fit_of(one, time, reading, *_start(one, time, reading, contact))
    if not found.converged:
        return f"its fit did not converge ({found.reason})"
    at = [found.names.index(name) for name in ("law.alpha", "contact.stiffness", "velocity")]
    covariance = found.covariance[np.ix_(at, at)]
    if not np.isfinite(covariance).all():
        return "its record does not determine speed, stiffness and damping"
    point = found.values[np.array(at)]
    with jax.enable_x64(True):
        logs, slope = _outcomes(point, np.float64(contact.mass), float(contact.exponent))
    logs, slope = np.asarray(logs), np.asarray(slope)
    errors = np.sqrt(np.diag(slope @ covariance @ slope.T))
    numbers = [
        FittedNumber(math.exp(a), math.exp(a) * float(s)) for a, s in zip(logs, errors, strict=True)
    ]
    if numbers[0].value > MEASURED_RESTITUTION.high:
        return f"its e would be {numbers[0].value:.3g}"
    touch = float(found.params.start_time)
    if not time[0] < touch < touch + numbers[1].value < time[-1]:
        return "its contact extends beyond the free part of the record"
    # At the fitted speed: an error of the speed moves the stiffness with it, but not the force.
    ahead = slope[[0, 2]].copy()
    ahead[:, 2] = 0
    error = np.sqrt(np.diag(covariance))
    return ImpactFit(
        one,
        found,
        time,
        reading,
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


def _scale(one: RecordedImpact, mass: float) -> float:
    """Return the factor from the readings to a force, or to the indentation."""
    return mass if one.trace.quantity == "acceleration" else 1.0


def _start(
    one: RecordedImpact, time: np.ndarray, reading: np.ndarray, contact: Contact
) -> tuple[AbstractLaw, Contact, float, float]:
    """Return law, contact, speed and touch from the impulse and its centre.

    It uses m v₀ T = ∫ F (T - t) dt and e = t̄/(T - t̄).
    """
    touch, long = float(one.trace.time[0] + one.touch * one.trace.step), one.duration
    inside = (time >= touch) & (time <= touch + long)
    mass, n = float(contact.mass), float(contact.exponent)
    t, step = time[inside] - touch, float(time[1] - time[0])
    y = _scale(one, mass) * reading[inside]
    if one.trace.quantity == "indentation":
        speed, e = duration_ratio(n) * float(y.max()) / long, 0.8
    else:
        impulse = max(float(y.sum()) * step, 1e-300)
        middle = min(max(float(t @ y) * step / impulse / long, 0.1), 0.499)
        e = middle / (1 - middle)
        speed = impulse * (1 - middle) / mass
    e = min(max(e, _LEAST_E), _MOST_E)
    law = Damped(alpha=jnp.asarray(1.5 * (1 - e) / e))
    stiffness = stiffness_of(mass, n, speed, long)
    return law, Contact(mass, stiffness, contact.exponent), speed, touch


def with_free_exponent(one: ImpactFit) -> Fit:
    """Fit the same readings with the exponent n free."""
    found = one.fit.params
    with jax.enable_x64(True):
        n = jnp.asarray(float(found.contact.exponent))
        free = Contact(found.contact.mass, found.contact.stiffness, n)
    start = found.law, free, float(found.velocity), float(found.start_time)
    return _fit_of(one.impact, one.time, one.reading, *start)


def _fit_of(
    one: RecordedImpact,
    time: np.ndarray,
    reading: np.ndarray,
    law: AbstractLaw,
    contact: Contact,
    velocity: float,
    touch: float,
) -> Fit:
    """Fit a window padded with readings of zero weight."""
    count = time.size
    step = float(time[-1] - time[0]) / (count - 1)
    time = np.concatenate([time, time[-1] + step * np.arange(1, _LENGTH - count + 1)])
    filled = np.zeros(_LENGTH)
    filled[:count] = _scale(one, float(contact.mass)) * reading
    weight = np.where(np.arange(_LENGTH) < count, float(np.abs(filled).max()) ** -2.0, 0.0)
    column = "indentation" if one.trace.quantity == "indentation" else "force"
    how: Any = {column: filled, "start_time": touch, "weights": {column: weight}}
    return fit_record(law, contact, time, velocity, throw=False, **how)


_AT_REST = 10
"""Least number of readings, and of standard errors, for the weight of a resting body."""

_FAR = 3.0
"""Standard errors beyond which the fitted exponent contradicts the given one."""

_NUMBERS = "velocity", "restitution", "duration", "max_force", "stiffness"


class Fitted(NamedTuple):
    """The impacts in a record; `covariance` is that of ln e and the logarithm of the force."""

    pairs: RecordedPairs
    fits: tuple[ImpactFit, ...]
    force: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n 2 2"]
    contact: Contact
    notes: tuple[str, ...]


def fitted_impacts(
    recording: Recording, contact: Contact, flight: Flight, tell: Callable[[str], None]
) -> Fitted:
    """Fit each impact with mass and exponent of `contact`; raise RecordingError if none can be."""
    good: list[ImpactFit] = []
    bad: list[str] = []
    records: list[RecordedImpact] = list(recording.records)  # pyright: ignore[reportAssignmentType]
    for one in records:
        tell(f"fitting impact {one.number} of {len(records)}")
        made = fitted_impact(one, contact)
        if isinstance(made, str):
            bad.append(f"at {one.trace.time[round(one.touch)]:.4g} s {made}")
        else:
            good.append(made)
    if not good:
        raise RecordingError(f"no impact could be fitted: {'; '.join(bad)}", recording.source)
    notes = []
    if bad:
        notes.append(f"impacts that could not be fitted, not used: {len(bad)} ({'; '.join(bad)})")
    notes += _exponent(max(good, key=lambda one: one.max_force.value), contact)
    notes += _shape(good) + _flights(good, flight)
    pairs = _pairs(recording, good, flight, len(bad))
    force = np.array([one.max_force.value for one in good])
    covariance = np.array([one.covariance for one in good])
    stiffness = float(np.median([one.stiffness.value for one in good]))
    contact = Contact(contact.mass, stiffness, contact.exponent)
    return Fitted(pairs, tuple(good), force, covariance, contact, tuple(notes))


def errors_of_impacts(found: Fitted, keep: np.ndarray) -> PairErrors:
    """Return the errors of ln e and ln(force): of readings, and about powers of the speed."""
    values = np.log(np.stack([found.pairs.restitution, found.force]))
    variance = np.diagonal(found.covariance, axis1=1, axis2=2).T
    scatter = [0.0, 0.0]
    if (count := int(keep.sum())) >= LEAST_PAIRS:
        trend = np.stack([np.ones(count), np.log(found.pairs.velocity[keep])], axis=1)
        scatter = [
            scatter_beside(y[keep], trend, np.diag(own[keep]))
            for y, own in zip(values, variance, strict=True)
        ]
    size = np.sqrt(variance + np.square(scatter)[:, None])
    n = size.shape[1]
    whole, rows = np.eye(2 * n), np.arange(n)
    whole[rows, n + rows] = whole[n + rows, rows] = found.covariance[:, 0, 1] / size.prod(axis=0)
    columns = Columns({"max_force": values[1]}, {"max_force": size[1]})
    noise = Noise(scatter[0], found.pairs.reading)
    return PairErrors(noise, size[0], correlation=whole, others=columns)


def summaries(fits: Iterable[ImpactFit]) -> tuple[ImpactSummary, ...]:
    """Return the impacts as plain data."""
    return tuple(
        ImpactSummary(
            number=one.impact.number,
            time=one.touch,
            adequate=one.adequate,
            notes=one.fit.notes,
            **{name: getattr(one, name).value for name in _NUMBERS},
            **{f"{name}_error": getattr(one, name).error for name in _NUMBERS},
        )
        for one in fits
    )


def exponent_of(recording: Recording, exponent: float | None) -> float:
    """Return the exponent n of the contact; raise ValueError if the recording does not use it."""
    if exponent is None:
        return 1.5
    if not recording.layout.fitted:
        raise refusal("exponent", "be None where e is measured and no force", exponent)
    return require_number("exponent", exponent, ranges(Contact)["exponent"])


def require_mass(recording: Recording, mass: float | None, stiffness: float | None) -> None:
    """Raise ValueError for a record without a mass, and for a given stiffness, which is fitted."""
    if stiffness is not None:
        raise refusal("stiffness", "be None for a record, which determines it", stiffness)
    if mass is None:
        raise ValueError(
            f"Argument `mass` is needed for a record of {recording.layout.name}. Speeds, e and K "
            "follow from it only with the mass in kg (the effective mass if both bodies move)."
            f"{_weight(recording)}"
        )


def _weight(recording: Recording) -> str:
    """Return a note on the weight of a body resting on the force plate at the end, or ""."""
    impacts: list[RecordedImpact] = list(recording.records)  # pyright: ignore[reportAssignmentType]
    first, trace = impacts[0], impacts[0].trace
    if trace.quantity != "force":
        return ""
    after = trace.value[math.ceil(impacts[-1].end) :]
    end = after[-max(after.size // 10, 1) :]
    before = trace.value[max(first.start - first.time.size // 3, 0) : first.start]
    if end.size < _AT_REST or before.size < _AT_REST:
        return ""
    error = trace.noise * math.sqrt(1 / end.size + 1 / before.size)
    weight = float(end.mean() - before.mean())
    if weight < _AT_REST * error:
        return ""
    return (
        f" At the end the plate carries {weight:.3g} N more than at the start: if the body lies "
        f"on it, its mass is {weight / STANDARD_GRAVITY:.3g} kg."
    )


def _exponent(one: ImpactFit, contact: Contact) -> list[str]:
    """Return what the clearest record implies for the exponent."""
    other = with_free_exponent(one)
    error = other.standard_errors.get("contact.exponent", math.nan)
    if not other.converged or not math.isfinite(error):
        return ["the clearest record does not determine the exponent n"]
    value, given = float(other.params.contact.exponent), float(contact.exponent)
    said = f"the shape of the clearest record has n = {value:.3f} ± {error:.3f}"
    if abs(value - given) <= _FAR * error:
        return [f"{said}, which agrees with the n = {given:g} of the fits"]
    return [
        f"{said}, NOT the n = {given:g} of the fits: K, speeds and e may be wrong; try --exponent "
        f"{value:.2f} (in Python exponent)"
    ]


def _shape(good: list[ImpactFit]) -> list[str]:
    """Return whether the fitted force law has the shape of the records."""
    wrong = [one.impact.number for one in good if one.adequate is False]
    told = sum(one.adequate is True for one in good)
    force = "the force K δ^n (1 + α δ'/v₀)"
    if wrong:
        which = ", ".join(map(str, wrong))
        return [
            f"{force} does not describe the record of impact {which} within its noise: errors of "
            "speed, e and K are too small there"
        ]
    if told < len(good):
        return [
            f"{force} describes {told} of these {len(good)} records; the others could not be tested"
        ]
    return [f"{force} describes all {told} of these records"]


def _flights(good: list[ImpactFit], flight: Flight) -> list[str]:
    """Return how flight times between consecutive impacts compare with the fitted speeds."""
    ratios = []
    for one, two in itertools.pairwise(good):
        if two.impact.number != one.impact.number + 1:
            continue
        pause = two.touch - one.touch - one.duration.value
        leaves = one.velocity.value * one.restitution.value
        ratios.append(flight.gravity * pause / (leaves + two.velocity.value))
    if not ratios or max(ratios) > 2 or min(ratios) < 0.5 or np.ptp(ratios) > 0.1:
        return []
    off = 100 * (float(np.median(ratios)) - 1)
    side, mass = ("above", "smaller") if off > 0 else ("below", "larger")
    guess = ""
    if good[0].impact.trace.quantity == "force" and abs(off) > 3:
        guess = f"; they would agree with a {mass} mass"
    return [
        f"flights between impacts give speeds {abs(off):.1f} % {side} those of the records{guess}"
    ]


def _pairs(
    recording: Recording, good: list[ImpactFit], flight: Flight, unfitted: int
) -> RecordedPairs:
    rows = np.array([one.impact.row for one in good], np.int64)
    e = np.array([one.restitution.value for one in good])
    variance = np.array([one.covariance[0, 0] for one in good])
    return RecordedPairs(
        source=recording.source,
        layout=recording.layout,
        ball=recording.ball,
        velocity=np.array([one.velocity.value for one in good]),
        restitution=e,
        reading_factor=np.zeros(len(good)),
        first_row=rows,
        second_row=rows,
        cluster=np.arange(len(good)),
        cluster_names=tuple(f"impact {one.impact.number}" for one in good),
        records=tuple((one.impact,) for one in good),
        flight=flight,
        unpaired=0,
        covariance=np.diag(variance),
        reading=float(np.sqrt(np.mean(variance))),
    )
