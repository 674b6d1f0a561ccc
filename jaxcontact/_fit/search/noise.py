"""Noise whose size is not known: of all points, or of each column of the data, found by the fit."""

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
"""A relative change of a size of noise that counts as none."""

_MEDIAN_OF_NORMAL = 0.6744897501960817

_LEAST = 1e-6
"""A column that is met to this part of its scatter shows no noise, and weighs no more than so."""


def columns_of(problem: Problem, noise: str) -> Int[np.ndarray, " n"]:
    """The number of the column of each point; zeros where noise is common to all."""
    sizes = [int(np.prod(shape)) for shape in problem.shapes]
    numbers = np.arange(len(sizes)) * (noise == BY_COLUMN)
    return np.repeat(numbers, sizes)


def refuse_between(
    columns: Int[np.ndarray, " n"], whitener: Float[np.ndarray, "n n"] | None
) -> None:
    """Raise ValueError for errors that are correlated between columns with noise of their own."""
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
    """The fit and the noise of its columns, found in turn, and whether they have settled.

    Of squares: σ_c² = Σ_c r²/(n_c - Σ_c h), h the leverage of each point in the fit that has these
    σ, at which the restricted likelihood is largest (Patterson & Thompson 1971, doi
    10.1093/biomet/58.3.545). With Huber's loss: the median of |residuals|.
    """
    relative = np.asarray(problem.factor)
    used = relative > 0
    count = int(columns.max()) + 1
    least = np.array([_scatter(problem, used & (columns == c)) for c in range(count)]) * _LEAST
    scale = np.ones(count)
    for turn in range(_ROUNDS):
        seen = scale * _sizes(problem, found, columns, used)
        new = np.maximum(seen, least)
        # Where nothing shows noise, there is no other weight to find.
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
    """The noise of each column in units of what the fit assumed."""
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
    """Of the data of a column, in units of what the fit assumed."""
    return float(np.std(np.asarray(problem.y * problem.factor)[rows])) if rows.any() else 0.0
