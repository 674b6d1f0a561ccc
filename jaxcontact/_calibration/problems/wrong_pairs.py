"""A robust fit of bounces, without pairs corrupted by a spurious or missed trigger."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._fit import Fit
from ..pairs.columns import for_each
from ..pairs.noise import estimate_noise
from ..pairs.outliers import THRESHOLD, mark

Column = Float[np.ndarray, " n"]

_MOST_WRONG = 0.4
"""Largest usable fraction of wrong pairs.

A wrong trigger corrupts two or three pairs, and medians are robust up to half.
"""

_ROUNDS = 10


class Readings(NamedTuple):
    """Two successive readings, and the speed and the restitution between them (n,)."""

    first: Column
    second: Column
    velocity: Column
    restitution: Column


def without_wrong_pairs(fitted: Callable[..., Fit], how: dict[str, Any], readings: Readings) -> Fit:
    """Fit the pairs that lie within `THRESHOLD` robust standard deviations of the fit.

    A wrong trigger is not scatter: however small its weight, it biases the fit. The first fit
    leaves out what lies off a trend without a law, so that it starts near its end. The next ones
    leave out what lies off the previous fit, until the pairs stay the same.
    """
    first, second, velocity, e = readings
    # Use the expected reading: a short reading would widen its own tolerance.
    usual = first * np.median(second / first)
    factor = first**-2.0 + usual**-2.0
    keep = ~mark(velocity, e, factor).flagged
    seen: set[bytes] = set()
    while True:
        seen.add(keep.tobytes())
        found = fitted(**_without_weight(keep, how))
        if not found.converged or len(seen) > _ROUNDS:
            break
        residual = np.asarray(found.predict()) - np.log(second)
        noise = estimate_noise(residual[keep], factor[keep], robust=True)
        keep = np.abs(residual) <= THRESHOLD * noise.sigma(factor)
        if keep.tobytes() in seen:
            break
    return _note_wrong_pairs(found, int(np.count_nonzero(~keep)), keep.size)


def _without_weight(keep: Bool[np.ndarray, " n"], how: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `fit` with zero weight for other pairs."""
    if how.get("sigma") is not None:
        sigma = for_each(how["sigma"], "sigma", keep.size)
        return {"sigma": np.where(keep, sigma, np.inf)}
    given = how.get("weights")
    weights = 1.0 if given is None else for_each(given, "weights", keep.size, zero=True)
    return {"weights": np.where(keep, weights, 0.0)}


def _note_wrong_pairs(found: Fit, wrong: int, count: int) -> Fit:
    if not wrong:
        return found
    pairs = f"{wrong} of {count} pairs lie more than {THRESHOLD:g} standard deviations off"
    if wrong <= _MOST_WRONG * count:
        return dataclasses.replace(found, notes=(*found.notes, f"{pairs} and are left out"))
    reason = f"{pairs}: the recording cannot be used"
    unknown = np.full_like(found.covariance, np.nan)
    return dataclasses.replace(
        found, converged=False, reason=reason, covariance=unknown, unidentified=()
    )
