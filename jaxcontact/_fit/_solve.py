"""Levenberg-Marquardt and the optimisers of optax, called alike."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._loss import shortened, shortened_slope
from ._problem import Point, Problem

MOST_STEPS = 200
"""Steps of Levenberg-Marquardt, unless the caller says otherwise."""

PATIENCE = 200
"""Steps of a gradient method that may gain nothing."""

_TOLERANCE = 1e-13
"""Of the last accepted step of Levenberg-Marquardt, relative and absolute. The search goes on until
rounding stops it; `Found.still` decides about convergence."""

_OTHER_SCALE = math.log(10)
_ROUNDS = 4
"""A search goes on in another scale, at most so many times, if its own is off by so much."""

_REFUSED = 24
"""Steps refused in a row after which none will be accepted: each is a quarter of the last."""

_LEVEL = 1e-12
"""Relative decrease of the loss that counts as none, for the patience of a gradient method."""


class Options(NamedTuple):
    """How to search: an `optimizer` of optax, or None for Levenberg-Marquardt.

    `rtol` decides about convergence; it is an array, so that another one does not compile anew.
    `tell` is called with the number of each step and its loss.
    """

    rtol: Float[Array, ""]
    optimizer: Any = None
    max_steps: int = MOST_STEPS
    patience: int = PATIENCE
    tell: Callable[[Any, Any], Any] | None = None

    def report(self, step: Array, loss: Array) -> None:
        """Call `tell`, if there is one, from compiled code."""
        if self.tell is not None:
            jax.debug.callback(self.tell, step, loss)


class Path(NamedTuple):
    """Where a search went: its best point, the loss after each of its steps (NaN beyond).

    `stopped`: by itself, not by the limit of steps.
    """

    theta: Float[Array, " k"]
    history: Float[Array, " steps"]
    steps: Int[Array, ""]
    stopped: Bool[Array, ""]


def search(problem: Problem, start: Float[Array, " k"], options: Options) -> tuple[Path, Point]:
    """Minimise from `start` until the loss no longer falls, or for `max_steps`; and the end."""
    method = _levenberg_marquardt if options.optimizer is None else _gradient_descent
    return method(problem, start, options)


# Shapes are asked for twice before the search: a compiled function is traced once for all of it.
_point = eqx.filter_jit(Problem.at)


class _Scale(NamedTuple):
    """The unit of residuals (), and the change (k,) of each free coordinate that moves them by it.

    Damping and tolerances of the solver have units: with these it is given numbers of order 1.
    """

    unit: Float[Array, ""]
    change: Float[Array, " k"]


def scale_of(problem: Problem, point: Point) -> _Scale:
    """The scale at a point. Logarithms and logits have a unit of their own, which is 1."""
    data = _rms(problem.y * problem.factor, problem)
    unit = _positive(jnp.where(data > 0, data, _rms(point.z, problem)))
    slope = shortened_slope(point.z, point.jacobian, problem.threshold)
    moved = jax.vmap(_rms, in_axes=(1, None))(slope, problem)
    change = jnp.where(moved > 0, unit / _positive(moved), 1)
    return _Scale(unit, jnp.where(problem.space.has_unit, 1, change))


def _rms(values: Float[Array, " n"], problem: Problem) -> Float[Array, ""]:
    used = problem.factor > 0
    return jnp.linalg.norm(jnp.where(used, values, 0)) / jnp.sqrt(jnp.sum(used))


def _positive(x: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.where(x > 0, x, 1)


class _Round(NamedTuple):
    """A search in one scale: where it began, and how many came before; `fresh` before its first
    step, which finds the scale.
    """

    origin: Float[Array, " k"]
    scale: _Scale
    fresh: Bool[Array, ""]
    number: Int[Array, ""]


def _levenberg_marquardt(
    problem: Problem, start: Float[Array, " k"], options: Options
) -> tuple[Path, Point]:
    # Loaded here, as it takes long: who looks at a fit needs none.
    import optimistix as optx

    solver = optx.LevenbergMarquardt(rtol=_TOLERANCE, atol=_TOLERANCE)

    # Value and Jacobian come together and are kept, so that the solver's own linearisation is a
    # product with a matrix, and the end of the search is known without another evaluation. A round
    # begins at zero, which is its origin in every scale: so that evaluation finds the scale, too.
    def residual(place: Array, args: tuple) -> tuple[Array, tuple[Point, _Scale, Array]]:
        problem, (origin, scale, fresh, _) = args
        here = jax.lax.stop_gradient(place)
        point = _point(problem, origin + scale.change * here)
        found = scale_of(problem, point)
        scale = jax.tree.map(functools.partial(jnp.where, fresh), found, scale)
        slope = shortened_slope(point.z, point.jacobian, problem.threshold) * scale.change[None, :]
        r = shortened(point.z, problem.threshold)
        return (r + slope @ (place - here)) / scale.unit, (point, scale, found.change)

    ones = jnp.ones_like(start)
    first = _Round(start, _Scale(ones[0], ones), jnp.asarray(True), jnp.zeros((), int))
    zeros = jnp.zeros_like(start)
    shape, at_shape = jax.eval_shape(lambda u: residual(u, (problem, first)), zeros)
    jac = {"jac": "fwd"}
    begun = solver.init(residual, zeros, (problem, first), jac, shape, at_shape, frozenset())
    at_first, rest = eqx.partition(begun, eqx.is_array)

    def unfinished(carry: tuple) -> Array:
        _, _, _, _, step, ended = carry
        return ~ended & (step < options.max_steps)

    def advance(carry: tuple) -> tuple:
        now, place, numbers, history, step, _ = carry
        state = eqx.combine(numbers, rest)
        place, state, _ = solver.step(residual, place, (problem, now), jac, state, frozenset())
        _, scale, change = state.aux
        loss = jnp.sum(jnp.square(state.f_info.residual * scale.unit)) / 2
        options.report(step, loss)
        # With its scale known a round goes on from zero, where a place has no rounding of origins.
        moved = now.origin / scale.change
        place = place + moved
        state = eqx.tree_at(lambda s: s.y_eval, state, state.y_eval + moved)
        idle = state.terminate | (state.num_steps_since_acceptance >= _REFUSED)
        # Where the scale has changed on the way the solver's measure of a small step was wrong.
        other = jnp.abs(jnp.log(change / scale.change)) > _OTHER_SCALE
        again = idle & jnp.any(other) & (now.number < _ROUNDS)
        origin = jnp.where(again, scale.change * place, 0)
        now = _Round(origin, scale, again, now.number + again)
        # The last point stays the one that is known.
        kept = eqx.tree_at(lambda s: s.aux, eqx.combine(at_first, rest), state.aux)
        numbers, first = (eqx.partition(s, eqx.is_array)[0] for s in (state, kept))
        numbers = jax.tree.map(functools.partial(jnp.where, again), first, numbers)
        place = jnp.where(again, 0, place)
        return now, place, numbers, history.at[step].set(loss), step + 1, idle & ~again

    history = jnp.full(options.max_steps, jnp.nan, start.dtype)
    zero = jnp.zeros((), int)
    carry = (first, zeros, at_first, history, zero, jnp.asarray(False))
    now, place, numbers, history, step, _ = jax.lax.while_loop(unfinished, advance, carry)
    point, *_ = eqx.combine(numbers, rest).aux
    here = now.origin + now.scale.change * place
    return Path(here, history, step, step < options.max_steps), point


def _gradient_descent(
    problem: Problem, start: Float[Array, " k"], options: Options
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
        # The best point is kept even where the gain is too small to count.
        lower = loss < lowest
        best, lowest = jnp.where(lower, theta, best), jnp.where(lower, loss, lowest)
        changes, state = optimizer.update(
            gradient, state, theta, value=loss, grad=gradient, value_fn=problem.loss
        )
        options.report(step, loss)
        moved = jnp.asarray(optax.apply_updates(theta, changes))
        # A step into a region without numbers is taken back to the best point.
        theta = jnp.where(jnp.all(jnp.isfinite(moved)) & jnp.isfinite(loss), moved, best)
        idle = jnp.where(better, 0, idle + 1)
        return theta, state, best, lowest, idle, history.at[step].set(loss), step + 1

    history = jnp.full(options.max_steps, jnp.nan, start.dtype)
    zero = jnp.zeros((), int)
    first = (start, optimizer.init(start), start, jnp.asarray(jnp.inf), zero, history, zero)
    _, _, best, _, idle, history, step = jax.lax.while_loop(unfinished, advance, first)
    return Path(best, history, step, idle >= options.patience), problem.at(best)
