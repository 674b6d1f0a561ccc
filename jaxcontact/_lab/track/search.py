"""The vector of a model with the least squares, robust at first, and the noise of what is left."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import least_squares

from .model import Model
from .seen import Floats

CONTACT, CONTACT_ERROR = 2e-3, 4e-3
"""In s: what contacts of balls last, and its standard deviation, before frames say more."""

POWER, POWER_ERROR = 0.1, 0.1
"""Contacts last as v^(-POWER): 0 to 1/5."""

AIR_ERROR = 2.0
"""The standard deviation of β in 1/s² about 0: a table-tennis ball has 1.2."""

NEARER = 0.03
"""The standard deviations of what heights grow in the picture while the ball bounces, and of what
the floor rises, over the height of the highest flight: a camera is set up by eye."""

LEVEL = 1e-6
"""The same where one impact cannot tell a floor that rises from another e."""

_FIRMLY = 100.0
"""What misreadings would stand in for is held so much more firmly at first."""

_FIRM_TURNS, _TURNS, _FEW = 5, 3, 6
"""How often weights are found anew, at first and then, and evaluations of the model each time."""

_LEAST = 1e-9
"""Of the range of places: no noise is smaller."""

MAD = 1.4826
"""The standard deviation of a normal law over its median absolute deviation."""


def robustly(model: Model, time: Floats, seen: np.ndarray, vector: Floats) -> Floats | None:
    """The vector by least squares with the weights 1/(1 + r²), found in turn.

    Contacts and the air, for which misreadings would stand in, are held at first.
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
    """The vector with the least squares; None where the search fails.

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
    # MINPACK's: it takes no singular values of tall matrices, on which threads would wait.
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
    """The standard deviations of σ and γ about 0 before frames say more."""
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
    """The derivative of the residuals, that of what is known before included."""
    _, slope = model.places(vector, time)
    slope = (-slope / sigma[..., None]).reshape(-1, model.size)
    known = np.zeros((5, model.size))
    known[0, model.contact], known[1, model.power] = 1 / CONTACT_ERROR, 1 / POWER_ERROR
    known[2, model.air] = 1 / AIR_ERROR
    known[3, model.rise], known[4, model.growth] = 1 / nearer[0], 1 / nearer[1]
    return np.concatenate([slope, known])


def scatter(model: Model, vector: Floats, time: Floats, seen: np.ndarray) -> Floats:
    """The noise along and up (axes,), by what most frames leave beside the parameters."""
    sigma = MAD * np.median(np.abs(seen - model.places(vector, time)[0]), axis=0)
    sigma *= math.sqrt(seen.size / max(seen.size - model.size, 1))
    return np.maximum(sigma, _LEAST * max(float(np.ptp(seen)), 1e-300))
