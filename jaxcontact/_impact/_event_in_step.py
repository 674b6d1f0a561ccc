"""The moment of an event inside of the step that passed it."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from .._forms import Flag
from .._implicit import bracketed_root, ratio, with_implicit_derivative
from .._varying import varying
from ._motion import Motion, Number, State

# Of a regula falsi over the last step. Rounding is mostly reached after about ten, and later at a
# corner of the gap, where a contact ends at a creeping speed.
_ITERATIONS = 60


class _LastStep(NamedTuple):
    """The step in which an event lies; `moving`: the arrays of its solver."""

    t: Number
    state: State
    after: Number
    motion: Motion
    compressing: Flag
    moving: Any


def event_in_step(
    term: diffrax.ODETerm,
    solver: Any,
    before: tuple[Number, State],
    after: Number,
    motion: Motion,
    compressing: Flag,
    arrived: Flag,
) -> tuple[Number, State]:
    """The moment of the event in the last step, and its state; the end of the step without one.

    The step is taken again for its interpolant, by the same solver. Between the ends of a long step
    the interpolant is the poorer method: its root is corrected by steps that end there.
    """
    moving, still = eqx.partition(solver, eqx.is_array)

    def stepped(fraction: Number, inputs: _LastStep) -> tuple[State, Any]:
        t, state, after, motion, compressing, moving = inputs
        solver, end = eqx.combine(moving, still), t + fraction * (after - t)
        args = (motion, compressing)
        memory = solver.init(term, t, end, state, args)
        found, _, dense, _, _ = solver.step(term, t, end, state, args, memory, made_jump=False)
        return found, solver.interpolation_cls(t0=t, t1=end, **dense)

    def gap(fraction: Number, inputs: _LastStep, closing: tuple, arrived: Flag) -> Number:
        found, _ = stepped(fraction, inputs)
        gaps = inputs.motion.gaps(found, inputs.compressing)
        return jnp.where(arrived, _nearest(closing, gaps), 1 - fraction)

    def find(inputs: _LastStep, closing: tuple, arrived: Flag) -> Number:
        t, _, after, motion, compressing, _ = inputs
        _, interpolant = stepped(jnp.ones_like(inputs.t), inputs)

        def between(fraction: Number) -> Number:
            gaps = motion.gaps(interpolant.evaluate(t + fraction * (after - t)), compressing)
            return jnp.where(arrived, _nearest(closing, gaps), 1 - fraction)

        first, last = jax.vmap(between)(jnp.arange(2, dtype=t.dtype))

        def corrected(carry: tuple[Number, ...]) -> tuple[Number, ...]:
            count, _, fraction, low, high = carry
            found, _ = stepped(fraction, inputs)
            rate = motion.rate(found, compressing)
            value, slope = jax.jvp(
                lambda state: _nearest(closing, motion.gaps(state, compressing)), (found,), (rate,)
            )
            low, high = jnp.where(value > 0, fraction, low), jnp.where(value > 0, high, fraction)
            newton = fraction - ratio(value, slope * (after - t))
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
        close = jnp.sqrt(jnp.finfo(t.dtype).eps)
        root = bracketed_root(between, first, last, _ITERATIONS)
        low, high = jnp.zeros_like(root), jnp.ones_like(root)
        start = varying(root, (low, high, root, low, high))
        return jax.lax.while_loop(unsettled, corrected, start)[2]

    t, state = before
    inputs = _LastStep(t, state, after, motion, compressing, moving)
    end, _ = stepped(jnp.ones_like(t), inputs)
    # Those that change sign in the step: a way out starts at a turn, which is not the next one, and
    # the corner between two gaps would slow the search for the one that closes.
    gaps = zip(motion.gaps(state, compressing), motion.gaps(end, compressing), strict=True)
    closing = tuple((opened > 0) & (closed <= 0) for opened, closed in gaps)
    fraction = with_implicit_derivative(find, gap)(inputs, closing, arrived)
    return t + fraction * (after - t), stepped(fraction, inputs)[0]


def _nearest(closing: tuple[Flag, ...], gaps: tuple[Number, ...]) -> Number:
    """The smallest gap of those that close."""
    chosen = (jnp.where(closes, gap, 1) for closes, gap in zip(closing, gaps, strict=True))
    return functools.reduce(jnp.minimum, chosen)
