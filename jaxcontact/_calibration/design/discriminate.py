"""The design of readings that separates two laws."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._fit import AbstractTransform, Space, fit
from ..._program import quick
from ..problems.impacts import ImpactModel, Outcome

_SETTLED = 1e-3
"""Relative decrease of the largest difference of two laws at convergence."""

_ROUNDS = 50
_REACH = 1.0
"""Step limit of one linear programme, in logarithms or logits."""

_SAME = 1e-6
"""Difference of two laws in units of the noise below which they are the same."""


def telling_apart(
    model: Outcome,
    other: ImpactModel,
    speeds: np.ndarray,
    readings: np.ndarray,
    size: np.ndarray,
    transforms: dict[str, AbstractTransform],
) -> np.ndarray:
    """Return the share of each candidate in the plan that separates another law from `readings`.

    The parameters of the other law minimise its largest difference. The multipliers of the
    candidates with that difference are the best plan; under it, these parameters are also those of
    least squares (Atkinson & Fedorov 1975). Solved by successive linear programmes.
    """
    # Imported here, since `linprog` loads half of SciPy.
    from scipy.optimize import linprog

    fields = model.fields
    data = dict(zip(fields, readings.reshape(len(fields), -1), strict=True))
    sigma = dict(zip(fields, size.reshape(len(fields), -1), strict=True))
    found = fit(model, data, other, x=speeds, sigma=sigma, transforms=transforms, throw=False)
    if not found.converged:
        raise ValueError(
            "Argument `goal` must be a law that can be fitted to the other, but its fit did not "
            f"converge: {found.reason}."
        )
    space, theta, reach = found.problem.space, found._theta, _REACH
    slopes, off = _differences(model, space, theta, speeds, readings, size)
    share = np.full(len(off), 1 / len(off))
    for _ in range(_ROUNDS):
        if np.max(np.abs(off)) < _SAME:
            return share
        # |off + slopes @ change| <= bound for each candidate, with the least bound.
        rows = np.concatenate([slopes, -slopes])
        limits = [(-reach, reach)] * theta.size + [(0, None)]
        cost = np.append(np.zeros(theta.size), 1.0)
        upper = np.column_stack([rows, -np.ones(len(rows))])
        made = linprog(cost, upper, np.concatenate([-off, off]), bounds=limits)
        multipliers = -made.ineqlin.marginals
        share = multipliers.reshape(2, -1).sum(axis=0)
        largest = np.max(np.abs(off))
        if largest - made.fun <= _SETTLED * largest:
            break
        there = _differences(model, space, theta + made.x[:-1], speeds, readings, size)
        if np.max(np.abs(there[1])) < largest:
            theta, (slopes, off) = theta + made.x[:-1], there
        else:
            reach = np.max(np.abs(made.x[:-1])) / 4
    return share / share.sum()


def _differences(
    model: Outcome,
    space: Space,
    theta: np.ndarray,
    speeds: np.ndarray,
    readings: np.ndarray,
    size: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of a law's readings, and its differences, in units of noise."""
    slopes, own = readings_of(model, space, theta, speeds)
    return slopes / size[:, None], (own - readings) / size


def distance_of(
    model: Outcome,
    other: ImpactModel,
    speeds: np.ndarray,
    readings: np.ndarray,
    size: np.ndarray,
    counts: np.ndarray,
    transforms: dict[str, AbstractTransform],
) -> float:
    """Return λ of a plan, with the other law fitted to its readings."""
    fields = model.fields
    data = dict(zip(fields, readings.reshape(len(fields), -1), strict=True))
    weights = dict(zip(fields, (counts / size**2).reshape(len(fields), -1), strict=True))
    found = fit(model, data, other, x=speeds, weights=weights, transforms=transforms, throw=False)
    distance = 2 * found.loss if found.converged else math.nan
    return 0.0 if distance < counts.sum() * _SAME**2 else distance


def readings_of(
    model: Outcome, space: Space, theta: np.ndarray, speeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return d reading/d(free coordinate) of all candidates, and the readings.

    Quantities follow each other in the order of the model.
    """
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        slopes, readings = _compiled(model, space, jnp.asarray(theta), jnp.asarray(speeds))
    return np.asarray(slopes), np.asarray(readings)


@quick
def _compiled(
    model: Outcome, space: Space, theta: Float[Array, " k"], speeds: Float[Array, " m"]
) -> tuple[Float[Array, "qm k"], Float[Array, " qm"]]:

    def read(theta: Float[Array, " k"]) -> tuple[Array, Array]:
        found = model(space.tree_of(space.values(theta)), speeds)
        readings = jnp.concatenate([found[name] for name in model.fields])
        return readings, readings

    return jax.jacfwd(read, has_aux=True)(theta)
