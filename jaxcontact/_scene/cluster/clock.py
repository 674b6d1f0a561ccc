"""The clock of a coupled solve: in which variable the motion is smooth where a contact begins and
where one ends.

A force δ^n has a branch point in time where a pair touches and where it opens; steps of high order
would have to shrink towards it. With dt = 2 w ds the powers of δ are smooth in s, where w = s at a
touch, so that t = s², and w = √δ of the pair that opens first, so that dw/ds = δ': the pair is open
at w = 0, which is a plain root. Far from both w = ½.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .equations import Modes, PerPair

LONG_AGO = -1e30
"""The time of a touch that is none."""


class Clock(NamedTuple):
    """Whether w is that of the last touch, or of the one pair that is `leaving`."""

    touch: Bool[Array, ""]
    leaving: Bool[Array, " pairs"]

    def rate(self, closing: PerPair) -> Float[Array, ""]:
        """dw/ds."""
        one = jnp.ones((), closing.dtype)
        opens = jnp.sum(jnp.where(self.leaving, closing, 0))
        return jnp.where(self.touch, one, opens)


def chosen(
    before: Clock,
    w: Float[Array, ""],
    modes: Modes,
    depth: PerPair,
    closing: PerPair,
    age: Float[Array, ""],
) -> tuple[Clock, Float[Array, ""]]:
    """The clock of the branch point that is nearest in time, with its w.

    `age`: the time since the last touch, 0 at one.
    """
    unloads = modes.closed & (closing < 0) & (depth > 0)
    left = jnp.where(unloads, depth / jnp.where(unloads, -closing, 1), jnp.inf)
    next_one = jnp.argmin(left)
    touch = (age < 1e9) & (age < left[next_one])
    pairs = jnp.arange(depth.shape[0])
    leaving = (pairs == next_one) & unloads & ~touch
    opens = jnp.any(leaving)
    root = jnp.sqrt(jnp.where(opens, depth[next_one], 1))
    root = jnp.where(jnp.any(leaving & before.leaving), w, root)
    old = touch & ~before.touch & (age > 0)
    since = jnp.where(age > 0, jnp.where(old, jnp.sqrt(jnp.where(old, age, 1)), w), 0)
    half = jnp.full_like(w, 0.5)
    return Clock(touch, leaving), jnp.where(touch, since, jnp.where(opens, root, half))
