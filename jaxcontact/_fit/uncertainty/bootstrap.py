"""Fits to data simulated from a fit."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import numpy as np

from ..._entry import FRACTION, require_count, require_number
from ..._program import in_double
from ..data import FitData, require_converged
from .interval import ends_of, refits

_drawn = eqx.filter_jit(ends_of)


@dataclasses.dataclass(frozen=True)
class Bootstrap:
    """Fits to simulated data: `values` (draws, k), and which of them `converged` (draws,)."""

    names: tuple[str, ...]
    values: np.ndarray
    converged: np.ndarray

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard deviation of each parameter over the draws that converged."""
        spread = self.values[self.converged].std(axis=0, ddof=1)
        return dict(zip(self.names, spread.tolist(), strict=True))

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return the percentile interval of each parameter."""
        level = require_number("level", level, FRACTION)
        part = np.array([1 - level, 1 + level]) / 2
        ends = np.quantile(self.values[self.converged], part, axis=0)
        return dict(zip(self.names, zip(*ends.tolist(), strict=True), strict=True))

    def __repr__(self) -> str:
        count = int(self.converged.sum())
        lines = [f"Bootstrap: {count} of {len(self.converged)} draws converged"]
        for name, (low, high) in self.interval().items():
            error = self.standard_errors[name]
            lines.append(f"  {name}  ± {error:.2g}, 95 % in [{low:.6g}, {high:.6g}]")
        return "\n".join(lines)


def bootstrap(fit: FitData, draws: int = 200, *, seed: int = 0) -> Bootstrap:
    """Fit data simulated from this fit: its prediction plus normal noise of its size.

    Returns a `Bootstrap`: parameters (draws, k), their spread and percentile intervals. Draws that
    did not converge are flagged and left out. Raises ValueError if the size of the noise is
    unknown, or if this fit did not converge.

    Source: Efron & Tibshirani (1993), doi 10.1201/9780429246593.
    """
    draws = require_count("draws", draws, 2)
    seed = require_count("seed", seed, 0)
    require_converged(fit, "bootstrap")
    if not np.isfinite(fit.noise):
        raise ValueError(
            "Argument `sigma` of `fit` must be given for a bootstrap without degrees of freedom, "
            "which leave the size of the noise unknown."
        )
    with in_double():
        # In NumPy: each JAX operation outside a compiled function is a program.
        noise = np.array(jax.random.normal(jax.random.key(seed), (draws, fit.data.size)))
        if fit._shared is None:
            noise *= np.sqrt(fit.noise)
        else:
            size, root = fit._shared
            # A new key: the same one would draw the same numbers again.
            key = jax.random.fold_in(jax.random.key(seed), 1)
            shared = np.asarray(jax.random.normal(key, (draws, root.shape[1]))) @ root.T
            noise[:, fit._used] = noise[:, fit._used] * np.sqrt(size) + shared
    if fit.problem.whitener is not None:
        noise = np.linalg.solve(np.asarray(fit.problem.whitener), noise.T).T
    y = fit.data + fit.residuals + noise / np.where(fit._used, fit._factor, 1)
    y, starts = np.where(fit._used, y, 0), np.tile(fit._theta, (draws, 1))
    values, _, converged, _ = refits(fit, _drawn, "y", y, starts)
    return Bootstrap(fit.names, values, converged)
