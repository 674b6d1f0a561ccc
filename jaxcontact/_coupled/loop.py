"""The coupled solve of contacts that last together, from event to event.

Between two events the motion is smooth except for powers of δ at touch and opening. The variable of
`clock` makes them smooth, and steps of order 8 are taken in it. A step that passes an event is
repeated up to the root of the cubic through its ends, until it ends there.

Events are a touch or an opening, and the end of the time. They also include the closing speed of a
contact: if it stops rising, v0 is latched; if it exceeds the latched v0, v0 rises again.

The stages and the step control are those of `_solver`. docs/rooms.md says why the loop is not.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .carry import Carry, CoupledSolve
from .clock import LONG_AGO, ContactClock, choose_clock
from .field import TIME, Grip, Look
from .modes import APART, NOT_CONVERGED, PAUSED, TIME_IS_UP, Flag, Index, Modes, Number, PerContact
from .step import advance, with_w

_stop = jax.lax.stop_gradient


class CoupledStart(NamedTuple):
    """The start of a solve: its vector, whose last three numbers are zero, and the modes, both in
    its units; then the last touch and the last time with a force in s, and the largest force since
    that touch. `parting` belongs to that last time, see `Carry`. `step`: the first step in units of
    time, if no contact begins just now.
    """

    y: Array
    modes: Modes
    since: PerContact
    force_until: PerContact
    parting: PerContact
    max_force: PerContact
    step: Number | None = None


def first_carry(solve: CoupledSolve, start: CoupledStart) -> Carry:
    """Return the initial state of the loop."""
    field, modes, finest, begin = solve.field, start.modes, solve.finest, solve.begin
    zero = jnp.zeros((), start.y.dtype)
    nobody, none = jnp.zeros_like(modes.closed), jnp.zeros_like(modes.latched)
    touching, renew = ContactClock(jnp.asarray(True), nobody), None
    if field.rules.jumps or field.rules.sticks:
        renew = jnp.asarray(field.rules.sticks)
    press = none if field.rules.fades else None
    if field.rules.sticks:
        # The first step, of no length, finds the rest.
        at, grip = field.approach(start.y, touching), Grip(none, none, none)
        here, slope = Look(*at, none, none, grip, press), Look(None, None, none, none, grip, press)
    else:
        here = field.look(start.y, modes, touching)
        force = field.force_slope(modes, (here.depth, here.rate), (here.rate, here.second))
        slope = Look(None, None, none, force, press=press)
        if field.rules.peak:
            # v0 follows a closing speed that is the largest so far and increases.
            largest = modes.closed & (here.rate >= modes.latched - 16 * finest)
            rising = modes.rising | (largest & (here.second > 0))
            modes = modes._replace(rising=field.refers_to_peak(rising))
    if field.rules.forgets and modes.deepest is not None:
        pulls = ~modes.loads & (here.depth < field.least(modes.deepest))
        modes = modes._replace(adheres=modes.closed & pulls)
    # True if a contact begins just now, up to rounding.
    just = jnp.abs(start.since - solve.start) <= 8 * finest * jnp.abs(solve.start)
    just = jnp.any(modes.closed & just)
    touched = jnp.where(just, zero, jnp.asarray(LONG_AGO, zero.dtype))
    clock, w = choose_clock(
        ContactClock(just, nobody), zero, modes, field.height(here.depth), here.rate, zero - touched
    )
    first = begin if start.step is None else start.step
    size = _stop(jnp.where(just, begin, first / jnp.where(just, 1, 2 * w)))
    over = jnp.where(field.until <= 0, TIME_IS_UP, -1)
    if not field.rules.flies:
        over = jnp.where(jnp.any(modes.closed), over, APART)
    return Carry(
        y=with_w(start.y, w),
        modes=modes,
        clock=clock,
        touched=touched,
        size=size,
        free=size,
        last_size=size,
        last_error=zero + 1,
        whole=zero,
        cruise=begin,
        sought=jnp.zeros(len(field.rules.events) * none.shape[0] + 1, bool),
        look=here,
        slope=slope,
        since=start.since,
        force_until=start.force_until,
        parting=start.parting,
        max_force=start.max_force,
        dropped=zero,
        error=zero,
        steps=jnp.zeros((), jnp.int32),
        status=over.astype(jnp.int32),
        renew=renew,
    )


def run_to_end(solve: CoupledSolve, first: Carry) -> Carry:
    """Return the last state of the loop."""

    def unfinished(c: Carry) -> Flag:
        return (c.status < 0) & (c.steps < solve.field.rules.max_steps)

    return jax.lax.while_loop(unfinished, lambda c: advance(solve, c)[0], first)


def status_of(end: Carry) -> Index:
    """Return how the loop ended."""
    # A solve that got farther than a contact's own time made progress.
    unfinished = jnp.where(end.y[TIME] > 1, PAUSED, NOT_CONVERGED)
    return jnp.where(end.status < 0, unfinished, end.status)
