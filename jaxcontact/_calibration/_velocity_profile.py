"""The power β of the velocity profile that a compression follows: the regression of Eq. 22."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ._minimise import minimise

_FEWEST = 3
"""Touch, turn, and a sample between them: at the two ends the profile does not depend on β."""

_REMAINING = 1e-4
"""The largest Newton step in ln β that may be left. A vanishing gradient alone is no proof: far
from any profile of this family the loss is flat in β."""


@dataclasses.dataclass(frozen=True)
class VelocityProfile:
    """The profile δ' = v0 √(1 - (δ/δ_m)^β) nearest to samples of a compression.

    `beta`, dimensionless; `residual`, the weighted root mean square of what was fitted, δ'/v0 or
    its square; both NaN unless `converged`. `evaluations` of the loss; `reason` says in words why
    the search stopped.
    """

    beta: float
    residual: float
    converged: bool
    evaluations: int
    reason: str


def fit_velocity_profile(
    indentation: ArrayLike,
    velocity: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    squared: bool = False,
    start: float = 2.5,
) -> VelocityProfile:
    """The β > 0 for which δ' = v0 √(1 - (δ/δ_m)^β) is nearest to a compression: least squares.

    Minimises Σ wᵢ [δ'ᵢ/v0 - √(1 - (δᵢ/δ_m)^β)]² / Σ wᵢ over ln β from `start`; with `squared=True`
    the squares of both are compared, and the root is gone. Arguments, all of shape (samples,), at
    least 3: `indentation` δ in m, from 0 at touch to δ_m, never falling; `velocity` δ' in m/s, from
    v0 > 0 at touch to 0 at the turn; `weights` ≥ 0, equal if None. A trajectory need not hold its
    turn: append `impact(...).max_indentation` and 0. The samples choose the β: each is one vote,
    wherever it stands.

    Returns a `VelocityProfile`. No standard error is given: the samples of a solved motion carry no
    noise, and what is left over is what no β can describe. Computes in double precision whatever
    JAX is set to, and is not for use under `jit`. Raises ValueError for samples that are no
    compression.

    Source: Hu & Guo (2015), Eq. 22, doi 10.1007/s11044-015-9453-z.
    """
    depth = _samples(indentation, "indentation")
    speed = _samples(velocity, "velocity", len(depth))
    share = np.ones(len(depth)) if weights is None else _samples(weights, "weights", len(depth))
    _check_compression(depth, speed)
    if not share.any():
        raise ValueError("Argument `weights` must not be zero everywhere, but is.")
    if not 0 < start < math.inf:
        raise ValueError(f"Argument `start` must be in (0, inf), but is {start!r}.")
    # In single precision the gradient's rounding is near the tolerance it has to meet.
    with jax.enable_x64(True):
        u = jnp.asarray(depth / depth[-1])
        v = jnp.asarray(speed / speed[0])
        w = jnp.asarray(share / share.sum())
        loss = _loss_of_squares if squared else _loss
        minimum = minimise(loss, jnp.log(jnp.full(1, float(start))), u, v, w)
        determined = _is_determined(minimum.parameters, minimum.gradient_norm, squared, u, w)
    converged, reason = minimum.converged, minimum.reason
    if converged and not determined:
        converged, reason = False, "the samples do not determine β"
    return VelocityProfile(
        beta=math.exp(float(minimum.parameters[0])) if converged else math.nan,
        residual=math.sqrt(minimum.loss) if converged else math.nan,
        converged=converged,
        evaluations=minimum.evaluations,
        reason=reason,
    )


def _square(log_beta: Float[Array, ""], u: Float[Array, " n"]) -> Float[Array, " n"]:
    """(δ'/v0)² = 1 - u^β, with its derivative in β: 0 at both ends, where ln 0 or 0/0 would be."""
    inside = (u > 0) & (u < 1)
    log_u = jnp.log(jnp.where(inside, u, 0.5))
    return jnp.where(inside, -jnp.expm1(jnp.exp(log_beta) * log_u), jnp.where(u > 0, 0.0, 1.0))


def _profile(log_beta: Float[Array, ""], u: Float[Array, " n"]) -> Float[Array, " n"]:
    """δ'/v0 = √(1 - u^β); where the square has vanished, so has its derivative."""
    square = _square(log_beta, u)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def _loss(theta: Array, u: Array, v: Array, w: Array) -> Float[Array, ""]:
    return jnp.sum(w * jnp.square(_profile(theta[0], u) - v))


def _loss_of_squares(theta: Array, u: Array, v: Array, w: Array) -> Float[Array, ""]:
    return jnp.sum(w * jnp.square(_square(theta[0], u) - jnp.square(v)))


def _is_determined(theta: Array, gradient: float, squared: bool, u: Array, w: Array) -> bool:
    """Whether the loss has a bottom here: a step of Gauss and Newton would hardly move β."""
    curve = _square if squared else _profile
    _, slope = jax.jvp(lambda x: curve(x, u), (theta[0],), (jnp.ones_like(theta[0]),))
    return gradient < _REMAINING * 2 * float(jnp.sum(w * jnp.square(slope)))


def _samples(value: ArrayLike, name: str, length: int | None = None) -> np.ndarray:
    array = np.asarray(value, float)
    if array.ndim != 1 or array.size < _FEWEST:
        raise ValueError(
            f"Argument `{name}` must have the shape (samples,) with at least {_FEWEST} samples, "
            f"but is of shape {array.shape}."
        )
    if length is not None and array.size != length:
        raise ValueError(
            f"Argument `{name}` must have the {length} samples of `indentation`, but has "
            f"{array.size}."
        )
    bad = ~(np.isfinite(array) & (array >= 0))
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"Argument `{name}` must be finite and not negative, but is {array[i]:g} at sample {i}."
        )
    return array


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
            f"{indentation[i]:g} to {indentation[i + 1]:g} at sample {i + 1}; leave out the "
            "restitution."
        )
    if velocity[0] == 0 or velocity[-1] != 0:
        raise ValueError(
            "Argument `velocity` must go from v0 > 0 at touch to 0 at the turn, but goes from "
            f"{velocity[0]:g} to {velocity[-1]:g}; append `impact(...).max_indentation` and 0."
        )
