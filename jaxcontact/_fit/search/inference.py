"""Uncertainty of the best parameters, the noise common to all points, and combinations that are not
identifiable.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..problem.problem import FitProblem
from ..problem.space import Space
from .minimum import SINGULAR, SearchEnd

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


class Inference(NamedTuple):
    """The covariance (k, k) of the parameters, NaN if not identifiable, and its grounds."""

    covariance: np.ndarray
    unidentified: tuple[Direction, ...]
    at_bound: tuple[str, ...]
    dof: int
    noise: float
    by_group: bool


def infer(
    problem: FitProblem,
    found: SearchEnd,
    at_bound: np.ndarray,
    absolute: bool,
    groups: np.ndarray | None,
) -> Inference:
    """Return Laplace's approximation Cov θ = s² (JᵀJ)⁻¹, converted to the parameters by dx/dθ.

    s² is 1 for known noise and Σz²/(n-k) otherwise. For Huber's loss it is Σψ²/(n-k)/(mean ψ')² in
    both cases (Huber & Ronchetti 2009, Eq. 7.86, doi 10.1002/9780470434697). With at least
    `LEAST_GROUPS` groups of points, the sandwich (JᵀJ)⁻¹ Σ_g s_g s_gᵀ (JᵀJ)⁻¹ C/(C-1) of the scores
    s_g = Σ Jᵀψ of C groups is used. It is valid for any correlation within a group (Liang & Zeger
    1986, doi 10.1093/biomet/73.1.13). It is NaN for a parameter that one group alone
    determines, which the fit meets exactly. Directions in which JᵀJ is singular come from a
    singular value decomposition of the scaled columns. A parameter at its bound is held.
    """
    finite = np.isfinite(found.jacobian).all()
    jacobian = found.jacobian if finite else np.zeros_like(found.jacobian)
    inverse, rank, directions, lost = _invert(jacobian, at_bound, problem.space)
    used = np.asarray(problem.factor) > 0
    dof = int(used.sum()) - rank
    # Squares are Huber's loss without a threshold: ψ = z, ψ' = 1.
    threshold = np.inf if problem.threshold is None else float(problem.threshold)
    z = found.z[used]
    pull, inside = np.clip(z, -threshold, threshold), np.mean(np.abs(z) <= threshold)
    noise = np.nan
    if absolute and problem.threshold is None:
        noise = 1.0
    elif dof > 0 and inside > 0:
        noise = float(np.sum(pull**2) / dof / inside**2)
    number = np.zeros(len(z), int) if groups is None else groups[used]
    by_group = len(np.unique(number)) >= LEAST_GROUPS
    if by_group:
        with np.errstate(divide="ignore", invalid="ignore"):
            bread = inverse / inside
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
    return Inference(covariance, directions, ran, dof, noise, by_group)


def _invert(
    jacobian: Float[np.ndarray, "n k"], held: np.ndarray, space: Space
) -> tuple[Float[np.ndarray, "k k"], int, tuple[Direction, ...], np.ndarray]:
    """Return (JᵀJ)⁻¹ without singular directions and held parameters, and the rank.

    Also return the singular directions, and which parameters (k,) are held or take part in one.
    """
    k = len(held)
    length = np.linalg.norm(jacobian, axis=0)
    flat = ~held & (length == 0)
    directions = [_direction({int(i): 1.0}, space) for i in np.flatnonzero(flat)]
    lost, inverse = held | flat, np.zeros((k, k))
    order = np.flatnonzero(~lost)
    if not len(order):
        return inverse, 0, tuple(directions), lost
    scaled = jacobian[:, order] / length[order]
    # With fewer points than parameters, rows of zeros make every open direction appear.
    spare = np.zeros((max(len(order) - len(scaled), 0), len(order)))
    _, s, vt = np.linalg.svd(np.concatenate([scaled, spare]), full_matrices=False)
    good = s > SINGULAR * s.max()
    for row in vt[~good]:
        change = row / length[order]
        share = np.abs(row) > _PART * np.abs(row).max()
        change = change / np.abs(change).max() * np.sign(change[np.argmax(share)])
        parts = {int(order[i]): float(change[i]) for i in np.flatnonzero(share)}
        directions.append(_direction(parts, space))
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


def basis_of(jacobian: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n rank"]:
    """Return an orthonormal basis of the directions that the parameters can move."""
    length = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian[:, length > 0] / length[length > 0]
    if not scaled.size:
        return np.zeros((len(jacobian), 0))
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > SINGULAR * s.max()]


def _direction(parts: dict[int, float], space: Space) -> Direction:
    return Direction(
        {space.names[i]: part for i, part in parts.items()},
        {space.names[i]: space.labels[i] for i in parts},
    )
