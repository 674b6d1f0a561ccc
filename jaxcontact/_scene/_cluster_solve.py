"""Several touching bodies as one coupled solve, from event to event.

Between two events the motion of `_touching` is smooth but for the powers of δ at touch and opening,
which `_cluster_clock` makes smooth. In its variable steps of order 8 are taken. A step that passes
an event is tried again, up to the root of the cubic through its ends, until it ends there.

Events: a pair touches or opens; the closing speed of a pair stops rising, so that its v0 is
latched, or rises above the latched one; the time is up.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._cluster_clock import LONG_AGO, Clock, chosen
from ._cluster_end import APART, CHANGED, NOT_CONVERGED, PAUSED, TIME_IS_UP, ClusterEnd
from ._cluster_problem import Problem, Rules, scaled, units_of
from ._cluster_rest import ASLEEP, rest_of
from ._cluster_vector import TIME, WORK, Parts, W
from ._cubic import ceiling, highest, to_root
from ._step import factor, step_and_slope
from ._touching import ClusterState, Geometry, Modes, PerPair, Touching, incidence_of

_TOGETHER = 0.65
_NEAR = 0.4
"""Powers of rounding: of the distance between simultaneous events, and of that from a state to an
event that the cubic through the ends of the step bridges, both beside the step."""

_BEGIN = 0.35
_BEGIN_FOR = 1e-8
"""The first step, in units of the contact's duration about, and the tolerance it is for."""


class _Look(NamedTuple):
    """What is asked of a state where a step ends, or the slopes of it in s."""

    depth: PerPair
    rate: PerPair
    second: PerPair
    force: PerPair


