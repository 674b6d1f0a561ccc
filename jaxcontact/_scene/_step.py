"""One step of an embedded Runge-Kutta method of order 8, small enough to compile inside a loop."""

from __future__ import annotations

from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

State = Float[Array, " numbers"]

_TABLEAU = diffrax.Dopri8.tableau
# The last stage serves dense output only.
_STAGES = int(np.flatnonzero(_TABLEAU.b_sol)[-1]) + 1
_MATRIX = np.zeros((_STAGES, _STAGES))
for _row, _weights in enumerate(_TABLEAU.a_lower[: _STAGES - 1], start=1):
    _MATRIX[_row, : len(_weights)] = _weights
_ORDER = 8


def step(
    rate: Callable[[State], State], state: State, size: Float[Array, ""]
) -> tuple[State, State]:
    """The state one step of `size` later, and how far the embedded method is from it.

    The stages are a loop, which compiles `rate` once. Source: Prince & Dormand (1981),
    J. Comput. Appl. Math. 7:67, doi 10.1016/0771-050X(81)90010-3, coefficients of diffrax.
    """

    def stage(slopes: Array, at: tuple[Array, Array]) -> tuple[Array, None]:
        index, weights = at
        return slopes.at[index].set(rate(state + size * (weights @ slopes))), None

    empty = jnp.zeros((_STAGES, *state.shape), state.dtype)
    rows = (jnp.arange(_STAGES), jnp.asarray(_MATRIX, state.dtype))
    slopes, _ = jax.lax.scan(stage, empty, rows)
    advance = jnp.asarray(_TABLEAU.b_sol[:_STAGES], state.dtype) @ slopes
    error = jnp.asarray(_TABLEAU.b_error[:_STAGES], state.dtype) @ slopes
    return state + size * advance, size * error


def factor(error: Float[Array, ""]) -> Float[Array, ""]:
    """By how much the next step may be longer; `error` is in units of what is allowed."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(0.9 * safe ** (-1 / _ORDER), 0.2, 5.0)
