"""Least squares for the vector of a model, robust at first, and the residual noise."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import least_squares

from .model import Model
from .seen import Floats

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
    nearer = nearer_errors(model, start)

    def residuals(vector: Floats) -> Floats:
        rest = (seen - model.places(vector, time)[0]) / sigma
        known = (
            (vector[model.contact] - CONTACT) / CONTACT_ERROR,
            (vector[model.power] - POWER) / POWER_ERROR,
            vector[model.air] / AIR_ERROR,
            vector[model.rise] / nearer[0],
            vector[model.growth] / nearer[1],
        )
        return np.append(rest, np.multiply(known, firmly))

    def slope(vector: Floats) -> np.ndarray:
        found = slope_of(model, vector, time, sigma, nearer)
        found[-5:] *= firmly
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


def nearer_errors(model: Model, vector: Floats) -> tuple[float, float]:
    """Return the prior standard deviations of σ and γ about 0."""
    growth = (NEARER if model.flights > 2 else LEVEL) / (model.last - model.first)
    whole = float(np.max(np.diff(vector[: model.flights + 1])))
    return growth * abs(vector[model.fall]) * whole**2 / 8, growth


def slope_of(
    model: Model,
    vector: Floats,
    time: Floats,
    sigma: np.ndarray,
    nearer: tuple[float, float],
) -> np.ndarray:
    """Return the derivative of the residuals, including those of the prior."""
    _, slope = model.places(vector, time)
    slope = (-slope / sigma[..., None]).reshape(-1, model.size)
    known = np.zeros((5, model.size))
    known[0, model.contact], known[1, model.power] = 1 / CONTACT_ERROR, 1 / POWER_ERROR
    known[2, model.air] = 1 / AIR_ERROR
    known[3, model.rise], known[4, model.growth] = 1 / nearer[0], 1 / nearer[1]
    return np.concatenate([slope, known])


def scatter(model: Model, vector: Floats, time: Floats, seen: np.ndarray) -> Floats:
    """Return the noise along and up (axes,), from the median residual."""
    sigma = MAD * np.median(np.abs(seen - model.places(vector, time)[0]), axis=0)
    sigma *= math.sqrt(seen.size / max(seen.size - model.size, 1))
    return np.maximum(sigma, _LEAST * max(float(np.ptp(seen)), 1e-300))
