"""Contacts that change between stick and slip within a coupled solve, and jumps of forces.

A step of no length gives what holds after a jump, so that no other part of the program computes it.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from .carry import Carry, Changed, CoupledSolve
from .field import TOGETHER, Grip, Look, W
from .interpolation import highest
from .modes import REDUNDANT, Flag, Flags

_stop = jax.lax.stop_gradient


def slips_within(c: Carry, now: Grip | None, slope: Grip | None) -> Flags:
    """Return which contacts may change between stick and slip, and back, within a step. `now` is
    the grip at its end, and `slope` the slopes in s.
    """
    assert now is not None and slope is not None
    assert c.look.grip is not None and c.slope.grip is not None
    before, rising, after, falling = _stop((c.look.grip, c.slope.grip, now.hold, slope.hold))
    outset = 2 * _stop(c.y[W]) * rising.hold
    dip, inside = highest(_stop(c.size), -before.hold, -outset, -after, -falling)
    return inside & (dip > float(jnp.finfo(after.dtype).eps) ** TOGETHER)


def change_grips(
    solve: CoupledSolve, changed: Changed, grip: Grip | None, happens: Flags
) -> Changed:
    """Apply the changes between stick and slip that an event brings."""
    assert grip is not None
    field, before = solve.field, changed.modes
    event = jnp.any(changed.touches | changed.opens | happens)
    settled = field.settled(changed.y, before, changed.touches, happens, grip.friction)
    y, modes, slides = jax.tree.map(
        lambda new, old: jnp.where(event, new, old),
        (settled.y, settled.modes, settled.slides),
        (changed.y, before, jnp.zeros_like(happens)),
    )
    jumps = jnp.any(slides) if changed.jumps is None else changed.jumps | jnp.any(slides)
    return changed._replace(
        y=y, modes=modes, slides=slides, jumps=jumps, redundant=settled.redundant
    )


def renewed(
    solve: CoupledSolve, before: Carry, now: Look, slope: Look, redundant: Flag | None
) -> Carry:
    """Return the state after a jump of the forces, of which `now` and `slope` are known."""
    modes, status = before.modes, before.status
    if solve.field.rules.peak:
        # With the accelerations the closing speed may begin or cease to rise.
        largest = modes.closed & (now.rate >= modes.latched - 16 * solve.finest)
        rising = solve.field.refers_to_peak((modes.rising | largest) & (now.second > 0))
        falls = modes.rising & ~rising
        latched = jnp.where(falls, jnp.maximum(now.rate, 0), modes.latched)
        modes = modes._replace(rising=rising, latched=latched)
    if redundant is not None:
        status = jnp.where(redundant, REDUNDANT, status).astype(jnp.int32)
    return before._replace(
        modes=modes,
        look=now,
        slope=slope,
        steps=before.steps + 1,
        status=status,
        renew=jnp.asarray(False),
    )
