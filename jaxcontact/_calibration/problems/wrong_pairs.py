"""Pairs of bounces corrupted by a spurious or missed trigger, which a robust fit leaves out."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._fit import AbstractErrors, Fit
from ..pairs.columns import for_each
from ..pairs.outliers import THRESHOLD, mark
from ..pairs.reading_noise import estimate_noise

Column = Float[np.ndarray, " n"]

_MOST_WRONG = 0.4
"""Largest usable fraction of wrong pairs.

A wrong trigger corrupts two or three pairs, and medians are robust up to half.
"""


class Readings(NamedTuple):
    """Two successive readings, and the speed and the restitution between them (n,)."""

    first: Column
    second: Column
    velocity: Column
    restitution: Column


class WrongPairs(AbstractErrors[Fit, dict[str, Any]]):
    """Pairs off the fit by more than `THRESHOLD` robust standard deviations, which are left out.

    A wrong trigger is not scatter: however small its weight, it biases the fit. The first fit
    leaves out what lies off a trend without a law, so that it starts near its end. The next ones
    leave out what lies off the previous fit, until the pairs stay the same. `options` are those of
    `fit`.
    """

    rounds = 10

    def __init__(self, readings: Readings, options: dict[str, Any]):
        first, second, velocity, e = readings
        # Use the expected reading: a short reading would widen its own tolerance.
        usual = first * np.median(second / first)
        self._second, self._factor = np.log(second), first**-2.0 + usual**-2.0
        self._keep = ~mark(velocity, e, self._factor).flagged
        self._seen, self._options = {self._keep.tobytes()}, options

    def weights(self) -> dict[str, Any]:
        """Return the arguments of `fit` with zero weight for the pairs left out."""
        return _without_weight(self._keep, self._options)

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the weights without the pairs off this fit."""
        if not found.converged:
            return None
        residual = np.asarray(found.predict()) - self._second
        keep = self._keep
        noise = estimate_noise(residual[keep], self._factor[keep], robust=True)
        self._keep = np.abs(residual) <= THRESHOLD * noise.sigma(self._factor)
        if self._keep.tobytes() in self._seen:
            return None
        self._seen.add(self._keep.tobytes())
        return self.weights()

    def finish(self, found: Fit) -> Fit:
        """Return the fit with the number of pairs left out; not converged if they are too many."""
        return _note_wrong_pairs(found, int(np.count_nonzero(~self._keep)), self._keep.size)


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
