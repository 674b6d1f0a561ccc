"""Levenberg-Marquardt and the optimisers of optax, with one interface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..problem.problem import FitProblem, Point
from .trust_region import Search, begin, least_squares

MOST_STEPS = 500
"""Default steps of Levenberg-Marquardt."""

PATIENCE = 200
"""Steps without gain after which a gradient method stops."""

_LEVEL = 1e-12
"""Least relative decrease of the loss that a gradient method counts as gain."""


class SearchOptions(NamedTuple):
    """Search options: an optax `optimizer`, or None for Levenberg-Marquardt.

    `rtol` decides convergence; it is an array, so that another value does not recompile. `tell` is
    called with the number of each step and its loss.
    """

    rtol: Float[Array, ""]
    optimizer: Any = None
    max_steps: int = MOST_STEPS
    patience: int = PATIENCE
    tell: Callable[[Any, Any], Any] | None = None

    def report(self, step: Array, loss: Array) -> None:
        """Call `tell`, if given, from compiled code."""
        if self.tell is not None:
            jax.debug.callback(self.tell, step, loss)


class Path(NamedTuple):
    """The course of a search: its best point, and the loss after each step (NaN beyond).

    `stopped`: it ended by itself, not by the limit of steps.
    """

    theta: Float[Array, " k"]
    history: Float[Array, " steps"]
    steps: Int[Array, ""]
    stopped: Bool[Array, ""]


def search(
    problem: FitProblem, start: Float[Array, " k"], options: SearchOptions
) -> tuple[Path, Point]:
    """Minimise from `start` until the loss no longer falls, or for `max_steps`; return the end."""
    method = _levenberg_marquardt if options.optimizer is None else _gradient_descent
    return method(problem, start, options)


def _levenberg_marquardt(
    problem: FitProblem, start: Float[Array, " k"], options: SearchOptions
) -> tuple[Path, Point]:
    begun = begin(problem, start, options.max_steps)
    return end_of(least_squares(problem, begun, options.max_steps, options.report))


def end_of(search: Search) -> tuple[Path, Point]:
    """Return the course of a search of Levenberg-Marquardt, and its best point."""
    here = search.here
    return Path(here.theta, search.history, search.step, search.ended), here.point


def _gradient_descent(
    problem: FitProblem, start: Float[Array, " k"], options: SearchOptions
) -> tuple[Path, Point]:
    import optax

    optimizer = optax.with_extra_args_support(options.optimizer)

    def unfinished(carry: tuple) -> Array:
        _, _, _, _, idle, _, step = carry
        return (idle < options.patience) & (step < options.max_steps)

    def advance(carry: tuple) -> tuple:
        theta, state, best, lowest, idle, history, step = carry
        loss, gradient = jax.value_and_grad(problem.loss)(theta)
        better = loss < lowest * (1 - _LEVEL)
        # The best point is kept even if the gain is too small to count.
        lower = loss < lowest
        best, lowest = jnp.where(lower, theta, best), jnp.where(lower, loss, lowest)
        changes, state = optimizer.update(
            gradient, state, theta, value=loss, grad=gradient, value_fn=problem.loss
        )
        options.report(step, loss)
        moved = jnp.asarray(optax.apply_updates(theta, changes))
        # A step into a region without finite values returns to the best point.
        theta = jnp.where(jnp.all(jnp.isfinite(moved)) & jnp.isfinite(loss), moved, best)
        idle = jnp.where(better, 0, idle + 1)
        return theta, state, best, lowest, idle, history.at[step].set(loss), step + 1

    history = jnp.full(options.max_steps, jnp.nan, start.dtype)
    zero = jnp.zeros((), int)
    first = (start, optimizer.init(start), start, jnp.asarray(jnp.inf), zero, history, zero)
    _, _, best, _, idle, history, step = jax.lax.while_loop(unfinished, advance, first)
    return Path(best, history, step, idle >= options.patience), problem.at(best)
