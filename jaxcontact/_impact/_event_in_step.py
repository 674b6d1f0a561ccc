"""The moment of an event inside of the step that passed it."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._forms import Flag
from .._implicit import bracketed_root, ratio, with_implicit_derivative
from .._varying import varying
from ._motion import Moment, Motion, Number, State

# Of the correction in the last step. Rounding is mostly reached after about ten, and later at a
# corner of the gap, where a contact ends at a creeping speed.
_ITERATIONS = 60
# Of a regula falsi for the guess, which is no better than its polynomial.
_GUESSES = 8
# What is left of a force, by its tangent, where it has vanished. A power p of the time to the end
# leaves 1-p of it.
_JUMP = 0.9


class _LastStep(NamedTuple):
    """The step in which an event lies; `moving`: the arrays of its solver."""

    before: Moment
    after: Moment
    motion: Motion
    compressing: Flag
    moving: Any


def event_in_step(
    term: diffrax.ODETerm,
    solver: Any,
    before: Moment,
    after: Moment,
    motion: Motion,
    compressing: Flag,
    arrived: Flag,
) -> tuple[Moment, Flag]:
    """The moment of the event in the last step, and its state; the end of the step without one.

    A polynomial through the ends of the step gives the first guess. It is corrected by steps of the
    same solver that end there. The flag says whether the event has a derivative.
    """
    moving, still = eqx.partition(solver, eqx.is_array)

    def stepped(fraction: Number, inputs: _LastStep) -> Moment:
        (t, state), after, motion, compressing, moving = inputs
        solver, end = eqx.combine(moving, still), t + fraction * (after.tau - t)
        args = (motion, compressing)
        memory = solver.init(term, t, end, state, args)
        found, *_ = solver.step(term, t, end, state, args, memory, made_jump=False)
        return Moment(end, found)

    def gap(fraction: Number, inputs: _LastStep, closing: tuple, *rest: Any) -> Number:
        found = stepped(fraction, inputs).state
        gaps = inputs.motion.gaps(found, inputs.compressing)
        return jnp.where(rest[0], _nearest(closing, gaps), 1 - fraction)

    def find(inputs: _LastStep, closing: tuple, arrived: Flag, until: Number) -> Number:
        before, after, motion, compressing, _ = inputs
        size = after.tau - before.tau

        def nearest(state: State) -> Number:
            return _nearest(closing, motion.gaps(state, compressing))

        def rate(state: State) -> State:
            return motion.rate(state, compressing)

        between = _through(rate, before.state, after.state, size)

        def guess(part: Number) -> Number:
            return jnp.where(arrived, nearest(between(part * until)), 1 - part)

        def corrected(carry: tuple[Number, ...]) -> tuple[Number, ...]:
            count, _, fraction, low, high = carry
            found = stepped(fraction, inputs).state
            value, slope = jax.jvp(nearest, (found,), (rate(found),))
            low, high = jnp.where(value > 0, fraction, low), jnp.where(value > 0, high, fraction)
            newton = fraction - ratio(value, slope * size)
            # One that moves nothing stands on an end of its own bracket, and has arrived.
            inside = (newton >= low) & (newton <= high) & (slope != 0)
            better = jnp.where(inside, newton, (low + high) / 2)
            # A step of Newton's squares its error; one to the middle is as wrong as it is long.
            moved = jnp.where(inside, jnp.abs(newton - fraction), (high - low) / close)
            done = ~arrived | (value == 0)
            return (
                count + 1,
                jnp.where(done, 0, moved),
                jnp.where(done, fraction, better),
                low,
                high,
            )

        def unsettled(carry: tuple[Number, ...]) -> Flag:
            count, moved, fraction, *_ = carry
            return (count < _ITERATIONS) & (moved > close * fraction)

        # The step of Newton's after this one would move only rounding.
        close = jnp.sqrt(jnp.finfo(size.dtype).eps)
        zero = jnp.zeros_like(size)
        first = jnp.where(arrived, nearest(before.state), 1)
        last = jnp.where(until < 1, nearest(between(until)), nearest(after.state))
        root = until * bracketed_root(guess, first, jnp.where(arrived, last, 0), _GUESSES)
        root = jnp.where((root > 0) & (root <= 1), root, until / 2)
        start = varying(root, (zero, zero + 1, root, zero, until))
        return jax.lax.while_loop(unsettled, corrected, start)[2]

    inputs = _LastStep(before, after, motion, compressing, moving)
    closing, until = _closing(*jax.lax.stop_gradient((motion, before, after, compressing)))
    found = with_implicit_derivative(find, gap)
    if not motion.may_clamp:
        return stepped(found(inputs, closing, arrived, until), inputs), jnp.asarray(True)
    # Where the law clamps its force, the end is found by the sign of the force, and its derivative
    # by the force that goes on along its tangent shortly before.
    frozen = jax.lax.stop_gradient(inputs)
    end = find(frozen, closing, arrived, until)
    size = jnp.abs(frozen.after.tau - frozen.before.tau)
    short = jnp.minimum(end / 2, jnp.sqrt(jnp.finfo(end.dtype).eps) / jnp.where(size > 0, size, 1))
    inside = stepped(end - short, frozen).state
    inputs = inputs._replace(motion=motion.continued(inside))
    found = with_implicit_derivative(
        lambda end, *rest: end, lambda x, end, short, *rest: gap(x - short, *rest)
    )
    place = found(end, short, inputs, closing, arrived)
    at_end = stepped(place, inputs)
    jumps = ~closing[0] & closing[-1] & _jumps(inputs.motion, inside, at_end.state)
    return at_end, compressing | ~jumps


def _jumps(motion: Motion, inside: State, end: State) -> Flag:
    """Whether the force of a way out jumps to zero, inside of x = 0, instead of going there.

    The tangent at the state `inside` then says nothing of the `end`, shortly afterwards.
    """
    forces = [motion.gap_of_force(state) for state in (inside, end)]
    return (forces[1] >= _JUMP * forces[0]) & (2 * end.w > inside.w)


def _closing(
    motion: Motion, before: Moment, after: Moment, compressing: Flag
) -> tuple[tuple[Flag, ...], Number]:
    """Which gaps close in a step, and a fraction of it at which the first one has closed.

    Those that change sign: a way out starts at a turn, which is not the next one, and the corner
    between two gaps would slow the search for the one that closes. Under a push the bodies may part
    and come back within the step, which their turn shows.
    """
    first, last = (motion.gaps(at.state, compressing) for at in (before, after))
    closing = [(opened > 0) & (closed <= 0) for opened, closed in zip(first, last, strict=True)]
    until = jnp.ones_like(after.tau)
    if motion.push is None:
        return tuple(closing), until
    size = after.tau - before.tau
    between = _through(
        lambda state: motion.rate(state, compressing), before.state, after.state, size
    )

    def turning(fraction: Number) -> Number:
        speed = motion.gaps(between(fraction), compressing)[0]
        return jnp.where(closing[0], speed, 1 - fraction)

    ends = jnp.where(closing[0], first[0], 1), jnp.where(closing[0], last[0], 0)
    turn = bracketed_root(turning, *ends, _GUESSES)
    there = motion.gaps(between(turn), compressing)
    apart = [(gap > 0) & (parted <= 0) for gap, parted in zip(first[1:], there[1:], strict=True)]
    until = jnp.where(closing[0] & functools.reduce(operator.or_, apart), turn, until)
    apart = [old | new for old, new in zip(closing[1:], apart, strict=True)]
    return (closing[0], *apart), until


def _through(
    rate: Callable[[State], State], start: State, end: State, size: Number
) -> Callable[[Number], State]:
    """The motion of a step as a function of the fraction of it that has passed.

    The polynomial of degree 5 with its first and second derivatives at both ends.
    """

    def derivatives(state: State) -> tuple[State, State]:
        return jax.jvp(rate, (state,), (rate(state),))

    (first, first_bend), (last, last_bend) = map(derivatives, (start, end))

    def polynomial(*at: Array) -> Array:
        x0, x1, v0, v1, a0, a1 = at
        v0, v1, a0, a1 = size * v0, size * v1, jnp.square(size) * a0 / 2, jnp.square(size) * a1 / 2
        moved, turned, bent = x1 - x0 - v0 - a0, v1 - v0 - 2 * a0, a1 - a0
        return jnp.stack(
            [
                x0,
                v0,
                a0,
                10 * moved - 4 * turned + bent,
                7 * turned - 15 * moved - 2 * bent,
                6 * moved - 3 * turned + bent,
            ]
        )

    coefficients = jax.tree.map(polynomial, start, end, first, last, first_bend, last_bend)
    return lambda fraction: jax.tree.map(lambda c: jnp.polyval(c[::-1], fraction), coefficients)


def _nearest(closing: tuple[Flag, ...], gaps: tuple[Number, ...]) -> Number:
    """The smallest gap of those that close."""
    chosen = (jnp.where(closes, gap, 1) for closes, gap in zip(closing, gaps, strict=True))
    return functools.reduce(jnp.minimum, chosen)
