"""The solve of a mechanism from its state to the end of the run, with its log."""

from __future__ import annotations

import dataclasses
import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._coupled.carry import SIZES, Carry, CoupledSolve
from .._coupled.energies import attracts, ends_of
from .._coupled.field import TIME, WORK, Look, LoopRules
from .._coupled.loop import CoupledStart, first_carry
from .._coupled.modes import (
    NOT_CONVERGED,
    NOT_FINITE,
    PAUSED,
    TIME_IS_UP,
    TOO_MANY_STEPS,
    Flag,
    Index,
    Modes,
    Number,
    PerContact,
)
from .._coupled.step import advance
from .._functions import moving
from .field import SystemField
from .problem import Scales, SystemLog, SystemProblem, SystemState, empty_log, scales_of, with_event

MOST_STEPS = 10**6
"""The limit of steps, which no run should reach."""

_OUTGROWN = 2
"""The rate of a gap, in units of the solve, from which it goes on in larger ones."""

_stop = jax.lax.stop_gradient


class SystemRules(NamedTuple):
    """The static rules of a solve. `peak`: whether v0 follows its peak. `rows`: those of its log,
    after which it pauses.
    """

    peak: bool
    rows: int


class SystemEnd(NamedTuple):
    """The state at the end, the log, the status, the number of steps, and the error estimate. That
    is the sum of step errors relative to the speeds, or the energy imbalance if that is larger.
    `painleve`: see `SystemMargin`; None unless contacts stick and slip.
    """

    state: SystemState
    log: SystemLog
    status: Index
    steps: Index
    error: Number
    painleve: Number | None = None


class _Loop(NamedTuple):
    """The state of the loop: that of the coupled solve, its units, and what the log keeps of each
    contact.
    """

    carry: Carry
    scales: Scales
    touch_speed: PerContact
    max_depth: PerContact
    log: SystemLog
    painleve: Number | None = None


@dataclasses.dataclass(frozen=True)
class _SystemSolve(CoupledSolve):
    """The solve up to one stop. `supplied` is the work in J before its start."""

    field: SystemField
    supplied: Number

    def within(self, scales: Scales) -> _SystemSolve:
        """Return the solve in other units with the same time."""
        ends, by = self.field.ends, self.units.length / scales.contact.length
        field = dataclasses.replace(
            self.field, scales=scales, ends=None if ends is None else ends * by
        )
        return dataclasses.replace(self, field=field, units=scales.contact)


def solve_system(problem: SystemProblem, rules: SystemRules) -> SystemEnd:
    """Solve a mechanism from its state to the last of its stops, or until the log is full."""
    zero = jnp.zeros((), jnp.int32)
    running = jnp.asarray(-1, jnp.int32)
    nothing = jnp.zeros_like(problem.tolerance)
    painleve = nothing + jnp.inf if problem.mechanics.system.rigid else None
    log = empty_log(problem.state, rules.rows)
    stops = problem.stops

    first = SystemEnd(problem.state, log, running, zero, nothing, painleve)
    if stops.shape[0] == 1:
        return _solve_to_stop(problem, rules, first, stops[0])

    def unfinished(end: SystemEnd) -> Flag:
        return end.status < 0

    def to_next(end: SystemEnd) -> SystemEnd:
        index = jnp.sum(stops <= end.state.time)
        stop = stops[jnp.minimum(index, stops.shape[0] - 1)]
        end = _solve_to_stop(problem, rules, end, stop)
        # A stop is met exactly, so that the next one is another.
        met = end.status == TIME_IS_UP
        time = jnp.where(met, stop, end.state.time)
        more = met & (index + 1 < stops.shape[0])
        status = jnp.where(more, running, end.status)
        return end._replace(state=end.state._replace(time=time), status=status)

    steps = operator.attrgetter("state.step", "log.states.step")
    first = eqx.tree_at(steps, moving(problem, first), steps(first))
    return jax.lax.while_loop(unfinished, to_next, first)


