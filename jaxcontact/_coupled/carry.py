"""What a coupled solve keeps from step to step, and the control of its steps."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._solver.march import _SAFETY, _SHRINKS
from .clock import ContactClock
from .field import AbstractCoupledField, Look
from .modes import Flag, Flags, Index, Modes, Number, PerContact, Units

_BEGIN = 0.35
_BEGIN_FOR = 1e-8
"""The first step, in units of about the contact's duration, and the tolerance that it is for."""


@dataclasses.dataclass(frozen=True)
class CoupledSolve:
    """The constants of a solve: its `field`, the tolerance of a step, the least v0 at
    touch in m/s (`floor`), and the time in s at which it starts. `to_the_end`: whether it continues
    at rest.
    """

    field: AbstractCoupledField
    tolerance: Number
    floor: Number
    start: Number
    to_the_end: Flag

    @property
    def units(self) -> Units:
        return self.field.units

    @property
    def finest(self) -> float:
        """The rounding error of 1."""
        return float(jnp.finfo(self.start.dtype).eps)

    @property
    def begin(self) -> Number:
        """The first step after a touch."""
        return _BEGIN * jnp.minimum((self.tolerance / _BEGIN_FOR) ** (1 / 8), 1.5)


class Carry(NamedTuple):
    """The state of the loop. `y` is the state vector, and `size` the next step. `free` is the size
    that the error alone allows. `whole` is the step in which an event was first seen, 0 if none is
    being sought. `cruise` is the last step without contacts in units of time. `parting` is the
    opening speed in m/s at the end of a force. That is at `force_until` in s, or `since` while it
    acts. Where forces may jump, `renew` is True after a jump: then `look` and `slope` are out of
    date.
    """

    y: Float[Array, " numbers"]
    modes: Modes
    clock: ContactClock
    touched: Number
    size: Number
    free: Number
    last_size: Number
    last_error: Number
    whole: Number
    cruise: Number
    sought: Bool[Array, " events"]
    look: Look
    slope: Look
    since: PerContact
    force_until: PerContact
    parting: PerContact
    max_force: PerContact
    dropped: Number
    error: Number
    steps: Index
    status: Index
    renew: Flag | None = None


class Changed(NamedTuple):
    """The state and the modes after the events of a step, and which contacts begin and end. `ends`
    marks those whose force ends, `slides` those that begin to stick or to slip. `lag` is 0 with the
    derivative of the time from the event to that of each. `jumps` is None if no force can jump.
    """

    y: Array
    modes: Modes
    touches: Flags
    opens: Flags
    ends: Flags
    now: Look
    touched: Array
    dropped: Array
    lag: PerContact
    slides: Flags | None = None
    jumps: Flag | None = None
    redundant: Flag | None = None


SIZES = "size", "free", "last_size", "last_error", "whole", "cruise", "error"
"""The numbers of a `Carry` that choose steps, which have no slopes."""

State = Float[Array, " numbers"]


def factor(error: Number) -> Number:
    """Return the factor for the next step size; `error` is in units of the allowed error."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(_SAFETY / jnp.sqrt(jnp.sqrt(jnp.sqrt(safe))), _SHRINKS, 5.0)


def onward(
    size: Number, free: Number, grown: Number, left: Number, fine: Flag, passed: Flag, sought: Flag
) -> tuple[Number, Number]:
    """Return the next step, and the size that the error alone allows, `free` and `grown` before and
    after this step. A step that `passed` an event is repeated up to it, which is `left` from its
    end, or halved. The step after it ends on the event that is still `sought`.
    """
    target = size + left
    back = jnp.where((target > 0.01 * size) & (target < size), target, size / 2)
    # The error of a step that was cut short says nothing about the next one, unless that may grow.
    free = jnp.where(fine & passed, free, jnp.where(fine & sought, jnp.maximum(free, grown), grown))
    ahead = jnp.where(sought & (left > 0), jnp.minimum(left, free), free)
    return jnp.where(fine, jnp.where(passed, back, ahead), free), free
