"""The errors that successive intervals share: those of the triggers between them.

An interval that ends late makes the next one begin late. With errors n of the triggers, each of the
standard deviation σ, and a scatter of each bounce of the relative size s₀,

    ln T₂ - ln T₁ - ln e  has the error  (n₃ - n₂)/T₂ - (n₂ - n₁)/T₁ + s₀ ε,

so that pairs which share triggers are correlated, to one and to two places.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .._fit import Fit, basis_of

_FEWEST, _FREE = 6, 4
"""Pairs, and degrees of freedom, from which two sizes of noise can be told."""

_MOST = 2000
"""Pairs whose correlation is held as a matrix. Of more there are many trials: give `groups`."""

_ROUNDS = 6
_SAME = 0.01
"""A change of the share of triggers that counts as none."""

_SHARES = np.sin(np.linspace(0, np.pi / 2, 33)) ** 2
"""Of triggers in the variance: evenly spaced in the angle between the two standard deviations."""


class SharedNoise(NamedTuple):
    """The errors of pairs: `variance` (n,) relative, `correlation` (n, n), `share` of triggers in
    the mean variance, the mean variance in s⁻² that triggers make of 1 s², and by how much squared
    standard errors are `wider` since the share is not known better.
    """

    variance: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, "n n"]
    share: float
    unit: float
    wider: float


def with_shared_triggers(
    fitted: Callable[..., Fit],
    found: Fit,
    first: Float[np.ndarray, " n"],
    second: Float[np.ndarray, " n"],
) -> Fit:
    """The fit with the correlation of pairs that share triggers, found in turn with it.

    Where no two pairs share one, or where they are too few or too many to tell, the same fit.
    """
    used = np.asarray(found.problem.factor) > 0
    triggers = by_triggers(first, second)
    if triggers is None or not _FEWEST <= np.count_nonzero(used) <= _MOST:
        return found
    share = math.inf
    for _ in range(_ROUNDS):
        if not found.converged or found.dof < _FREE:
            return found
        noise = shared_noise(found, used, triggers)
        weights = np.where(used, 1 / noise.variance, 0)
        notes, found = found.notes, fitted(weights=weights, correlation=noise.correlation)
        found = dataclasses.replace(found, notes=notes)
        if abs(noise.share - share) < _SAME:
            break
        share = noise.share
    if not found.converged:
        return found
    wider = {"covariance": found.covariance * noise.wider, "noise": found.noise * noise.wider}
    # A robust fit has put the scale that it found into its weights.
    factor = np.asarray(found.problem.factor)[used]
    size = found.noise * float(np.median(factor**-2.0 / noise.variance[used]))
    trigger = 1e3 * math.sqrt(size * noise.share / noise.unit)
    scatter = 100 * math.sqrt(size * (1 - noise.share))
    told = f"errors of triggers {trigger:.2g} ms, scatter of ln e {scatter:.2g} %"
    runs = 1 + np.count_nonzero(second[:-1] != first[1:])
    alone = "one trial does not tell how much trials differ: that is not in the standard errors"
    notes = (*found.notes, told, *([alone] if runs == 1 else []))
    return dataclasses.replace(found, notes=notes, **wider)


def by_triggers(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n n"] | None:
    """The covariance of pairs of intervals in s⁻² for trigger errors of 1 s; None if no two share
    one.

    Two pairs follow each other where the second interval of one is the first of the next.
    """
    follows = np.concatenate([[False], second[:-1] == first[1:]])
    if not follows.any():
        return None
    # By the interval that is expected: one that was read too short would else get less weight.
    expected = first * np.median(second / first)
    run = np.cumsum(~follows) - 1
    at = np.arange(first.size) + 2 * run
    slopes = np.zeros((first.size, at[-1] + 3))
    rows = np.arange(first.size)
    slopes[rows, at], slopes[rows, at + 1] = 1 / first, -1 / first - 1 / expected
    slopes[rows, at + 2] = 1 / expected
    return slopes @ slopes.T


def shared_noise(
    found: Fit, used: Bool[np.ndarray, " n"], triggers: Float[np.ndarray, "n n"]
) -> SharedNoise:
    """The share of trigger errors in what a fit leaves, by restricted likelihood.

    -2 ln L = (n - k) ln(rᵀ P r) + ln|V| + ln|Xᵀ V⁻¹ X|, V = (1 - s) I + s B, with the fit
    linearised about its end (Patterson & Thompson 1971, doi 10.1093/biomet/58.3.545). Few pairs
    leave s open: it is averaged with the weight L, the two standard deviations equally probable
    before; so are the estimates and their covariance.
    """
    unit = float(np.mean(np.diag(triggers)[used]))
    shape = triggers[np.ix_(used, used)] / unit
    residual, slope = found.residuals[used], _slope(found)[used]
    n, k = slope.shape
    logs, moved, spread = [], [], []
    for share in _SHARES:
        factor = np.linalg.cholesky((1 - share) * np.eye(n) + share * shape)
        r, x = (np.linalg.solve(factor, part) for part in (residual, slope))
        q, corner = np.linalg.qr(x)
        inverse = np.linalg.inv(corner)
        left = r - q @ (q.T @ r)
        square = max(float(left @ left), 1e-300)
        volume = np.sum(np.log(np.diag(factor))) + np.sum(np.log(np.abs(np.diag(corner))))
        logs.append(-(n - k) * math.log(square) / 2 - volume)
        moved.append(inverse @ (q.T @ r))
        spread.append(square / (n - k) * np.sum(inverse**2, axis=1))
    weight = np.exp(np.array(logs) - max(logs))
    weight /= weight.sum()
    share = float(weight @ _SHARES)
    middle = weight @ np.array(moved)
    variance = weight @ (np.array(spread) + (np.array(moved) - middle) ** 2)
    alone = np.array([np.interp(share, _SHARES, column) for column in np.array(spread).T])
    whole = (1 - share) * np.eye(used.size) + share * triggers / unit
    size = np.sqrt(np.diag(whole))
    wider = float(np.mean(variance / alone))
    return SharedNoise(size**2, whole / np.outer(size, size), share, unit, wider)


def _slope(found: Fit) -> Float[np.ndarray, "n rank"]:
    """What the parameters can move, of the residuals themselves."""
    factor, whitener = np.asarray(found.problem.factor), found.problem.whitener
    slope = found.jacobian
    if whitener is not None:
        slope = np.linalg.solve(np.asarray(whitener), slope)
    return basis_of(slope / np.where(factor > 0, factor, 1)[:, None])
