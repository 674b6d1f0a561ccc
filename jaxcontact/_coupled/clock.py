"""The clock of a coupled solve: a variable in which motion is smooth near touch and opening.

A force δ^n has a branch point in time where a contact begins and where it ends. High-order
steps would have to shrink towards it. With dt = 2 w ds the powers of δ are smooth in s, for two
choices of w. After a touch w = s, so that t = s². Before an opening w = √(δ - δ_end) of the contact
that ends first, so that dw/ds = δ'. It ends at w = 0, which is a simple root. Far from both w = ½.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .modes import Flag, Flags, Modes, Number, PerContact
from .rows import rows_of

LONG_AGO = -1e30
"""The time of the last touch if there was none."""


class ContactClock(NamedTuple):
    """The choice of w: after the last touch if `touch`, or of the one contact that is `leaving`."""

    touch: Flag
    leaving: Flags

    def rate(self, closing: PerContact) -> Number:
        """Return dw/ds."""
        unit = jnp.ones((), closing.dtype)
        opens = jnp.sum(jnp.where(self.leaving, closing, 0))
        return jnp.where(self.touch, unit, opens)


def choose_clock(
    before: ContactClock,
    w: Number,
    modes: Modes,
    height: PerContact,
    closing: PerContact,
    age: Number,
) -> tuple[ContactClock, Number]:
    """Return the clock of the branch point nearest in time, with its w. `height` is that of the
    indentations above their ends. `age` is the time since the last touch, 0 at a touch.
    """
    unloads = modes.closed & (closing < 0) & (height > 0)
    high, pace = jax.lax.stop_gradient((height, closing))
    left = jnp.where(unloads, high / jnp.where(unloads, -pace, 1), jnp.inf)
    next_one = jnp.argmin(left)
    soonest, deep = rows_of((left, height), next_one)
    # Once all have opened, the motion is smooth in time.
    touch = jnp.any(modes.closed) & (age < 1e9) & (age < soonest)
    contacts = jnp.arange(height.shape[0])
    leaving = (contacts == next_one) & unloads & ~touch
    opens = jnp.any(leaving)
    root = jnp.sqrt(jnp.where(opens, deep, 1))
    root = jnp.where(jnp.any(leaving & before.leaving), w, root)
    old = touch & ~before.touch & (age > 0)
    since = jnp.where(age > 0, jnp.where(old, jnp.sqrt(jnp.where(old, age, 1)), w), 0)
    half = jnp.full_like(w, 0.5)
    return ContactClock(touch, leaving), jnp.where(touch, since, jnp.where(opens, root, half))
