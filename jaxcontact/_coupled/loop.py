"""The coupled solve of contacts that last together, from event to event.

Between two events the motion is smooth except for powers of δ at touch and opening. The variable of
`clock` makes them smooth, and steps of order 8 are taken in it. A step that passes an event is
repeated up to the root of the cubic through its ends, until it ends there.

Events are a touch or an opening, and the end of the time. They also include the closing speed of a
contact: if it stops rising, v0 is latched; if it exceeds the latched v0, v0 rises again.

The stages and the step control are those of `_solver`. docs/rooms.md says why the loop is not.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .carry import Carry, CoupledSolve
from .clock import LONG_AGO, ContactClock, choose_clock
from .field import TIME, WORK, AbstractCoupledField, Grip, Look
from .modes import APART, NOT_CONVERGED, PAUSED, TIME_IS_UP, Flag, Index, Modes, Number
from .step import advance, with_w

_stop = jax.lax.stop_gradient


def modes_of(field: AbstractCoupledField, state: Any) -> Modes:
    """Return the modes of the contacts of a state in SI units."""
    units, deepest = field.units, state.deepest
    modes = Modes(state.closed, state.rising, state.latched / units.speed)
    if deepest is not None:
        modes = modes._replace(deepest=deepest / units.length)
    if field.law.fades:
        modes = modes._replace(faded=state.closed & (state.force_until > state.since))
    return modes


def records_of(solve: CoupledSolve, c: Carry) -> dict[str, Any]:
    """Return what a state of the loop holds of its contacts, in SI units."""
    units, modes = solve.units, c.modes
    return {
        "closed": modes.closed,
        "rising": modes.rising,
        "latched": units.speed * modes.latched,
        "since": c.since,
        "force_until": c.force_until,
        "parting": c.parting,
        "max_force": c.max_force,
        "lost": units.energy * solve.field.lost(c.y),
        "deepest": None if modes.deepest is None else units.length * modes.deepest,
    }


def first_carry(
    solve: CoupledSolve, y: Array, modes: Modes, state: Any, step: Number | None = None
) -> Carry:
    """Return the initial state of the loop: its vector, whose last three numbers are zero, and the
    modes, with the records of a `state` in SI units. `step`: the first step in units of time, if no
    contact begins just now.
    """
    field, finest, begin = solve.field, solve.finest, solve.begin
    zero = jnp.zeros((), y.dtype)
    nobody, none = jnp.zeros_like(modes.closed), jnp.zeros_like(modes.latched)
    touching, contacts = ContactClock(jnp.asarray(True), nobody), field.contacts
    renew = jnp.asarray(field.rules.sticks) if contacts.jumps or field.rules.sticks else None
    press = none if field.law.fades else None
    if field.rules.sticks:
        # The first step, of no length, finds the rest.
        at, grip = field.approach(y, touching), Grip(none, none, none)
        here, slope = Look(*at, none, none, grip, press), Look(None, None, none, none, grip, press)
    else:
        here = field.look(y, modes, touching)
        force = contacts.force_slope(modes, (here.depth, here.rate), (here.rate, here.second))
        slope = Look(None, None, none, force, press=press)
        if field.rules.peak:
            modes = field.with_peak(modes, here, finest)
    if field.law.forgets and modes.deepest is not None:
        pulls = ~modes.loads & (here.depth < contacts.least(modes.deepest))
        modes = modes._replace(adheres=modes.closed & pulls)
    # True if a contact begins just now, up to rounding.
    just = jnp.abs(state.since - solve.start) <= 8 * finest * jnp.abs(solve.start)
    just = jnp.any(modes.closed & just)
    touched = jnp.where(just, zero, jnp.asarray(LONG_AGO, zero.dtype))
    before, height = ContactClock(just, nobody), contacts.height(here.depth)
    clock, w = choose_clock(before, zero, modes, height, here.rate, zero - touched)
    first = begin if step is None else step
    size = _stop(jnp.where(just, begin, first / jnp.where(just, 1, 2 * w)))
    over = jnp.where(field.until <= 0, TIME_IS_UP, -1)
    if not field.rules.flies:
        over = jnp.where(jnp.any(modes.closed), over, APART)
    return Carry(
        y=with_w(y, w),
        modes=modes,
        clock=clock,
        touched=touched,
        size=size,
        free=size,
        last_size=size,
        last_error=zero + 1,
        whole=zero,
        cruise=begin,
        sought=jnp.zeros(len(field.events) * none.shape[0] + 1, bool),
        look=here,
        slope=slope,
        since=state.since,
        force_until=state.force_until,
        parting=state.parting,
        max_force=state.max_force,
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


def balance(solve: CoupledSolve, first: Carry, end: Carry) -> tuple[Number, tuple[Number, ...]]:
    """Return the energy that is missing at the end of a solve, and the energies at both ends, those
    without their signs if contacts attract; without derivatives.
    """
    still = _stop([(c.y, c.modes) for c in (first, end)])
    both = jax.tree.map(lambda *ends: jnp.stack(ends), *still)
    # The energies of finished contacts are not in the state.
    energies, without_signs = jax.vmap(solve.field.still().energies)(*both)
    before, now = energies
    missing = jnp.abs(now - before - _stop(end.dropped) - still[1][0][WORK])
    return missing, (before, now) if without_signs is None else tuple(without_signs)
