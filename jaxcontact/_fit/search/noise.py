"""Unknown noise, common to all points or of each column of the data, estimated by the fit."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..problem.problem import Problem
from .laplace import basis_of
from .minimum import Found

COMMON, BY_COLUMN = "common", "by column"

_ROUNDS = 30
_SAME = 1e-3
"""Relative change of the noise at convergence."""

_MEDIAN_OF_NORMAL = 0.6744897501960817

_LEAST = 1e-6
"""Least noise of a column relative to its scatter, which limits the weight of exact data."""


def columns_of(problem: Problem, noise: str) -> Int[np.ndarray, " n"]:
    """Return the number of the column of each point; zeros for common noise."""
    sizes = [int(np.prod(shape)) for shape in problem.shapes]
    numbers = np.arange(len(sizes)) * (noise == BY_COLUMN)
    return np.repeat(numbers, sizes)


def refuse_between(
    columns: Int[np.ndarray, " n"], whitener: Float[np.ndarray, "n n"] | None
) -> None:
    """Raise ValueError for errors correlated between columns that have their own noise."""
    if whitener is not None and whitener[columns[:, None] != columns].any():
        raise ValueError(
            "Argument `noise` must be 'common' with a `correlation` between columns, but is "
            "'by column'."
        )


def with_noise(
    problem: Problem,
    found: Found,
    columns: Int[np.ndarray, " n"],
    search: Callable[[Problem, np.ndarray], Found],
) -> tuple[Problem, Found, bool]:
    """Iterate the fit and the noise of its columns; return whether they have settled.

    For squares: σ_c² = Σ_c r²/(n_c - Σ_c h), with h the leverage of each point in the fit with
    these σ. There the restricted likelihood is largest (Patterson & Thompson 1971, doi
    10.1093/biomet/58.3.545). For Huber's loss: the median of |residuals|.
    """
    relative = np.asarray(problem.factor)
    used = relative > 0
    count = int(columns.max()) + 1
    least = np.array([_scatter(problem, used & (columns == c)) for c in range(count)]) * _LEAST
    scale = np.ones(count)
    for turn in range(_ROUNDS):
        seen = scale * _sizes(problem, found, columns, used)
        new = np.maximum(seen, least)
        # If no column shows noise, the weights cannot improve.
        if not (seen > least).any() or (turn and np.all(np.abs(new - scale) <= _SAME * new)):
            return problem, found, True
        scale = np.where(new > 0, new, scale)
        problem = eqx.tree_at(lambda p: p.factor, problem, relative / scale[columns])
        found = search(problem, found.theta)
        if not np.isfinite(found.loss):
            break
    return problem, found, False


def _sizes(
    problem: Problem, found: Found, columns: np.ndarray, used: np.ndarray
) -> Float[np.ndarray, " columns"]:
    """Return the noise of each column in units of what the fit assumed."""
    count = int(columns.max()) + 1
    inside = [used & (columns == c) for c in range(count)]
    if problem.threshold is not None:
        medians = [np.median(np.abs(found.z[rows])) if rows.any() else 0.0 for rows in inside]
        return np.array(medians) / _MEDIAN_OF_NORMAL
    leverage = np.zeros(used.size)
    leverage[used] = np.sum(basis_of(found.jacobian[used]) ** 2, axis=1)
    free = np.array([rows.sum() - leverage[rows].sum() for rows in inside])
    squares = np.array([np.sum(found.z[rows] ** 2) for rows in inside])
    return np.sqrt(np.where(free > _SAME, squares / np.maximum(free, _SAME), 0))


def _scatter(problem: Problem, rows: np.ndarray) -> float:
    """Return the scatter of the data of a column, in units of what the fit assumed."""
    return float(np.std(np.asarray(problem.y * problem.factor)[rows])) if rows.any() else 0.0
