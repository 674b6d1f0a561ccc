"""Implicit steps for strongly damped, stiff motion, by Radau collocation.

The velocity relaxes at the rate c x^(n-p). Then the bodies creep, usually back with c v = -x^p,
over a time up to 1e12 times longer. The first of these times limits the steps of an explicit
method. Radau IIA with seven nodes has order 13 and takes about forty steps for both.

Source: Hairer & Wanner (1996), Solving ordinary differential equations II, section IV.8,
doi 10.1007/978-3-642-05221-7.
"""

from __future__ import annotations

import operator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import legendre

from ..._forms import Flag, signed_power
from ..._functions import bracketed_root, ratio, small_product, varying, with_implicit_derivative
from ..._solver import chosen
from ..motion.coordinates import Number, State
from ..motion.ends import Followed, creeps_to_rest, gaps, is_held
from ..motion.equation import Motion

_STAGES = 7
_MOST_STEPS = 400
_NEWTON = 12
# The number of times a step that passes an event is repeated, each time to at most 2 % beyond it.
_SHORTENED = 3
_ITERATIONS = 60


def _rule() -> tuple[np.ndarray, ...]:
    """Return the nodes in (0, 1], the collocation matrix, its inverse, and Legendre coefficients.
    The last matrix maps values to the coefficients of the polynomial through 0 and the nodes.
    """
    s = _STAGES
    top = np.zeros(s + 1)
    top[s], top[s - 1] = 1, -1
    # NumPy 2.5 returns complex roots, also of a polynomial whose roots are real.
    nodes = np.sort(np.real(legendre.legroots(top)))
    nodes[-1] = 1
    # Integrals from -1 of P_j are (P_(j+1) - P_(j-1))/(2j+1); half of that on [0, 1].
    integrals = np.stack(
        [legendre.legval(nodes, legendre.legint(np.eye(s)[j], lbnd=-1)) for j in range(s)], 1
    )
    matrix = integrals / 2 @ np.linalg.inv(legendre.legvander(nodes, s - 1))
    through = np.linalg.inv(legendre.legvander(np.concatenate([[-1.0], nodes]), s))
    return (1 + nodes) / 2, matrix, np.linalg.inv(matrix), through[:, 1:]


_NODES, _MATRIX, _INVERSE, _COEFFICIENTS = _rule()


class _ImplicitStep(NamedTuple):
    """A step of `size` from a state, and the increments of the state at the nodes."""

    start: State
    size: Number
    increments: State


class _Progress(NamedTuple):
    """The last accepted step, the size of the next one, and the progress of the leg."""

    last: _ImplicitStep
    next_size: Number
    count: Int[Array, ""]
    met: Bool[Array, ""]
    done: Bool[Array, ""]
    shortened: Int[Array, ""]


def follow_on(motion: Motion, explicit: Followed, rtol: float) -> Followed:
    """Return both legs after explicit steps, with stuck or stiff ones solved by implicit steps. The
    compression continues from its last state; the way out is solved again from the turn. The way
    out also ends if the push holds the bodies permanently. Differentiable in forward mode.
    """

    def go_on(before: tuple[State, Bool[Array, ""], Bool[Array, ""]], leg: tuple) -> tuple:
        state, useful, again = before
        compressing, end, arrived, likely = leg
        needed = useful & (again | likely | ~arrived)
        start = chosen(compressing, end, motion.still(state))
        # A branch, since even a solve without steps costs more than most explicit legs.
        end, arrived, steps = jax.lax.cond(
            needed,
            lambda: _solved(motion, start, compressing, rtol, needed),
            lambda: (end, arrived, jnp.zeros((), int)),
        )
        return (end, arrived, needed), (end, arrived, steps)

    flags = jnp.asarray([True, False])
    ends = jax.tree.map(lambda *leaves: jnp.stack(leaves), explicit.turn, explicit.end)
    legs = (flags, ends, explicit.arrived, jnp.stack([flags[1], motion.creeps()]))
    first = (explicit.turn, ~explicit.creeps, varying(explicit.turn.w, flags[1]))
    _, (ends, arrived, steps) = jax.lax.scan(go_on, first, legs)
    turn, end = (jax.tree.map(operator.itemgetter(leg), ends) for leg in (0, 1))
    return Followed(
        turn=turn,
        end=end,
        arrived=arrived,
        creeps=explicit.creeps | (~arrived[0] & creeps_to_rest(motion, turn)),
        steps=explicit.steps + jnp.sum(steps),
    )