def _solve_to_stop(
    problem: SystemProblem, rules: SystemRules, begun: SystemEnd, stop: Number
) -> SystemEnd:
    """Go on from `begun` to a stop."""
    state, mechanics = begun.state, problem.mechanics
    scales = scales_of(problem, state)
    units = scales.contact
    field = SystemField(
        mechanics=mechanics,
        contact=problem.contact,
        scales=scales,
        rules=LoopRules(
            rules.peak,
            False,
            MOST_STEPS,
            flies=True,
            sticks=mechanics.system.sticks,
            remembers=mechanics.system.law.remembers,
            forgets=mechanics.system.law.forgets,
            fades=mechanics.system.law.fades,
            jumps=mechanics.system.law.jumps(mechanics.system.exponent),
        ),
        until=(stop - state.time) / units.time,
        used=jnp.ones_like(state.closed),
        start=state.time,
        last=_stop(jnp.nextafter(_stop(stop), jnp.full_like(stop, -jnp.inf))),
        ends=ends_of(mechanics.system.law, problem.contact, units.length, state.closed.shape[0]),
    )
    solve = _SystemSolve(
        field=field,
        units=units,
        tolerance=problem.tolerance,
        floor=problem.floor,
        start=state.time,
        to_the_end=jnp.asarray(True),
        supplied=state.work,
    )
    first = first_carry(solve, _start(solve, state))
    loop = _Loop(first, scales, state.touch_speed, state.max_depth, begun.log, begun.painleve)
    sizes = (f"carry.{name}" for name in SIZES)
    still = operator.attrgetter("scales", "log.states.step", *sizes)
    loop = eqx.tree_at(still, moving((problem, state), loop), still(loop))

    def unfinished(loop: _Loop) -> Flag:
        c = loop.carry
        more = (begun.steps + c.steps < MOST_STEPS) & (loop.log.count < rules.rows)
        return (c.status < 0) & more

    def go_on(loop: _Loop) -> _Loop:
        there = solve.within(loop.scales)
        return _in_larger_units(there, _advance(there, loop))

    end = jax.lax.while_loop(unfinished, go_on, loop)
    return _assess(solve, begun, loop, end)


def _in_larger_units(solve: _SystemSolve, loop: _Loop) -> _Loop:
    """Return the loop in units of the present motion, if that is faster than its own by far."""
    c, field = loop.carry, solve.field
    modes, renew = c.modes, c.renew
    pace = jnp.max(jnp.abs(c.look.rate))
    grows = (pace > _OUTGROWN) & ~jnp.any(c.sought) & ~jnp.any(c.clock.leaving)
    by = _stop(jnp.where(grows, pace, 1))
    # Energies grow by the square; times, w and the numbers for `pressing` do not.
    energies, springs = field.used.shape[0] + 1, field.springs(c.y)
    # States of a friction law have a unit of their own.
    own = 0 if springs is None or field.rules.sticks else springs.size
    speeds = c.y.shape[0] - own - energies - 2
    powers = np.repeat([1, 0, 2, 0], [speeds, own, energies, 2])
    powers = jnp.asarray(powers, c.y.dtype)

    def grown(look: Look) -> Look:
        return look._replace(
            **{
                name: None if value is None else value / by
                for name, value in look._asdict().items()
                if name not in ("grip", "press")
            }
        )

    carry = c._replace(
        y=c.y / by**powers,
        modes=modes._replace(
            latched=modes.latched / by,
            deepest=None if modes.deepest is None else modes.deepest / by,
        ),
        look=grown(c.look),
        slope=grown(c.slope),
        dropped=c.dropped / by**2,
        # Parts of grips have other units.
        renew=renew if renew is None or not field.rules.sticks else renew | grows,
    )
    return loop._replace(carry=carry, scales=loop.scales.grown(by))


def _start(solve: _SystemSolve, state: SystemState) -> CoupledStart:
    scales, units = solve.field.scales, solve.units
    q, v = state.position / scales.position, state.velocity / scales.velocity
    latched, mass = state.latched / units.speed, state.mass
    springs = None if state.spring is None else state.spring / solve.field.unit_of_states
    deepest = None if state.deepest is None else state.deepest / units.length
    modes = Modes(state.closed, state.rising, latched, mass, state.slide, deepest)
    if solve.field.rules.fades:
        modes = modes._replace(faded=state.closed & (state.force_until > state.since))
    return CoupledStart(
        y=solve.field.pack(
            q, v, state.lost / units.energy, [jnp.zeros_like(state.time)] * 3, springs
        ),
        modes=modes,
        since=state.since,
        force_until=state.force_until,
        parting=state.parting,
        max_force=state.max_force,
        step=jnp.where(state.step > 0, state.step / units.time, solve.begin),
    )


