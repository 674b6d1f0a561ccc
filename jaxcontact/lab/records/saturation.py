"""Instrument limits: readings that stay at the largest or smallest value."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ... import Fit
from ...extend import AbstractErrors

Column = Float[np.ndarray, " n"]

_RUN = 3
"""Least number of equal readings in a row for a plateau."""

_STEPS, _TIMES, _LONGER = 4.0, 4, 8
"""A plateau is a limit if one of three conditions holds.

The readings beside it rise to it by more than 4 resolution steps; or it is 4 times as long as there
are readings of the value beside it; or it is 8 times as long as any other run. A peak in coarse
steps is flat too, but it is reached slowly: a parabola has at most 1 + √2 times as many readings
there as of the value beside it. Noise shortens the runs beside it; where it also cuts the peak, it
cuts all other runs as well.
"""


class Limits(NamedTuple):
    """The limits of an instrument, and which readings (n,) are at one of them.

    A limit that does not occur is infinite.
    """

    low: float
    high: float
    at_limit: Bool[np.ndarray, " n"]


def limits_of(readings: Float[np.ndarray, " n"], *, two_sided: bool) -> Limits:
    """Return the limits that a column of readings shows; the low one only if `two_sided`.

    A limit is a value that no reading exceeds, that at least three successive readings have, and
    that they reach abruptly.
    """
    at_high = _plateau(readings)
    at_low = _plateau(-readings) if two_sided else np.zeros_like(at_high)
    high = float(readings.max()) if at_high.any() else np.inf
    low = float(readings.min()) if at_low.any() else -np.inf
    return Limits(low, high, at_high | at_low)


def _plateau(y: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return the mask of readings in a plateau at the maximum."""
    at_top = y == y.max()
    begin = np.concatenate([[0], np.flatnonzero(np.diff(y)) + 1])
    length, level = np.diff(np.append(begin, y.size)), y[begin]
    values = np.unique(y)
    step = float(np.min(np.diff(values))) if values.size > 1 else 0.0
    for i in np.flatnonzero((level == y.max()) & (length >= _RUN)):
        beside = [j for j in (i - 1, i + 1) if 0 <= j < level.size]
        rise = min((y.max() - level[j] for j in beside), default=0.0)
        most = max((np.count_nonzero(y == level[j]) for j in beside), default=y.size)
        others = max(length[level < y.max()], default=y.size)
        if rise > _STEPS * step or length[i] > min(_TIMES * most, _LONGER * others):
            # One long plateau shows the limit; other readings at that value are limited too.
            return at_top
    return np.zeros_like(at_top)


class BeyondLimits(AbstractErrors[Fit, dict[str, Any]]):
    """Readings at a limit that the fit puts beyond it, which are left out: they have no residual.

    `sizes` are the "sigma" or the "weights" of the columns.
    """

    rounds = 1

    def __init__(self, limits: Mapping[str, Limits], sizes: Mapping[str, Mapping[str, Column]]):
        self._limits, self._sizes, self._met = limits, sizes, False

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the sizes, with no weight for the readings beyond a limit."""
        self._met = found.converged and any(one.at_limit.any() for one in self._limits.values())
        if not self._met:
            return None
        expected = found.predict()
        beyond = {
            name: one.at_limit & ((expected[name] <= one.low) | (expected[name] >= one.high))
            for name, one in self._limits.items()
        }
        nothing = {"sigma": np.inf, "weights": 0.0}
        return {
            kind: {name: np.where(beyond[name], nothing[kind], own) for name, own in sizes.items()}
            for kind, sizes in self._sizes.items()
        }

    def finish(self, found: Fit) -> Fit:
        """Return the fit with notes on the limits."""
        said = [
            f"{np.count_nonzero(one.at_limit)} of {one.at_limit.size} readings of {name} are at a "
            "limit of the instrument and count as at or beyond it"
            for name, one in self._limits.items()
            if self._met and one.at_limit.any()
        ]
        return dataclasses.replace(found, notes=(*found.notes, *said))
