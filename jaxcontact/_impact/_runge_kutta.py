"""Steps of an 8th-order Runge-Kutta method, with the coefficients of diffrax's Dopri8."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import TypeVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

State = TypeVar("State")

_TABLEAU = diffrax.Dopri8.tableau
# The last stage serves dense output only.
_STAGES = int(np.flatnonzero(_TABLEAU.b_sol)[-1]) + 1
NODES = np.concatenate([[0.0], _TABLEAU.c])[:_STAGES]
"""Where in a step the stages lie, as fractions of it."""
_MATRIX = np.zeros((_STAGES, _STAGES))
for _row, _weights in enumerate(_TABLEAU.a_lower[: _STAGES - 1], start=1):
    _MATRIX[_row, : len(_weights)] = _weights


def step(rate: Callable[[State], State], state: State, size: Array) -> State:
    """The state one step of `size` later.

    The stages are a loop, which compiles `rate` once instead of thirteen times: for the few steps
    that are taken out of order.
    """
    buffer = jax.tree.map(lambda leaf: jnp.zeros((_STAGES, *leaf.shape), leaf.dtype), state)

    def combined(weights: Array, slopes: State) -> State:
        return jax.tree.map(
            lambda leaf, slope: leaf + size * jnp.tensordot(weights.astype(leaf.dtype), slope, 1),
            state,
            slopes,
        )

    def stage(slopes: State, at: tuple[Array, Array]) -> tuple[State, None]:
        index, weights = at
        slope = rate(combined(weights, slopes))
        return jax.tree.map(lambda buffer, s: buffer.at[index].set(s), slopes, slope), None

    slopes, _ = jax.lax.scan(stage, buffer, (jnp.arange(_STAGES), jnp.asarray(_MATRIX)))
    return combined(jnp.asarray(_TABLEAU.b_sol[:_STAGES]), slopes)


def step_with_error(
    rate: Callable[[int, State], State], state: State, size: float
) -> tuple[State, State]:
    """The state one step of `size` later, and how far the embedded method of order 7 is from it.

    `rate(j, state)` is the derivative at stage j. The stages are unrolled, so that they fuse.
    """
    slopes: list[State] = []

    def change(weights: np.ndarray) -> State:
        chosen = [(size * float(w), s) for w, s in zip(weights, slopes, strict=False) if w != 0]
        return jax.tree.map(
            lambda *leaves: sum(w * leaf for (w, _), leaf in zip(chosen, leaves, strict=True)),
            *(slope for _, slope in chosen),
        )

    def moved(weights: np.ndarray) -> State:
        return jax.tree.map(operator.add, state, change(weights))

    slopes.append(rate(0, state))
    for row in range(1, _STAGES):
        slopes.append(rate(row, moved(_MATRIX[row])))
    return moved(_TABLEAU.b_sol), change(_TABLEAU.b_error)
