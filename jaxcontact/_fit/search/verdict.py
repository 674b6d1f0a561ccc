"""Whether the end of a search is a minimum, and which parameters ran to a bound."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..problem.problem import Problem
from ..problem.space import Space
from .laplace import Direction
from .minimum import Found, losses, start_scale

AT_BOUND = "at the bound"
"""How a reason ends where parameters ran there."""

_AT_BOUND = 1e-6
"""A parameter nearer to a bound than this part of the interval has run there."""

_FAR = 18.0
"""A logarithm that has fallen by more than this (to 1.5e-8 of its start) has run to 0."""

_OUTWARD = 3.0
"""With a larger remaining step of a logarithm or logit, the search creeps to a bound."""

_ASIDE = 1e-2
"""How far a direction without slope is followed to see whether the loss falls there, relative to
the parameter, absolute for a logarithm or a logit."""

_FALL = 1e-5
"""Relative fall of the loss by which a saddle is recognised: a curvature of order 1 gives 1e-4."""

_ROUNDING = 16 * float(np.finfo(float).eps)
"""Of a residual, relative to the terms it is the sum of."""


def at_bound_of(space: Space, found: Found, start: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Which parameters have run to an end of their interval.

    A wide interval may hold a well-determined value near its end, so nearness alone is not enough:
    a change of the distance to the end by a factor e must stay below the scatter of the data, or
    the search must have stopped by itself with an outward step remaining.
    """
    low, high = np.asarray(space.low), np.asarray(space.high)
    two_sided = space.bounded_above
    near = _AT_BOUND * np.where(two_sided, high - low, 1)
    below = np.where(two_sided, found.values - low, np.inf) < near
    below |= space.has_unit & ~two_sided & (found.theta < start - _FAR)
    above = np.where(two_sided, high - found.values, np.inf) < near
    scatter = np.sqrt(np.sum(found.z**2) / max(int(used.sum()) - start.size, 1))
    noticeable = np.linalg.norm(found.jacobian, axis=0) > scatter
    outwards = (below & (found.step < 0)) | (above & (found.step > 0))
    creeps = ~found.still & outwards & found.stopped
    return (below | above) & (~noticeable | creeps)


def creeping(space: Space, step: np.ndarray) -> np.ndarray:
    """Which logarithms and logits a search moves to a bound, where its remaining step is large."""
    # A logarithm has a bound on one side only.
    bounded = space.bounded_above | (space.has_unit & (step < 0))
    return (np.abs(step) > _OUTWARD) & bounded


def falling(
    problem: Problem, found: Found, start: np.ndarray, directions: tuple[Direction, ...]
) -> Direction | None:
    """A direction without slope along which the loss still falls: the end is no minimum."""
    if not directions:
        return None
    theta, space = found.theta, problem.space
    size = np.maximum(np.where(space.has_unit, 1, np.abs(theta)), start_scale(problem, start))
    change = np.array([[one.components.get(name, 0) for name in space.names] for one in directions])
    change *= _ASIDE / np.max(np.abs(change) / size, axis=1, keepdims=True)
    aside = np.asarray(
        losses(problem, jnp.asarray(theta + np.stack([change, -change])).reshape(-1, len(theta)))
    ).reshape(2, -1)
    # Where the data are met to rounding, the loss is nothing else.
    factor = np.asarray(problem.factor)
    used = factor > 0
    terms = factor[used] * (np.abs(problem.y)[used] + np.abs(found.prediction)[used])
    blur = _ROUNDING * (terms + np.abs(found.jacobian[used]) @ np.abs(theta))
    blur = np.sum(blur * (np.abs(found.z[used]) + blur))
    falls = np.any(aside < float(found.loss) * (1 - _FALL) - blur, axis=0)
    return directions[int(np.argmax(falls))] if falls.any() else None


def verdict(found: Found, at_bound: np.ndarray, space: Space, most: int) -> tuple[bool, str]:
    """Whether the search converged, and the reason in words."""
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
