"""What the data say of the parameters near the best ones, and what they do not say."""

from __future__ import annotations

import dataclasses

import numpy as np

from ._found import SINGULAR

_PART = 1e-3
"""A direction that nothing determines takes a parameter with it if it holds more than this of it,
relative to its largest component."""

AT_BOUND = 1e-6
"""Nearer to a bound than this part of the interval, or of its start, a number has run there."""


@dataclasses.dataclass(frozen=True)
class Direction:
    """A change of parameters that the data do not see.

    `components` by name, the largest is 1: of a number without bounds its change, of a bounded
    one that of its logarithm or logit. Prints as "ln K + 1.00 ln m".
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
    """The covariance (k, k) of the parameters, NaN where undetermined; directions; bounds."""

    covariance: np.ndarray
    unidentified: tuple[Direction, ...]
    at_bound: tuple[str, ...]
    dof: int
    noise: float


def infer(
    jacobian: np.ndarray,
    z: np.ndarray,
    used: int,
    names: tuple[str, ...],
    kinds: tuple[str, ...],
    stretch: np.ndarray,
    at_bound: np.ndarray,
    absolute: bool,
    threshold: float | None,
) -> Inference:
    """Laplace's approximation: Cov θ = s² (JᵀJ)⁻¹, carried to the parameters by dx/dθ.

    s² is 1 for known noise and Σz²/(n-k) otherwise; for Huber's loss Σψ²/(n-k)/(mean ψ')², whatever
    was said of the noise (Huber & Ronchetti 2009, Eq. 7.86, doi 10.1002/9780470434697). Directions
    in which JᵀJ is singular are found by a singular value decomposition of the scaled columns; a
    number at its bound is held there.
    """
    k = len(names)
    length = np.linalg.norm(jacobian, axis=0)
    free = ~at_bound & (length > 0)
    blind = ~at_bound & (length == 0)
    directions = [_direction({int(i): 1.0}, names, kinds) for i in np.flatnonzero(blind)]
    lost = at_bound | blind
    order = np.flatnonzero(free)
    inverse = np.zeros((k, k))
    rank = 0
    if len(order):
        scaled = jacobian[:, order] / length[order]
        # Fewer points than numbers leave directions without a row: rows of zeros name them.
        spare = np.zeros((max(len(order) - len(scaled), 0), len(order)))
        _, s, vt = np.linalg.svd(np.concatenate([scaled, spare]), full_matrices=False)
        good = s > SINGULAR * s.max()
        rank = int(good.sum())
        for row in vt[~good]:
            change = row / length[order]
            share = np.abs(row) > _PART * np.abs(row).max()
            change = change / np.abs(change).max() * np.sign(change[np.argmax(share)])
            directions.append(
                _direction(
                    {int(order[i]): float(change[i]) for i in np.flatnonzero(share)}, names, kinds
                )
            )
            lost[order[share]] = True
        basis = vt[good] / s[good, None] / length[order]
        inverse[np.ix_(order, order)] = basis.T @ basis
    dof = used - rank
    noise = _noise(z, dof, absolute, threshold)
    covariance = noise * inverse * np.outer(stretch, stretch)
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    return Inference(
        covariance,
        tuple(directions),
        tuple(name for name, there in zip(names, at_bound, strict=True) if there),
        dof,
        noise,
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


def _direction(
    parts: dict[int, float], names: tuple[str, ...], kinds: tuple[str, ...]
) -> Direction:
    label = {"free": "{}", "log": "ln {}", "logit": "logit {}"}
    return Direction(
        {names[i]: part for i, part in parts.items()},
        {names[i]: label[kinds[i]].format(names[i]) for i in parts},
    )
