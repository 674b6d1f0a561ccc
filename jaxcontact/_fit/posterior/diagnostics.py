"""Agreement of chains of draws, and their effective sample size.

Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner (2021), Bayesian Analysis 16:667, doi
10.1214/20-BA1221.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_TAILS = 0.05, 0.95
_FEWEST = 4
"""Least draws of a chain whose halves have a variance."""


def r_hat(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Return the rank-normalised split R-hat.

    It is the larger of that of the draws and of their distances from the median. It is NaN for
    fewer than four draws of a chain, and for constant draws.
    """
    if draws.shape[1] < _FEWEST or not np.isfinite(draws).all():
        return np.nan
    halves = _halves(draws)
    folded = np.abs(halves - np.median(halves))
    return float(np.max([_ratio(_normal(x)) for x in (halves, folded)]))


def effective(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Return the smaller of the bulk and tail effective sample sizes; NaN as for `r_hat`."""
    if draws.shape[1] < _FEWEST or not np.isfinite(draws).all():
        return np.nan
    tails = [_halves(draws <= end).astype(float) for end in np.quantile(draws, _TAILS)]
    return float(np.min([_independent(x) for x in (_normal(_halves(draws)), *tails)]))


def _halves(draws: np.ndarray) -> np.ndarray:
    # For an odd number the middle draw is left out.
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _normal(draws: np.ndarray) -> np.ndarray:
    """Return normal quantiles of the ranks; equal draws share theirs."""
    _, place, count = np.unique(draws, return_inverse=True, return_counts=True)
    rank = np.cumsum(count) - (count - 1) / 2
    from scipy.special import ndtri

    return ndtri((rank[place] - 3 / 8) / (draws.size + 1 / 4)).reshape(draws.shape)


def _ratio(draws: np.ndarray) -> float:
    """Return √(variance of all / variance within chains)."""
    n, within = draws.shape[1], draws.var(axis=1, ddof=1).mean()
    if within == 0:
        return np.nan
    return np.sqrt((n - 1) / n + draws.mean(axis=1).var(ddof=1) / within)


def _independent(draws: np.ndarray) -> float:
    """Return the effective number of draws, with autocorrelations cut by Geyer's monotone pairs."""
    n = draws.shape[1]
    off = draws - draws.mean(axis=1, keepdims=True)
    wave = np.fft.rfft(off, 2 * n)
    lagged = np.fft.irfft(np.abs(wave) ** 2, 2 * n)[:, :n].mean(axis=0) / n
    within = lagged[0] * n / (n - 1)
    if within == 0:
        return np.nan
    whole = lagged[0] + draws.mean(axis=1).var(ddof=1)
    rho = 1 - (within - lagged) / whole
    rho[0] = 1
    last = (n - 1) // 2
    pairs = rho[0 : 2 * last : 2] + rho[1 : 2 * last : 2]
    low = np.flatnonzero(pairs <= 0)
    end = int(low[0]) if low.size else max(last - 1, 0)
    # The even term after the cut may count; its odd neighbour is noise.
    tau = -1 + 2 * np.minimum.accumulate(pairs[:end]).sum() + max(rho[2 * end], 0)
    return float(draws.size / max(tau, 1 / np.log10(draws.size)))
