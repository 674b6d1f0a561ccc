"""Levenberg-Marquardt and the optimisers of optax behind one face."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from ._problem import Problem

Tell = Callable[[Any, Any], None]

MOST_STEPS = 200
"""Steps of Levenberg-Marquardt, unless the caller says otherwise."""

PATIENCE = 200
"""Steps of a gradient method that may gain nothing."""

_TOLERANCE = 1e-13
"""Of the last accepted step of Levenberg-Marquardt, relative and absolute: its verdict is not
used, so it may go on until rounding stops it."""

_REFUSED = 24
"""Steps refused in a row after which none will be accepted: each is a quarter of the last."""

_LEVEL = 1e-12
"""Relative decrease of the loss that counts as none, for the patience of a gradient method."""


class Path(NamedTuple):
    """Where a search went: its best point, the loss after each step (NaN beyond), the steps."""

    theta: Float[Array, " k"]
    history: Float[Array, " steps"]
    steps: Int[Array, ""]
    patient: Bool[Array, ""]


def search(
    problem: Problem,
    start: Float[Array, " k"],
    optimizer: Any,
    max_steps: int,
    patience: int,
    tell: Tell | None,
) -> Path:
    """From `start` downhill until nothing is gained any more, or `max_steps` are used up."""
    if optimizer is None:
        return _levenberg_marquardt(problem, start, max_steps, tell)
    return _gradient_descent(problem, start, optimizer, max_steps, patience, tell)


def _said(tell: Tell | None, step: Array, loss: Array) -> None:
    if tell is not None:
        jax.debug.callback(tell, step, loss)


def _levenberg_marquardt(
    problem: Problem, start: Float[Array, " k"], max_steps: int, tell: Tell | None
) -> Path:
    solver = optx.LevenbergMarquardt(rtol=_TOLERANCE, atol=_TOLERANCE)
    options = {"jac": "bwd" if problem.reverse else "fwd"}

    # The damping and the tolerances of the solver have units: it is given numbers of order 1.
    spread = jnp.sqrt(jnp.mean(jnp.square(problem.y * problem.factor)))
    unit = jnp.where(spread > 0, spread, 1)

    def residual(place: Array, problem: Problem) -> tuple[Array, None]:
        return problem.residual(place) / unit, None

    kinds = jax.eval_shape(problem.residual, start)
    common = (problem, options)
    state = solver.init(residual, start, *common, kinds, None, frozenset())
    numbers, rest = eqx.partition(state, eqx.is_array)

    def unfinished(carry: tuple) -> Array:
        _, numbers, _, step = carry
        state = eqx.combine(numbers, rest)
        able = state.num_steps_since_acceptance < _REFUSED
        return ~state.terminate & able & (step < max_steps)

    def advance(carry: tuple) -> tuple:
        place, numbers, history, step = carry
        state = eqx.combine(numbers, rest)
        place, state, _ = solver.step(residual, place, *common, state, frozenset())
        loss = jnp.sum(jnp.square(state.f_info.residual * unit)) / 2
        _said(tell, step, loss)
        numbers, _ = eqx.partition(state, eqx.is_array)
        return place, numbers, history.at[step].set(loss), step + 1

    history = jnp.full(max_steps, jnp.nan, start.dtype)
    place, numbers, history, step = jax.lax.while_loop(
        unfinished, advance, (start, numbers, history, jnp.zeros((), int))
    )
    return Path(place, history, step, step < max_steps)


def _gradient_descent(
    problem: Problem,
    start: Float[Array, " k"],
    optimizer: Any,
    max_steps: int,
    patience: int,
    tell: Tell | None,
) -> Path:
    import optax

    optimizer = optax.with_extra_args_support(optimizer)

    def unfinished(carry: tuple) -> Array:
        _, _, _, _, idle, _, step = carry
        return (idle < patience) & (step < max_steps)

    def advance(carry: tuple) -> tuple:
        theta, state, best, lowest, idle, history, step = carry
        loss, gradient = jax.value_and_grad(problem.loss)(theta)
        better = loss < lowest * (1 - _LEVEL)
        # The best point is kept even where the gain is too small to go on for.
        lower = loss < lowest
        best, lowest = jnp.where(lower, theta, best), jnp.where(lower, loss, lowest)
        changes, state = optimizer.update(
            gradient, state, theta, value=loss, grad=gradient, value_fn=problem.loss
        )
        _said(tell, step, loss)
        moved = jnp.asarray(optax.apply_updates(theta, changes))
        # A step into a region without numbers is taken back to the best point.
        theta = jnp.where(jnp.all(jnp.isfinite(moved)) & jnp.isfinite(loss), moved, best)
        return (
            theta,
            state,
            best,
            lowest,
            jnp.where(better, 0, idle + 1),
            history.at[step].set(loss),
            step + 1,
        )

    history = jnp.full(max_steps, jnp.nan, start.dtype)
    zero = jnp.zeros((), int)
    first = (start, optimizer.init(start), start, jnp.asarray(jnp.inf), zero, history, zero)
    _, _, best, _, idle, history, step = jax.lax.while_loop(unfinished, advance, first)
    return Path(best, history, step, idle >= patience)
