"""Fits to data simulated from a fit."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._data import FitData
from ._found import Found, found_from
from ._problem import Problem

_STEPS = 100
_FEWEST = 2


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
        """The percentile interval of each parameter."""
        if not 0 < level < 1:
            raise ValueError(f"Argument `level` must be in (0, 1), but is {level!r}.")
        ends = np.quantile(
            self.values[self.converged], [(1 - level) / 2, (1 + level) / 2], axis=0
        ).T
        return {name: (float(a), float(b)) for name, (a, b) in zip(self.names, ends, strict=True)}

    def __repr__(self) -> str:
        count = int(self.converged.sum())
        lines = [f"Bootstrap: {count} of {len(self.converged)} draws converged"]
        for name, (low, high) in self.interval().items():
            error = self.standard_errors[name]
            lines.append(f"  {name}  ± {error:.2g}, 95 % in [{low:.6g}, {high:.6g}]")
        return "\n".join(lines)


def bootstrap(fit: FitData, draws: int, seed: int) -> Bootstrap:
    """The draws of `Fit.bootstrap`."""
    if not isinstance(draws, int) or draws < _FEWEST:
        raise ValueError(f"Argument `draws` must be at least {_FEWEST}, but is {draws!r}.")
    if not fit.converged:
        raise ValueError(f"A fit that did not converge has no bootstrap: {fit.reason}.")
    if not np.isfinite(fit.noise):
        raise ValueError(
            "Argument `sigma` of `fit` must be given for a bootstrap without degrees of freedom, "
            "which leave the size of the noise unknown."
        )
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        theta = jnp.asarray(fit.theta)
        key = jax.random.key(seed)
        noise = jax.random.normal(key, (draws, fit.data.size)) * np.sqrt(fit.noise)
        found = _refits(fit.problem, theta, noise, jnp.asarray(fit.rtol))
        fine = jnp.all(found.still, axis=1) & jnp.isfinite(found.loss)
    return Bootstrap(fit.names, np.asarray(found.values), np.asarray(fine))


@eqx.filter_jit
def _refits(
    problem: Problem,
    theta: Float[Array, " k"],
    noise: Float[Array, "draws n"],
    rtol: Float[Array, ""],
) -> Found:
    used = problem.factor > 0
    clean = problem.prediction(theta)

    def one(noise: Float[Array, " n"]) -> Found:
        y = clean + jnp.where(used, noise / jnp.where(used, problem.factor, 1), 0)
        simulated = eqx.tree_at(lambda p: p.y, problem, y)
        return found_from(simulated, theta, rtol, None, _STEPS, 0, None)

    return jax.vmap(one)(noise)
