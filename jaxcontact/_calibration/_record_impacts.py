"""Impacts in the record of an instrument: each fitted, as pairs of speed and e, and their forces."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._contact import EXPONENT, Contact
from .._fit import Fit
from .._flight import STANDARD_GRAVITY, Flight, Floats
from .._impact import impact
from .._laws import Damped
from .._measurements import MEASURED_RESTITUTION, Impact, Pairs, Recording, RecordingError
from .._measurements._noise import Noise, scatter_beside
from .._measurements._pairs import LEAST_PAIRS
from .._parameter import rendered, require_number
from ._limits import limits_of
from ._outcomes import Columns
from ._record import fit_record
from ._summary import ImpactSummary

_LENGTH = 512
"""Readings of every fit, so that all share one program: longer windows are averaged, shorter ones
filled up with readings without weight."""

_LEAST_E, _MOST_E = 0.1, 0.99
_WRONG = 0.01
_AT_REST = 10
_FAR = 3.0
"""Standard errors by which an exponent is another one."""

_NUMBERS = "velocity", "restitution", "duration", "max_force", "stiffness"
OUTCOMES = "restitution", "duration", "max_force"


class Outcome(NamedTuple):
    """A number of one impact and its standard error."""

    value: float
    error: float


@dataclasses.dataclass(frozen=True, eq=False)
class ImpactFit:
    """One impact of a record, fitted by F = K δ^n (1 + α δ'/v₀).

    `impact` holds the readings, `fit` what was found with them (see `fit_record`), of the `time`
    (n,) in s and the `reading` (n,); `velocity` in m/s, `restitution`, `duration` in s, `max_force`
    in N and `stiffness` in N/m^n follow; `covariance` (2, 2) is that of ln e and, at the speed
    found, of the logarithm of the largest force.
    """

    impact: Impact
    fit: Fit
    time: Float[np.ndarray, " n"]
    reading: Float[np.ndarray, " n"]
    velocity: Outcome
    restitution: Outcome
    duration: Outcome
    max_force: Outcome
    stiffness: Outcome
    covariance: Float[np.ndarray, "2 2"]

    @property
    def adequate(self) -> bool | None:
        """Whether the fit describes the readings, of which noise makes it fail one in a hundred."""
        p = self.fit.adequacy.p
        return None if p is None else p >= _WRONG

    @property
    def touch(self) -> float:
        """The time in s at which the contact begins."""
        return float(self.fit.params.start_time)


class Fitted(NamedTuple):
    """What the impacts of a record gave: the pairs, the largest forces beside e, the covariance
    (n, 2, 2) of both logarithms, the fits, and what to say.
    """

    pairs: Pairs
    fits: tuple[ImpactFit, ...]
    force: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n 2 2"]
    contact: Contact
    notes: tuple[str, ...]


def fitted_impacts(
    recording: Recording, contact: Contact, flight: Flight, tell: Callable[[str], None]
) -> Fitted:
    """The impacts of a recording, each fitted with the mass and the exponent of `contact`.

    Raises RecordingError where none can be fitted.
    """
    good: list[ImpactFit] = []
    bad: list[str] = []
    records: list[Impact] = list(recording.records)  # pyright: ignore[reportAssignmentType]
    for one in records:
        tell(f"fitting impact {one.number} of {len(records)}")
        made = _fitted(one, contact)
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


class WeighedImpacts(NamedTuple):
    """As `Weighed`, with the largest forces as a column beside e; the correlation is (2n, 2n)."""

    noise: Noise
    weights: Floats
    correlation: Float[np.ndarray, "m m"]
    others: Columns


def weighed(found: Fitted, keep: np.ndarray) -> WeighedImpacts:
    """The noise of ln e and of the logarithm of the force, about trends of the impacts to `keep`.

    Beside the errors that the readings of each impact give, both may scatter from impact to impact
    about a power of the speed.
    """
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
    return WeighedImpacts(Noise(scatter[0], found.pairs.reading), size[0] ** -2, whole, columns)


def summaries(found: Fitted) -> tuple[ImpactSummary, ...]:
    """The impacts as plain data."""
    return tuple(
        ImpactSummary(
            one.impact.number,
            one.touch,
            *(number for name in _NUMBERS for number in getattr(one, name)),
            one.adequate,
            one.fit.notes,
        )
        for one in found.fits
    )


def exponent_of(recording: Recording, exponent: float | None) -> float:
    """The exponent n of the contact. Raises ValueError where the recording does not use it."""
    if exponent is None:
        return 1.5
    if not recording.layout.fitted:
        raise ValueError(
            "Argument `exponent` must be None where e is measured and no force, but is "
            f"{rendered(exponent)}."
        )
    return require_number("exponent", exponent, EXPONENT)


def require_mass(recording: Recording, mass: float | None, stiffness: float | None) -> None:
    """Raise ValueError for a record without a mass, and for a stiffness, which is fitted."""
    if stiffness is not None:
        raise ValueError(
            "Argument `stiffness` must be None for a record, which gives it, but is "
            f"{rendered(stiffness)}."
        )
    if mass is None:
        raise ValueError(
            f"Argument `mass` is needed for a record of {recording.layout.name}: it gives F or F/m "
            "over time, and speeds, e and K only with the mass m of the body in kg (the effective "
            f"mass, where both bodies move).{_weighed(recording)}"
        )


def _weighed(recording: Recording) -> str:
    """What the body weighs that lies on a force plate at the end; nothing where none does."""
    trace = recording.records[0].trace
    if trace.quantity != "force":
        return ""
    last = recording.records[-1]
    after = trace.value[math.ceil(last.end) :]
    end = after[-max(after.size // 10, 1) :]
    free = recording.records[0].time.size // 3
    before = trace.value[max(recording.records[0].start - free, 0) : recording.records[0].start]
    if end.size < _AT_REST or before.size < _AT_REST:
        return ""
    error = trace.noise * math.sqrt(1 / end.size + 1 / before.size)
    weight = float(end.mean() - before.mean())
    if weight < 10 * error:
        return ""
    return (
        f" At its end the plate carries {weight:.3g} N more than before: if the body lies on it, "
        f"its mass is {weight / STANDARD_GRAVITY:.3g} kg."
    )


def _fitted(one: Impact, contact: Contact) -> ImpactFit | str:
    time, reading = _shortened(one)
    mass, quantity = float(contact.mass), one.trace.quantity
    column, scale = ("indentation", 1.0) if quantity == "indentation" else ("force", 1.0)
    if quantity == "acceleration":
        scale = mass
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
    numbers = [Outcome(float(math.exp(a)), float(math.exp(a) * s)) for a, s in zip(logs, errors)]
    if numbers[0].value > MEASURED_RESTITUTION.high:
        return f"its e would be {numbers[0].value:.3g}"
    end = float(found_law.start_time) + numbers[1].value
    if not time[0] < float(found_law.start_time) < end < time[-1]:
        return "its contact reaches beyond what is free about it"
    # At the speed found: a wrong speed moves the stiffness with it, and not the force.
    ahead = slope[[0, 2]].copy()
    ahead[:, 2] = 0
    error = np.sqrt(np.diag(covariance))
    return ImpactFit(
        one,
        found,
        time,
        reading / scale,
        Outcome(float(point[2]), float(error[2])),
        *numbers,
        Outcome(float(point[1]), float(error[1])),
        ahead @ covariance @ ahead.T,
    )


@functools.partial(jax.jit, static_argnums=2)
def _outcomes(
    point: Float[Array, " 3"], mass: Float[Array, ""], exponent: float
) -> tuple[Float[Array, " 3"], Float[Array, "3 3"]]:
    """The logarithms of e, contact time and largest force, and their slopes by α, K and v₀."""

    def logs(point: Float[Array, " 3"]) -> Float[Array, " 3"]:
        alpha, stiffness, velocity = point
        hit = impact(Damped(alpha=alpha), Contact(mass, stiffness, exponent), velocity)
        return jnp.log(jnp.stack([getattr(hit, name) for name in OUTCOMES]))

    return logs(point), jax.jacfwd(logs)(point)


def _shortened(one: Impact) -> tuple[np.ndarray, np.ndarray]:
    """The window of an impact, in means of readings where it is longer than a fit takes."""
    time, reading = one.time, one.reading
    width = math.ceil(time.size / _LENGTH)
    if width == 1:
        return time, reading
    if limits_of(reading, two_sided=False).at_limit.any():
        # The mean over the end of a plateau is no reading.
        return time[::width], reading[::width]
    count = time.size // width
    means = (x[: count * width].reshape(count, width).mean(axis=1) for x in (time, reading))
    return tuple(means)  # pyright: ignore[reportReturnType]


class _Start(NamedTuple):
    law: Damped
    contact: Contact
    velocity: float
    time: float


def _start(one: Impact, time: np.ndarray, reading: np.ndarray, contact: Contact) -> _Start:
    """Where a fit begins: by the impulse and its centre, m v₀ T = ∫ F (T - t) dt, e = t̄/(T - t̄)."""
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
    law = Damped(alpha=1.5 * (1 - e) / e)
    return _Start(law, Contact(mass, stiffness, contact.exponent), speed, touch)


def _fit_of(time: np.ndarray, reading: np.ndarray, column: str, start: _Start) -> Fit:
    """The fit of a window that is filled up with readings without weight."""
    count = time.size
    step = float(time[-1] - time[0]) / (count - 1)
    time = np.concatenate([time, time[-1] + step * np.arange(1, _LENGTH - count + 1)])
    filled = np.zeros(_LENGTH)
    filled[:count] = reading
    weight = np.where(np.arange(_LENGTH) < count, float(np.abs(reading).max()) ** -2.0, 0.0)
    columns: Any = {column: filled}
    return fit_record(
        *(time, start.law, start.contact, start.velocity),
        **columns,
        start_time=start.time,
        weights={column: weight},
    )


def _exponent(one: ImpactFit, contact: Contact) -> list[str]:
    """What the clearest record says about the exponent."""
    scale = float(contact.mass) if one.impact.trace.quantity == "acceleration" else 1.0
    column = "indentation" if one.impact.trace.quantity == "indentation" else "force"
    found = one.fit.params
    with jax.enable_x64(True):
        free = Contact(contact.mass, found.contact.stiffness, jnp.asarray(contact.exponent))
    start = _Start(found.law, free, float(found.velocity), float(found.start_time))
    other = _fit_of(one.time, scale * one.reading, column, start)
    error = other.standard_errors.get("contact.exponent", math.nan)
    if not other.converged or not math.isfinite(error):
        return ["the clearest record does not tell the exponent n"]
    value, given = float(other.params.contact.exponent), float(contact.exponent)
    said = f"the shape of the clearest record has n = {value:.3f} ± {error:.3f}"
    if abs(value - given) <= _FAR * error:
        return [f"{said}, which agrees with the n = {given:g} of the fits"]
    return [
        f"{said}, NOT the n = {given:g} of the fits: give --exponent {value:.2f} (in Python "
        "exponent), or doubt K, speeds and e"
    ]


def _shape(good: list[ImpactFit]) -> list[str]:
    """Whether the force that is fitted has the shape of the records."""
    wrong = [one.impact.number for one in good if one.adequate is False]
    if not wrong:
        return [f"the force K δ^n (1 + α δ'/v₀) describes all {len(good)} of these records"]
    which = ", ".join(map(str, wrong))
    return [
        f"the force K δ^n (1 + α δ'/v₀) does not describe the record of impact {which} within its "
        "noise: errors of speed, e and K are too small there"
    ]


def _flights(good: list[ImpactFit], flight: Flight) -> list[str]:
    """What the times between impacts say, where each follows the last by a bounce."""
    ratios = []
    for one, two in zip(good[:-1], good[1:], strict=True):
        if two.impact.number != one.impact.number + 1:
            continue
        pause = two.touch - one.touch - one.duration.value
        leaves = one.velocity.value * one.restitution.value
        ratios.append(flight.gravity * pause / (leaves + two.velocity.value))
    if not ratios or max(ratios) > 2 or min(ratios) < 0.5 or np.ptp(ratios) > 0.1:
        return []
    off = 100 * (float(np.median(ratios)) - 1)
    if good[0].impact.trace.quantity == "force":
        what = "with a mass that is so much smaller" if off > 0 else "with a mass that is larger"
        guess = f"; the flights would be right {what}" if abs(off) > 3 else ""
    else:
        guess = ""
    return [
        f"flights between impacts give speeds {abs(off):.1f} % "
        f"{'above' if off > 0 else 'below'} those of the records{guess}"
    ]


def _pairs(recording: Recording, good: list[ImpactFit], flight: Flight, unfitted: int) -> Pairs:
    rows = np.array([one.impact.row for one in good], np.int64)
    e = np.array([one.restitution.value for one in good])
    variance = np.array([one.covariance[0, 0] for one in good])
    return Pairs(
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
