"""Times of impacts between frames: all parabolas of a drop fitted together.

Flights share the fall, the floor and the duration of contact, so that each is known from the frames
of all. Frames in which the ball touches the floor, or may have during the exposure, are left out;
so are misreadings, by a robust search first and by their distance then.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool
from scipy.optimize import least_squares

from ._model import Model, Shape, parabola
from ._seen import Camera, Drop, Floats, Frames

CONTACT, CONTACT_ERROR = 2e-3, 4e-3
"""In s: what contacts of balls last, and its standard deviation, before frames say more."""

FAR = 5.0
"""Standard deviations from which a frame is a misreading."""

LEAST_FRAMES = 4
"""Of a flight: a parabola whose fall is known has two numbers."""

_LOST = 3
"""Frames in a row that are off end the first and the last flight."""

_ROUNDS = 6
_MAD = 1.4826


class Guess(NamedTuple):
    """Where a search begins: the ends of the flights and the impacts between (m + 2,) in s, the
    floor and the fall, the noise of one height, and the frames from `low` to below `high`.
    """

    times: Floats
    floor: float
    fall: float
    noise: float
    low: int
    high: int


def fit_drop(frames: Frames, guess: Guess) -> Drop | None:
    """The drop whose parabolas fit best; None where too few frames are left or nothing fits."""
    time, flights = frames.time, guess.times.size - 1
    low, high = guess.low, guess.high
    step = float(np.median(np.diff(time)))
    seen = _seen(frames)
    model = Model(flights, frames.along is not None, time[low], time[high - 1])
    start = _start(model, frames, guess)
    sigma = np.full(seen.shape[1], max(guess.noise, 1e-12))
    vector, off = start, np.zeros(time.size, bool)
    for k in range(_ROUNDS):
        inside = _inside(model, vector, time, low, high, step)
        model = dataclasses.replace(model, first=time[low], last=time[high - 1])
        robust = k == 0
        use = inside if robust else inside & ~off
        if not _enough(model, vector, time, use):
            return None
        found = _search(model, time[use], seen[use], sigma, vector, robust=robust)
        if found is None:
            return None
        vector = found
        residual = seen - model.places(vector, time)[0]
        sigma = _MAD * np.median(np.abs(residual[use]), axis=0)
        sigma = np.maximum(sigma, 1e-9 * max(np.ptp(frames.height), 1e-300))
        now = np.any(np.abs(residual) > FAR * sigma, axis=1)
        before = (low, high)
        low, high = _reach(model, vector, time, now, sigma[0], step)
        if k > 1 and before == (low, high) and np.array_equal(now[inside], off[inside]):
            break
        off = now
    return _drop(model, vector, frames, seen, sigma, low, high, step)


def refit(drop: Drop, shape: Shape) -> Drop:
    """The same frames with flights of another shape: with the drag of the air."""
    frames = drop.frames
    model = Model(
        drop.start.size,
        frames.along is not None,
        frames.time[drop.used][0],
        frames.time[drop.used][-1],
        shape,
    )
    seen, sigma = _seen(frames), np.array([s for s in drop.noise[::-1] if s is not None])
    found = _search(model, frames.time[drop.used], seen[drop.used], sigma, drop.vector)
    vector = drop.vector if found is None else found
    return _result(model, vector, frames, seen, sigma, drop.used, drop.off)


def _seen(frames: Frames) -> np.ndarray:
    """Heights, and places along (n, 1 or 2)."""
    columns = [frames.height] if frames.along is None else [frames.height, frames.along]
    return np.stack(columns, axis=1)


def _start(model: Model, frames: Frames, guess: Guess) -> Floats:
    vector = np.zeros(model.size)
    vector[: model.flights + 1] = guess.times
    vector[model.contact] = CONTACT
    vector[model.floor], vector[model.fall] = guess.floor, guess.fall
    if frames.along is not None:
        knots = np.concatenate([[model.first], guess.times[1:-1], [model.last]])
        at = np.searchsorted(frames.time, knots)
        near = np.clip(at[:, None] + np.arange(-2, 3), guess.low, guess.high - 1)
        vector[model.tilt + 1 :] = np.median(frames.along[near], axis=1)
    return vector


def _search(
    model: Model,
    time: Floats,
    seen: np.ndarray,
    sigma: Floats,
    start: Floats,
    *,
    robust: bool = False,
) -> Floats | None:
    """The vector with the least squares; None where the search fails."""

    def residuals(vector: Floats) -> Floats:
        places, _ = model.places(vector, time)
        rest = ((seen - places) / sigma).ravel()
        return np.append(rest, (vector[model.contact] - CONTACT) / CONTACT_ERROR)

    def slope(vector: Floats) -> np.ndarray:
        return _slope(model, vector, time, sigma)

    if not np.isfinite(residuals(start)).all():
        return None
    found = least_squares(
        residuals,
        start,
        slope,
        x_scale="jac",
        loss="soft_l1" if robust else "linear",
        xtol=1e-10,
        ftol=1e-10,
        gtol=1e-12,
        max_nfev=60,
    )
    times = found.x[: model.flights + 1]
    good = found.x[model.fall] > 0 and np.all(np.diff(times) > 0)
    return found.x if good and np.isfinite(found.x).all() else None


def _slope(model: Model, vector: Floats, time: Floats, sigma: Floats) -> np.ndarray:
    """The derivative of the residuals, that of what is known of contacts included."""
    _, slope = model.places(vector, time)
    slope = (-slope / sigma[:, None]).reshape(-1, model.size)
    known = np.zeros((1, model.size))
    known[0, model.contact] = 1 / CONTACT_ERROR
    return np.concatenate([slope, known])


def _inside(
    model: Model, vector: Floats, time: Floats, low: int, high: int, step: float
) -> Bool[np.ndarray, " n"]:
    """The frames within flights, far enough from contacts that no exposure has one."""
    inside = np.zeros(time.size, bool)
    inside[low:high] = True
    away = abs(vector[model.contact]) / 2 + 0.55 * step
    for impact in vector[1 : model.flights]:
        inside &= np.abs(time - impact) > away
    return inside


def _enough(model: Model, vector: Floats, time: Floats, use: np.ndarray) -> bool:
    counts = np.bincount(model.flight_of(vector, time[use]), minlength=model.flights)
    return bool(np.all(counts >= LEAST_FRAMES))


def _reach(
    model: Model, vector: Floats, time: Floats, off: np.ndarray, noise: float, step: float
) -> tuple[int, int]:
    """The frames from the first to below the last that are on the parabolas.

    A ball that is held where it is let go, or is caught, leaves its parabola slowly: for so long as
    that hides in the noise frames are left out, too.
    """
    start, end = np.moveaxis(model.ends() @ vector, 1, 0)
    fall = vector[model.fall]

    def hidden(at: float, flight: int) -> float:
        speed = abs(fall * ((start[flight] + end[flight]) / 2 - at))
        return (math.sqrt(speed**2 + 2 * FAR * noise * fall) - speed) / fall

    first, last = vector[1], vector[model.flights - 1]
    low = int(np.searchsorted(time, first - 0.55 * step))
    stop = _until_lost(off[:low][::-1])
    low -= stop
    begin = time[low] + hidden(float(time[low]), 0) if low < time.size else first
    low = int(np.searchsorted(time, max(begin, start[0]), "left"))
    high = int(np.searchsorted(time, last + 0.55 * step))
    high += _until_lost(off[high:])
    at = float(time[high - 1])
    over = at - hidden(at, model.flights - 1)
    high = int(np.searchsorted(time, min(over, end[-1]), "right"))
    return min(low, time.size - 1), max(high, 1)


def _until_lost(off: np.ndarray) -> int:
    """How many frames until several in a row are off."""
    run = 0
    for k, one in enumerate(off):
        run = run + 1 if one else 0
        if run == _LOST:
            return k + 1 - _LOST
    return off.size - run


def _drop(
    model: Model,
    vector: Floats,
    frames: Frames,
    seen: np.ndarray,
    sigma: Floats,
    low: int,
    high: int,
    step: float,
) -> Drop | None:
    time = frames.time
    inside = _inside(model, vector, time, low, high, step)
    residual = seen - model.places(vector, time)[0]
    off = inside & np.any(np.abs(residual) > FAR * sigma, axis=1)
    used = inside & ~off
    if not _enough(model, vector, time, used):
        return None
    return _result(model, vector, frames, seen, sigma, used, off)


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
    # The size of both errors by what is left, beside the parameters.
    freedom = max(residual.size - model.size, 1) / residual.size
    sigma = np.sqrt(np.mean(residual**2, axis=0) / freedom)
    slope = _slope(model, vector, time[used], sigma)
    size = np.linalg.norm(slope, axis=0)
    size[size == 0] = 1.0
    covariance = np.linalg.pinv((slope / size).T @ (slope / size)) / np.outer(size, size)
    ends = model.ends()
    start, end = np.moveaxis(ends @ vector, 1, 0)
    lasting = ends[:, 1] - ends[:, 0]
    error = np.sqrt(np.diag(covariance))
    tilt, fall = model.tilt, model.fall
    camera = Camera(
        float(vector[fall]),
        float(error[fall]),
        float(vector[tilt]) if model.along else None,
        float(error[tilt]) if model.along else None,
    )
    whole = (time >= time[used][0]) & (time <= time[used][-1])
    fitted = np.where(whole[:, None], places, math.nan)
    return Drop(
        frames=frames,
        start=start,
        end=end,
        covariance=lasting @ covariance @ lasting.T,
        impact=vector[1:flights].copy(),
        error=error[1:flights],
        camera=camera,
        noise=(float(sigma[1]) if model.along else None, float(sigma[0])),
        used=used,
        off=off,
        fitted=fitted[:, 0],
        fitted_along=fitted[:, 1] if model.along else None,
        vector=vector,
    )
