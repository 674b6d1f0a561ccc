"""Times of impacts between frames: all parabolas of a drop are fitted together.

Flights share the acceleration, the floor and the contact time, so that all frames contribute to
each. Frames in which the ball touches the floor, or may have during the exposure, are left out. So
are misreadings, first by a robust search and then by their distance.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool
from scipy.optimize import least_squares

from ...extend import Flight
from .model import Camera, Drop, Floats, Frames, Model, Shape

CONTACT, CONTACT_ERROR = 2e-3, 4e-3
"""Prior mean and standard deviation in s of the contact time of balls."""

POWER, POWER_ERROR = 0.1, 0.1
"""Prior of the power: contacts last as v^(-POWER), 0 to 1/5."""

AIR_ERROR = 2.0
"""Prior standard deviation of β in 1/s² about 0; a table-tennis ball has 1.2."""

NEARER = 0.03
"""Prior standard deviations of the growth of heights over a drop, and of the rise of the floor.

The rise is relative to the highest flight. A camera is set up by eye.
"""

LEVEL = 1e-6
"""The same for one impact, which cannot separate a rising floor from another e."""

_FIRMLY = 100.0
"""Factor by which parameters that could absorb misreadings are held more firmly at first."""

_FIRM_TURNS, _TURNS, _FEW = 5, 3, 6
"""Rounds of reweighting, at first and then, and evaluations of the model in each."""

_LEAST = 1e-9
"""Least noise as a fraction of the range of positions."""

MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def robustly(model: Model, time: Floats, seen: np.ndarray, vector: Floats) -> Floats | None:
    """Return the vector by iterated least squares with the weights 1/(1 + r²).

    Contact and air parameters, which could absorb misreadings, are held at first.
    """
    found: Floats | None = vector
    for firmly in (*[_FIRMLY] * _FIRM_TURNS, *[1.0] * _TURNS):
        sigma = scatter(model, found, time, seen)
        rest = (seen - model.places(found, time)[0]) / sigma
        size = sigma * np.sqrt(1 + np.sum(rest**2, axis=1, keepdims=True))
        found = search(model, time, seen, size, found, firmly=firmly, most=_FEW)
        if found is None:
            return None
    return found


def search(
    model: Model,
    time: Floats,
    seen: np.ndarray,
    sigma: np.ndarray,
    start: Floats,
    *,
    firmly: float = 1.0,
    most: int = 60,
) -> Floats | None:
    """Return the least-squares vector; None if the search fails.

    `sigma` (axes,) or (n, axes).
    """
    prior = _prior(model, start)

    def residuals(vector: Floats) -> Floats:
        rest = (seen - model.places(vector, time)[0]) / sigma
        return np.append(rest, (vector[prior.place] - prior.mean) / prior.error * firmly)

    def slope(vector: Floats) -> np.ndarray:
        found = _slope_of(model, vector, time, sigma, prior)
        found[-prior.place.size :] *= firmly
        return found

    if not np.isfinite(residuals(start)).all():
        return None
    # MINPACK takes no singular values of tall matrices, on which threads would wait.
    found = least_squares(
        residuals,
        start,
        slope,  # pyright: ignore[reportArgumentType]  (SciPy's types know names of schemes only)
        method="lm",
        x_scale="jac",
        ftol=1e-9,
        xtol=1e-11,
        max_nfev=most,
    )
    times = found.x[: model.flights + 1]
    good = found.x[model.fall] > 0 and np.all(np.diff(times) > 0)
    return found.x if good and np.isfinite(found.x).all() else None


class _Beforehand(NamedTuple):
    """Parameters known beforehand: their places in the vector, means and standard deviations."""

    place: np.ndarray
    mean: Floats
    error: Floats


def _prior(model: Model, vector: Floats) -> _Beforehand:
    growth = (NEARER if model.flights > 2 else LEVEL) / (model.last - model.first)
    whole = float(np.max(np.diff(vector[: model.flights + 1])))
    rise = growth * abs(vector[model.fall]) * whole**2 / 8
    place = np.array([model.contact, model.power, model.air, model.rise, model.growth])
    error = np.array([CONTACT_ERROR, POWER_ERROR, AIR_ERROR, rise, growth])
    return _Beforehand(place, np.array([CONTACT, POWER, 0.0, 0.0, 0.0]), error)


def _slope_of(
    model: Model, vector: Floats, time: Floats, sigma: np.ndarray, prior: _Beforehand
) -> np.ndarray:
    """Return the derivative of the residuals, including those of the prior."""
    _, slope = model.places(vector, time)
    known = np.eye(model.size)[prior.place] / prior.error[:, None]
    return np.concatenate([(-slope / sigma[..., None]).reshape(-1, model.size), known])


def scatter(model: Model, vector: Floats, time: Floats, seen: np.ndarray) -> Floats:
    """Return the noise along and up (axes,), from the median residual."""
    sigma = MAD * np.median(np.abs(seen - model.places(vector, time)[0]), axis=0)
    sigma *= math.sqrt(seen.size / max(seen.size - model.size, 1))
    return np.maximum(sigma, _LEAST * max(float(np.ptp(seen)), 1e-300))


FAR = 5.0
"""Standard deviations beyond which a frame is a misreading."""

LEAST_FRAMES = 4
"""Least frames of a flight: a parabola of known acceleration has two parameters."""

_LOST = 3
"""Successive frames whose mean is off, which end the first and the last flight."""

_SEEN = 8.0
"""Least rise of a flight in standard deviations."""

_ROUNDS = 6

_SHORTEST = 256
"""Tracks up to this length share one compiled function."""


class Guess(NamedTuple):
    """The start of a search: ends of the flights and impacts between them (m + 2,) in s.

    Also floor and acceleration, the noise of one height, and the frames from `low` to below `high`.
    """

    times: Floats
    floor: float
    fall: float
    noise: float
    low: int
    high: int


def fit_drop(frames: Frames, guess: Guess) -> Drop | None:
    """Return the best-fitting drop; None if too few frames are left or nothing fits.

    A first or last flight with too few frames is left out.
    """
    while guess.times.size > 2:
        found = _fit(frames, guess)
        if isinstance(found, Drop):
            return found
        short = np.flatnonzero(found < LEAST_FRAMES)
        times = guess.times
        step = float(np.median(np.diff(frames.time)))
        if short.size and short[-1] == times.size - 2:
            high = int(np.searchsorted(frames.time, times[-2] - 0.55 * step))
            guess = guess._replace(times=times[:-1], high=min(guess.high, high))
        elif short.size and short[0] == 0:
            low = int(np.searchsorted(frames.time, times[1] + 0.55 * step))
            guess = guess._replace(times=times[1:], low=max(guess.low, low))
        else:
            return None
    return None


def _fit(frames: Frames, guess: Guess) -> Drop | np.ndarray:
    """Return the drop, or the frames of each flight if it cannot be fitted."""
    time, flights = frames.time, guess.times.size - 1
    low, high = guess.low, guess.high
    step = float(np.median(np.diff(time)))
    seen = _observations(frames)
    speeds = _speeds(np.diff(guess.times))
    model = Model(flights, frames.along is not None, time[low], time[high - 1], speeds)
    vector = _start(model, frames, guess)
    off = np.zeros(time.size, bool)
    for k in range(_ROUNDS):
        inside = _inside(model, vector, time, low, high, step)
        use = inside & ~off
        counts = _counts(model, vector, time, use)
        if counts.min() < LEAST_FRAMES:
            return counts
        if k == 0:
            found = robustly(model, time[use], seen[use], vector)
        else:
            sigma = scatter(model, vector, time[use], seen[use])
            found = search(model, time[use], seen[use], sigma, vector)
        if found is None:
            return counts
        vector = found
        sigma = scatter(model, vector, time[use], seen[use])
        residual = seen - model.places(vector, time)[0]
        now = np.any(np.abs(residual) > FAR * sigma, axis=1)
        before = (low, high)
        low, high = _reach(model, vector, time, residual[:, 0], sigma[0], step)
        if k > 1 and before == (low, high) and np.array_equal(now[inside], off[inside]):
            break
        off = now
        ends, _ = model.ends(vector)
        model = dataclasses.replace(
            model,
            first=time[low],
            last=time[high - 1],
            speeds=_speeds(ends[:, 1] - ends[:, 0]),
        )
    inside = _inside(model, vector, time, low, high, step)
    used = inside & ~off
    counts = _counts(model, vector, time, used, sigma[0])
    if counts.min() < LEAST_FRAMES:
        return counts
    return _result(model, vector, frames, seen, sigma, used, inside & off)


def refit(drop: Drop, shape: Shape, beta: float) -> Drop:
    """Refit the same frames with flights of another shape: with known air drag, which gives β."""
    frames = drop.frames
    model = Model(
        drop.start.size,
        frames.along is not None,
        frames.time[drop.used][0],
        frames.time[drop.used][-1],
        _speeds(drop.seconds),
        shape,
        beta,
    )
    seen, sigma = _observations(frames), np.array([s for s in drop.noise[::-1] if s is not None])
    found = search(model, frames.time[drop.used], seen[drop.used], sigma, drop.vector)
    vector = drop.vector if found is None else found
    return _result(model, vector, frames, seen, sigma, drop.used, drop.off)


def _observations(frames: Frames) -> np.ndarray:
    """Return heights, and positions along the floor (n, 1 or 2)."""
    columns = [frames.height] if frames.along is None else [frames.height, frames.along]
    return np.stack(columns, axis=1)


def _speeds(seconds: Floats) -> Floats:
    """Return speeds of impacts relative to the first, from the flight times before them."""
    return np.clip(seconds[:-1] / seconds[0], 1e-3, 1e3)


def _start(model: Model, frames: Frames, guess: Guess) -> Floats:
    vector = np.zeros(model.size)
    vector[: model.flights + 1] = guess.times
    vector[model.contact], vector[model.power] = CONTACT, POWER
    vector[model.floor], vector[model.fall] = guess.floor, guess.fall
    if frames.along is not None:
        knots = np.concatenate([[model.first], guess.times[1:-1], [model.last]])
        at = np.searchsorted(frames.time, knots)
        near = np.clip(at[:, None] + np.arange(-2, 3), guess.low, guess.high - 1)
        vector[model.tilt + 1 :] = np.median(frames.along[near], axis=1)
    return vector


def _inside(
    model: Model, vector: Floats, time: Floats, low: int, high: int, step: float
) -> Bool[np.ndarray, " n"]:
    """Return the frames within flights, far enough from contacts that no exposure includes one."""
    inside = np.zeros(time.size, bool)
    inside[low:high] = True
    start, end = model.ends(vector)[0].T
    for impact, half in zip(vector[1 : model.flights], (start[1:] - end[:-1]) / 2, strict=True):
        inside &= np.abs(time - impact) > abs(half) + 0.55 * step
    return inside


def _counts(
    model: Model, vector: Floats, time: Floats, use: np.ndarray, noise: float = 0.0
) -> np.ndarray:
    """Return the frames of each flight; 0 if it does not rise above the noise."""
    start, end = model.ends(vector)[0].T
    seen = vector[model.fall] * (end - start) ** 2 / 8 > _SEEN * noise
    return seen * np.bincount(model.flight_of(vector, time[use]), minlength=model.flights)


def _reach(
    model: Model, vector: Floats, time: Floats, residual: Floats, noise: float, step: float
) -> tuple[int, int]:
    """Return the frames from the first to below the last that are on the parabolas.

    A ball that is held at release, or caught, leaves its parabola slowly. Frames are also left out
    for as long as that is hidden in the noise.
    """
    start, end = model.ends(vector)[0].T
    fall, limit = vector[model.fall], FAR / math.sqrt(_LOST)
    clipped = np.clip(residual / noise, -FAR, FAR)

    def hidden(at: float, flight: int, lost: bool) -> float:
        speed = abs(fall * ((start[flight] + end[flight]) / 2 - at))
        far = (limit + 1) * noise
        return (math.sqrt(speed**2 + 2 * far * fall) - speed) / fall + lost * (_LOST // 2) * step

    low = int(np.searchsorted(time, vector[1] - 0.55 * step))
    low -= _until_lost(clipped[:low][::-1], limit)
    begin = float(time[min(low, time.size - 1)])
    low = int(np.searchsorted(time, max(begin + hidden(begin, 0, low > 0), start[0])))
    high = int(np.searchsorted(time, vector[model.flights - 1] + 0.55 * step))
    high += _until_lost(clipped[high:], limit)
    over = float(time[high - 1])
    over -= hidden(over, model.flights - 1, high < time.size)
    high = int(np.searchsorted(time, min(over, end[-1]), "right"))
    return min(low, time.size - 1), max(high, 1)


def _until_lost(residual: Floats, limit: float) -> int:
    """Return the frames until some in a row are off in their mean, in standard deviations."""
    if residual.size < _LOST:
        return residual.size
    mean = np.convolve(residual, np.ones(_LOST) / _LOST, "valid")
    lost = np.flatnonzero(np.abs(mean) > limit)
    return int(lost[0]) if lost.size else residual.size


def _result(
    model: Model,
    vector: Floats,
    frames: Frames,
    seen: np.ndarray,
    sigma: Floats,
    used: np.ndarray,
    off: np.ndarray,
) -> Drop:
    time, flights = frames.time, model.flights
    places, _ = model.places(vector, time)
    residual = (seen - places)[used]
    # Scale both errors by the residuals, with the degrees of freedom.
    freedom = max(residual.size - model.size, 1) / residual.size
    sigma = np.sqrt(np.mean(residual**2, axis=0) / freedom)
    slope = _slope_of(model, vector, time[used], sigma, _prior(model, vector))
    size = np.linalg.norm(slope, axis=0)
    size[size == 0] = 1.0
    covariance = np.linalg.pinv((slope / size).T @ (slope / size)) / np.outer(size, size)
    ends, ends_slope = model.ends(vector)
    start, end = ends.T
    lasting = ends_slope[:, 1] - ends_slope[:, 0]
    error = np.sqrt(np.diag(covariance))

    def known(place: int) -> tuple[float, float]:
        return float(vector[place]), float(error[place])

    tilt = known(model.tilt) if model.along else (None, None)
    whole = (time >= time[used][0]) & (time <= time[used][-1])
    fitted = np.where(whole[:, None], places, math.nan)
    return Drop(
        frames=frames,
        start=start,
        end=end,
        covariance=lasting @ covariance @ lasting.T,
        impact=vector[1:flights].copy(),
        error=error[1:flights],
        floor=model.places(vector, vector[1:flights])[0][:, 0],
        camera=Camera(*known(model.fall), *tilt),
        air=None if model.shape else known(model.air),
        rise=known(model.rise),
        growth=known(model.growth),
        noise=(float(sigma[1]) if model.along else None, float(sigma[0])),
        used=used,
        off=off,
        fitted=fitted[:, 0],
        fitted_along=fitted[:, 1] if model.along else None,
        vector=vector,
    )


def shape_of(flight: Flight) -> Shape:
    """Return H of a flight with drag: height over g, by time since launch and by duration."""

    def shape(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
        size, n = max(_SHORTEST, 1 << (since.size - 1).bit_length()), since.size
        both = np.ones((2, size))
        both[0, :n], both[1, :n] = since, whole
        with jax.enable_x64(True):
            found = _height(*both, np.float64(flight.gravity), np.float64(flight.rate or 0.0))
        height, by_since, by_whole = (np.array(one)[:n] for one in found)
        return height, by_since, by_whole

    return shape


@jax.jit
def _height(since: Array, whole: Array, gravity: Array, b: Array) -> tuple[Array, Array, Array]:
    def height(since: Array, whole: Array) -> Array:
        launch = Flight.launch_speed(whole, gravity, b)
        return Flight.height_after(since, launch, gravity, b) / gravity

    one, zero = jnp.ones_like(since), jnp.zeros_like(since)
    value, by_since = jax.jvp(height, (since, whole), (one, zero))
    _, by_whole = jax.jvp(height, (since, whole), (zero, one))
    return value, by_since, by_whole
