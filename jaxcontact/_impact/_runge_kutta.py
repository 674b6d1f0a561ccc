"""Steps of an 8th-order Runge-Kutta method, with the coefficients of diffrax's Dopri8."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import TypeVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._elementary import small_product
from .._varying import varying

State = TypeVar("State")
Computed = TypeVar("Computed")

_TABLEAU = diffrax.Dopri8.tableau
# The last stage serves dense output only.
_STAGES = int(np.flatnonzero(_TABLEAU.b_sol)[-1]) + 1
NODES = np.concatenate([[0.0], _TABLEAU.c])[:_STAGES]
"""Where in a step the stages lie, as fractions of it."""
_MATRIX = np.zeros((_STAGES, _STAGES))
for _row, _weights in enumerate(_TABLEAU.a_lower[: _STAGES - 1], start=1):
    _MATRIX[_row, : len(_weights)] = _weights


def step(rate: Callable[[State], State], state: State, size: Array) -> State:
    """The state one step of `size` later: for the few steps that are taken out of order."""
    return step_in_loop(rate, state, size)[0]


def step_in_loop(
    rate: Callable[[State], State], state: State, size: Array
) -> tuple[State, State, State]:
    """The state one step of `size` later, how far the embedded method of order 7 is from it, and
    the slope at the start.

    The stages are a loop, which compiles `rate` once instead of thirteen times.
    """
    buffer = jax.tree.map(
        lambda leaf: varying(size, jnp.zeros((_STAGES, *leaf.shape), leaf.dtype)), state
    )

    def changed(weights: np.ndarray | Array, slopes: State) -> State:
        return jax.tree.map(
            lambda slope: size * small_product(jnp.asarray(weights, slope.dtype), slope), slopes
        )

    def moved(weights: np.ndarray | Array, slopes: State) -> State:
        return jax.tree.map(operator.add, state, changed(weights, slopes))

    def stage(slopes: State, at: tuple[Array, Array]) -> tuple[State, None]:
        index, weights = at
        slope = rate(moved(weights, slopes))
        return jax.tree.map(functools.partial(_put, index), slopes, slope), None

    slopes, _ = jax.lax.scan(stage, buffer, (jnp.arange(_STAGES), jnp.asarray(_MATRIX)))
    error = changed(_TABLEAU.b_error[:_STAGES], slopes)
    first = jax.tree.map(lambda slope: slope[0], slopes)
    return moved(_TABLEAU.b_sol[:_STAGES], slopes), error, first


def _put(index: Array, buffer: Array, slope: Array) -> Array:
    # Unlike `at`, without a check of the place at every stage.
    return jax.lax.dynamic_update_index_in_dim(buffer, slope, index, 0)


def step_written_out(
    rate: Callable[[int, State], State], state: State, size: Array | float
) -> tuple[State, State]:
    """The state one step of `size` later, and how far the embedded method of order 7 is from it.

    `rate(j, state)` is the derivative at stage j. The stages are written one after another.
    """
    slopes: list[State] = []
    # A number known beforehand costs nothing in the weights.
    within, outside = (size, 1.0) if isinstance(size, float) else (1.0, size)

    def change(weights: np.ndarray) -> State:
        chosen = [(within * float(w), s) for w, s in zip(weights, slopes, strict=False) if w != 0]
        return jax.tree.map(
            lambda *leaves: (
                outside * sum(w * leaf for (w, _), leaf in zip(chosen, leaves, strict=True))
            ),
            *(slope for _, slope in chosen),
        )

    def moved(weights: np.ndarray) -> State:
        return jax.tree.map(operator.add, state, change(weights))

    for row in range(_STAGES):
        slopes.append(rate(row, moved(_MATRIX[row]) if row else state))
    return moved(_TABLEAU.b_sol), change(_TABLEAU.b_error)


def step_with_error(
    rate: Callable[[int, State], tuple[State, Array]], state: State, size: float, always: Array
) -> tuple[State, State, Array]:
    """A step that is written out, its error, and whether all stages were good.

    `rate(j, state)` is the derivative at stage j, and whether it is good. `always` is a flag that
    is true, but not known to be while compiling; see `_computed_once`.
    """
    good = [always]

    def slope(stage: int, state: State) -> State:
        change, fine = _computed_once(rate(stage, state), always)
        good.append(fine)
        return change

    after, error = step_written_out(slope, state, size)
    return after, error, functools.reduce(operator.and_, good)


def _computed_once(values: Computed, always: Array) -> Computed:
    """`values`, which the compiler for processors must not compute again where they are used.

    Every later stage uses the slopes of the earlier ones, and XLA fuses into each use all that
    leads to it: four times the work, measured. It drops an optimization barrier before it fuses,
    but does not look through a branch. Graphics processors would wait for the branch.
    """
    zeros = functools.partial(jax.tree.map, jnp.zeros_like)

    def branch(values: Computed) -> Computed:
        return jax.lax.cond(always, lambda values: values, zeros, values)

    return jax.lax.platform_dependent(values, cpu=branch, default=lambda values: values)
