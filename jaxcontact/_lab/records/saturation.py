"""Instrument limits: readings that stay at the largest or smallest value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._fit import Fit

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


def met_limits(found: Fit, limits: Mapping[str, Limits]) -> dict[str, Bool[np.ndarray, " n"]]:
    """Return masks of readings at a limit that the fit puts beyond it (no residual)."""
    predicted = found.predict()
    return {
        name: one.at_limit & ((predicted[name] <= one.low) | (predicted[name] >= one.high))
        for name, one in limits.items()
    }


def left_out(
    given: Mapping[str, Float[np.ndarray, " n"]],
    met: Mapping[str, Bool[np.ndarray, " n"]],
    kind: str,
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return the "sigma" or "weights" of columns with readings beyond a limit left out."""
    nothing = np.inf if kind == "sigma" else 0.0
    return {name: np.where(met[name], nothing, values) for name, values in given.items()}


def said(limits: Mapping[str, Limits]) -> list[str]:
    """Return notes on the limits."""
    return [
        f"{np.count_nonzero(one.at_limit)} of {one.at_limit.size} readings of {name} are at a "
        "limit of the instrument and count as at or beyond it"
        for name, one in limits.items()
        if one.at_limit.any()
    ]
