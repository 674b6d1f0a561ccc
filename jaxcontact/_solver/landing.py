"""The end of a motion, within the step that passed it."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._functions import ratio, varying
from .field import Field, Flags, Moment, Number, Packed, Record, chosen, in_time
from .march import Marched

# Usually one suffices; more at a corner between two guards.
_ITERATIONS = 60
# The share of a step: this close to the end, the last step of order 8 is exact.
_NEAR = 1e-2
# The share of the remaining time: guards that close within it close together.
_TOGETHER = 1e-4


class _Falling(eqx.Module):
    """A motion with a falling guard as the independent variable in place of time. Source: Hénon
    (1982), doi 10.1016/0167-2789(82)90034-3.
    """

    field: Any
    closed: Flags

    def nearest(self, state: Any) -> Number:
        """Return the smallest of the closing guards."""
        guards = self.field.guards(state)
        pairs = zip(self.closed, guards, strict=True)
        closing = (jnp.where(closes, guard, jnp.inf) for closes, guard in pairs)
        return functools.reduce(jnp.minimum, closing)

    def slopes(self, moment: Moment) -> Moment:
        """Return the slopes of the moment with respect to the guard."""
        rate = self.field.rate(moment.state)
        _, fall = jax.jvp(self.nearest, (moment.state,), (rate,))
        pace = 1 / jnp.where(fall != 0, fall, 1)
        return Moment(pace, jax.tree.map(lambda change: change * pace, rate))


def land(field: Field, packed: Packed, last: Marched) -> tuple[Record, Bool[Array, ""]]:
    """Return the moment in which the first guard closes; without one, the end of the step. The last
    step has the guard as its variable and ends at its zero, with all of its derivatives. The flag
    is True if there are derivatives.
    """
    field, before, closed, smooth = _searched(field, packed, last)
    arrived = jnp.any(closed)
    fall = _Falling(field, closed)
    lacking = jnp.where(arrived, fall.nearest(packed.state(before)), 0)
    end, _ = packed.step(_Falling.slopes)(fall, before, -lacking)
    return chosen(arrived, end, last.after), smooth


class _EndSearch(NamedTuple):
    """A moment of the step, its distance from the end, and a bracket of the end. `low` and `high`
    hold values and slopes of the guards at the bracket, by the fraction of the step.
    """

    count: Number
    there: Record
    off: Number
    fraction: Number
    begin: Number
    end: Number
    low: Array
    high: Array
    closed: Flags


def _searched(
    field: Field, packed: Packed, last: Marched
) -> tuple[Field, Record, Flags, Bool[Array, ""]]:
    """Return a moment of the last step close to the end, and the guards that close there. Cubic
    interpolation within a bracket, with values and slopes at both ends, usually needs one step. The
    result includes the motion that continues smoothly there, and whether it is smooth and found.
    """
    stop = jax.lax.stop_gradient
    frozen, ends = stop((field, last.closed))
    length = stop(packed.tau(last.after) - packed.tau(last.before))
    # Derivatives may not go back through a loop.
    searched = (frozen, stop(last.before)) if packed.backwards else (field, last.before)
    step, close = packed.step(in_time), math.sqrt(jnp.finfo(length.dtype).eps)

    def look(record: Record) -> Array:
        state = packed.state(record)
        rate = jax.tree.map(lambda change: change * length, frozen.rate(state))
        return jnp.stack(jax.jvp(lambda s: jnp.stack(frozen.guards(s)), (state,), (rate,)))

    def narrow(at: _EndSearch) -> _EndSearch:
        fraction = _crossing(at)
        there, _ = step(*searched, fraction * length)
        now = look(stop(there))
        # A guard may close and open again within the step, which only a moment in between shows.
        closed = at.closed | ((at.low[0] > 0) & (now[0] <= 0))
        value, slope = now[:, _foremost(now[0], closed)]
        open_ = value > 0
        begin, end = jnp.where(open_, fraction, at.begin), jnp.where(open_, at.end, fraction)
        # The distance is bounded by the length of the bracket, which counts if the slope is zero.
        off = jnp.where(slope == 0, jnp.inf, jnp.abs(ratio(value, slope)))
        return _EndSearch(
            at.count + 1,
            there,
            jnp.minimum(off, (end - begin) / close),
            fraction,
            begin,
            end,
            jnp.where(open_, now, at.low),
            jnp.where(open_, at.high, now),
            closed,
        )

    def unsettled(at: _EndSearch) -> Bool[Array, ""]:
        # The last step from here is exact, except across a corner or a clamp.
        near = close
        if field.smooth:
            near = jnp.where(jnp.sum(at.closed) == 1, _NEAR, close)
        return jnp.any(ends) & (at.count < _ITERATIONS) & (at.off > near * at.fraction)

    zero = jnp.zeros_like(length)
    low, high = packed.each(look, *stop((last.before, last.after)))
    begin = _EndSearch(zero, last.after, zero + 1, zero + 1, zero, zero + 1, low, high, ends)
    at = jax.lax.while_loop(unsettled, narrow, varying(length, begin))
    there, found = at.there, at.count < _ITERATIONS
    if packed.backwards:
        there, _ = step(field, last.before, at.fraction * length)
    if not field.clamped:
        closed = at.closed
        if not field.smooth:
            # Only the guard that was searched for is certain to have a slope at its zero.
            closed &= jnp.arange(ends.size) == _foremost(at.high[0], closed)
        return field, there, closed, found
    short = jnp.minimum(at.fraction / 2, close / jnp.where(length > 0, length, 1))
    inside, _ = step(field, last.before, (at.fraction - short) * length)
    state = packed.state(stop(inside))
    field = field.continued(state)
    smooth = ~field.jumps(state, packed.state(stop(there)), at.closed)
    return field, inside, _first(field, state, at.closed), smooth & found


def _foremost(values: Array, closed: Flags) -> Array:
    return jnp.argmin(jnp.where(closed, values, jnp.inf))


def _crossing(at: _EndSearch) -> Number:
    """Return the root of the most negative guard, by a cubic of the moment in its value. It is the
    middle of the bracket if that root lies outside.
    """
    first = _foremost(at.high[0], at.closed)
    (value, early), (beyond, late) = at.low[:, first], at.high[:, first]
    fall, size = beyond - value, at.end - at.begin
    part = -ratio(value, fall)
    left, flat = 1 - part, (early == 0) | (late == 0)
    early, late = (jnp.where(flat, 1, slope) for slope in (early, late))
    way = part * (3 - 2 * part) * size + left * fall * (left / early - part / late)
    guess = at.begin + part * way
    # Where the slope changes much, the cubic may approach a wrong moment from one side.
    inside = (
        (guess > at.begin)
        & (guess < at.end)
        & ~flat
        & (jax.lax.rem(at.count, jnp.full_like(at.count, 3)) < 2)
    )
    return jnp.where(inside, guess, at.begin + size / 2)


def _first(field: Field, state: Any, closed: Flags) -> Flags:
    """Return the guard that closes first from a state on; the first in order of those together.
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
