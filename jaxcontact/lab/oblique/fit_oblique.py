"""The numbers of a friction law from measured oblique impacts, and their regimes.

The search starts at the best of a few numbers. A lowest loss may stand at a jump of the slope of an
outcome, where no search by derivatives ends.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import AbstractFriction, AbstractLaw, Contact, Fit, Fixed, RoundBodies, fit
from ...extend import (
    ColumnKeywords,
    FitData,
    Range,
    counted,
    ranges,
    require_friction,
    takes,
    with_transforms,
)
from .measurements import Measurements, ObliqueModel, measurements

Friction = TypeVar("Friction", bound=AbstractFriction)

_MU = np.geomspace(0.005, 3.0, 65)
"""Coefficients that are tried; neighbours differ by a tenth."""

_INSIDE = 9
_AROUND = np.array([0.125, 0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0])


@eqx.filter_jit
def _predicted(
    model: ObliqueModel,
    friction: AbstractFriction,
    names: tuple[str, ...],
    grid: Float[Array, "laws k"],
    x: dict[str, Array],
) -> dict[str, Float[Array, "laws n"]]:
    """Return the outcomes of a friction law with the numbers of each row of a grid."""
    return jax.vmap(lambda numbers: model(_with(friction, names, numbers), x))(grid)


def _with(friction: Friction, names: Sequence[str], numbers: Any) -> Friction:
    """Return a friction law with other numbers."""
    return eqx.tree_at(lambda law: [getattr(law, name) for name in names], friction, list(numbers))


def lowest(friction: Friction, there: Measurements, fixed: frozenset[str]) -> Friction:
    """Return the friction law whose numbers on a grid have the lowest loss.

    The loss of laws without a tangential spring has flat parts and several minima, in which a
    search by derivatives may end. Numbers that are `fixed`, and arrays, stay.
    """
    numbers = {
        name: allowed
        for name, allowed in ranges(friction).items()
        if name not in fixed and np.shape(getattr(friction, name)) == ()
        if getattr(friction, name) is not None
    }
    if not numbers:
        return friction
    axes = [_tried(name, float(getattr(friction, name)), one) for name, one in numbers.items()]
    grid = np.array(list(itertools.product(*axes)))
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        given = jax.device_put((grid, there.x))
        outcome = _predicted(there.model, friction, tuple(numbers), *given)
    loss = np.zeros(len(grid))
    for name, values in there.table["data"].items():
        factor = there.factor[name]
        off = np.where(factor > 0, np.asarray(outcome[name]) - values, 0) * factor
        loss += np.sum(np.square(off), axis=1)
    if not np.isfinite(loss).any():
        return friction
    best = grid[int(np.nanargmin(loss))]
    return _with(friction, tuple(numbers), map(jnp.asarray, best))


def _tried(name: str, value: float, allowed: Range) -> np.ndarray:
    """Return the numbers to try for one parameter, its own among them if it can be fitted."""
    if name == "mu":
        tried = _MU
    elif math.isfinite(allowed.low) and math.isfinite(allowed.high):
        tried = np.linspace(allowed.low, allowed.high, _INSIDE + 2)[1:-1]
    else:
        return np.unique(value * _AROUND)
    inside = allowed.low < value < allowed.high
    return np.unique([*tried, value]) if inside else tried


_TRIED = 96
_WIDE, _CLOSE = 0.3, 1e-10
"""Largest and smallest change of a coordinate that is tried."""

_ROUNDS = 4
"""Rounds in which differences over one standard error give the standard error."""

_FAR = 0.05
_LEAST = 1e-4

REASON = "no lower loss was found around a jump of slope"
NOTE = (
    "at the best parameters an outcome changes between sticking and sliding; their standard errors "
    "are from differences over one standard error"
)


@eqx.filter_jit
def _residuals(problem: eqx.Module, thetas: Float[Array, "lanes k"]) -> Float[Array, "lanes n"]:
    return jax.vmap(problem.residual)(thetas)  # pyright: ignore[reportAttributeAccessIssue]


@eqx.filter_jit
def _there(problem: Any, theta: Float[Array, " k"]) -> tuple[Any, Array, Array]:
    values = problem.space.values(theta)
    return problem.space.tree_of(values), values, problem.prediction(theta)


def lowest_around(found: FitData) -> np.ndarray:
    """Return the coordinates (k,) of the lowest loss, by random changes of decreasing size."""
    random, theta = np.random.default_rng(0), found._theta
    size, best = _WIDE, np.inf
    while size > _CLOSE:
        away = random.normal(size=(_TRIED, len(theta)))
        away *= size * random.uniform(size=(_TRIED, 1)) / np.linalg.norm(away, axis=1)[:, None]
        lanes = theta + np.concatenate([np.zeros((1, len(theta))), away])
        loss = np.sum(np.square(residuals_at(found, lanes)), axis=1)
        i = int(np.nanargmin(loss))
        if loss[i] < best * (1 - 1e-13):
            theta, best = lanes[i], loss[i]
        else:
            size /= 2
    return theta


def residuals_at(found: FitData, lanes: np.ndarray) -> np.ndarray:
    """Return the standardised residuals (lanes, n) at coordinates (lanes, k)."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        return np.asarray(_residuals(found.problem, jax.device_put(lanes)))


