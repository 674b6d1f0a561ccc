"""What the data say of the parameters near the best ones, and what they leave open."""

from __future__ import annotations

import dataclasses

import numpy as np

from ._found import SINGULAR
from ._space import Space

_PART = 1e-3
"""A direction that the data leave open makes a parameter unidentifiable if the direction holds more
than this of it, relative to its largest component."""

LEAST_GROUPS = 8
"""Groups of points needed before their scatter says anything about standard errors."""


@dataclasses.dataclass(frozen=True)
class Direction:
    """A change of parameters that leaves the prediction unchanged.

    `components` by name, the largest is 1: the change of an unbounded parameter, of a bounded one
    that of its logarithm or logit. Prints as "ln K + 1.00 ln m".
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


@dataclasses.dataclass(frozen=True)
class Inference:
    """The covariance (k, k) of the parameters, NaN where not identifiable, and its grounds."""

    covariance: np.ndarray
    unidentified: tuple[Direction, ...]
    at_bound: tuple[str, ...]
    dof: int
    noise: float
    by_group: bool


def infer(
    jacobian: np.ndarray,
    z: np.ndarray,
    used: np.ndarray,
    space: Space,
    values: np.ndarray,
    at_bound: np.ndarray,
    absolute: bool,
    threshold: float | None,
    groups: np.ndarray | None,
) -> Inference:
    """Laplace's approximation Cov θ = s² (JᵀJ)⁻¹, carried to the parameters by dx/dθ.

    s² is 1 for known noise and Σz²/(n-k) otherwise; for Huber's loss Σψ²/(n-k)/(mean ψ')² in both
    cases (Huber & Ronchetti 2009, Eq. 7.86, doi 10.1002/9780470434697). With at least
    `LEAST_GROUPS` groups of points: the sandwich (JᵀJ)⁻¹ Σ_g s_g s_gᵀ (JᵀJ)⁻¹ C/(C-1) of the scores
    s_g = Σ Jᵀψ of C groups, which holds whatever the correlation inside a group (Liang & Zeger
    1986, doi 10.1093/biomet/73.1.13). Directions in which JᵀJ is singular come from a singular
    value decomposition of the scaled columns; a parameter at its bound is held.
    """
    names, k = space.names, len(space.names)
    length = np.linalg.norm(jacobian, axis=0)
    free = ~at_bound & (length > 0)
    blind = ~at_bound & (length == 0)
    directions = [_direction({int(i): 1.0}, space) for i in np.flatnonzero(blind)]
    lost = at_bound | blind
    order = np.flatnonzero(free)
    inverse = np.zeros((k, k))
    rank = 0
    if len(order):
        scaled = jacobian[:, order] / length[order]
        # With fewer points than parameters, rows of zeros make every open direction appear.
        spare = np.zeros((max(len(order) - len(scaled), 0), len(order)))
        _, s, vt = np.linalg.svd(np.concatenate([scaled, spare]), full_matrices=False)
        good = s > SINGULAR * s.max()
        rank = int(good.sum())
        for row in vt[~good]:
            change = row / length[order]
            share = np.abs(row) > _PART * np.abs(row).max()
            change = change / np.abs(change).max() * np.sign(change[np.argmax(share)])
            parts = {int(order[i]): float(change[i]) for i in np.flatnonzero(share)}
            directions.append(_direction(parts, space))
            lost[order[share]] = True
        basis = vt[good] / s[good, None] / length[order]
        inverse[np.ix_(order, order)] = basis.T @ basis
    dof = int(used.sum()) - rank
    noise = _noise(z[used], dof, absolute, threshold)
    number = None if groups is None else np.unique(groups[used], return_inverse=True)[1]
    by_group = number is not None and int(number.max()) + 1 >= LEAST_GROUPS
    if by_group:
        assert number is not None  # for the type checker
        scatter = _sandwich(jacobian[used], z[used], inverse, number, threshold)
    else:
        scatter = noise * inverse
    stretch = space.stretch(values)
    covariance = scatter * np.outer(stretch, stretch)
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    return Inference(
        covariance,
        tuple(directions),
        tuple(name for name, there in zip(names, at_bound, strict=True) if there),
        dof,
        noise,
        by_group,
    )


def _noise(z: np.ndarray, dof: int, absolute: bool, threshold: float | None) -> float:
    if threshold is None and absolute:
        return 1.0
    if dof < 1:
        return float("nan")
    if threshold is None:
        return float(np.sum(z**2) / dof)
    inside = np.mean(np.abs(z) <= threshold)
    pull = np.clip(z, -threshold, threshold)
    return float(np.sum(pull**2) / dof / inside**2) if inside > 0 else float("nan")


def _sandwich(
    jacobian: np.ndarray,
    z: np.ndarray,
    inverse: np.ndarray,
    number: np.ndarray,
    threshold: float | None,
) -> np.ndarray:
    pull = z if threshold is None else np.clip(z, -threshold, threshold)
    inside = 1.0 if threshold is None else float(np.mean(np.abs(z) <= threshold))
    count = int(number.max()) + 1
    score = np.zeros((count, jacobian.shape[1]))
    np.add.at(score, number, jacobian * pull[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        bread = inverse / np.float64(inside)
    return bread @ (score.T @ score) @ bread * (count / (count - 1))


def _direction(parts: dict[int, float], space: Space) -> Direction:
    return Direction(
        {space.names[i]: part for i, part in parts.items()},
        {space.names[i]: space.labels[i] for i in parts},
    )
