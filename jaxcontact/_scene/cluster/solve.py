"""The coupled solve of several touching bodies, from event to event.

Between two events the motion of `equations` is smooth except for powers of δ at touch and opening.
The variable of `clock` makes them smooth, and steps of order 8 are taken in it. A step that passes
an event is repeated up to the root of the cubic through its ends, until it ends there.

Events are a touch or opening of a pair, and the end of the time. They also include the closing
speed of a pair: if it stops rising, v0 is latched; if it exceeds the latched v0, v0 rises again.

The stages and the step control are those of `_solver`. docs/rooms.md says why the loop is not.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..scalars import Flag
from .clock import LONG_AGO, ClusterClock, choose_clock
from .equations import ClusterState, Modes
from .field import TIME, WORK, Look, field_of
from .problem import (
    APART,
    NOT_CONVERGED,
    PAUSED,
    TIME_IS_UP,
    ClusterEnd,
    ClusterProblem,
    ClusterRules,
    units_of,
)
from .rest import ASLEEP
from .step import Carry, ClusterSolve, advance

_stop = jax.lax.stop_gradient


def solve_cluster(problem: ClusterProblem, rules: ClusterRules) -> ClusterEnd:
    """Solve a cluster from its state to its end."""
    free = (problem.inverse_mass > 0)[:, None]
    velocity = problem.state.velocity
    frame = jnp.sum(jnp.where(free, _stop(velocity), 0), axis=0, keepdims=True)
    frame = frame / jnp.sum(free, dtype=velocity.dtype)
    units = units_of(problem)
    solve = ClusterSolve(problem, field_of(problem, rules, units), units, frame)
    first = _first(solve)

    def unfinished(c: Carry) -> Flag:
        return (c.status < 0) & (c.steps < rules.max_steps)

    end = jax.lax.while_loop(unfinished, functools.partial(advance, solve), first)
    done, status = _state_at(solve, end)
    return _assess(solve, first, end, done, status)


def _first(solve: ClusterSolve) -> Carry:
    """Return the initial state of the loop."""
    problem, field, units, finest = solve.problem, solve.field, solve.units, solve.finest
    state, pairs, begin = problem.state, problem.pairs, solve.begin
    dtype = state.position.dtype
    zero, none = jnp.zeros((), dtype), jnp.zeros_like(state.lost)
    velocity = (state.velocity - solve.frame) / units.speed
    lost = state.lost / units.energy
    y = field.parts.pack(jnp.zeros_like(velocity), velocity, lost, [zero, zero, zero])
    modes = Modes(state.closed & pairs.used, state.rising, state.latched / units.speed)
    nobody = jnp.zeros_like(modes.closed)
    here = field.look(y, modes, ClusterClock(jnp.asarray(True), nobody))
    if field.rules.peak:
        # v0 follows a closing speed that is the largest so far and increases.
        largest = modes.closed & (here.rate >= modes.latched - 16 * finest)
        modes = modes._replace(rising=modes.rising | (largest & (here.second > 0)))
    force = field.force_slope(modes, (here.depth, here.rate), (here.rate, here.second))
    # True if a pair touches just now, up to rounding.
    just = jnp.abs(state.since - state.time) <= 8 * finest * jnp.abs(state.time)
    just = jnp.any(modes.closed & just)
    touched = jnp.where(just, zero, jnp.asarray(LONG_AGO, dtype))
    clock, w = choose_clock(
        ClusterClock(just, nobody), zero, modes, here.depth, here.rate, zero - touched
    )
    size = _stop(jnp.where(just, begin, begin / jnp.where(just, 1, 2 * w)))
    nothing = ~jnp.any(modes.closed)
    over = jnp.where(nothing, APART, jnp.where(field.until <= 0, TIME_IS_UP, -1))
    return Carry(
        y=field.parts.with_w(y, w),
        modes=modes,
        clock=clock,
        touched=touched,
        size=size,
        free=size,
        last_size=size,
        last_error=zero + 1,
        whole=zero,
        sought=jnp.zeros((2 if field.rules.peak else 1) * field.parts.pairs + 1, bool),
        look=here,
        slope=Look(here.rate, here.second, none, force),
        since=state.since,
        force_until=state.force_until,
        max_force=state.max_force,
        dropped=zero,
        error=zero,
        steps=jnp.zeros((), jnp.int32),
        status=over.astype(jnp.int32),
    )


def _state_at(solve: ClusterSolve, end: Carry) -> tuple[ClusterState, Array]:
    """Return the final state of a solve in SI units, and its status."""
    problem, units, parts, frame = solve.problem, solve.units, solve.field.parts, solve.frame
    state, free = problem.state, (problem.inverse_mass > 0)[:, None]
    at = solve.field.system.geometry(parts.moved(end.y), parts.velocity(end.y))
    done = ClusterState(
        time=state.time + units.time * end.y[TIME],
        position=state.position
        + units.length * parts.moved(end.y)
        + frame * units.time * end.y[TIME],
        velocity=frame + units.speed * parts.velocity(end.y),
        indentation=units.length * at.depth,
        closed=end.modes.closed,
        rising=end.modes.rising,
        latched=units.speed * end.modes.latched,
        since=end.since,
        force_until=end.force_until,
        max_force=end.max_force,
        lost=units.energy * parts.lost(end.y),
    )
    asleep = end.status == ASLEEP
    # A body with constant velocity keeps it without rounding.
    steady = ~free if problem.drive is None else ~free & ~problem.drive.shakes[:, None]
    velocity = jnp.where(steady, state.velocity, done.velocity)
    done = done._replace(
        time=jnp.where(asleep, problem.until, done.time),
        velocity=jnp.where(asleep & free, 0, velocity),
    )
    status = jnp.where(asleep, TIME_IS_UP, end.status)
    # A solve that got farther than a contact's own time made progress.
    unfinished_status = jnp.where(end.y[TIME] > 1, PAUSED, NOT_CONVERGED)
    return done, jnp.where(end.status < 0, unfinished_status, status)


def _assess(
    solve: ClusterSolve, first: Carry, end: Carry, done: ClusterState, status: Array
) -> ClusterEnd:
    """Return the end with its work and its error estimate, which determines convergence."""
    problem, units, tolerance = solve.problem, solve.units, solve.problem.tolerance
    # The energies at both ends; those of finished contacts are not in the state.
    field = dataclasses.replace(solve.field, system=_stop(solve.field.system))
    begun, last = _stop((first, end))
    ends = ((c.y, c.modes) for c in (begun, last))
    both = jax.tree.map(lambda *ends: jnp.stack(ends), *ends)
    before, now = jax.vmap(field.energy)(*both)
    missing = jnp.abs(now - before - last.dropped - last.y[WORK])
    error = jnp.maximum(last.error, missing / jnp.maximum(before, jnp.abs(last.y[WORK])))
    sound = jnp.all(jnp.isfinite(last.y)) & (error <= 1e5 * tolerance)
    status = jnp.where(sound, status, NOT_CONVERGED)
    # The work differs in the frame of the cluster, by the frame velocity times the momentum change.
    free = (problem.inverse_mass > 0)[:, None]
    mass = jnp.where(free, 1 / jnp.where(free, problem.inverse_mass[:, None], 1), 0)
    gain = jnp.sum(mass * solve.frame * (done.velocity - problem.state.velocity))
    work = units.energy * end.y[WORK] + gain
    return ClusterEnd(done, work, status, end.steps, error, error * units.speed)