def _advance(solve: _SystemSolve, loop: _Loop) -> _Loop:
    """Take one step and log its events."""
    before, units = loop.carry, solve.units
    after, changes = advance(solve, before)
    moved = after.y[TIME] > before.y[TIME]
    lasts = jnp.where(moved, after.y[TIME] - before.y[TIME], 1)
    deepest = units.length * solve.field.deepest(lasts, before.look, after.look)
    deepest = jnp.where(moved & before.modes.closed, deepest, 0)
    max_depth = jnp.where(changes.touches, 0, jnp.maximum(loop.max_depth, deepest))
    closing = units.speed * after.look.rate
    touch_speed = jnp.where(changes.touches, closing, loop.touch_speed)
    # Steps below the resolution of time make no progress. Those up to an event may be shorter.
    resolution = solve.finest * jnp.maximum(1, jnp.abs(after.y[TIME]))
    goes_on = (after.size > resolution / 1024) & (after.free > resolution)
    stuck = (after.status < 0) & ~goes_on
    status = jnp.where(stuck, TOO_MANY_STEPS, after.status)
    after = after._replace(status=status.astype(jnp.int32))
    painleve = loop.painleve
    if painleve is not None:
        painleve = jnp.minimum(painleve, solve.field.painleve(_stop(after.y), after.modes))
    loop = loop._replace(
        carry=after, touch_speed=touch_speed, max_depth=max_depth, painleve=painleve
    )
    return loop._replace(log=with_event(loop.log, state_of(solve, loop), *changes))


def state_of(solve: _SystemSolve, loop: _Loop) -> SystemState:
    """Return the state of the loop in SI units."""
    c, units, scales = loop.carry, solve.units, solve.field.scales
    nq, nv = scales.position.shape[0], scales.velocity.shape[0]
    assert c.modes.mass is not None
    springs = solve.field.springs(c.y)
    return SystemState(
        time=solve.start + units.time * c.y[TIME],
        position=scales.position * c.y[:nq],
        velocity=scales.velocity * c.y[nq : nq + nv],
        closing=units.speed * c.look.rate,
        closed=c.modes.closed,
        rising=c.modes.rising,
        latched=units.speed * c.modes.latched,
        mass=c.modes.mass,
        since=c.since,
        touch_speed=loop.touch_speed,
        force_until=c.force_until,
        parting=c.parting,
        max_force=c.max_force,
        max_depth=loop.max_depth,
        lost=units.energy * solve.field.lost(c.y),
        work=solve.supplied + units.energy * c.y[WORK],
        step=_stop(units.time * c.size * 2 * c.y[-1]),
        slide=c.modes.slide,
        spring=None if springs is None else solve.field.unit_of_states * springs,
        deepest=None if c.modes.deepest is None else units.length * c.modes.deepest,
    )


def _assess(solve: _SystemSolve, begun: SystemEnd, first: _Loop, end: _Loop) -> SystemEnd:
    """Return the end with its error estimate, which determines convergence."""
    field = dataclasses.replace(
        solve.field, mechanics=_stop(solve.field.mechanics), contact=_stop(solve.field.contact)
    )
    still, solve, c = dataclasses.replace(solve, field=field), solve.within(end.scales), end.carry
    ends = _stop([(loop.scales, loop.carry.y, loop.carry.modes) for loop in (first, end)])
    units = (ends[0][0].contact.speed / ends[1][0].contact.speed) ** 2
    units = jnp.stack([units, jnp.ones_like(units)])
    both = jax.tree.map(lambda *x: jnp.stack(x), *ends)
    before, now = units * jax.vmap(lambda to, *at: still.within(to).field.energy(*at))(*both)
    work, dropped = _stop((c.y[WORK], c.dropped))
    missing = jnp.abs(now - before - dropped - work)
    turnover = jnp.maximum(jnp.maximum(before, now), jnp.abs(work))
    if attracts(field.mechanics.system.law):
        # The energy of bodies that stick may vanish.
        others = jax.vmap(lambda to, *at: still.within(to).field.turnover(*at))(*both)
        turnover = jnp.maximum(turnover, jnp.max(units * others))
    imbalance = missing / jnp.maximum(turnover, 1)
    error = jnp.maximum(_stop(c.error), imbalance) + begun.error
    sound = jnp.all(jnp.isfinite(_stop(c.y))) & (imbalance <= 1e5 * solve.tolerance)
    steps = begun.steps + c.steps
    unfinished = jnp.where(steps < MOST_STEPS, PAUSED, TOO_MANY_STEPS)
    status = jnp.where(c.status < 0, unfinished, c.status)
    status = jnp.where(sound | (status >= NOT_FINITE), status, NOT_CONVERGED).astype(jnp.int32)
    return SystemEnd(state_of(solve, end), end.log, status, steps, error, end.painleve)
