"""The verdict on the end of a search: minimum or not, bounds, combinations that are not
identifiable, and the uncertainty of the parameters.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..._text.words import first_few
from ..problem.problem import FitProblem, evaluated
from ..problem.space import Space
from .minimum import ROUNDING, SearchEnd, decomposed, losses, start_scale

_PART = 1e-3
"""Relative component in an open direction above which a parameter is not identifiable.

An open direction leaves the prediction unchanged; the component is relative to the largest.
"""

_LONE = 1e-6
"""Share of a parameter's sensitivity to the data, from all but one group, below which that group
alone determines it. A law with a kink ignores the points beyond it: their share is 0. For spheres
that adhere, from 1.0005 to 5 times the sticking speed, it is 5e-5 at 25 speeds.
"""

LEAST_GROUPS = 8
"""Fewest groups of points whose scatter gives standard errors."""

_AT_BOUND = 1e-6
"""Distance to a bound, as a fraction of the interval, at which a parameter has run there."""

FAR = 18.0
"""Fall of a logarithm (to 1.5e-8 of its start) by which a parameter has run to 0.

In a posterior, the distance of a logarithm or logit from the mode at which it is at a bound.
"""

_OUTWARD = 3.0
"""Remaining step of a logarithm or logit above which the search creeps to a bound."""

_ASIDE = 1e-2
"""Distance along a flat direction at which the loss is tested.

It is relative to the parameter, absolute for a logarithm or a logit.
"""

_FALL = 1e-5
"""Relative fall of the loss that identifies a saddle; a curvature of order 1 gives 1e-4."""


@dataclasses.dataclass(frozen=True)
class Direction:
    """A change of parameters that leaves the prediction unchanged.

    `components` by name, the largest is 1: the change of an unbounded parameter, or of the
    logarithm or logit of a bounded one. Prints as "ln K + 1.00 ln m".
    """

    components: dict[str, float]
    labels: dict[str, str]

    def __str__(self) -> str:
        text = ""
        for name, part in self.components.items():
            size = "" if abs(abs(part) - 1) < 5e-3 else f"{abs(part):.2g} "
            sign = ("" if part > 0 else "-") if not text else (" + " if part > 0 else " - ")
            text += f"{sign}{size}{self.labels[name]}"
        return text


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
    below |= space.has_unit & ~two_sided & (found.theta < start - FAR)
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
    sides = (theta + np.stack([change, -change])).reshape(-1, len(theta))
    aside = np.asarray(losses(problem, jax.device_put(sides))).reshape(2, -1)
    # If the data are met to rounding, the loss is only rounding.
    factor = np.asarray(problem.factor)
    used = factor > 0
    terms = factor[used] * (np.abs(problem.y)[used] + np.abs(found.prediction)[used])
    blur = ROUNDING * (terms + np.abs(found.jacobian[used]) @ np.abs(theta))
    blur = np.sum(blur * (np.abs(found.z[used]) + blur))
    falls = np.any(aside < float(found.loss) * (1 - _FALL) - blur, axis=0)
    return directions[int(np.argmax(falls))] if falls.any() else None


def verdict(found: SearchEnd, at_bound: np.ndarray, space: Space, most: int) -> tuple[bool, str]:
    """Return whether the search converged, and the reason in words."""
    if not (np.isfinite(found.loss) and np.isfinite(found.jacobian).all()):
        return False, "the prediction is not finite there"
    ran = [name for name, there in zip(space.names, at_bound, strict=True) if there]
    bound = f", {' and '.join(ran)} at the bound" if ran else ""
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
    leaves, structure = jax.tree.flatten(problem.space.tree_of(found.values))
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


def infer(
    problem: FitProblem, found: SearchEnd, at_bound: np.ndarray, absolute: bool, groups: Any
) -> dict[str, Any]:
    """Return Laplace's approximation Cov θ = s² (JᵀJ)⁻¹, converted to the parameters by dx/dθ.

    s² is 1 for known noise and Σz²/(n-k) otherwise. For Huber's loss it is Σψ²/(n-k)/(mean ψ')² in
    both cases (Huber & Ronchetti 2009, Eq. 7.86, doi 10.1002/9780470434697). With at least
    `LEAST_GROUPS` groups of points, the sandwich (JᵀJ)⁻¹ Σ_g s_g s_gᵀ (JᵀJ)⁻¹ C/(C-1) of the scores
    s_g = Σ Jᵀψ of C groups is used. It is valid for any correlation within a group (Liang & Zeger
    1986, doi 10.1093/biomet/73.1.13). It is NaN for a parameter that one group alone
    determines, which the fit meets exactly. Directions in which JᵀJ is singular come from a
    singular value decomposition of the scaled columns. A parameter at its bound is held.
    The result holds the fields of a fit that follow.
    """
    finite = np.isfinite(found.jacobian).all()
    jacobian = found.jacobian if finite else np.zeros_like(found.jacobian)
    inverse, rank, directions, lost = _invert(jacobian, at_bound, problem.space)
    used = np.asarray(problem.factor) > 0
    dof = int(used.sum()) - rank
    noise, inside = noise_of(problem, found.z, used, dof, absolute)
    number = np.zeros(int(used.sum()), int) if groups is None else groups[used]
    by_group = len(np.unique(number)) >= LEAST_GROUPS
    if by_group:
        with np.errstate(divide="ignore", invalid="ignore"):
            bread = inverse / inside
        pull = np.clip(found.z[used], -float(problem.limit), float(problem.limit))
        scatter = sandwich(bread, jacobian[used] * pull[:, None], number)
        own = np.zeros((int(number.max()) + 1, len(lost)))
        np.add.at(own, number, np.square(jacobian[used] @ inverse))
        lost |= own.max(0) > (1 - _LONE) * own.sum(0)
    else:
        scatter = noise * inverse
    stretch = problem.space.stretch(found.values)
    covariance = scatter * np.outer(stretch, stretch)
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    ran = tuple(np.array(problem.space.names, object)[at_bound])
    grounds = {"dof": dof, "noise": float(noise), "by_group": by_group}
    return grounds | {"covariance": covariance, "unidentified": directions, "at_bound": ran}


def noise_of(
    problem: FitProblem, z: np.ndarray, used: np.ndarray, dof: Any, absolute: bool
) -> tuple[Any, Any]:
    """Return s² of residuals (..., n), see `infer`, and the mean ψ' of those `used`."""
    # Squares are Huber's loss without a threshold: ψ = z, ψ' = 1.
    size, threshold = np.abs(z), float(problem.limit)
    inside = np.sum(used & (size <= threshold), axis=-1) / np.maximum(used.sum(axis=-1), 1)
    if absolute and problem.threshold is None:
        return np.ones_like(inside), inside
    with np.errstate(all="ignore"):
        squares = np.sum(np.where(used, np.minimum(size, threshold), 0) ** 2, axis=-1)
        noise = squares / dof / inside**2
    return np.where((np.asarray(dof) > 0) & (inside > 0), noise, np.nan), inside


