"""The limits of an instrument: readings that stay at the largest or smallest it can show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._fit import Fit

_RUN = 3
"""Equal readings in a row from which a plateau is told."""

_STEPS, _TIMES, _LONGER = 4.0, 4, 8
"""A plateau is a limit where the readings beside it rise to it by more than so many of their steps
of resolution, where it is so many times as long as there are readings of the value beside it, or
so many times as long as any other run of equal readings. A peak in coarse steps is flat, too, but
reached slowly: of a parabola there are at most 1 + √2 times as many readings as of the value beside
it, whose runs noise cuts short; and where noise cuts the peak, it cuts all else as well."""


class Limits(NamedTuple):
    """The smallest and the largest reading of an instrument (infinite where it has shown none),
    and which readings (n,) are at one of them.
    """

    low: float
    high: float
    at_limit: Bool[np.ndarray, " n"]


def limits_of(readings: Float[np.ndarray, " n"], *, two_sided: bool) -> Limits:
    """The limits that a column of readings shows; the low one only if asked for.

    A limit is a value that no reading exceeds, that at least three readings in a row have, and that
    they reach at once.
    """
    at_high = _plateau(readings)
    at_low = _plateau(-readings) if two_sided else np.zeros_like(at_high)
    high = float(readings.max()) if at_high.any() else np.inf
    low = float(readings.min()) if at_low.any() else -np.inf
    return Limits(low, high, at_high | at_low)


def _plateau(y: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """The readings in a plateau at the maximum."""
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
            # One long plateau shows the limit; other readings there are at it, too.
            return at_top
    return np.zeros_like(at_top)


def met_limits(found: Fit, limits: Mapping[str, Limits]) -> dict[str, Bool[np.ndarray, " n"]]:
    """Readings at a limit beyond which the fit puts them: they have no residual, and no noise."""
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
    """The "sigma" or "weights" of columns without the readings that a limit has met."""
    nothing = np.inf if kind == "sigma" else 0.0
    return {name: np.where(met[name], nothing, values) for name, values in given.items()}


def said(limits: Mapping[str, Limits]) -> list[str]:
    """The limits in words."""
    return [
        f"{np.count_nonzero(one.at_limit)} of {one.at_limit.size} readings of {name} are at a "
        "limit of the instrument and count as that or beyond"
        for name, one in limits.items()
        if one.at_limit.any()
    ]
