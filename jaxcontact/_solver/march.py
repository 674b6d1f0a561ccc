"""The steps of a motion until one passes its end."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._functions import varying
from .field import Field, Flags, Number, Packed, Record, chosen, in_time

Seen = TypeVar("Seen")

# As in diffrax's step control, which is that of Hairer, Nørsett & Wanner (1993), section II.4.
_SAFETY, _SHRINKS, _GROWS = 0.9, 0.2, 10.0
_ORDER = 8
# The first step of a motion whose scales are one, in units of the eighth root of the tolerance.
_FIRST = 1.3


class Tolerance(NamedTuple):
    """The allowed error of a step, relative `rtol` and absolute `atol`, and the number of steps."""

    rtol: Number
    atol: Number | float
    max_steps: int


class Marched(NamedTuple):
    """The result of a march: the step that passed the end, `before` and `after`.

    `closed` marks the guards that closed in it, none if no step passed an end. `steps` is the
    number of accepted steps. `seen` is the watch's record of their starts. `path` holds all of
    their starts, None unless requested.
    """

    before: Record
    after: Record
    closed: Flags
    steps: Int[Array, ""]
    seen: Any
    path: Record | None = None


class _March(NamedTuple):
    now: Marched
    size: Number
    tries: Int[Array, ""]


def march(
    field: Field,
    packed: Packed,
    tolerance: Tolerance,
    begun: Seen,
    see: Callable[[Seen, Record, Record], Seen],
    keep: bool = False,
) -> Marched:
    """Take steps of order 8 from the start of a motion until a guard closes. `see(seen, before,
    now)` is called once for every accepted state, with the state before it. `keep`: whether all
    states are returned.
    """
    stop = jax.lax.stop_gradient
    step, start = packed.step(in_time), packed.start

    def guards(vector: Record) -> Array:
        return packed.guards(field, vector)

    def unfinished(way: _March) -> Bool[Array, ""]:
        return ~jnp.any(way.now.closed) & (way.tries < tolerance.max_steps)

    def advance(way: _March) -> _March:
        last = way.now
        here = last.after
        there, error = step(field, here, way.size)
        off = _norm(*stop((error, here, there)), tolerance)
        fine = off < 1
        opened, left = packed.each(guards, *stop((here, there)))
        passed = Marched(
            before=here,
            after=there,
            closed=(opened > 0) & (left <= 0),
            steps=last.steps + 1,
            seen=see(last.seen, last.before, here),
        )
        now = chosen(fine, passed, last._replace(path=None))
        if last.path is not None:

            def put(path: Array, leaf: Array) -> Array:
                return path.at[last.steps].set(leaf)

            # A rejected step stores the same state again.
            now = now._replace(path=jax.tree.map(put, last.path, here))
        off = jnp.where(jnp.isfinite(off), jnp.maximum(off, 1e-12), 1e12)
        least, most = jnp.where(fine, 1, _SHRINKS), jnp.where(fine, _GROWS, _SAFETY)
        # The eighth root by square roots takes a quarter of the time of a power.
        root = jnp.sqrt(jnp.sqrt(jnp.sqrt(off)))
        factor = jnp.clip(_SAFETY / root, least, most)
        return _March(now, way.size * factor, way.tries + 1)

    none = jnp.zeros((), int)
    closed = jnp.zeros(jax.eval_shape(guards, start).shape, bool)
    path = None
    if keep:
        slots = tolerance.max_steps + 1
        path = jax.tree.map(lambda leaf: jnp.zeros((slots, *leaf.shape), leaf.dtype), start)
    first = Marched(start, start, closed, none, begun, path)
    size = jnp.asarray(_FIRST, packed.tau(start).dtype) * stop(tolerance.rtol) ** (1 / _ORDER)
    begin = varying(packed.tau(start), _March(first, size, none))
    return jax.lax.while_loop(unfinished, advance, begin).now


def _norm(error: Record, before: Record, after: Record, tolerance: Tolerance) -> Number:
    """Return the root mean square of the errors in units of the allowed ones; time has none."""

    def squares(error: Array, before: Array, after: Array) -> Number:
        largest = jnp.maximum(jnp.abs(before), jnp.abs(after))
        return jnp.sum(jnp.square(error / (tolerance.atol + tolerance.rtol * largest)))

    total = jax.tree.reduce(operator.add, jax.tree.map(squares, error, before, after))
    return jnp.sqrt(total / (sum(leaf.size for leaf in jax.tree.leaves(error)) - 1))
