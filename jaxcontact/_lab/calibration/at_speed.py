"""Restitution of a calibrated law at closing speeds, with its interval."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from ..._calibration.choice.kind import padded
from ..._fit import Fit


@dataclasses.dataclass(frozen=True)
class AtSpeed:
    """The mean e of the law at a closing speed in m/s, with its 95 % interval from `low` to `high`.

    The interval is that of the fitted curve (`Fit.confidence_band`) and assumes that the law is
    right. It is None if the data do not determine it. `measured` is True if the speed lies between
    those of the kept pairs. `least` and `most` are the extremes of e over all laws that are not
    ruled out, including this law.
    """

    velocity: float
    restitution: float
    low: float | None
    high: float | None
    measured: bool
    least: float
    most: float


def at_speeds(
    fit: Fit, others: Iterable[Fit], kept: np.ndarray, asked: Sequence[float]
) -> tuple[AtSpeed, ...]:
    """Return e at the slowest and the fastest `kept` speed (m/s), and at those `asked`."""
    ends = float(kept.min()), float(kept.max())
    speeds = np.array([*ends, *asked])
    n, at = len(speeds), padded(speeds, ends[0])
    # ln e comes before contact times and forces.
    curve = np.exp(np.asarray(fit.predict_with_error(at)[0])[:n])
    low, high = (np.exp(side[:n]) for side in fit.confidence_band(at))
    # Identical readings do not determine their error.
    known = np.isfinite(low) & np.isfinite(high) & (high > low) & (len(fit.at_bound) == 0)
    all_curves = np.array(
        [curve, *(np.exp(one.predict_with_error(at)[0][:n]) for one in others if one.converged)]
    )
    return tuple(
        AtSpeed(
            velocity=float(speeds[i]),
            restitution=float(curve[i]),
            low=float(low[i]) if known[i] else None,
            # No law delivers more than 1.
            high=min(float(high[i]), 1.0) if known[i] else None,
            measured=ends[0] <= speeds[i] <= ends[1],
            least=float(all_curves[:, i].min()),
            most=float(all_curves[:, i].max()),
        )
        for i in range(n)
    )