class _Carry(NamedTuple):
    y: Float[Array, " numbers"]
    modes: Modes
    clock: Clock
    touched: Float[Array, ""]
    size: Float[Array, ""]
    free: Float[Array, ""]
    last_size: Float[Array, ""]
    last_error: Float[Array, ""]
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
    layout = Parts(bodies, dim, pairs.used.shape[0], problem.law.damped)
    tolerance = problem.tolerance
    dtype = state.position.dtype
    finest = float(jnp.finfo(dtype).eps)
    together, near = finest**_TOGETHER, finest**_NEAR
    begin = _BEGIN * jnp.minimum((tolerance / _BEGIN_FOR) ** (1 / 8), 1.5)
    free = (problem.inverse_mass > 0)[:, None]
    frame = stop(jnp.sum(jnp.where(free, state.velocity, 0), axis=0, keepdims=True))
    frame = frame / jnp.sum(free, dtype=dtype)
    system = Touching(
        law=problem.law,
        contact=problem.contact,
        units=units,
        pairs=pairs,
        apart=pairs.between(state.position) / units.length,
        depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scaled(problem.drive, units),
        incidence=incidence_of(pairs, bodies, dtype),
        in_line=rules.in_line,
    )
    until = (problem.until - state.time) / units.time

    def geometry(y: Array, clock: Clock) -> Geometry:
        at = system.geometry(layout.moved(y), layout.velocity(y))
        return at._replace(depth=jnp.where(clock.leaving, jnp.square(y[W]), at.depth))

    def rate(y: Array, modes: Modes, clock: Clock) -> Array:
        """d/ds."""
        velocity, at = layout.velocity(y), geometry(y, clock)
        acceleration, lost, work = system.motion(at, velocity, modes, y[TIME])
        one = jnp.ones((), dtype)
        per_time = layout.packed(velocity, acceleration, lost, [work, one, one])
        return (2 * y[W] * per_time).at[W].set(clock.rate(at.rate))

    def look(y: Array, modes: Modes, clock: Clock) -> _Look:
        at = geometry(y, clock)
        force = system.force(at.depth, at.rate, modes)
        acceleration, _ = system.accelerations(at, force, y[TIME])
        return _Look(at.depth, at.rate, system.second(at, acceleration), force)

    def looked(y: Array, modes: Modes, clock: Clock, toward: Array) -> tuple[_Look, _Look]:
        """With its slopes along `toward`."""
        if rules.peak:
            return jax.jvp(lambda y: look(y, modes, clock), (y,), (toward,))
        # No event needs the slope of δ''.
        now, pace = look(y, modes, clock), 2 * y[W]
        slopes = (pace * now.rate, pace * now.second)
        force = jax.jvp(lambda d, r: system.force(d, r, modes), (now.depth, now.rate), slopes)[1]
        return now, _Look(*slopes, jnp.zeros_like(force), force)

    def gaps_of(modes: Modes, clock: Clock, at: _Look, w: Array, latched: Any, left: Array) -> Any:
        """What falls through zero at an event, or its slope, for slopes."""
        meets = jnp.where(clock.leaving, w, jnp.where(modes.closed, at.depth, -at.depth))
        if not rules.peak:
            return jnp.concatenate([meets, left[None]])
        return jnp.concatenate(
            [meets, jnp.where(modes.rising, at.second, latched - at.rate), left[None]]
        )

    def passed(modes: Modes, at: _Look, gaps: Array) -> Bool[Array, " events"]:
        """Which gaps are negative because of an event: those of rounding go the other way."""
        inwards = jnp.where(modes.closed, at.rate < 0, at.rate > 0)
        meets, last = pairs.used & inwards, jnp.ones(1, bool)
        if not rules.peak:
            return (gaps < 0) & jnp.concatenate([meets, last])
        latches = pairs.used & modes.closed & (modes.rising | (at.second > 0))
        return (gaps < 0) & jnp.concatenate([meets, latches, last])

    def advance(c: _Carry) -> _Carry:
        modes, clock = c.modes, c.clock
        y, error, outset, toward = step_and_slope(lambda y: rate(y, modes, clock), c.y, c.size)
        error = stop(jnp.max(jnp.abs(error) / (tolerance + 20 * finest * jnp.abs(y))))
        fine = error <= 1
        now_w = y[W]
        now, slope = looked(y, modes, clock, toward)
        gaps = gaps_of(modes, clock, now, y[W], modes.latched, until - y[TIME])
        fall = gaps_of(modes, clock, slope, toward[W], 0, -toward[TIME])
        before = gaps_of(modes, clock, c.look, c.y[W], modes.latched, until - c.y[TIME])
        earlier = jax.tree.map(lambda x: 2 * c.y[W] * x, c.slope)
        fell = gaps_of(modes, clock, earlier, outset[W], 0, -outset[TIME])
        crossed = passed(modes, now, gaps)
        # A pair may touch and open again within a step, unless a bound of its depth says no: in a
        # long step through a close pass the cubic through the ends is far too low.
        passing = y[TIME] - c.y[TIME]
        peak, inside = ceiling(passing, c.look.depth, c.look.rate, now.depth, now.rate)
        hidden = ~modes.closed & inside & (peak > 0)
        # Or open and touch again. Where a step ends between, the rate at its end says nothing.
        out, parts = highest(passing, -c.look.depth, -c.look.rate, -now.depth, -now.rate)
        hidden = hidden | (modes.closed & ~clock.leaving & parts & (out > 16 * finest))
        grazed = jnp.any(pairs.used & hidden)
        if rules.peak:
            # So is a closing speed that exceeds its peak and falls again.
            faster, _ = highest(passing, c.look.rate, c.look.second, now.rate, now.second)
            hidden = modes.closed & ~modes.rising & (now.second < 0)
            grazed = grazed | jnp.any(pairs.used & hidden & (faster > modes.latched + together))
        fine = fine & (~grazed | (c.size < 1e-6))
        left = stop(to_root(c.size, before, fell, gaps, fall))
        seeking = jnp.any(c.sought)
        anything = jnp.any(crossed)
        sought = crossed | c.sought
        left = jnp.where(sought, left, jnp.inf)
        first = jnp.argmin(left)
        next_one = left[first]
        whole = jnp.where(seeking, c.whole, c.size)
        small = jnp.abs(next_one) <= near * whole
        # Where a gap falls slowly its rounding hides the moment: that is all that can be known.
        known = sought & (left <= next_one) & (jnp.abs(gaps) <= 16 * finest)
        stuck = jnp.any(known) | (anything & (c.size < finest))
        event = fine & (small | stuck)
        taken = fine & (event | ~anything)
        at_once = jnp.where(jnp.any(known), known, crossed)
        happens = event & jnp.where(small, sought & (left <= next_one + together * whole), at_once)
        # The root varies with all that the gap varies with.
        moved = jnp.where(small, next_one, 0)
        at_root, steep = gaps[first] + moved * fall[first], stop(fall[first])
        varies = event & small & (steep < 0)
        moved = moved - (at_root - stop(at_root)) / jnp.where(varies, steep, -jnp.inf)
        mean = (y - c.y) / c.size
        bends = (2 * toward + outset - 3 * mean) / c.size
        bends = stop(bends + moved * (toward + outset - 2 * mean) / jnp.square(c.size))
        y = y + jnp.where(event, moved, 0) * (toward + jnp.where(event, moved, 0) * bends)

        # What changes: all pairs that are on their event at once.
        meets = happens[: layout.pairs]
        # At the event: the depth is what the clock goes on from.
        there = geometry(y, clock)
        now, closing = now._replace(depth=there.depth, rate=there.rate), there.rate
        touches, opens = meets & ~modes.closed, meets & modes.closed
        closed = (modes.closed | touches) & ~opens
        speed = jnp.maximum(closing, 0)
        at_touch = jnp.maximum(speed, problem.floor / units.speed)
        latched, rising = jnp.where(touches, at_touch, modes.latched), modes.rising & ~opens
        if rules.peak:
            latches = happens[layout.pairs : -1]
            latched = jnp.where(latches, speed, latched)
            rising = jnp.where(latches, ~modes.rising, rising)
            rising = jnp.where(touches, now.second > 0, rising)
        after = Modes(closed, rising, latched)
        any_touch = jnp.any(touches)
        lost = jnp.where(touches, 0, layout.lost(y))
        dropped = c.dropped - jnp.sum(layout.lost(y) - lost)
        touched = jnp.where(any_touch, y[TIME], c.touched)
        free_clock, w = chosen(clock, y[W], after, now.depth, closing, y[TIME] - touched)
        y = layout.packed(layout.moved(y), layout.velocity(y), lost, [y[WORK], y[TIME], y[W]])

        # The next step.
        target = stop(c.size + next_one)
        inside = (target > 0.01 * c.size) & (target < c.size)
        back = jnp.where(inside, target, c.size / 2)
        # Where steps have been getting harder the next one is expected to be harder again.
        trend = c.size / c.last_size * ((c.last_error + 1e-6) / (error + 1e-6)) ** (1 / 8)
        grown = c.size * factor(error) * jnp.where(fine, jnp.clip(trend, 0.7, 1.0), 1)
        free = jnp.where(fine & (seeking | anything), c.free, jnp.where(grazed, c.size / 2, grown))
        ahead = jnp.where(seeking & jnp.isfinite(next_one) & (next_one > 0), stop(next_one), free)
        size = jnp.where(anything, back, jnp.minimum(ahead, free))
        size = jnp.where(event, jnp.where(any_touch, begin, free), size)
        free = jnp.where(event & any_touch, begin, free)
        size = jnp.where(fine, size, free)
        keep = fine & ~event & (anything | (seeking & (next_one > 0) & jnp.isfinite(next_one)))
        # Another clock, unless a step goes on to an event.
        anew = taken & ~keep
        scale = jnp.where(anew & (w > 0), stop(y[W] / w), 1)
        opened = event & jnp.any(opens) & ~any_touch
        first_one = stop(begin / jnp.where(opened, 2 * w, 1))
        opens_in = stop(w / jnp.max(jnp.where(free_clock.leaving, -closing, 0)))
        most = jnp.where(anew & jnp.any(free_clock.leaving), 1.1 * opens_in, jnp.inf)
        size, free = jnp.minimum(jnp.where(opened, first_one, size * scale), most), free * scale
        free = jnp.where(opened, first_one, free)
        clock = jax.tree.map(lambda a, b: jnp.where(anew, a, b), free_clock, clock)
        y = jnp.where(anew, y.at[W].set(w), y)

        # The record of every pair. A pair opens where nothing goes on in s.
        safe = jnp.abs(now_w) > near
        per_time = jax.tree.map(lambda x: x / jnp.where(safe, 2 * now_w, 1), slope)
        at_opening = _Look(now.rate, now.second, zero_each, zero_each)
        per_time = jax.tree.map(lambda a, b: jnp.where(safe, a, b), per_time, at_opening)
        time = state.time + units.time * y[TIME]
        strongest = highest(passing, c.look.force, c.slope.force, now.force, per_time.force)[0]
        strongest = jnp.where(modes.closed, units.force * strongest, 0)
        deepest = jnp.where(modes.closed, units.length * jnp.maximum(peak, now.depth), 0)
        fresh = jnp.where(touches, 0, 1).astype(dtype)
        max_force = fresh * jnp.maximum(c.max_force, strongest)
        max_indentation = fresh * jnp.maximum(c.max_indentation, deepest)
        acts = modes.closed & (c.look.force != 0)
        # A force that vanishes while the pair is closed does so about where its slope leads to.
        vanishes = acts & (now.force == 0) & ~opens & (c.slope.force < 0)
        lasted = -c.look.force / jnp.where(vanishes, c.slope.force, -1)
        lasted = jnp.where(vanishes, jnp.minimum(lasted, passing), passing)
        until_then = state.time + units.time * (c.y[TIME] + lasted)
        force_until = jnp.where(acts, until_then, jnp.where(touches, time, c.force_until))

        speed = layout.velocity(y) + frame / units.speed
        pace = layout.velocity(toward) / (2 * now_w)
        resting = rest_of(system, closed, (now.rate, now.second), (speed, pace), tolerance)
        status = jnp.where(taken & ~event & ~problem.to_the_end, resting, -1)
        changed = jnp.any(touches | opens) & rules.until_change
        status = jnp.where(changed, CHANGED, status)
        status = jnp.where(~jnp.any(closed & pairs.used), APART, status)
        status = jnp.where(happens[-1], TIME_IS_UP, status)

        def either(new: Any, old: Any) -> Any:
            return jax.tree.map(lambda a, b: jnp.where(taken, a, b), new, old)

        return _Carry(
            y=either(y, c.y),
            modes=either(after, c.modes),
            clock=clock,
            touched=either(touched, c.touched),
            size=stop(size),
            free=stop(free),
            last_size=stop(jnp.where(anew, jnp.where(event, size, c.size * scale), c.last_size)),
            last_error=jnp.where(anew, jnp.where(event, 1, error), c.last_error),
            whole=stop(jnp.where(keep, whole, 0)),
            sought=keep & sought,
            look=either(now, c.look),
            slope=either(per_time, c.slope),
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
        depth = system.geometry(layout.moved(y), layout.velocity(y)).depth
        stored = jnp.sum(system.stored(depth, modes))
        return system.kinetic(layout.velocity(y)) + stored + jnp.sum(layout.lost(y))

    zero, zero_each = jnp.zeros((), dtype), jnp.zeros_like(state.lost)
    velocity = (state.velocity - frame) / units.speed
    lost = state.lost / units.energy
    y = layout.packed(jnp.zeros_like(velocity), velocity, lost, [zero, zero, zero])
    modes = Modes(state.closed & pairs.used, state.rising, state.latched / units.speed)
    nobody = jnp.zeros_like(modes.closed)
    here = look(y, modes, Clock(jnp.asarray(True), nobody))
    if rules.peak:
        # A closing speed that is the largest one yet, and grows, is what v0 follows.
        largest = modes.closed & (here.rate >= modes.latched - 16 * finest)
        modes = modes._replace(rising=modes.rising | (largest & (here.second > 0)))
    force = jax.jvp(
        lambda d, r: system.force(d, r, modes), (here.depth, here.rate), (here.rate, here.second)
    )[1]
    # Whether a pair touches just now, but for rounding.
    just = jnp.abs(state.since - state.time) <= 8 * finest * jnp.abs(state.time)
    just = jnp.any(modes.closed & just)
    touched = jnp.where(just, zero, jnp.asarray(LONG_AGO, dtype))
    clock, w = chosen(Clock(just, nobody), zero, modes, here.depth, here.rate, zero - touched)
    y = y.at[W].set(w)
    size = stop(jnp.where(just, begin, begin / jnp.where(just, 1, 2 * w)))
    nothing = ~jnp.any(modes.closed)
    over = jnp.where(nothing, APART, jnp.where(until <= 0, TIME_IS_UP, -1))
    first = _Carry(
        y=y,
        modes=modes,
        clock=clock,
        touched=touched,
        size=size,
        free=size,
        last_size=size,
        last_error=zero + 1,
        whole=zero,
        sought=jnp.zeros((2 if rules.peak else 1) * layout.pairs + 1, bool),
        look=here,
        slope=_Look(here.rate, here.second, zero_each, force),
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
    at = system.geometry(layout.moved(end.y), layout.velocity(end.y))
    done = ClusterState(
        time=state.time + units.time * end.y[TIME],
        position=state.position
        + units.length * layout.moved(end.y)
        + frame * units.time * end.y[TIME],
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
    asleep = end.status == ASLEEP
    # What goes on at its velocity has it without rounding.
    steady = ~free if problem.drive is None else ~free & ~problem.drive.shakes[:, None]
    velocity = jnp.where(steady, state.velocity, done.velocity)
    done = done._replace(
        time=jnp.where(asleep, problem.until, done.time),
        velocity=jnp.where(asleep & free, 0, velocity),
    )
    status = jnp.where(asleep, TIME_IS_UP, end.status)
    # Steps that got it farther than a contact's own time did not die out.
    unfinished_status = jnp.where(end.y[TIME] > 1, PAUSED, NOT_CONVERGED)
    status = jnp.where(end.status < 0, unfinished_status, status)
    # The energies at both ends; those of contacts that are over are left out of the state.
    both = jax.tree.map(lambda *ends: jnp.stack(ends), (y, modes), (end.y, end.modes))
    before, now = jax.vmap(energy)(*stop(both))
    missing = jnp.abs(now - before - end.dropped - end.y[WORK])
    error = jnp.maximum(end.error, missing / jnp.maximum(before, jnp.abs(end.y[WORK])))
    good = jnp.all(jnp.isfinite(end.y)) & (error <= 1e5 * tolerance)
    status = jnp.where(good, status, NOT_CONVERGED)
    # In the frame of the cluster its work is another one, by what the forces change in momentum.
    mass = jnp.where(free, 1 / jnp.where(free, problem.inverse_mass[:, None], 1), 0)
    gain = jnp.sum(mass * frame * (done.velocity - state.velocity))
    work = units.energy * end.y[WORK] + gain
    error = stop(error)
    return ClusterEnd(done, work, status, end.steps, end.events, error, error * units.speed)
