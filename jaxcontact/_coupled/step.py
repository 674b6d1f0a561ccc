"""One step of a coupled solve: trial, acceptance, and landing on an event."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._solver.runge_kutta import step_and_slope
from .carry import Carry, Changed, CoupledSolve, factor, onward
from .clock import ContactClock, choose_clock
from .field import NO_SLOPES, TIME, TOGETHER, Grip, Look, W
from .interpolation import highest, to_root
from .modes import APART, CHANGED, NOT_FINITE, REDUNDANT, TIME_IS_UP, Flag, Flags, Number
from .rows import rows_of

_NEAR = 0.4
"""A power of rounding, relative to the step: the distance to an event that its cubic bridges."""

_FADES = 100
"""The size of a vanished force, in tolerances of a step, that differs from one of rounding."""

_stop = jax.lax.stop_gradient


class _Attempt(NamedTuple):
    """A trial step. `y` is its end, and `error` is in units of the allowed error. `outset` and
    `toward` are the slopes at its ends. `now` holds the quantities at its end, and `slope` their
    slopes. If `grazed`, a touch or an opening may be hidden in the step. The `shorter` part of a
    step that hides an event is tried next.
    """

    y: Array
    error: Array
    outset: Array
    toward: Array
    now: Look
    slope: Look
    passing: Array
    grazed: Array
    shorter: Array


class _StepEvents(NamedTuple):
    """The events of a step. `fine`: whether it is accurate and hides none. `grazed`: whether it may
    hide one. `event`: whether it ends on one. `taken`: whether it is accepted. `happens` marks the
    events on which it ends. `next_one` is the distance to the first of the `sought` events. `y` is
    `moved` in s from the end of the trial.
    """

    y: Array
    fine: Array
    grazed: Array
    moved: Array
    event: Array
    taken: Array
    happens: Bool[Array, " events"]
    sought: Bool[Array, " events"]
    seeking: Array
    anything: Array
    next_one: Array
    whole: Array


def with_w(y: Array, w: Number) -> Float[Array, " numbers"]:
    """Return the state with another w."""
    return jnp.concatenate([y[:W], w[None]])


class Changes(NamedTuple):
    """The contacts that begin and end with a step, and those that begin to stick or to slip."""

    touches: Flags
    opens: Flags
    slides: Flags | None = None


def advance(solve: CoupledSolve, c: Carry) -> tuple[Carry, Changes]:
    """Take one step, or retry with a shorter one."""
    field = solve.field
    if field.rules.flies:
        c = c._replace(size=_within(solve, c))
    size = c.size if c.renew is None else jnp.where(c.renew, 0, c.size)
    trial = _try_step(solve, c, size)
    events = _find_events(solve, c, trial)
    changed = _apply_events(solve, c, trial, events)
    modes, touches, opens, happens = changed.modes, changed.touches, changed.opens, events.happens
    now, age = changed.now, changed.y[TIME] - changed.touched
    height = field.contacts.height(now.depth)
    clock, w = choose_clock(c.clock, changed.y[W], modes, height, now.rate, age)
    onwards = _onward(solve, c, trial, events, changed, clock, w)
    time = solve.start + solve.units.time * changed.y[TIME]
    records = _records(solve, c, trial, changed, time)

    resting = field.resting(
        _stop(onwards["y"]), _stop(trial.toward), 2 * _stop(trial.y[W]), _stop(now), modes
    )
    still = events.taken & ~events.event & ~solve.to_the_end
    status = jnp.where(still, resting, -1)
    ended = jnp.any(touches | opens) & field.rules.until_change
    status = jnp.where(ended, CHANGED, status)
    if not field.rules.flies:
        status = jnp.where(~jnp.any(modes.closed), APART, status)
    if changed.redundant is not None:
        status = jnp.where(changed.redundant, REDUNDANT, status)
    status = jnp.where(happens[-1], TIME_IS_UP, status)

    new = records | {
        "y": onwards.pop("y"),
        "modes": modes,
        "touched": changed.touched,
        "dropped": changed.dropped,
        "status": status.astype(jnp.int32),
    }
    kept = {
        name: jax.tree.map(lambda a, b: jnp.where(events.taken, a, b), value, getattr(c, name))
        for name, value in new.items()
    }
    happened = touches, opens, changed.slides
    changes = Changes(*jax.tree.map(lambda flags: events.taken & flags, happened))
    carry = c._replace(
        **kept,
        **onwards,
        error=c.error + jnp.where(events.taken, trial.error * solve.tolerance, 0),
        steps=c.steps + 1,
    )
    if field.rules.flies:
        resolution = solve.finest * jnp.maximum(1, jnp.abs(c.y[TIME]))
        endless = ~jnp.isfinite(trial.error) & (size <= 8 * resolution)
        carry = carry._replace(status=jnp.where(endless, NOT_FINITE, carry.status))
    renew, jumps, redundant = c.renew, changed.jumps, changed.redundant
    if renew is not None and jumps is not None:
        jumps = jumps if redundant is None else jumps & ~redundant
        carry = carry._replace(renew=events.taken & jumps)
        again = _renewed(solve, c, trial.now, records["slope"], redundant)
        carry = jax.tree.map(lambda a, b: jnp.where(renew, a, b), again, carry)
    return carry, changes


def _within(solve: CoupledSolve, c: Carry) -> Number:
    """Return the size of a step that does not pass the end, where forces may jump."""
    y, closing = _stop((c.y, c.look.rate))
    left, w = _stop(solve.field.until) - y[TIME], y[W]
    # With dt = 2 w ds and a constant dw/ds, w² grows by dw/ds times dt.
    there = jnp.sqrt(jnp.maximum(jnp.square(w) + c.clock.rate(closing) * left, 0))
    # The end is passed by rounding, so that it is met.
    least = 4 * solve.finest * jnp.maximum(1, jnp.abs(y[TIME]))
    return jnp.minimum(c.size, (left + least) / (w + there))


def _try_step(solve: CoupledSolve, c: Carry, size: Number) -> _Attempt:
    """Try a step; return its error, its end, and whether an event may be hidden in it."""
    field, modes, clock = solve.field, c.modes, c.clock
    finest = solve.finest
    y, error, outset, toward = step_and_slope(lambda y: field.rate(y, modes, clock), c.y, size)
    allowed = field.allowed(*_stop((c.y, y)), solve.tolerance, finest)
    error = jnp.max(jnp.abs(_stop(error)) / allowed)
    now, slope = field.look_along(y, modes, clock, toward)
    # No choice of a step has a derivative.
    before, after = _stop((c.look, now))
    if field.rules.flies:
        # A gap that is not finite is no motion either.
        error = error + 0 * jnp.sum(after.depth + after.second)
    passing = y[TIME] - c.y[TIME]
    lasts = _stop(passing)
    hidden, shorter = field.hidden(
        lasts, before, after, modes, clock.leaving, field.noise(y, finest)
    )
    grazed = jnp.any(hidden)
    return _Attempt(y, error, outset, toward, now, slope, passing, grazed, shorter)


def _find_events(solve: CoupledSolve, c: Carry, trial: _Attempt) -> _StepEvents:
    """Find the first event of a step, and move the state to it if it is near."""
    field, modes, clock = solve.field, c.modes, c.clock
    y, toward, outset = trial.y, trial.toward, trial.outset
    finest, until = solve.finest, field.until
    together, near = finest**TOGETHER, finest**_NEAR
    fixed = field.fixed(modes)
    gaps = field.gaps(modes, clock, trial.now, y[W], fixed, until - y[TIME])
    fall = field.gaps(modes, clock, trial.slope, toward[W], NO_SLOPES, -toward[TIME])
    last, begun, ended = _stop((c, outset, toward))
    left = _stop(until) - last.y[TIME]
    before = field.gaps(modes, clock, last.look, last.y[W], _stop(fixed), left)
    falling = last.slope._replace(depth=last.look.rate, rate=last.look.second, force=None)
    earlier = jax.tree.map(lambda x: 2 * last.y[W] * x, falling)
    fell = field.gaps(modes, clock, earlier, begun[W], NO_SLOPES, -begun[TIME])
    # A gap may fall through zero and come back within a step.
    dip, inside, *_ = highest(c.size, -before, -fell, *_stop((-gaps, -fall)))
    hidden = field.may_dip(modes) & inside & (dip > together)
    grazed = trial.grazed | jnp.any(hidden)
    fine = (trial.error <= 1) & (~grazed | (c.size < 1e-6))
    crossed = field.has_passed(modes, trial.now, gaps)
    if c.renew is not None:
        crossed = crossed & ~c.renew
    left, steepness = to_root(c.size, before, fell, *_stop((gaps, fall)))
    whole = jnp.where(jnp.any(c.sought), c.whole, c.size)
    # A shorter step may show that an event of a longer one is not there.
    still = c.sought & (left <= whole)
    seeking, anything = jnp.any(still), jnp.any(crossed)
    sought = crossed | still
    left = jnp.where(sought, left, jnp.inf)
    first = jnp.argmin(left)
    next_one = rows_of(left, first)
    small = jnp.abs(next_one) <= near * whole
    # If a gap falls slowly, its rounding hides the exact time; this is the attainable accuracy.
    noise = field.noise(y, finest)
    if field.rules.peak:
        # Forces may rise so steeply at a touch that the depth's rounding hides a peak, too.
        count, pace = len(modes.closed), _stop(trial.slope.depth)
        steep = jnp.abs(_stop(fall)[count : 2 * count]) / jnp.where(pace > 0, pace, jnp.inf)
        noise = noise + noise * jnp.pad(steep, (count, len(gaps) - 2 * count))
    on_event = sought & (left <= next_one) & (jnp.abs(gaps) <= 16 * noise)
    stands = jnp.any(on_event)
    stuck = stands | (anything & (c.size < finest))
    event = fine & (small | stuck)
    taken = fine & (event | ~anything)
    at_once = jnp.where(stands, on_event, crossed)
    happens = event & jnp.where(small, sought & (left <= next_one + together * whole), at_once)
    # The root depends on everything that the gap depends on.
    moved = jnp.where(small, next_one, 0)
    gap, steep, at_root = rows_of((gaps, fall, steepness), first)
    change = gap + moved * steep
    # The end of the run is a sharp event, however small the step is.
    varies = event & (small | (first == gaps.shape[0] - 1)) & (at_root < 0)
    moved = moved - (change - _stop(change)) / jnp.where(varies, at_root, -jnp.inf)
    mean = (_stop(y) - last.y) / c.size
    bends = (1 + _stop(moved) / c.size) * (ended + begun - 2 * mean)
    bends = (bends + ended - mean) / c.size
    # In a step near rounding they are noise.
    bends = jnp.where(c.size > math.sqrt(finest), bends, 0)
    moved = jnp.where(event, moved, 0)
    y = y + moved * (toward + moved * bends)
    return _StepEvents(
        y, fine, grazed, moved, event, taken, happens, sought, seeking, anything, next_one, whole
    )


def _apply_events(solve: CoupledSolve, c: Carry, trial: _Attempt, events: _StepEvents) -> Changed:
    """Apply all events on which the step ends."""
    field, modes, y, happens = solve.field, c.modes, events.y, events.happens
    kinds, contacts = field.events, field.contacts
    each = dict(zip(kinds, happens[:-1].reshape(len(kinds), -1), strict=True))
    meets = each["gap"]
    # At the event the depth is that from which the clock continues.
    depth, closing = field.approach(y, c.clock)
    there = trial.now._replace(depth=None, rate=None)
    along = trial.slope._replace(depth=None, rate=None)
    moved = jax.tree.map(lambda x, pace: x + events.moved * pace, there, along)
    now = moved._replace(depth=depth, rate=closing)
    # Gaps that are zero within rounding close and open together; noise would decide otherwise.
    gap = depth
    if contacts.ends is not None:
        gap = jnp.where(modes.closed, contacts.height(depth), depth)
    zero = jnp.abs(gap) <= 16 * field.noise(y, solve.finest)
    goes_on = jnp.where(modes.closed, closing < 0, closing > 0)
    meets = meets | (jnp.any(meets) & zero & goes_on)
    touches, opens = meets & ~modes.closed, meets & modes.closed
    closed = (modes.closed | touches) & ~opens
    # Each of them has a time of its own, which differs by its derivative.
    moves = (touches | opens) & (closing != 0)
    lag = jnp.where(moves, _stop(gap) - gap, 0) / _stop(jnp.where(moves, closing, 1))
    speed = jnp.maximum(closing + now.second * lag, 0)
    at_touch = jnp.maximum(speed, solve.floor / solve.units.speed)
    latched, rising = jnp.where(touches, at_touch, modes.latched), modes.rising & ~opens
    if field.rules.peak:
        latches = each["peak"]
        latched = jnp.where(latches, speed, latched)
        rising = jnp.where(latches, ~modes.rising, rising)
        rising = jnp.where(touches, contacts.refers_to_peak(now.second > 0), rising)
    before = field.lost(y)
    lost = jnp.where(touches, 0, before)
    dropped = c.dropped - jnp.sum(before - lost)
    deepest, adheres = modes.deepest, modes.adheres
    if deepest is not None:
        turns = each["remembers"]
        kept = contacts.kept(jnp.where(modes.loads, depth, deepest), modes)
        # The energy kept is lost when a contact unloads, until it loads again.
        lost = lost + jnp.where(turns, jnp.where(modes.loads, kept, -kept), 0)
        deepest = jnp.where(turns, jnp.where(modes.loads, depth, 0), deepest)
        if adheres is not None:
            changes = each["forgets"] & ~modes.loads & ~turns
            # A contact that closes again loads as if it had not been as deep.
            deepest = jnp.where(changes & adheres, contacts.shrunk(depth), deepest)
            adheres = closed & ~touches & ~turns & (adheres ^ changes)
        deepest = jnp.where(closed & ~touches, deepest, 0)
    if contacts.ends is not None:
        lost = lost + jnp.where(opens, contacts.torn(modes), 0)
    faded, ends = modes.faded, opens
    if faded is not None and now.press is not None:
        # A force of rounding only, as that of contacts that creep apart, lasts until they open.
        lasts = ~faded | (now.press > -_FADES * solve.tolerance)
        changes = each["fades"] & ~opens
        ends = (opens & lasts) | (changes & ~faded)
        faded = (faded ^ changes) & closed & ~touches
    touched = jnp.where(jnp.any(touches), y[TIME], c.touched)
    y = field.renewed(field.with_lost(y, lost), touches)
    modes = field.at_touch(
        y,
        touches,
        modes._replace(
            closed=closed,
            rising=rising,
            latched=latched,
            deepest=deepest,
            adheres=adheres,
            faded=faded,
        ),
    )
    jumps = None
    if contacts.jumps:
        jump = jnp.abs(contacts.force(depth, closing, modes) - now.force)
        jumps = jnp.any((touches | opens) & (jump > solve.finest**TOGETHER))
    changed = Changed(y, modes, touches, opens, ends, now, touched, dropped, lag, jumps=jumps)
    if not field.rules.sticks:
        return changed
    return _change_grips(solve, changed, now.grip, each["sticks"])


def _change_grips(
    solve: CoupledSolve, changed: Changed, grip: Grip | None, happens: Flags
) -> Changed:
    """Apply the changes between stick and slip that an event brings."""
    assert grip is not None
    field, before = solve.field, changed.modes
    event = jnp.any(changed.touches | changed.opens | happens)
    settled = field.settled(changed.y, before, changed.touches, happens, grip.friction)
    y, modes = jax.tree.map(
        lambda new, old: jnp.where(event, new, old),
        (settled.y, settled.modes),
        (changed.y, before),
    )
    slides = before.closed & (modes.slide != before.slide) | changed.touches
    jumps = jnp.any(slides) if changed.jumps is None else changed.jumps | jnp.any(slides)
    return changed._replace(
        y=y, modes=modes, slides=slides, jumps=jumps, redundant=settled.redundant
    )


def _renewed(
    solve: CoupledSolve, before: Carry, now: Look, slope: Look, redundant: Flag | None
) -> Carry:
    """Return the state after a jump of the forces, of which `now` and `slope` are known.

    They are those of a step of no length, so that no other part of the program computes them.
    """
    modes, status = before.modes, before.status
    if solve.field.rules.peak:
        modes = solve.field.with_peak(modes, now, solve.finest)
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


def _onward(
    solve: CoupledSolve,
    c: Carry,
    trial: _Attempt,
    events: _StepEvents,
    changed: Changed,
    clock: ContactClock,
    w: Array,
) -> dict[str, Any]:
    """Return the next step, and its clock."""
    field, error, fine, event = solve.field, trial.error, events.fine, events.event
    begin = solve.begin
    next_one, anything, seeking = events.next_one, events.anything, events.seeking
    any_touch, opens = jnp.any(changed.touches), jnp.any(changed.opens)
    # If steps have become harder, the next one is expected to be harder again.
    trend = c.size / c.last_size * ((c.last_error + 1e-6) / (error + 1e-6)) ** (1 / 8)
    grown = c.size * factor(error) * jnp.where(fine, jnp.clip(trend, 0.7, 1.0), 1)
    grown = jnp.where(events.grazed, c.size * trial.shorter, grown)
    size, free = onward(c.size, c.free, grown, next_one, fine, anything, seeking)
    free = jnp.where(event & any_touch, begin, free)
    size = jnp.where(event, free, size)
    keep = fine & ~event & (anything | (seeking & (next_one > 0) & jnp.isfinite(next_one)))
    # The clock changes, unless a step continues to an event.
    anew = events.taken & ~keep
    there, closing, now_w = _stop((w, changed.now.rate, changed.y[W]))
    # Below that w is rounding, and the compiler may round it otherwise where it is used twice.
    beyond = there > math.sqrt(solve.finest)
    scale = jnp.where(anew & beyond, now_w / jnp.where(beyond, there, 1), 1)
    opened = event & opens & ~any_touch
    first_one = begin / jnp.where(opened, 2 * there, 1)
    cruise = c.cruise
    if field.rules.flies:
        # After the last contact the motion goes on as before the first.
        closed = jnp.any(changed.modes.closed)
        first_one = jnp.where(closed, first_one, cruise)
        cruise = jnp.where(events.taken & ~event & ~closed, free, cruise)
    opens_in = there / jnp.max(jnp.where(clock.leaving, -closing, 0))
    most = jnp.where(anew & jnp.any(clock.leaving), 1.1 * opens_in, jnp.inf)
    size, free = jnp.minimum(jnp.where(opened, first_one, size * scale), most), free * scale
    free = jnp.where(opened, first_one, free)
    last_size = jnp.where(anew, jnp.where(event, size, c.size * scale), c.last_size)
    return {
        "y": jnp.where(anew, with_w(changed.y, w), changed.y),
        "clock": jax.tree.map(lambda a, b: jnp.where(anew, a, b), clock, c.clock),
        "size": size,
        "free": free,
        "last_size": last_size,
        "last_error": jnp.where(anew, jnp.where(event, 1, error), c.last_error),
        "whole": jnp.where(keep, events.whole, 0),
        "cruise": cruise,
        "sought": keep & events.sought,
    }


def _records(
    solve: CoupledSolve, c: Carry, tried: _Attempt, changed: Changed, time: Number
) -> dict[str, Any]:
    """Return the records of every contact; slopes in time are special where w vanishes."""
    units, modes, now = solve.units, c.modes, changed.now
    passing, touches, ends = changed.y[TIME] - c.y[TIME], changed.touches, changed.ends
    now_w, zero = tried.y[W], jnp.zeros_like(now.rate)
    safe = jnp.abs(now_w) > solve.finest**_NEAR
    # Those of depths and their rates are known.
    per_step = tried.slope._replace(depth=None, rate=None)
    per_time = jax.tree.map(lambda x: x / jnp.where(safe, 2 * now_w, 1), per_step)
    none = None if now.grip is None else Grip(zero, zero, zero)
    press = None if now.press is None else zero
    at_opening = Look(None, None, zero, zero, none, press)
    per_time = jax.tree.map(lambda a, b: jnp.where(safe, a, b), per_time, at_opening)
    if now.press is not None:
        # Before a touch it is not that of the contact.
        now = now._replace(press=jnp.where(touches, 1, now.press))
        per_time = per_time._replace(press=jnp.where(touches, 0, per_time.press))
    strongest = solve.field.strongest(passing, (c.look, c.slope), (now, per_time), modes)
    strongest = jnp.where(modes.closed, units.force * strongest, 0)
    fresh = jnp.where(touches, 0, 1).astype(zero.dtype)
    time, parting = time + units.time * changed.lag, now.rate + now.second * changed.lag
    since, acts = jnp.where(touches, time, c.since), changed.modes.closed
    if changed.modes.faded is not None:
        acts = acts & ~changed.modes.faded
    return {
        "look": now,
        "slope": per_time,
        "since": since,
        "force_until": jnp.where(acts, since, jnp.where(ends, time, c.force_until)),
        "parting": jnp.where(ends, -units.speed * parting, c.parting),
        "max_force": fresh * jnp.maximum(c.max_force, strongest),
    }
