"""A law fitted to most trials, beside the restitution of the trials that were held out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import stats

from ..pairs.pairs import RELATIVE_FLOOR
from .kind import Kind, padded
from .table import ChoiceTable

_EVERY = 4
"""Every fourth trial is held out."""

_LEAST = 8
"""Trials to fit, from which standard errors allow for the correlation within a trial."""


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """The mean e of `pairs` in the trials that were held out: predicted, and measured.

    The law was fitted to the other of all `trials`, at the same speeds. Means are those of ln e by
    weight. `error` is the half width of the 95 % interval of measured - predicted, from the scatter
    of the trials that were fitted.
    """

    held: tuple[str, ...]
    trials: int
    pairs: int
    predicted: float
    measured: float
    error: float

    @property
    def agrees(self) -> bool:
        """True if the difference lies within its 95 % interval."""
        return abs(self.measured - self.predicted) <= self.error


def held_out(table: ChoiceTable, kind: Kind, names: tuple[str, ...]) -> HeldOut | None:
    """Fit a law without every fourth trial, and predict these; None if there are too few trials.

    With weights w, residuals r of ln e, W_g = Σ w and R_g = Σ w r in a trial, the variance of the
    measured mean is φ/Σ W_g of the trials held out, with φ = Σ R_g²/Σ W_g · G/(G - k) of those G
    that were fitted, and k parameters.
    """
    pairs, use = table.pairs, table.use
    trials = np.unique(pairs.cluster[use])
    held = trials[_EVERY - 1 :: _EVERY]
    fitted = len(trials) - len(held)
    if fitted < _LEAST or table.errors.correlation is not None:
        return None
    out = use & np.isin(pairs.cluster, held)
    rest = dataclasses.replace(table, use=use & ~out)
    found = rest.fit(kind)
    k = len(found.names)
    if not found.converged or fitted <= k or not np.isfinite(found.covariance).all():
        return None
    n = len(pairs)
    curve, slope = found.linearised(padded(pairs.velocity, float(np.median(pairs.velocity))))
    weight, off = table.errors.sigma**-2, np.log(pairs.restitution) - curve[:n]

    def by_trial(of: np.ndarray) -> np.ndarray:
        return np.bincount(pairs.cluster[rest.use], of[rest.use])

    spread = np.sum(by_trial(weight * off) ** 2) / np.sum(weight[rest.use])
    whole, w = np.sum(weight[out]), weight[out] / np.sum(weight[out])
    along = w @ slope[:n][out]
    variance = spread * fitted / (fitted - k) / whole + along @ found.covariance @ along
    predicted, measured = math.exp(w @ curve[:n][out]), math.exp(w @ np.log(pairs.restitution[out]))
    error = float(stats.t.ppf(0.975, fitted - k)) * math.sqrt(variance) * predicted
    if error < RELATIVE_FLOOR:  # readings without scatter
        return None
    return HeldOut(
        held=tuple(names[one] for one in held),
        trials=len(trials),
        pairs=int(out.sum()),
        predicted=predicted,
        measured=measured,
        error=error,
    )
