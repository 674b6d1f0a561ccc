"""The end of a motion, within the step that passed it."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._implicit import ratio
from .._varying import varying
from .field import Field, Flags, Moment, Number, Packed, Record, chosen, in_time
from .march import Marched

# Mostly five; more at a corner between two guards.
_ITERATIONS = 60
# Of the time that is left: guards that close within so much of it close together.
_TOGETHER = 1e-4


class _Falling(eqx.Module):
    """A motion with what falls to zero at its end in place of time.

    Source: Hénon (1982), doi 10.1016/0167-2789(82)90034-3.
    """

    field: Any
    closed: Flags

    def nearest(self, state: Any) -> Number:
        """The smallest guard of those that close."""
        guards = self.field.guards(state)
        chosen = (jnp.where(c, guard, 1) for c, guard in zip(self.closed, guards, strict=True))
        return functools.reduce(jnp.minimum, chosen)

    def slopes(self, moment: Moment) -> Moment:
        """Of the moment by what falls."""
        rate = self.field.rate(moment.state)
        _, fall = jax.jvp(self.nearest, (moment.state,), (rate,))
        pace = 1 / jnp.where(fall != 0, fall, 1)
        return Moment(pace, jax.tree.map(lambda change: change * pace, rate))


def land(field: Field, packed: Packed, last: Marched) -> tuple[Record, Bool[Array, ""]]:
    """The moment in which the first guard closes, and its state; without one the end of the step.

    The last step has the guard as its variable, and ends at its zero: with all of its derivatives.
    The flag says whether there are any.
    """
    before, closed, smooth = last.before, last.closed, jnp.asarray(True)
    if not field.one_way:
        found = _searched(field, packed, last)
        field, before, closed, smooth = found
    arrived = jnp.any(closed)
    fall = _Falling(field, closed)
    lacking = jnp.where(arrived, fall.nearest(packed.state(before)), 0)
    end, _ = packed.step(_Falling.slopes)(fall, before, -lacking)
    return chosen(arrived, end, last.after), smooth


class _Search(NamedTuple):
    count: Number
    moved: Number
    fraction: Number
    low: Number
    high: Number
    closed: Flags


def _searched(
    field: Field, packed: Packed, last: Marched
) -> tuple[Field, Record, Flags, Bool[Array, ""]]:
    """A moment of the last step within rounding of the end, and which guards close there.

    Newton's method by steps from the start of the last one, within a bracket. And the motion that
    goes on smoothly there, if any.
    """
    step, size = packed.step(in_time), packed.tau(last.after) - packed.tau(last.before)
    frozen, start, ends = jax.lax.stop_gradient((field, last.before, last.closed))
    length = jax.lax.stop_gradient(size)
    # The step of Newton's after this one would move only rounding.
    close = jnp.sqrt(jnp.finfo(length.dtype).eps)

    def guards(state: Any) -> Array:
        return jnp.stack(frozen.guards(state))

    opened = packed.guards(frozen, start) > 0

    def narrow(at: _Search) -> _Search:
        there, _ = step(frozen, start, at.fraction * length)
        state = packed.state(there)
        values, slopes = jax.jvp(guards, (state,), (frozen.rate(state),))
        # Bodies may part and come back within the step: that shows in between alone.
        closed = at.closed | (opened & (values <= 0))
        first = jnp.argmin(jnp.where(closed, values, jnp.inf))
        value, slope = values[first], slopes[first]
        low = jnp.where(value > 0, at.fraction, at.low)
        high = jnp.where(value > 0, at.high, at.fraction)
        newton = at.fraction - ratio(value, slope * length)
        # One that moves nothing stands on an end of its own bracket, and has arrived.
        inside = (newton >= low) & (newton <= high) & (slope != 0)
        # A step of Newton's squares its error; one to the middle is as wrong as it is long.
        moved = jnp.where(inside, jnp.abs(newton - at.fraction), (high - low) / close)
        better = jnp.where(inside, newton, (low + high) / 2)
        done = value == 0
        return _Search(
            at.count + 1,
            jnp.where(done, 0, moved),
            jnp.where(done, at.fraction, better),
            low,
            high,
            closed,
        )

    def unsettled(at: _Search) -> Bool[Array, ""]:
        return jnp.any(ends) & (at.count < _ITERATIONS) & (at.moved > close * at.fraction)

    zero = jnp.zeros_like(length)
    begin = varying(length, _Search(zero, zero + 1, zero + 1, zero, zero + 1, ends))
    at = jax.lax.while_loop(unsettled, narrow, begin)
    if not field.clamped:
        after, _ = step(field, last.before, at.fraction * length)
        return field, after, at.closed, jnp.asarray(True)
    short = jnp.minimum(at.fraction / 2, close / jnp.where(length > 0, length, 1))
    inside, _ = step(field, last.before, (at.fraction - short) * length)
    end, _ = step(frozen, start, at.fraction * length)
    state = packed.state(jax.lax.stop_gradient(inside))
    field = field.continued(state)
    smooth = ~field.jumps(state, packed.state(end), at.closed)
    return field, inside, _first(field, state, at.closed), smooth


def _first(field: Field, state: Any, closed: Flags) -> Flags:
    """Which guard closes first from a state on; the foremost of those that close together.

    Beyond a corner another guard may have no slope.
    """
    frozen = jax.lax.stop_gradient(field)
    values, slopes = jax.jvp(
        lambda state: jnp.stack(frozen.guards(state)), (state,), (frozen.rate(state),)
    )
    falls = closed & (slopes < 0)
    left = jnp.where(falls, values / jnp.where(falls, -slopes, 1), jnp.inf)
    first = jnp.argmax(closed & (left <= (1 + _TOGETHER) * jnp.min(left)))
    return closed & (jnp.arange(closed.size) == first)
