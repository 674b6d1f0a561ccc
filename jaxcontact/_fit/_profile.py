"""The profile likelihood of one parameter."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float
from scipy import stats
from scipy.interpolate import PchipInterpolator

from ._data import FitData
from ._found import found_from
from ._problem import Problem
from ._space import Space

_STEPS = 100


@dataclasses.dataclass(frozen=True)
class Profile:
    """The lowest loss (points,) with one parameter held at each of `values` (points,).

    `deviation` (points,) is ±√(2 (loss - best)/s²), which is a straight line through the best value
    where the normal approximation holds; s² is the variance of the standardised residuals. Points
    whose fit of the other parameters did not converge are NaN.
    """

    name: str
    best: float
    values: np.ndarray
    loss: np.ndarray
    deviation: np.ndarray
    dof: int
    absolute: bool

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Where the deviation is that of a normal, or of Student's t with `dof`, at the level.

        An end beyond the profiled values is infinite.
        """
        if not 0 < level < 1:
            raise ValueError(f"Argument `level` must be in (0, 1), but is {level!r}.")
        tail = (1 + level) / 2
        wanted = stats.norm.ppf(tail) if self.absolute else stats.t.ppf(tail, self.dof)
        fine = np.isfinite(self.deviation)
        x = np.concatenate([self.values[fine], [self.best]])
        y = np.concatenate([self.deviation[fine], [0.0]])
        y, order = np.unique(y, return_index=True)
        x = x[order]
        curve = PchipInterpolator(y, x, extrapolate=False)
        low, high = float(curve(-wanted)), float(curve(wanted))
        return (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)

    def __repr__(self) -> str:
        low, high = self.interval()
        return f"Profile of {self.name}: {self.best:.9g}, 95 % in [{low:.6g}, {high:.6g}]"


def profile(fit: FitData, name: str, values: ArrayLike | None, points: int, span: float) -> Profile:
    """The profile of `Fit.profile`."""
    if name not in fit.names:
        raise ValueError(f"Argument `name` must be one of {', '.join(fit.names)}, but is {name!r}.")
    if not fit.converged:
        raise ValueError(f"A fit that did not converge has no profile: {fit.reason}.")
    place = fit.names.index(name)
    space = fit.problem.space
    coordinate = space.coordinates[place]
    low, high = float(space.low[place]), float(space.high[place])
    best = float(fit.values[place])
    if values is None:
        error = fit.standard_errors[name]
        if not np.isfinite(error):
            raise ValueError(
                f"Argument `values` must be given for {name}, which has no standard error."
            )
        at = best + np.linspace(-span, span, points) * error
        at = at[(at > low) & (at < high)]
    else:
        at = np.sort(np.asarray(values, float).ravel())
        if not (np.isfinite(at) & (at > low) & (at < high)).all():
            raise ValueError(
                f"Argument `values` must be finite and in ({low:g}, {high:g}), but is {values!r}."
            )
    held = np.array([coordinate.to_free(float(value), low, high) for value in at])
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        loss, fine = _profile(
            fit.problem, jnp.asarray(fit.theta), jnp.asarray(held), place, jnp.asarray(fit.rtol)
        )
    loss = np.where(fine, loss, np.nan)
    rise = np.maximum(loss - fit.loss, 0)
    unit = _unit(fit)
    with np.errstate(invalid="ignore"):
        deviation = np.sign(at - best) * np.sqrt(2 * rise / unit)
    return Profile(name, best, at, loss, deviation, fit.dof, fit.absolute)


def _unit(fit: FitData) -> float:
    """The rise of twice the loss at one standard error.

    The curvature of Huber's loss is mean ψ' times that of squares, and so is the rise.
    """
    if fit.problem.threshold is None:
        return fit.noise
    return fit.noise * float(np.mean(np.abs(fit.z) <= float(fit.problem.threshold)))


class _Held(eqx.Module):
    """A space in which one coordinate is held."""

    space: Space
    held: Float[Array, ""]
    place: int = eqx.field(static=True)

    @property
    def has_unit(self) -> np.ndarray:
        return np.delete(self.space.has_unit, self.place)

    def params(self, theta: Float[Array, " rest"]) -> object:
        return self.space.params(self._whole(theta))

    def values(self, theta: Float[Array, " rest"]) -> Float[Array, " k"]:
        return self.space.values(self._whole(theta))

    def _whole(self, theta: Float[Array, " rest"]) -> Float[Array, " k"]:
        return jnp.concatenate((theta[: self.place], self.held[None], theta[self.place :]))


@eqx.filter_jit
def _profile(
    problem: Problem,
    theta: Float[Array, " k"],
    held: Float[Array, " points"],
    place: int,
    rtol: Float[Array, ""],
) -> tuple[Float[Array, " points"], Bool[Array, " points"]]:
    start = jnp.concatenate([theta[:place], theta[place + 1 :]])

    def one(held: Float[Array, ""]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        space = _Held(problem.space, held, place)
        reduced = eqx.tree_at(lambda p: p.space, problem, space)
        if start.size == 0:
            loss = reduced.loss(start)
            return loss, jnp.isfinite(loss)
        found = found_from(reduced, start, rtol, None, _STEPS, 0, None)
        return found.loss, jnp.all(found.still) & jnp.isfinite(found.loss)

    return jax.vmap(one)(held)