def _solved(
    motion: Motion, start: State, compressing: Flag, rtol: float, needed: Bool[Array, ""]
) -> tuple[State, Bool[Array, ""], Int[Array, ""]]:
    """Return the end of a leg, whether an event ended it, and the steps; none unless `needed`."""
    nothing = jax.tree.map(lambda leaf: jnp.zeros(_STAGES, leaf.dtype), start)
    first = _Progress(
        last=_ImplicitStep(start, jnp.zeros_like(start.t), nothing),
        next_size=0.1 / jax.lax.stop_gradient(motion.stiffness(start)),
        count=jnp.zeros((), int),
        met=jnp.asarray(False),
        done=~needed,
        shortened=jnp.zeros((), int),
    )
    first = varying(start.w, first)

    def advance(progress: _Progress) -> _Progress:
        state = _after(progress.last)
        step, good = _collocated(motion, state, compressing, progress.next_size)
        error = jax.lax.stop_gradient(_error(motion, step))
        fine = good & (error <= rtol)
        grown = 0.9 * jnp.power(rtol / jnp.maximum(error, 1e-6 * rtol), 1 / _STAGES)
        factor = jnp.clip(grown, 0.2, jnp.where(fine, 4, 0.9))
        factor = jnp.where(good, factor, 0.25)
        closing = _closing(motion, step, compressing)
        meets = fine & jnp.any(closing)
        # A step far beyond the end is also inaccurate before it, so it is repeated with a smaller
        # size.
        again = meets & (progress.shortened < _SHORTENED)
        lost = _force_is_lost(motion, state)
        fine, met = fine & ~again, meets & ~again & ~lost
        beyond = _node_beyond(motion, step, compressing, closing)
        last = chosen(fine, step, progress.last)
        state = _after(last)
        ends = jnp.where(compressing, creeps_to_rest(motion, state), is_held(motion, state))
        return _Progress(
            last=last,
            next_size=progress.next_size * jnp.where(again, beyond, factor),
            count=progress.count + 1,
            met=met,
            done=met | lost | (fine & ends),
            shortened=progress.shortened + again.astype(progress.shortened.dtype),
        )

    def unfinished(progress: _Progress) -> Bool[Array, ""]:
        return ~progress.done & (progress.count < _MOST_STEPS)

    progress = jax.lax.while_loop(unfinished, advance, first)
    fraction = _landing(motion, progress.last, compressing, progress.met)
    return _within(progress.last, fraction), progress.met, progress.count


def _force_is_lost(motion: Motion, state: State) -> Bool[Array, ""]:
    """Return whether the force has underflowed although it still changes a free motion. In
    regularised time the damping force changes the speed v at the rate r v. Until the end it changes
    v by a share r w/v.
    """
    if motion.push is not None:
        return jnp.asarray(False)
    c, p = motion.damping_back()
    rate = c * signed_power(state.w, motion.order * (motion.n - p + 1) - 1)
    # At the turn v is momentarily zero.
    speed = jnp.maximum(jnp.abs(motion.velocity(state)), motion.creeping_speed(state))
    numbers = jnp.finfo(state.w.dtype)
    # The spring force uses up some part of it.
    return (rate * speed < 100 * numbers.tiny) & (
        motion.order * rate * state.w > numbers.eps * speed
    )


def _after(step: _ImplicitStep) -> State:
    return jax.tree.map(lambda start, change: start + change[-1], step.start, step.increments)


def _within(step: _ImplicitStep, fraction: Number) -> State:
    """Return the state at a fraction of a step."""
    at = 2 * fraction - 1
    values = [jnp.ones_like(at), at]
    for j in range(1, _STAGES):
        values.append(((2 * j + 1) * at * values[j] - j * values[j - 1]) / (j + 1))
    basis = jnp.stack(values)

    # In a batch, too, a product of matrices would be a call of a library.
    weights = jnp.sum(basis[:, None] * jnp.asarray(_COEFFICIENTS, at.dtype), axis=0)

    def moved(start: Array, change: Array) -> Array:
        return start + jnp.sum(weights * change)

    return jax.tree.map(moved, step.start, step.increments)


