"""The measurement that would settle an undecided choice among laws."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..._fit import Fit, scatter
from ..design.optimal_rows import shared_out
from .kind import padded

_PLACES = 40
"""Candidate speeds of the measurement."""

_WANTED = 40.0
"""λ at which the wrong law is detected in all but one of ten thousand tables."""

_MANY = 2_000
"""Readings beyond which shared errors dominate, such as a scale that reads 1 % too high."""

_SHOWN = 12
"""Parts into which the readings are divided, to find the speeds that need them."""


def what_settles(
    fits: dict[str, Fit], best: str | None, rivals: list[str], ends: tuple[float, float]
) -> str:
    """Return where and how often to measure e to separate the best law from its nearest rival.

    Minimax: the law with more parameters is taken as right, as fitted. The other law is refitted to
    minimise its maximum deviation between the slowest and the fastest speed. The speeds are those
    where that maximum occurs (see `design`). Returns "" if the choice is clear, or if the best law
    does not describe the data.
    """
    if best is None or not rivals or fits[best].adequate is False:
        return ""
    # With equal numbers of parameters, the best is taken as right.
    right, other = sorted((best, rivals[0]), key=lambda name: -len(fits[name].names))
    low, high = ends
    if not high > low:
        return (
            f"to distinguish {best} from {rivals[0]}, measure e at speeds other than {low:.3g} m/s"
        )
    speeds = np.geomspace(low, high, _PLACES)
    distance, share = _least_distance(fits[right], fits[other], speeds)
    # The noise of e, which is the first column.
    noise = float(np.nanmedian(scatter(fits[right])[: len(fits[right].problem.x)]))
    between = f"to distinguish {best} from {rivals[0]}"
    count = math.inf if distance == 0 else math.ceil(_WANTED * (noise / distance) ** 2)
    if count > _MANY:
        most = f"{100 * distance:.1g} % of e at most"
        return (
            f"{between}, measure e at speeds outside {low:.3g} to {high:.3g} m/s: inside, the "
            f"difference of {most} is hidden by the scatter of single readings"
        )
    places = speeds[shared_out(share, _SHOWN) > 0]
    at = " and ".join(f"{v:.3g}" for v in places)
    count = float(f"{max(count, len(places) + 1):.2g}")
    return (
        f"{between}, measure e equally often at {at} m/s: about {count:g} independent readings "
        f"with this scatter rule out {other} if {right} is right"
    )


def _least_distance(
    right: Fit, other: Fit, speeds: Float[np.ndarray, " m"]
) -> tuple[float, Float[np.ndarray, " m"]]:
    """Return the minimax difference of ln e, and the shares of the readings.

    The difference is linear in the parameters of the other law.
    """
    from scipy.optimize import linprog

    at = padded(speeds, speeds[0])
    truth = right.linearised(at)[0][: len(speeds)]
    curve, slopes = (part[: len(speeds)] for part in other.linearised(at))
    off, k = curve - truth, slopes.shape[1]
    # Scale parameters of different units by their effect, for the linear programme.
    size = np.abs(slopes).max(axis=0)
    slopes = slopes / np.where(size > 0, size, 1)
    upper = np.column_stack([np.concatenate([slopes, -slopes]), -np.ones(2 * len(off))])
    cost = np.append(np.zeros(k), 1.0)
    limits = [(None, None)] * k + [(0, None)]
    made = linprog(cost, upper, np.concatenate([-off, off]), bounds=limits)
    share = -made.ineqlin.marginals.reshape(2, -1).sum(axis=0)
    return float(made.fun), share / share.sum() if share.sum() > 0 else share
