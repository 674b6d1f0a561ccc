"""Several touching bodies as one coupled solve, from event to event.

Between two events the motion of `_touching` is smooth but for the powers of δ at touch and opening.
With t = t_touch + σ² the powers δ^(n) of a contact that has just been touched are smooth in σ, in
which steps of order 8 are taken; towards an opening the error control shortens them. A step that
passes an event is tried again, with a length corrected by Newton's method, until it ends there.

Events: a pair touches or opens; the closing speed of a pair stops rising, so that its v0 is
latched, or rises above the latched one; the time is up.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._impact._runge_kutta import step_in_loop
from ._cluster_problem import Problem, Rules, scaled, units_of
from ._step import factor
from ._touching import (
    ClusterState,
    Geometry,
    Modes,
    PerBody,
    PerPair,
    Touching,
)

APART, TIME_IS_UP, NOT_CONVERGED, CHANGED, AT_REST = range(5)
"""How a solve ended: `ClusterEnd.status`. All pairs are open; `until` was reached; the numbers
cannot be trusted; a pair touched or opened, where `until_change` asked for that; nothing that
touches moves along its normal any more."""

# As in `_oblique`.
_ON_EVENT = 0.65
_BEGIN = 0.1


class ClusterEnd(NamedTuple):
    """The `state` at the end, its `status`, and how it was reached.

    `error_estimate`: the larger one of what the steps add up to, relative to the speeds, and of the
    energy that is missing, relative to the energy of the cluster. `work` in J, of gravity and of
    prescribed bodies on the free ones.
    """

    state: ClusterState
    work: Float[Array, ""]
    status: Int[Array, ""]
    steps: Int[Array, ""]
    events: Int[Array, ""]
    error_estimate: Float[Array, ""]


class _Layout(NamedTuple):
    """Where in the vector of a state its parts lie."""

    bodies: int
    dim: int
    pairs: int

    def packed(
        self, moved: PerBody, velocity: PerBody, lost: PerPair, rest: list[Float[Array, ""]]
    ) -> Float[Array, " numbers"]:
        """Of `rest`: the work, the time and σ."""
        return jnp.concatenate([moved.ravel(), velocity.ravel(), lost, jnp.stack(rest)])

    def moved(self, y: Array) -> PerBody:
        return y[: self.bodies * self.dim].reshape(self.bodies, self.dim)

    def velocity(self, y: Array) -> PerBody:
        m = self.bodies * self.dim
        return y[m : 2 * m].reshape(self.bodies, self.dim)

    def lost(self, y: Array) -> PerPair:
        return y[2 * self.bodies * self.dim : -3]


_WORK, _TIME, _SIGMA = -3, -2, -1


class _Look(NamedTuple):
    """What is asked of a state where a step ends."""

    gaps: Float[Array, " events"]
    force: PerPair
    depth: PerPair
    rate: PerPair
    second: PerPair


class _Carry(NamedTuple):
    y: Float[Array, " numbers"]
    modes: Modes
    size: Float[Array, ""]
    free: Float[Array, ""]
    whole: Float[Array, ""]
    sought: Bool[Array, " events"]
    look: _Look
    slope: _Look
    since: PerPair
    force_until: PerPair
    max_force: PerPair
    max_indentation: PerPair
    dropped: Float[Array, ""]
    error: Float[Array, ""]
    steps: Int[Array, ""]
    events: Int[Array, ""]
    status: Int[Array, ""]


# JAX traces it once for all derivatives and batches of the same shape.
@functools.partial(jax.jit, static_argnums=1)
def solve_cluster(problem: Problem, rules: Rules) -> ClusterEnd:
    state, units, stop = problem.state, units_of(problem), jax.lax.stop_gradient
    pairs, (bodies, dim) = problem.pairs, state.position.shape
    layout, tolerance = _Layout(bodies, dim, pairs.used.shape[0]), problem.tolerance
    dtype = state.position.dtype
    finest = float(jnp.finfo(dtype).eps)
    on_event = finest**_ON_EVENT
    free = (problem.inverse_mass > 0)[:, None]
    frame = stop(jnp.sum(jnp.where(free, state.velocity, 0), axis=0, keepdims=True))
    frame = frame / jnp.sum(free, dtype=dtype)
    system = Touching(
        law=problem.law,
        contact=problem.contact,
        units=units,
        pairs=pairs,
        apart=(state.position[pairs.first] - state.position[pairs.second]) / units.length,
        depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scaled(problem.drive, units),
    )
    until = (problem.until - state.time) / units.time

    def geometry(y: Array) -> Geometry:
        return system.geometry(layout.moved(y), layout.velocity(y))

    def rate(y: Array, modes: Modes) -> Array:
        """d/dσ."""
        velocity = layout.velocity(y)
        acceleration, lost, work = system.motion(layout.moved(y), velocity, modes, y[_TIME])
        one = jnp.ones((), dtype)
        per_time = layout.packed(velocity, acceleration, lost, [work, one, one])
        clock = 2 * y[_SIGMA]
        return (clock * per_time).at[_SIGMA].set(1)

    def look(y: Array, modes: Modes) -> _Look:
        at = geometry(y)
        force = system.force(at.depth, at.rate, modes)
        acceleration, _ = system.accelerations(at, force, y[_TIME])
        meets = jnp.where(modes.closed, at.depth, -at.depth)
        second = system.second(at, acceleration)
        latch = jnp.where(modes.rising, second, modes.latched - at.rate)
        gaps = jnp.concatenate([meets, latch, (until - y[_TIME])[None]])
        return _Look(gaps, force, at.depth, at.rate, second)

    def passed(modes: Modes, at: _Look) -> Bool[Array, " events"]:
        """Which gaps are negative because of an event: those of rounding go the other way."""
        inwards = jnp.where(modes.closed, at.rate < 0, at.rate > 0)
        meets = pairs.used & inwards
        latches = pairs.used & modes.closed & rules.peak & (modes.rising | (at.second > 0))
        return (at.gaps < 0) & jnp.concatenate([meets, latches, jnp.ones(1, bool)])

    def advance(c: _Carry) -> _Carry:
        modes = c.modes
        y, error, _ = step_in_loop(lambda y: rate(y, modes), c.y, c.size)
        error = stop(jnp.max(jnp.abs(error) / (tolerance + 20 * finest * jnp.abs(y))))
        fine = error <= 1
        toward = rate(y, modes)
        now, slope = jax.jvp(lambda y: look(y, modes), (y,), (toward,))
        crossed = passed(modes, now)
        # A pair that touches and opens again within a step is found by the cubic through its ends.
        peak = _highest(c.size, c.look.depth, c.slope.depth, now.depth, slope.depth)
        grazed = jnp.any(pairs.used & ~modes.closed & (peak > 0) & (now.depth < 0))
        fine = fine & (~grazed | (c.size < 1e-6))
        falls = slope.gaps < 0
        left = jnp.where(falls, -now.gaps / jnp.where(falls, slope.gaps, 1), jnp.inf)
        seeking = jnp.any(c.sought)
        anything = jnp.any(crossed)
        sought = crossed | c.sought
        left = jnp.where(sought, left, jnp.inf)
        next_one = jnp.min(left)
        whole = jnp.where(seeking, c.whole, c.size)
        small = jnp.abs(next_one) <= on_event * whole
        # Where a gap falls slowly its rounding hides the moment: that is all that can be known.
        known = sought & (left <= next_one) & (jnp.abs(now.gaps) <= 16 * finest)
        stuck = jnp.any(known) | (anything & (c.size < finest))
        event = fine & (small | stuck)
        taken = fine & (event | ~anything)
        at_once = jnp.where(jnp.any(known), known, crossed)
        happens = event & jnp.where(small, sought & (left <= next_one + on_event * whole), at_once)
        moved = jnp.where(small, next_one, 0)
        y = y + jnp.where(event, moved, 0) * toward

        # What changes: all pairs that are on their event at once.
        meets, latches = happens[: layout.pairs], happens[layout.pairs : -1]
        closing = geometry(y).rate
        touches, opens = meets & ~modes.closed, meets & modes.closed
        closed = (modes.closed | touches) & ~opens
        speed = jnp.maximum(closing, 0)
        at_touch = jnp.maximum(speed, problem.floor / units.speed)
        latched = jnp.where(latches, speed, jnp.where(touches, at_touch, modes.latched))
        rising = jnp.where(latches, ~modes.rising, modes.rising & ~opens)
        rising = jnp.where(touches, (now.second > 0) & rules.peak, rising)
        after = Modes(closed, rising, latched)
        any_touch = jnp.any(touches)
        lost = jnp.where(touches, 0, layout.lost(y))
        dropped = c.dropped - jnp.sum(layout.lost(y) - lost)
        y = layout.packed(
            layout.moved(y),
            layout.velocity(y),
            lost,
            [y[_WORK], y[_TIME], jnp.where(any_touch, 0, y[_SIGMA])],
        )

        # The next step.
        target = stop(c.size + next_one)
        inside = (target > 0.01 * c.size) & (target < c.size)
        back = jnp.where(inside, target, c.size / 2)
        grown = c.size * factor(error)
        free = jnp.where(fine & (seeking | anything), c.free, jnp.where(grazed, c.size / 2, grown))
        ahead = jnp.where(seeking & jnp.isfinite(next_one) & (next_one > 0), stop(next_one), free)
        size = jnp.where(anything, back, jnp.minimum(ahead, free))
        size = jnp.where(event, jnp.where(any_touch, _BEGIN, free), size)
        free = jnp.where(event & any_touch, _BEGIN, free)
        size = jnp.where(fine, size, free)
        keep = fine & ~event & (anything | (seeking & (next_one > 0) & jnp.isfinite(next_one)))

        # The record of every pair.
        time = state.time + units.time * y[_TIME]
        highest = jnp.maximum(
            jnp.maximum(now.force, c.look.force),
            _highest(c.size, c.look.force, c.slope.force, now.force, slope.force),
        )
        highest = jnp.where(modes.closed, units.force * highest, 0)
        deepest = jnp.where(modes.closed, units.length * jnp.maximum(peak, now.depth), 0)
        fresh = jnp.where(touches, 0, 1).astype(dtype)
        max_force = fresh * jnp.maximum(c.max_force, highest)
        max_indentation = fresh * jnp.maximum(c.max_indentation, deepest)
        acts = modes.closed & (c.look.force > 0)
        force_until = jnp.where(touches | acts, time, c.force_until)

        still = jnp.abs(now.rate) + jnp.abs(now.second) < 100 * tolerance
        at_rest = taken & jnp.all(jnp.where(closed & pairs.used, still, True)) & ~event
        if problem.drive is not None:
            # What a moving wall carries is never at rest.
            carried = problem.drive.moves[pairs.first] | problem.drive.moves[pairs.second]
            at_rest = at_rest & ~jnp.any(closed & pairs.used & carried)
        status = jnp.where(at_rest, AT_REST, -1)
        changed = jnp.any(touches | opens) & rules.until_change
        status = jnp.where(changed, CHANGED, status)
        status = jnp.where(~jnp.any(closed & pairs.used), APART, status)
        status = jnp.where(happens[-1], TIME_IS_UP, status)

        def either(new: Any, old: Any) -> Any:
            return jax.tree.map(lambda a, b: jnp.where(taken, a, b), new, old)

        # At a touch σ starts anew: nothing changes in σ there, to first order.
        restart = jax.tree.map(lambda s: jnp.where(any_touch, 0, s), slope)
        return _Carry(
            y=either(y, c.y),
            modes=either(after, c.modes),
            size=stop(size),
            free=stop(free),
            whole=stop(jnp.where(keep, whole, 0)),
            sought=keep & sought,
            look=either(now, c.look),
            slope=either(restart, c.slope),
            since=either(jnp.where(touches, time, c.since), c.since),
            force_until=either(force_until, c.force_until),
            max_force=either(max_force, c.max_force),
            max_indentation=either(max_indentation, c.max_indentation),
            dropped=either(dropped, c.dropped),
            error=c.error + jnp.where(taken, error * tolerance, 0),
            steps=c.steps + 1,
            events=c.events + jnp.where(event, 1, 0),
            status=either(status.astype(jnp.int32), c.status),
        )

    def energy(y: Array, modes: Modes) -> Float[Array, ""]:
        stored = jnp.sum(system.stored(geometry(y).depth, modes))
        return system.kinetic(layout.velocity(y)) + stored + jnp.sum(layout.lost(y))

    zero = jnp.zeros((), dtype)
    velocity = (state.velocity - frame) / units.speed
    lost = state.lost / units.energy
    y = layout.packed(jnp.zeros_like(velocity), velocity, lost, [zero, zero, zero])
    modes = Modes(state.closed & pairs.used, state.rising, state.latched / units.speed)
    here = look(y, modes)
    nothing = ~jnp.any(modes.closed)
    over = jnp.where(nothing, APART, jnp.where(until <= 0, TIME_IS_UP, -1))
    first = _Carry(
        y=y,
        modes=modes,
        size=zero + jnp.asarray(_BEGIN, dtype),
        free=zero + jnp.asarray(_BEGIN, dtype),
        whole=zero,
        sought=jnp.zeros(2 * layout.pairs + 1, bool),
        look=here,
        slope=jax.tree.map(jnp.zeros_like, here),
        since=state.since,
        force_until=state.force_until,
        max_force=state.max_force,
        max_indentation=state.max_indentation,
        dropped=zero,
        error=zero,
        steps=jnp.zeros((), jnp.int32),
        events=jnp.zeros((), jnp.int32),
        status=over.astype(jnp.int32),
    )

    def unfinished(c: _Carry) -> Bool[Array, ""]:
        return (c.status < 0) & (c.steps < rules.max_steps)

    end = jax.lax.while_loop(unfinished, advance, first)
    at = geometry(end.y)
    done = ClusterState(
        time=state.time + units.time * end.y[_TIME],
        position=state.position
        + units.length * layout.moved(end.y)
        + frame * units.time * end.y[_TIME],
        velocity=frame + units.speed * layout.velocity(end.y),
        indentation=units.length * at.depth,
        closed=end.modes.closed,
        rising=end.modes.rising,
        latched=units.speed * end.modes.latched,
        since=end.since,
        force_until=end.force_until,
        max_force=end.max_force,
        max_indentation=end.max_indentation,
        lost=units.energy * layout.lost(end.y),
    )
    status = jnp.where(end.status < 0, NOT_CONVERGED, end.status)
    # The energies at both ends; those of contacts that are over are left out of the state.
    both = jax.tree.map(lambda *ends: jnp.stack(ends), (y, modes), (end.y, end.modes))
    before, now = jax.vmap(energy)(*stop(both))
    missing = jnp.abs(now - before - end.dropped - end.y[_WORK])
    error = jnp.maximum(end.error, missing / jnp.maximum(before, jnp.abs(end.y[_WORK])))
    good = jnp.all(jnp.isfinite(end.y)) & (error <= 1e5 * tolerance)
    status = jnp.where(good, status, NOT_CONVERGED)
    # In the frame of the cluster its work is another one, by what the forces change in momentum.
    mass = jnp.where(free, 1 / jnp.where(free, problem.inverse_mass[:, None], 1), 0)
    gain = jnp.sum(mass * frame * (done.velocity - state.velocity))
    work = units.energy * end.y[_WORK] + gain
    return ClusterEnd(done, work, status, end.steps, end.events, stop(error))


def _highest(size: Array, left: PerPair, rises: PerPair, right: PerPair, falls: PerPair) -> PerPair:
    """The maximum of the cubic with these values and slopes at the ends of a step, if inside."""
    a, b, d = rises * size, falls * size, right - left
    second, third = 3 * d - 2 * a - b, a + b - 2 * d
    inside = (a > 0) & (b < 0)
    square = jnp.where(inside, jnp.square(second) - 3 * third * a, 1)
    bottom = jnp.where(inside, jnp.sqrt(square) - second, 1)
    u = jnp.where(inside, a, 0) / bottom
    top = left + u * (a + u * (second + u * third))
    return jnp.where(inside, top, jnp.maximum(left, right))
