"""Tests whether the end of a search is a minimum, which parameters ran to a bound, and which
numbers a prediction never uses.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..._text.words import first_few
from ..problem.problem import FitProblem, evaluated
from ..problem.space import Space
from .inference import Direction
from .minimum import SearchEnd, losses, start_scale

AT_BOUND = "at the bound"
"""Ending of the reason if parameters ran to a bound."""

_AT_BOUND = 1e-6
"""Distance to a bound, as a fraction of the interval, at which a parameter has run there."""

_FAR = 18.0
"""Fall of a logarithm (to 1.5e-8 of its start) by which a parameter has run to 0."""

_OUTWARD = 3.0
"""Remaining step of a logarithm or logit above which the search creeps to a bound."""

_ASIDE = 1e-2
"""Distance along a flat direction at which the loss is tested.

It is relative to the parameter, absolute for a logarithm or a logit.
"""

_FALL = 1e-5
"""Relative fall of the loss that identifies a saddle; a curvature of order 1 gives 1e-4."""

_ROUNDING = 16 * float(np.finfo(float).eps)
"""Rounding of a residual, relative to the terms of its difference."""


def at_bound_of(space: Space, found: SearchEnd, start: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return which parameters have run to an end of their interval.

    A wide interval may hold a well-determined value near its end, so nearness alone is not enough.
    A change of the distance to the end by a factor e must stay below the scatter of the data.
    Otherwise the search must have stopped by itself with an outward step remaining.
    """
    below, above = near_bound(space, found, start)
    with np.errstate(over="ignore"):
        scatter = np.sqrt(np.sum(found.z**2) / max(int(used.sum()) - start.size, 1))
    noticeable = np.linalg.norm(found.jacobian, axis=0) > scatter
    outwards = (below & (found.step < 0)) | (above & (found.step > 0))
    creeps = ~found.still & outwards & found.stopped
    return (below | above) & (~noticeable | creeps)


def near_bound(space: Space, found: SearchEnd, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which parameters (..., k) are close to the lower, and to the upper end."""
    low, high = np.asarray(space.low), np.asarray(space.high)
    two_sided = space.bounded_above
    near = _AT_BOUND * np.where(two_sided, high - low, 1)
    below = np.where(two_sided, found.values - low, np.inf) < near
    below |= space.has_unit & ~two_sided & (found.theta < start - _FAR)
    return below, np.where(two_sided, high - found.values, np.inf) < near


def creeping(space: Space, step: np.ndarray) -> np.ndarray:
    """Return which logarithms and logits creep to a bound, by their large remaining step."""
    # A logarithm has a bound on one side only.
    bounded = space.bounded_above | (space.has_unit & (step < 0))
    return (np.abs(step) > _OUTWARD) & bounded


def falling(
    problem: FitProblem, found: SearchEnd, start: np.ndarray, directions: tuple[Direction, ...]
) -> Direction | None:
    """Return a flat direction along which the loss still falls, so the end is not a minimum."""
    if not directions:
        return None
    theta, space = found.theta, problem.space
    size = np.maximum(np.where(space.has_unit, 1, np.abs(theta)), start_scale(problem, start))
    change = np.array([[one.components.get(name, 0) for name in space.names] for one in directions])
    change *= _ASIDE / np.max(np.abs(change) / size, axis=1, keepdims=True)
    aside = np.asarray(
        losses(problem, jnp.asarray(theta + np.stack([change, -change])).reshape(-1, len(theta)))
    ).reshape(2, -1)
    # If the data are met to rounding, the loss is only rounding.
    factor = np.asarray(problem.factor)
    used = factor > 0
    terms = factor[used] * (np.abs(problem.y)[used] + np.abs(found.prediction)[used])
    blur = _ROUNDING * (terms + np.abs(found.jacobian[used]) @ np.abs(theta))
    blur = np.sum(blur * (np.abs(found.z[used]) + blur))
    falls = np.any(aside < float(found.loss) * (1 - _FALL) - blur, axis=0)
    return directions[int(np.argmax(falls))] if falls.any() else None


def verdict(found: SearchEnd, at_bound: np.ndarray, space: Space, most: int) -> tuple[bool, str]:
    """Return whether the search converged, and the reason in words."""
    if not (np.isfinite(found.loss) and np.isfinite(found.jacobian).all()):
        return False, "the prediction is not finite there"
    ran = [name for name, there in zip(space.names, at_bound, strict=True) if there]
    bound = f", {' and '.join(ran)} {AT_BOUND}" if ran else ""
    left = ~(found.still | at_bound)
    if not left.any():
        return True, "no step is left" + bound
    i = int(np.argmax(np.where(left, np.abs(found.step) / np.asarray(found.allowed), 0)))
    step = f"a step of {abs(float(found.step[i])):.1e} in {space.labels[i]} is left"
    if int(found.steps) >= most:
        return False, f"{most} steps were not enough: {step}" + bound
    return False, f"no better point was found, but {step}" + bound


def refuse_unused(problem: FitProblem, found: SearchEnd) -> None:
    """Raise ValueError for numbers of the start that do not enter the prediction.

    A number whose derivative alone vanishes is not identifiable, which is not a mistake.
    """
    without = np.flatnonzero(~np.any(found.jacobian, axis=0))
    if not without.size:
        return
    leaves, structure = jax.tree.flatten(problem.space.tree_of(jnp.asarray(found.values)))
    fitted = [i for i, shape in enumerate(problem.space.shapes) if shape is not None]

    def of_fitted(numbers: list[jax.Array]) -> list[jax.Array]:
        whole = list(leaves)
        for i, number in zip(fitted, numbers, strict=True):
            whole[i] = number
        tree = jax.tree.unflatten(structure, whole)
        return jax.tree.leaves(evaluated(problem.predict, tree, problem.x))

    jaxpr = jax.make_jaxpr(of_fitted)([leaves[i] for i in fitted]).jaxpr
    # Backwards from the results; all inputs of one operation count as used by it.
    used = {id(one) for one in jaxpr.outvars}
    for step in reversed(jaxpr.eqns):
        if any(id(one) in used for one in step.outvars):
            used |= {id(one) for one in step.invars}
    counts = [np.size(leaves[i]) for i in fitted]
    enters = np.repeat([id(one) in used for one in jaxpr.invars], counts)
    names = [problem.space.names[i] for i in without if not enters[i]]
    if names:
        raise ValueError(
            "Argument `start` must hold numbers that the prediction uses, but does not use "
            f"{first_few(names)}; leave out what is not fitted, or hold it by `transforms`."
        )
