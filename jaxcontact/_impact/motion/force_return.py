"""The motion after a force without tension has vanished: to x = 0, or until the force returns."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._functions import bracketed_root, power
from .motion import Motion, Number, State

# The number of moments at which the force is sampled, the last but one at 1e-6 of the depth. A
# force present only between two of them, or returning later, is missed.
_SAMPLES = 32


class Onward(NamedTuple):
    """The motion without contact force: whether the force `returns`, and the state then. `reaches`:
    whether the motion would come to x = 0 without it.
    """

    returns: Bool[Array, ""]
    reaches: Bool[Array, ""]
    state: State


def onward(motion: Motion, end: State, max_indentation: Number) -> Onward:
    """Return the motion x'' = Γ from the state in which the force vanished. The moment of return is
    a constant to the derivative. At zero force the motions with and without it agree to first
    order.
    """
    k = motion.order
    depth, speed = jnp.maximum(end.w, 0) ** k, -motion.velocity(end)
    pull = jnp.zeros_like(depth) if motion.push is None else motion.push
    square = jnp.square(speed) - 2 * pull * depth
    reaches = square >= 0
    root = jnp.sqrt(jnp.where(reaches, square, 0))
    # To x = 0, or until the bodies are at rest.
    landing = 2 * depth / jnp.where(speed + root > 0, speed + root, 1)
    longest = jnp.where(reaches, landing, speed / jnp.where(pull > 0, pull, 1))

    def at(motion: Motion, end: State, time: Number) -> State:
        depth, pull = end.w**k, 0 if motion.push is None else motion.push
        x = depth + (motion.velocity(end) + time * pull / 2) * time
        w = power(jnp.maximum(x, 0), 1 / k)
        freed = end._replace(w=w, u=motion.velocity(end) + time * pull + motion.creep(w))
        # Damping absorbs the work that the elastic force would have done.
        kept = None if end.loss is None else end.loss + motion.stored(end) - motion.stored(freed)
        return freed._replace(t=end.t + time, loss=kept)

    frozen, still, longest, deepest = jax.lax.stop_gradient((motion, end, longest, max_indentation))

    def force(fraction: Number) -> Number:
        return frozen.pulling(at(frozen, still, fraction * longest), jnp.asarray(False))

    passed = jnp.arange(_SAMPLES + 1, dtype=depth.dtype) / _SAMPLES
    # Samples are denser near x = 0, where a spring may exceed damping that falls faster. At x = 0
    # both vanish.
    fractions = jnp.where(reaches, 1 - (1 - passed) ** 4, passed)
    forces = jax.vmap(force)(fractions[1:])
    present = (forces > 0) & ~(reaches & (passed[1:] == 1))
    first = jnp.argmax(present)
    # An elastic contact has only rounding left at x = 0.
    rounding = math.sqrt(jnp.finfo(depth.dtype).eps)
    deep = (end.w > 0) & (still.w**k > rounding * deepest) & (speed > 0)
    returns = deep & jnp.any(present)
    low, size, last = fractions[first], fractions[first + 1] - fractions[first], forces[first]

    floor = jnp.where(returns, last / 100, 0.5)

    def missing(part: Number) -> Number:
        # Divided by the time passed, since the force is also zero at the beginning. A law that
        # clamps its own force has no sign before the return.
        fraction = low + part * size
        lacking = -force(fraction) / jnp.where(fraction > 0, fraction, 1)
        lacking = jnp.where(lacking >= 0, jnp.maximum(lacking, floor), lacking)
        return jnp.where(returns, lacking, 0.5 - part)

    part = bracketed_root(missing, floor, jnp.where(returns, -last, -0.5), iterations=60)
    return Onward(returns, reaches, at(motion, end, (low + part * size) * longest))
