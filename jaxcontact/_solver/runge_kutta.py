"""Steps of an 8th-order Runge-Kutta method, with the coefficients of diffrax's Dopri8."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._functions import Product, small_product, varying

State = TypeVar("State")
Computed = TypeVar("Computed")


class Tableau(NamedTuple):
    """The coefficients of a step: stage times, and weights of stages, solution and error."""

    nodes: np.ndarray
    matrix: np.ndarray
    solution: np.ndarray
    error: np.ndarray


@functools.cache
def tableau() -> Tableau:
    """Return the tableau of Dopri8, without its last stage, which only serves dense output."""
    # Imported here: a closed form needs no solver, and diffrax takes as long to load as JAX.
    import diffrax

    given = diffrax.Dopri8.tableau
    stages = int(np.flatnonzero(given.b_sol)[-1]) + 1
    matrix = np.zeros((stages, stages))
    for row, weights in enumerate(given.a_lower[: stages - 1], start=1):
        matrix[row, : len(weights)] = weights
    nodes = np.concatenate([[0.0], given.c])[:stages]
    return Tableau(nodes, matrix, given.b_sol[:stages], given.b_error[:stages])


def step(rate: Callable[[State], State], state: State, size: Array) -> State:
    """Return the state one step of `size` later, for the few steps outside of a march."""
    return step_in_loop(rate, state, size)[0]


def step_in_loop(
    rate: Callable[[State], State], state: State, size: Array, product: Product = small_product
) -> tuple[State, State]:
    """Return the state one step of `size` later, and its difference from the order-7 method. The
    stages are a loop, which compiles `rate` once instead of thirteen times. `product`: the one of
    weights and slopes.
    """
    rule = tableau()
    stages = len(rule.nodes)
    buffer = jax.tree.map(
        lambda leaf: varying(size, jnp.zeros((stages, *leaf.shape), leaf.dtype)), state
    )

    def changed(weights: np.ndarray | Array, slopes: State) -> State:
        return jax.tree.map(
            lambda slope: size * product(jnp.asarray(weights, slope.dtype), slope), slopes
        )

    def moved(weights: np.ndarray | Array, slopes: State) -> State:
        return jax.tree.map(operator.add, state, changed(weights, slopes))

    def stage(slopes: State, at: tuple[Array, Array]) -> tuple[State, None]:
        index, weights = at
        slope = rate(moved(weights, slopes))
        # Unlike `at`, this does not check the index at every stage.
        put = jax.lax.dynamic_update_index_in_dim
        return jax.tree.map(lambda rows, row: put(rows, row, index, 0), slopes, slope), None

    slopes, _ = jax.lax.scan(stage, buffer, (jnp.arange(stages), jnp.asarray(rule.matrix)))
    return moved(rule.solution, slopes), changed(rule.error, slopes)


def step_and_slope(
    rate: Callable[[Array], Array], state: Array, size: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the step of a vector, its error, and the slopes at both ends.

    The error is the difference from the embedded method of order 7. The stages are a loop, which
    compiles `rate` once. The state of the last stage is the end of the step, so that the slope
    there costs no extra call of `rate`.
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


def step_written_out(
    rate: Callable[[int, State], State], state: State, size: Array | float
) -> tuple[State, State]:
    """Return the state one step of `size` later, and its difference from the order-7 method.
    `rate(j, state)` is the derivative at stage j. The stages are written one after another.
    """
    slopes: list[State] = []
    # A concrete number costs nothing within the weights.
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

    rule = tableau()
    for row, weights in enumerate(rule.matrix):
        slopes.append(rate(row, moved(weights) if row else state))
    return moved(rule.solution), change(rule.error)


def step_with_error(
    rate: Callable[[int, State], tuple[State, Array]], state: State, size: float, always: Array
) -> tuple[State, State, Array]:
    """Return a written-out step, its error, and whether all stages were good. `rate(j, state)` is
    the derivative at stage j, and whether it is good. `always` is a flag that is true, but not
    known to be true at compile time; see `_computed_once`.
    """
    good = [always]

    def slope(stage: int, state: State) -> State:
        change, fine = _computed_once(rate(stage, state), always)
        good.append(fine)
        return change

    after, error = step_written_out(slope, state, size)
    return after, error, functools.reduce(operator.and_, good)


def _computed_once(values: Computed, always: Array) -> Computed:
    """Return `values`, such that the CPU compiler does not recompute them at each use.

    Every later stage uses the slopes of the earlier ones. XLA fuses their whole computation into
    each use: four times the work, measured. It removes an optimization barrier before it fuses, but
    does not fuse through a branch. On GPUs the branch would cause a wait.
    """
    zeros = functools.partial(jax.tree.map, jnp.zeros_like)

    def branch(values: Computed) -> Computed:
        return jax.lax.cond(always, lambda values: values, zeros, values)

    return jax.lax.platform_dependent(values, cpu=branch, default=lambda values: values)
