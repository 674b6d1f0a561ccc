"""What the adaptive solves of scenes share: a step, and the length of the next one."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._elementary import small_product
from .._impact._solver.runge_kutta import tableau
from .._varying import varying

State = Float[Array, " numbers"]
_ORDER = 8
"""Of the Runge-Kutta method."""


def step_and_slope(
    rate: Callable[[State], State], state: State, size: Float[Array, ""]
) -> tuple[State, State, State, State]:
    """The state one step of `size` later, how far the embedded method of order 7 is from it, and
    the slopes at both ends.

    The stages are a loop, which compiles `rate` once. The state of the last one is the end of the
    step, so that the slope there costs no `rate` of its own.
    """
    rule, stages = tableau(), len(tableau().nodes)
    matrix = np.zeros((stages + 1, stages + 1))
    matrix[:stages, :stages], matrix[stages, :stages] = rule.matrix, rule.solution
    start = jnp.zeros((stages + 1, *state.shape), state.dtype)

    def moved(weights: Array, slopes: Array) -> Array:
        return state + size * small_product(weights, slopes)

    def stage(carry: tuple[Array, Array], at: tuple[Array, Array]) -> tuple[tuple, None]:
        (slopes, _), (index, weights) = carry, at
        there = moved(weights, slopes)
        slopes = jax.lax.dynamic_update_index_in_dim(slopes, rate(there), index, 0)
        return (slopes, there), None

    rows = (jnp.arange(stages + 1), jnp.asarray(matrix, state.dtype))
    first = (varying(size, start), varying(size, state))
    (slopes, end), _ = jax.lax.scan(stage, first, rows)
    error = size * small_product(jnp.asarray(rule.error, state.dtype), slopes[:stages])
    return end, error, slopes[0], slopes[stages]


def factor(error: Float[Array, ""]) -> Float[Array, ""]:
    """By how much the next step may be longer; `error` is in units of what is allowed."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(0.9 * safe ** (-1 / _ORDER), 0.2, 5.0)
