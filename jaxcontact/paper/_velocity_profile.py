"""The power β of the velocity profile of a compression: the regression of Eq. 22."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import Fit, Positive, fit
from ..extend import NOT_NEGATIVE, POSITIVE, Shown, as_weights, column, require_flag, require_number

Params = Mapping[str, Float[Array, ""]]
_FEWEST = 3
"""Touch, turn, and a sample between them: at the two ends the profile does not depend on β."""


@dataclasses.dataclass(frozen=True)
class VelocityProfile:
    """The profile δ' = v0 √(1 - (δ/δ_m)^β) nearest to samples of a compression.

    `beta`, dimensionless, and `residual`, the weighted root mean square for δ'/v0 or its square;
    both NaN unless `converged`. `steps` of the search, and `reason` why it stopped, in words. `fit`
    is the fit of δ'/v0 or its square over δ/δ_m.
    """

    beta: float
    residual: float
    converged: bool
    steps: int
    reason: str
    fit: Fit = dataclasses.field(repr=False, compare=False)


def fit_velocity_profile(
    indentation: ArrayLike,
    velocity: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    squared: bool = False,
    start: float = 2.5,
) -> VelocityProfile:
    """Fit the β > 0 for which δ' = v0 √(1 - (δ/δ_m)^β) is nearest to a compression.

    Minimises Σ wᵢ [δ'ᵢ/v0 - √(1 - (δᵢ/δ_m)^β)]² / Σ wᵢ over ln β from `start`. With `squared=True`
    the squares of both are compared, without the root. Arguments, all of shape (samples,), at least
    3: `indentation` δ in m, from 0 at touch to δ_m, never falling; `velocity` δ' in m/s, from v0 >
    0 at touch to 0 at the turn; `weights` ≥ 0, equal if None. If a trajectory lacks its turn,
    append `impact(...).max_indentation` and 0. β depends on the distribution of the samples, each
    of which counts by its weight.

    Returns a `VelocityProfile`. It has no standard error: the samples of a solved motion carry no
    noise, and the residual is the part that no β describes. Computes in double precision regardless
    of the JAX setting, and does not work under `jit`. Raises ValueError for samples that are not a
    compression.

    Source: Hu & Guo (2015), Eq. 22, doi 10.1007/s11044-015-9453-z.
    """
    squares = require_flag("squared", squared)
    guess = require_number("start", start, POSITIVE)
    depth = column(indentation, "indentation", NOT_NEGATIVE, least=_FEWEST)
    speed = column(velocity, "velocity", NOT_NEGATIVE, ("indentation", depth))
    share = np.ones(len(depth))
    if weights is not None:
        share = column(as_weights(weights), "weights", NOT_NEGATIVE, ("indentation", depth))
    _check_compression(depth, speed)
    u, v = depth / depth[-1], speed / speed[0]
    profile, wanted, first = SpeedProfile(squares), v**2 if squares else v, {"beta": guess}
    found = fit(profile, wanted, first, x=u, weights=share, transforms=Positive(), throw=False)
    reason = found.reason
    converged = found.converged and not (found.at_bound or found.unidentified)
    if found.converged and not converged:
        reason = "the samples do not determine β"
    beta, residual = float(found.params["beta"]), math.sqrt(2 * found.loss / share.sum())
    if not converged:
        beta = residual = math.nan
    return VelocityProfile(beta, residual, converged, found.steps, reason, found)


class SpeedProfile(eqx.Module):
    """δ'/v0, or its square, over δ/δ_m."""

    squared: bool = eqx.field(static=True)

    @property
    def shown(self) -> dict[str, Shown]:
        """The presentation of both."""
        words = "velocity / velocity at touch"
        return {
            "x": Shown("", "indentation / largest"),
            "": Shown("", f"({words})²" if self.squared else words),
        }

    def __call__(self, params: Params, u: Float[Array, " n"]) -> Float[Array, " n"]:
        return _square(params, u) if self.squared else _profile(params, u)


def _square(params: Params, u: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return (δ'/v0)² = 1 - u^β with its derivative in β, which is 0 at both ends.

    The guards avoid ln 0 and 0/0 there.
    """
    inside = (u > 0) & (u < 1)
    log_u = jnp.log(jnp.where(inside, u, 0.5))
    return jnp.where(inside, -jnp.expm1(params["beta"] * log_u), jnp.where(u > 0, 0.0, 1.0))


def _profile(params: Params, u: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return δ'/v0 = √(1 - u^β); where the square is zero, so is its derivative."""
    square = _square(params, u)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def _check_compression(indentation: np.ndarray, velocity: np.ndarray) -> None:
    if indentation[0] != 0 or indentation[-1] == 0:
        raise ValueError(
            "Argument `indentation` must rise from 0 at touch to the turn, but goes from "
            f"{indentation[0]:g} to {indentation[-1]:g}."
        )
    falls = np.diff(indentation) < 0
    if falls.any():
        i = int(np.argmax(falls))
        raise ValueError(
            "Argument `indentation` must never fall during compression, but falls from "
            f"{indentation[i]:g} to {indentation[i + 1]:g} at point {i + 1}; leave out the "
            "restitution."
        )
    if velocity[0] == 0 or velocity[-1] != 0:
        raise ValueError(
            "Argument `velocity` must go from v0 > 0 at touch to 0 at the turn, but goes from "
            f"{velocity[0]:g} to {velocity[-1]:g}; append `impact(...).max_indentation` and 0."
        )