def at_jump(found: Fit) -> Fit:
    """Return a fit at the lowest loss around the end of its search, as converged.

    The slopes of the two sides differ, so the curvature is that over one standard error of each.
    """
    theta = lowest_around(found)
    k = len(theta)
    points = int(np.count_nonzero(np.asarray(found.problem.factor)))
    z = residuals_at(found, theta[None])[0]
    noise = 1.0 if found._absolute else float(np.sum(z**2)) / max(points - k, 1)
    step, covariance = np.full(k, _FAR), np.full((k, k), np.nan)
    jacobian = np.zeros((len(z), k))
    for _ in range(_ROUNDS):
        sides = residuals_at(found, np.concatenate([theta + np.diag(step), theta - np.diag(step)]))
        jacobian = ((sides[:k] - sides[k:]) / (2 * step[:, None])).T
        square = jacobian.T @ jacobian
        if np.linalg.matrix_rank(square) < k:
            break
        covariance = noise * np.linalg.inv(square)
        step = np.clip(np.sqrt(np.diag(covariance)), _LEAST, 1.0)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        params, values, prediction = _there(found.problem, jax.device_put(theta))
        values, prediction = np.asarray(values), np.asarray(prediction)
    stretch = found.problem.space.stretch(values)
    used = np.asarray(found.problem.factor) > 0
    return dataclasses.replace(
        found,
        params=params,
        values=values,
        loss=float(np.sum(z**2)) / 2,
        residuals=np.where(used, prediction - np.asarray(found.problem.y), np.nan),
        converged=True,
        reason=REASON,
        covariance=covariance * np.outer(stretch, stretch),
        dof=points - k,
        noise=noise,
        notes=(*found.notes, NOTE),
        _theta=theta,
        _jacobian=jacobian,
    )


_IMPACTS = "impact", "impacts"
_ROUNDING = 1e-9
_AT_JUMP = 1e-6


class Regimes(NamedTuple):
    """How many of the measured impacts slid throughout; the least distance to a jump, or None."""

    slid: int
    count: int
    margin: float | None

    @property
    def has_jumps(self) -> bool:
        """True if the slope of an outcome may jump."""
        return self.margin is not None

    @property
    def at_jump(self) -> bool:
        """True if an impact is at a jump."""
        return self.margin is not None and self.margin < _AT_JUMP

    @property
    def note(self) -> str:
        """What the impacts determine, in words."""
        which = f"{self.slid} of {counted(self.count, _IMPACTS)} slid throughout"
        if self.slid == self.count:
            return f"{which}: only μ follows from them; measure closer to the normal as well"
        if self.slid == 0:
            return f"{which}: μ follows from the tangential spring alone; measure nearer grazing"
        return which


_rebound = eqx.filter_jit(ObliqueModel.rebound)


