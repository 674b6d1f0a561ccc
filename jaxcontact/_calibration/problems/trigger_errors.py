"""Errors that pairs share: those of triggers between intervals, or of one drop height.

An interval that ends late makes the next one begin late. With trigger errors n, each of standard
deviation σ, and a scatter of each bounce of relative size s₀,

    ln T₂ - ln T₁ - ln e  has the error  (n₃ - n₂)/T₂ - (n₂ - n₁)/T₁ + s₀ ε,

so pairs that share triggers are correlated, up to two places apart. The divisors T are those that
the fit expects. Division by the reading would give errors of long readings less weight, and e would
be too small. Drops from one height h share its error n, which enters ln h₂ - ln h as -n/h.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..._fit import AbstractErrors, Fit
from .shared_noise import shared_noise, widening

Column = Float[np.ndarray, " n"]

_FEWEST, _FREE = 6, 4
"""Least pairs and degrees of freedom to separate two sizes of noise."""

_MOST = 2000
"""Largest number of pairs with a correlation matrix. More pairs have many trials: use `groups`."""

_SAME = 0.01
"""Largest change of the share of shared errors at convergence."""


class Shared(NamedTuple):
    """The errors that pairs share, and their words.

    `shape` (n, n) is the covariance for shared errors of 1 s or 1 m, None if no two pairs share
    one. `words` report both errors, for numbers in ms or mm and in %. `notes` are additional notes.
    """

    shape: Float[np.ndarray, "n n"] | None
    words: str
    notes: tuple[str, ...] = ()


class ReadingErrors(AbstractErrors[Fit, dict[str, Any]]):
    """Errors of `first` and `second` readings that pairs share, and the scatter of the bounces.

    `shared_by` returns the shared errors from the readings and the second readings that the fit
    expects. Nothing is estimated if no two pairs share an error, or from too few or too many pairs.
    """

    rounds = 6

    def __init__(
        self, first: Column, second: Column, shared_by: Callable[[Column, Column, Column], Shared]
    ):
        self.first, self.second, self.shared_by = first, second, shared_by
        self._shared, self._noise, self._settled = Shared(None, ""), None, False

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the weights and the correlation of the pairs."""
        used = np.asarray(found.problem.factor) > 0
        enough = _FEWEST <= np.count_nonzero(used) <= _MOST and found.dof >= _FREE
        if self._settled or not enough or not found.converged:
            return None
        expected = np.where(used, np.exp(np.asarray(found.predict())), np.nan)
        self._shared = self.shared_by(self.first, self.second, expected)
        if self._shared.shape is None:
            return None
        last, noise = self._noise, shared_noise(found, used, self._shared.shape)
        self._settled = last is not None and abs(noise.share - last.share) < _SAME
        self._noise = noise
        return {"weights": np.where(used, 1 / noise.variance, 0), "correlation": noise.correlation}

    def finish(self, found: Fit) -> Fit:
        """Return the fit with wider standard errors, and both sizes of errors in its notes."""
        noise, shared = self._noise, self._shared
        if noise is None or shared.shape is None or not found.converged:
            return found
        used = np.asarray(found.problem.factor) > 0
        wider = widening(found, used, shared.shape)
        # A robust fit has included its estimated scale in its weights.
        factor = np.asarray(found.problem.factor)[used]
        size = found.noise * float(np.median(factor**-2.0 / noise.variance[used]))
        both = (
            1e3 * math.sqrt(size * noise.share / noise.unit),
            100 * math.sqrt(size * (1 - noise.share)),
        )
        return dataclasses.replace(
            found,
            notes=(*found.notes, shared.words.format(*both), *shared.notes),
            covariance=found.covariance * wider,
            _wider=np.full(len(found.names), wider),
        )


def by_triggers(first: Column, second: Column, expected: Column) -> Shared:
    """Return the errors that pairs of intervals share.

    Two pairs are successive if the second interval of one is the first of the next. The `expected`
    second intervals (NaN for a pair without weight) give the ratios within a run; the length of the
    run sets their scale.
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
    alone = "standard errors exclude differences between trials, as there is only one trial"
    one = np.count_nonzero(~follows) == 1
    return Shared(slopes @ slopes.T, words, (alone,) if one else ())


def by_height(first: Column, second: Column, expected: Column) -> Shared:
    """Return the errors that drops share: all from one height share its error."""
    same = first[:, None] == first
    shape = None if np.array_equal(same, np.eye(first.size)) else same / np.outer(first, first)
    return Shared(shape, "errors of drop heights {:.2g} mm, scatter of ln h {:.2g} %")
