"""Whether the end of a search is a minimum, and which numbers ran to a bound."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ._found import Found, losses
from ._inference import AT_BOUND, Direction
from ._problem import Problem
from ._space import Space

_FAR = 18.0
"""A logarithm that has gone down by more than this (to 1.5e-8 of its start) has run to 0."""

_ASIDE = 1e-2
"""How far a direction without slope is followed to see whether the loss falls there, relative to a
number, or in a logarithm or logit."""

_FALL = 1e-5
"""Relative fall of the loss by which a saddle is known: a curvature of order 1 gives 1e-4."""


def at_bound_of(space: Space, found: Found, start: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Which numbers have run to an end of their interval.

    Near an end is not enough: a wide interval may hold a number that the data tell well. It has run
    there if the data do not see its distance from the end change by a factor e, or if the search
    stopped by itself with a step outwards left.
    """
    low, high = np.asarray(space.low), np.asarray(space.high)
    values, theta, step = (np.asarray(a) for a in (found.values, found.theta, found.step))
    kinds = np.array(space.kinds)
    logit = kinds == "logit"
    width = np.where(logit, high - low, 1)
    below = np.where(logit, values - low, np.inf) < AT_BOUND * width
    below |= (kinds == "log") & (theta < start - _FAR)
    above = np.where(logit, high - values, np.inf) < AT_BOUND * width
    z, jacobian = np.asarray(found.z), np.asarray(found.jacobian)
    scatter = np.sqrt(np.sum(z**2) / max(int(used.sum()) - theta.size, 1))
    seen = np.linalg.norm(jacobian, axis=0) > scatter
    outwards = (below & (step < 0)) | (above & (step > 0))
    creeps = ~np.asarray(found.still) & outwards & bool(found.patient)
    return (below | above) & (~seen | creeps)


def falling(
    problem: Problem, found: Found, start: np.ndarray, directions: tuple[Direction, ...]
) -> Direction | None:
    """A direction without slope in which the loss falls all the same: this is no minimum."""
    if not directions or found.loss == 0:
        return None
    theta, names = np.asarray(found.theta), problem.space.names
    free = np.array([kind == "free" for kind in problem.space.kinds])
    size = np.where(free, np.maximum(np.abs(theta), np.abs(start)), 1)
    size = np.where(size > 0, size, 1)
    change = np.array([[one.components.get(name, 0) for name in names] for one in directions])
    change *= _ASIDE / np.max(np.abs(change) / size, axis=1, keepdims=True)
    aside = np.asarray(
        losses(problem, jnp.asarray(theta + np.stack([change, -change])).reshape(-1, len(theta)))
    ).reshape(2, -1)
    falls = np.any(aside < float(found.loss) * (1 - _FALL), axis=0)
    return directions[int(np.argmax(falls))] if falls.any() else None


def verdict(
    found: Found, jacobian: np.ndarray, at_bound: np.ndarray, space: Space, most: int
) -> tuple[bool, str]:
    if not (np.isfinite(found.loss) and np.isfinite(jacobian).all()):
        return False, "the prediction is not finite there"
    ran = [name for name, there in zip(space.names, at_bound, strict=True) if there]
    said = f", {' and '.join(ran)} at the bound" if ran else ""
    left = ~np.asarray(found.still) & ~at_bound
    if not left.any():
        return True, "no step is left" + said
    i = int(np.argmax(np.where(left, np.abs(found.step) / np.asarray(found.allowed), 0)))
    unit = {"log": "ln ", "logit": "logit "}.get(space.kinds[i], "")
    step = f"a step of {abs(float(found.step[i])):.1e} in {unit}{space.names[i]} is left"
    if int(found.steps) >= most:
        return False, f"{most} steps were not enough: {step}" + said
    return False, f"no better point was found, but {step}" + said