def regimes_of(friction: AbstractFriction, there: Measurements) -> Regimes:
    """Return the regimes of the measured impacts by a friction law."""
    used = np.any([factor > 0 for factor in there.factor.values()], axis=0)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        after = _rebound(there.model, friction, jax.device_put(there.x))
    # A ramp slides at any speed; in full sliding the impulse has the ratio μ.
    slid = np.asarray(after.impulse_ratio) > np.asarray(friction.mu) * (1 - _ROUNDING)
    margin = None if after.margin is None else float(np.min(np.asarray(after.margin)[used]))
    return Regimes(int(np.sum(slid & used)), int(used.sum()), margin)


@takes(ColumnKeywords, noise=None)
def fit_oblique(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: AbstractFriction,
    tangential_restitution: ArrayLike | None = None,
    rebound_angle: ArrayLike | None = None,
    rebound_spin: ArrayLike | None = None,
    sigma_tangential_restitution: ArrayLike | None = None,
    sigma_rebound_angle: ArrayLike | None = None,
    sigma_rebound_spin: ArrayLike | None = None,
    bodies: RoundBodies | str | None = None,
    **how: Unpack[ColumnKeywords],
) -> Fit:
    """Fit a friction law to the rebounds of oblique impacts: μ, and κ, β0 or v_d if it has them.

    Arguments: the `law` and the `contact` of the normal motion, which are known. The closing speeds
    `velocity` v_n = v cos θ > 0 and `tangential_velocity` v_t = v sin θ ≥ 0 in m/s, with θ from the
    normal; no spin before. `friction`, as in `oblique_impact`, is the start: all its numbers are
    fitted. A `ratio` of None stays that of the contact's materials, and
    `transforms={"ratio": jc.Fixed()}` holds a given one.

    Measured, at least one of them, NaN for missing readings, all (points,):
    `tangential_restitution` v_t'/v_t; `rebound_angle` arctan(v_t'/v_n') in rad, from the normal,
    negative if v_t reversed; `rebound_spin` in rad/s, of the first body, positive in the sense of
    rolling (`-hit.spin[0]` of an `oblique_impact`). A spin needs `bodies` with radii; otherwise
    `bodies` is the name of a shape, by default "sphere".

    `sigma_...`: the standard deviation of each column (one number, or one for each point), of all
    or of none. Without them the fit estimates the noise of each column (`noise` is "by column" by
    default). The search starts from the lowest loss on a grid of numbers that holds the given
    start. Other keywords go to `fit`.

    Returns a `Fit` whose params are the fitted friction law; its notes count the impacts that slid
    throughout. They determine nothing but μ, and those of laws without a tangential spring alone
    determine it. The slope of such a law jumps between sticking and sliding; a note says if the
    lowest loss is at a jump. Raises ValueError for columns that do not match or are out of range,
    and as `oblique_impact` does.

    Source: Maw, Barber & Fawcett (1976), doi 10.1016/0043-1648(76)90201-5; Foerster et al. (1994),
    doi 10.1063/1.868282.
    """
    columns = columns_of(
        (tangential_restitution, sigma_tangential_restitution),
        (rebound_angle, sigma_rebound_angle),
        (rebound_spin, sigma_rebound_spin),
    )
    require_friction(friction)
    there = measurements(law, contact, velocity, tangential_velocity, bodies, columns)
    return fitted(friction, there, dict(how))


def columns_of(*columns: tuple[Any, Any]) -> dict[str, tuple[Any, Any]]:
    """Return values and standard deviations of the measured columns by name."""
    names = "tangential_restitution", "rebound_angle", "rebound_spin"
    return dict(zip(names, columns, strict=True))


def fitted(friction: AbstractFriction, there: Measurements, how: dict[str, Any]) -> Fit:
    """Return the fit of a friction law to measurements, with notes on what they determine."""
    how = with_transforms({}, how)
    if how.get("noise") is None:
        how["noise"] = "by column" if there.unlike else "common"
    held = {name for name, one in how["transforms"].items() if isinstance(one, Fixed)}
    start = lowest(friction, there, frozenset(held))
    found = fit(there.model, start=start, x=there.x, **(there.table | how))
    if not np.isfinite(found.values).all():
        return found
    if not found.converged and not found.at_bound and regimes_of(found.params, there).has_jumps:
        tried = at_jump(found)
        found = tried if regimes_of(tried.params, there).at_jump else found
    return dataclasses.replace(found, notes=(*found.notes, regimes_of(found.params, there).note))
