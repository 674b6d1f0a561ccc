"""Agreement of chains of draws, and their effective sample size, by ArviZ.

Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner (2021), Bayesian Analysis 16:667, doi
10.1214/20-BA1221.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_TAILS = 0.05, 0.95
_FEWEST = 4
"""Least draws of a chain whose halves have a variance."""


def r_hat_and_effective(draws: Float[np.ndarray, "chains draws"]) -> tuple[float, float]:
    """Return the rank-normalised split R-hat, and the smaller effective size of bulk and tails.

    R-hat is the larger of that of the draws and of their distances from the median. Both numbers
    are NaN for fewer than four draws of a chain, and for constant draws.
    """
    if draws.shape[1] < _FEWEST or not np.isfinite(draws).all() or np.ptp(draws) == 0:
        return np.nan, np.nan
    from arviz_stats.base.array import array_stats

    with np.errstate(divide="ignore", invalid="ignore"):  # chains that do not move
        bulk = array_stats.ess(draws, method="bulk")
        tail = array_stats.ess(draws, method="tail", prob=_TAILS)
        r_hat = np.asarray(array_stats.rhat(draws))
        return float(r_hat), float(np.minimum(bulk, tail))