def _invert(
    jacobian: Float[np.ndarray, "n k"], held: np.ndarray, space: Space
) -> tuple[Float[np.ndarray, "k k"], int, tuple[Direction, ...], np.ndarray]:
    """Return (JᵀJ)⁻¹ without singular directions and held parameters, and the rank.

    Also return the singular directions, and which parameters (k,) are held or take part in one.
    """
    k = len(held)
    length = np.linalg.norm(jacobian, axis=0)
    flat = ~held & (length == 0)
    labels = dict(zip(space.names, space.labels, strict=True))
    directions = [Direction({space.names[i]: 1.0}, labels) for i in np.flatnonzero(flat)]
    lost, inverse = held | flat, np.zeros((k, k))
    order = np.flatnonzero(~lost)
    if not len(order):
        return inverse, 0, tuple(directions), lost
    # With fewer points than parameters, rows of zeros make every open direction appear.
    spare = np.zeros((max(len(order) - len(jacobian), 0), len(order)))
    _, s, vt, *_, good = decomposed(np.concatenate([jacobian[:, order], spare]))
    for row in vt[~good]:
        change = row / length[order]
        share = np.abs(row) > _PART * np.abs(row).max()
        change = change / np.abs(change).max() * np.sign(change[np.argmax(share)])
        parts = {space.names[order[i]]: float(change[i]) for i in np.flatnonzero(share)}
        directions.append(Direction(parts, labels))
        lost[order[share]] = True
    basis = vt[good] / s[good, None] / length[order]
    inverse[np.ix_(order, order)] = basis.T @ basis
    return inverse, int(good.sum()), tuple(directions), lost


def sandwich(
    bread: Float[np.ndarray, "k k"], scores: Float[np.ndarray, "n k"], number: np.ndarray
) -> Float[np.ndarray, "k k"]:
    """Return the covariance from the scores of points in groups; `number` (n,) is their group."""
    summed = np.zeros((int(number.max()) + 1, scores.shape[1]))
    np.add.at(summed, number, scores)
    count = len(np.unique(number))
    return bread @ (summed.T @ summed) @ bread * (count / (count - 1))
