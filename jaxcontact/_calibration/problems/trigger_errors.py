"""The errors that pairs share: those of the triggers between intervals, or of one drop height.

An interval that ends late makes the next one begin late. With errors n of the triggers, each of the
standard deviation σ, and a scatter of each bounce of the relative size s₀,

    ln T₂ - ln T₁ - ln e  has the error  (n₃ - n₂)/T₂ - (n₂ - n₁)/T₁ + s₀ ε,

so that pairs which share triggers are correlated, to one and to two places. The T that divide are
those that the fit expects: divided by an interval that was read too long, its error would count
less, and e come out too small. Drops from one height h
share its error n, which enters ln h₂ - ln h as -n/h.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._fit import Fit
from .shared_errors import shared_noise, widening

Column = Float[np.ndarray, " n"]

_FEWEST, _FREE = 6, 4
"""Pairs, and degrees of freedom, from which two sizes of noise can be told."""

_MOST = 2000
"""Pairs whose correlation is held as a matrix. Of more there are many trials: give `groups`."""

_ROUNDS = 6
_SAME = 0.01
"""A change of the share of shared errors that counts as none."""


class Shared(NamedTuple):
    """What pairs share: the covariance (n, n) for shared errors of 1 s or 1 m, None where no two
    pairs share one; the words of both errors, for numbers in ms or mm and in %; and what else to
    say.
    """

    shape: Float[np.ndarray, "n n"] | None
    words: str
    notes: tuple[str, ...] = ()


def with_shared_errors(
    fitted: Callable[..., Fit],
    found: Fit,
    first: Column,
    second: Column,
    shared_by: Callable[[Column, Column, Column], Shared],
) -> Fit:
    """The fit with the correlation of pairs that share errors, found in turn with it.

    `shared_by` tells what they share from the readings and what the fit expects of the second.
    Where no two pairs share an error, or where they are too few or too many to tell, the same fit.
    """
    used = np.asarray(found.problem.factor) > 0
    if not _FEWEST <= np.count_nonzero(used) <= _MOST:
        return found
    share, shared = math.inf, shared_by(first, second, second)
    for _ in range(_ROUNDS):
        if shared.shape is None or not found.converged or found.dof < _FREE:
            return found
        expected = np.where(used, np.exp(np.asarray(found.predict())), np.nan)
        shared = shared_by(first, second, expected)
        assert shared.shape is not None  # for the type checker
        noise = shared_noise(found, used, shared.shape)
        weights = np.where(used, 1 / noise.variance, 0)
        notes, found = found.notes, fitted(weights=weights, correlation=noise.correlation)
        found = dataclasses.replace(found, notes=notes)
        if abs(noise.share - share) < _SAME:
            break
        share = noise.share
    if not found.converged or shared.shape is None:
        return found
    wider = widening(found, used, shared.shape)
    # A robust fit has put the scale that it found into its weights.
    factor = np.asarray(found.problem.factor)[used]
    size = found.noise * float(np.median(factor**-2.0 / noise.variance[used]))
    both = (
        1e3 * math.sqrt(size * noise.share / noise.unit),
        100 * math.sqrt(size * (1 - noise.share)),
    )
    notes = (*found.notes, shared.words.format(*both), *shared.notes)
    return dataclasses.replace(
        found,
        notes=notes,
        covariance=found.covariance * wider,
        wider=np.full(len(found.names), wider),
    )


def by_triggers(first: Column, second: Column, expected: Column) -> Shared:
    """What pairs of intervals share.

    Two pairs follow each other where the second interval of one is the first of the next. The
    `expected` second intervals (NaN of a pair that does not count) give the ratios between those of
    a run, and its length their size.
    """
    words = "errors of triggers {:.2g} ms, scatter of ln e {:.2g} %"
    follows = np.concatenate([[False], second[:-1] == first[1:]])
    if not follows.any():
        return Shared(None, words)
    good = np.isfinite(expected)
    chained = follows & good & np.concatenate([[False], good[:-1]])
    slopes = np.zeros((first.size, first.size + 2 * np.count_nonzero(~follows)))
    for rows in np.split(np.arange(first.size), np.flatnonzero(~chained)[1:]):
        read = np.append(first[rows], second[rows[-1]])
        ratio = np.where(good[rows], expected[rows], second[rows]) / first[rows]
        course = np.cumprod(np.append(1, ratio))
        before, after = np.stack([course[:-1], course[1:]]) * read.sum() / course.sum()
        at = rows + 2 * (np.cumsum(~follows)[rows] - 1)
        slopes[rows, at], slopes[rows, at + 1] = 1 / before, -1 / before - 1 / after
        slopes[rows, at + 2] = 1 / after
    alone = "one trial does not tell how much trials differ: that is not in the standard errors"
    one = np.count_nonzero(~follows) == 1
    return Shared(slopes @ slopes.T, words, (alone,) if one else ())


def by_height(first: Column, second: Column, expected: Column) -> Shared:
    """What drops share: all from one height its error."""
    same = first[:, None] == first
    shape = None if np.array_equal(same, np.eye(first.size)) else same / np.outer(first, first)
    return Shared(shape, "errors of drop heights {:.2g} mm, scatter of ln h {:.2g} %")