def _scales(motion: Motion, start: State) -> Float[Array, "2"]:
    """Return the units of w and u: w itself, and the creeping speed where u may vanish."""
    least = motion.creeping_speed(start) if motion.form.tension else jnp.zeros_like(start.u)
    return jax.lax.stop_gradient(jnp.stack([start.w, jnp.maximum(jnp.abs(start.u), least)]))


@jax.jit
def _eliminated(matrix: Float[Array, "N N"], right: Float[Array, " N"]) -> Float[Array, " N"]:
    """Return the solution of a small linear system by elimination with pivots.

    XLA compiles a loop with a call of LAPACK as many small functions.
    """
    rows = jnp.arange(right.size)

    def eliminate(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        table, place = carry
        column = jax.lax.dynamic_index_in_dim(table, k, 1)
        here = rows[:, None] == jnp.argmax(jnp.where(place < 0, jnp.abs(column), -1))
        pivot = jnp.sum(jnp.where(here, table, 0), axis=0)
        pivot = pivot / jax.lax.dynamic_index_in_dim(pivot, k, keepdims=False)
        return jnp.where(here, pivot[None], table - column * pivot[None]), jnp.where(here, k, place)

    table = jnp.concatenate([matrix, right[:, None]], axis=1)
    start = table, jnp.full_like(rows[:, None], -1)
    table, place = jax.lax.fori_loop(0, right.size, eliminate, start)
    # The compiler may divide by a pivot inexactly, so that the matrix is no exact permutation.
    return jnp.sum(jnp.where(place == rows[None], table[:, -1:], 0), axis=0)


def _collocated(
    motion: Motion, start: State, compressing: Flag, size: Number
) -> tuple[_ImplicitStep, Bool[Array, ""]]:
    """Return one step of Radau's method, and whether Newton's iteration converged."""
    dtype = start.w.dtype
    inverse, eye = jnp.asarray(_INVERSE, dtype), jnp.eye(2, dtype=dtype)
    scales = _scales(motion, start)

    def rate(motion: Motion, start: State, z: Array) -> State:
        state = start._replace(w=start.w + scales[0] * z[0], u=start.u + scales[1] * z[1])
        return motion.rate(state, compressing)

    def slopes(motion: Motion, start: State, z: Array) -> Array:
        change = rate(motion, start, z)
        return jnp.stack([change.w, change.u]) / scales

    def residual(motion: Motion, start: State, z: Array) -> Array:
        there = jax.vmap(lambda node: slopes(motion, start, node))(z)
        return small_product(inverse, z) - size * there

    frozen = jax.lax.stop_gradient((motion, start))

    def solved(z: Array, right: Array) -> Array:
        jacobian = jax.vmap(jax.jacfwd(lambda node: slopes(*frozen, node)))(z)
        # Broadcasting, since these products are no contractions.
        alone = jnp.eye(_STAGES, dtype=dtype)[:, None, :, None] * jacobian[:, :, None, :]
        blocks = inverse[:, None, :, None] * eye[None, :, None, :] - size * alone
        flat = blocks.reshape(2 * _STAGES, 2 * _STAGES)
        return _eliminated(flat, right.reshape(-1)).reshape(_STAGES, 2)

    close = 1e-9 if dtype == jnp.float64 else 1e-4

    def improve(carry: tuple[Array, Number, Int[Array, ""]]) -> tuple:
        z, _, count = carry
        change = solved(z, residual(*frozen, z))
        largest = jnp.maximum(1, jnp.max(jnp.abs(z), 0, keepdims=True))
        moved = jnp.max(jnp.abs(change) / largest)
        return z - change, moved, count + 1

    def unsolved(carry: tuple[Array, Number, Int[Array, ""]]) -> Bool[Array, ""]:
        _, moved, count = carry
        return (moved > close) & (count < _NEWTON)

    guess = (jnp.zeros((_STAGES, 2), dtype), jnp.full_like(size, jnp.inf), jnp.zeros((), int))
    z, moved, _ = jax.lax.while_loop(unsolved, improve, varying(start.w, guess))
    # One more Newton step changes only rounding, and carries the derivative.
    z = jax.lax.stop_gradient(z)
    z = z - solved(z, residual(motion, start, z))
    change = jax.vmap(lambda node: rate(motion, start, node))(z)
    matrix = size * jnp.asarray(_MATRIX, dtype)
    loss = None if change.loss is None else small_product(matrix, change.loss)
    increments = State(
        scales[0] * z[:, 0], scales[1] * z[:, 1], small_product(matrix, change.t), loss
    )
    good = (moved <= close) & jnp.all(jnp.isfinite(z))
    return _ImplicitStep(start, size, increments), good


def _error(motion: Motion, step: _ImplicitStep) -> Number:
    """Return the highest Legendre coefficient relative to the largest increment of the step."""

    def of(increments: Array, least: Number) -> Number:
        highest = small_product(jnp.asarray(_COEFFICIENTS[-1], increments.dtype), increments)
        return jnp.abs(highest) / jnp.maximum(jnp.max(jnp.abs(increments)), least)

    least = _scales(motion, step.start)
    return jnp.maximum(of(step.increments.w, least[0]), of(step.increments.u, least[1]))


def _closing(motion: Motion, step: _ImplicitStep, compressing: Flag) -> Bool[Array, "nodes gaps"]:
    """Return which gaps that are open at the start are closed at which node."""
    before = jnp.stack(gaps(motion, step.start, compressing))
    nodes = jax.tree.map(operator.add, step.start, step.increments)
    after = jnp.stack(jax.vmap(lambda s: gaps(motion, s, compressing))(nodes), 1)
    return (before > 0)[None, :] & ~(after > 0)


def _first_bracket(closing: Array, dtype: Any) -> tuple[Int[Array, ""], Number, Number]:
    """Return the first node at which a gap is closed, and the fractions of a step before and at it.
    If no gap closes, any bracket serves.
    """
    first = jnp.argmax(jnp.any(closing, 1))
    nodes = jnp.asarray(np.concatenate([[0.0], _NODES]), dtype)
    return first, nodes[first], nodes[first + 1]


def _node_beyond(motion: Motion, step: _ImplicitStep, compressing: Flag, closing: Array) -> Number:
    """Return a fraction of a step slightly beyond the first gap that closes, from its chord."""
    first, low, high = _first_bracket(closing, step.size.dtype)

    def nearest(fraction: Number) -> Number:
        left = jnp.stack(gaps(motion, _within(step, fraction), compressing))
        return jnp.min(jnp.where(closing[first], left, jnp.inf))

    before, after = nearest(low), nearest(high)
    share = jnp.where(before > 0, ratio(before, before - after), 1)
    between = low + (high - low) * jnp.clip(1.02 * share, 0, 1)
    return jax.lax.stop_gradient(jnp.where(jnp.any(closing), between, 1))


def _landing(
    motion: Motion, step: _ImplicitStep, compressing: Flag, met: Bool[Array, ""]
) -> Number:
    """Return the fraction of a step at which the first gap closes; 1 if none does."""
    closing = _closing(motion, step, compressing)
    first, low, high = _first_bracket(closing, step.size.dtype)
    which = closing[first] & met

    def gap(fraction: Number, *inputs: Any) -> Number:
        step, motion, compressing, which, low, high = inputs
        left = jnp.stack(gaps(motion, _within(step, fraction), compressing))
        nearest = jnp.min(jnp.where(which, left, jnp.inf))
        return jnp.where(jnp.any(which), nearest, (low + high) / 2 - fraction)

    def find(*inputs: Any) -> Number:
        *_, low, high = inputs

        def at(share: Number) -> Number:
            return gap(low + share * (high - low), *inputs)

        ends = jax.vmap(at)(jnp.arange(2, dtype=low.dtype))
        return low + (high - low) * bracketed_root(at, ends[0], ends[1], _ITERATIONS)

    root = with_implicit_derivative(find, gap)
    return jnp.where(met, root(step, motion, compressing, which, low, high), 1)
