"""The solve of a mechanism from its state to the end of the run, with its log."""

from __future__ import annotations

import dataclasses
import math
import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._coupled.carry import SIZES, Carry, CoupledSolve
from .._coupled.contacts import ScaledContacts
from .._coupled.energies import ends_of, loses
from .._coupled.field import TIME, WORK, Look, LoopRules
from .._coupled.loop import balance, first_carry, modes_of, records_of
from .._coupled.modes import (
    NOT_CONVERGED,
    NOT_FINITE,
    PAUSED,
    TIME_IS_UP,
    TOO_MANY_STEPS,
    Flag,
    Index,
    Number,
    PerContact,
    layout_of,
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
        return dataclasses.replace(self, field=self.field.within(scales))


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
    scales, system, gaps = scales_of(problem, state), mechanics.system, state.closed.shape[0]
    units = scales.contact
    ends = ends_of(system.law, problem.contact, units.length, gaps)
    contacts = ScaledContacts(system.law, problem.contact, units, ends)
    parts = layout_of(
        position=state.position,
        velocity=state.velocity,
        spring=state.spring,
        lost=state.lost if loses(system.law) else None,
    )
    field = SystemField(
        contacts=contacts,
        parts=parts,
        rules=LoopRules(rules.peak, False, MOST_STEPS, flies=True, sticks=system.sticks),
        until=(stop - state.time) / units.time,
        mechanics=mechanics,
        scales=scales,
        start=state.time,
        last=_stop(jnp.nextafter(_stop(stop), jnp.full_like(stop, -jnp.inf))),
    )
    solve = _SystemSolve(
        field=field,
        tolerance=problem.tolerance,
        floor=problem.floor,
        start=state.time,
        to_the_end=jnp.asarray(True),
        supplied=state.work,
    )
    first = _first(solve, state)
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
    c, renew = loop.carry, loop.carry.renew
    pace = jnp.max(jnp.abs(c.look.rate))
    grows = (pace > _OUTGROWN) & ~jnp.any(c.sought) & ~jnp.any(c.clock.leaving)
    by = _stop(jnp.where(grows, pace, 1))

    def grown(look: Look) -> Look:
        return look._replace(
            **{
                name: None if value is None else value / by
                for name, value in look._asdict().items()
                if name not in ("grip", "press")
            }
        )

    carry = _grown(solve, c, by)._replace(
        look=grown(c.look),
        slope=grown(c.slope),
        dropped=c.dropped / by**2,
        # Parts of grips have other units.
        renew=renew if renew is None or not solve.field.rules.sticks else renew | grows,
    )
    return loop._replace(carry=carry, scales=loop.scales.grown(by))


def _grown(solve: _SystemSolve, c: Carry, by: Number) -> Carry:
    """Return the vector and the modes in units of larger lengths and speeds with the same time."""
    # Energies grow by the square; times, w and the numbers for `pressing` do not. States of a
    # friction law have a unit of their own.
    own = 1 if solve.field.rules.sticks else 0
    powers = {"position": 1, "velocity": 1, "spring": own, "lost": 2}
    shapes = solve.field.parts.shapes
    each = [np.full(math.prod(shape), powers[name]) for name, shape in shapes]
    exponents = jnp.asarray(np.concatenate([*each, [2, 0, 0]]), c.y.dtype)
    modes = c.modes._replace(latched=c.modes.latched / by)
    if modes.deepest is not None:
        modes = modes._replace(deepest=modes.deepest / by)
    return c._replace(y=c.y / by**exponents, modes=modes)


def _first(solve: _SystemSolve, state: SystemState) -> Carry:
    """Return the loop at the start of the solve."""
    field, units, scales = solve.field, solve.units, solve.field.scales
    y = field.parts.pack(
        [jnp.zeros_like(state.time)] * 3,
        position=state.position / scales.position,
        velocity=state.velocity / scales.velocity,
        spring=None if state.spring is None else state.spring / field.unit_of_states,
        lost=state.lost / units.energy,
    )
    modes = modes_of(field, state)._replace(mass=state.mass, slide=state.slide)
    step = jnp.where(state.step > 0, state.step / units.time, solve.begin)
    return first_carry(solve, y, modes, state, step)


def _advance(solve: _SystemSolve, loop: _Loop) -> _Loop:
    """Take one step and log its events."""
    before, units = loop.carry, solve.units
    after, changes = advance(solve, before)
    moved = after.y[TIME] > before.y[TIME]
    lasts = jnp.where(moved, after.y[TIME] - before.y[TIME], 1)
    deepest = units.length * solve.field.deepest(lasts, before.look, after.look)
    deepest = jnp.where(moved & before.modes.closed, deepest, 0)
    max_depth = jnp.where(changes.touches, 0, jnp.maximum(loop.max_depth, deepest))
    # The v0 of a touch is its closing speed if it exceeds the least v0, and refers to its own time.
    rate, latched = after.look.rate, after.modes.latched
    closing = units.speed * jnp.where(rate < latched, rate, latched)
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
    c, units, field = loop.carry, solve.units, solve.field
    states, scales, part = field.states(c.y), field.scales, field.parts.part
    assert c.modes.mass is not None
    return SystemState(
        time=solve.start + units.time * c.y[TIME],
        position=scales.position * part(c.y, "position"),
        velocity=scales.velocity * part(c.y, "velocity"),
        closing=units.speed * c.look.rate,
        mass=c.modes.mass,
        touch_speed=loop.touch_speed,
        max_depth=loop.max_depth,
        work=solve.supplied + units.energy * c.y[WORK],
        step=_stop(units.time * c.size * 2 * c.y[-1]),
        slide=c.modes.slide,
        spring=None if states is None else field.unit_of_states * states,
        **records_of(solve, c),
    )


def _assess(solve: _SystemSolve, begun: SystemEnd, first: _Loop, end: _Loop) -> SystemEnd:
    """Return the end with its error estimate, which determines convergence."""
    solve, c = solve.within(end.scales), end.carry
    by = _stop(end.scales.contact.speed / first.scales.contact.speed)
    missing, turnover = balance(solve, _grown(solve, first.carry, by), c)
    most = jnp.maximum(jnp.maximum(*turnover), jnp.abs(_stop(c.y[WORK])))
    imbalance = missing / jnp.maximum(most, 1)
    error = jnp.maximum(_stop(c.error), imbalance) + begun.error
    sound = jnp.all(jnp.isfinite(_stop(c.y))) & (imbalance <= 1e5 * solve.tolerance)
    steps = begun.steps + c.steps
    unfinished = jnp.where(steps < MOST_STEPS, PAUSED, TOO_MANY_STEPS)
    status = jnp.where(c.status < 0, unfinished, c.status)
    status = jnp.where(sound | (status >= NOT_FINITE), status, NOT_CONVERGED).astype(jnp.int32)
    return SystemEnd(state_of(solve, end), end.log, status, steps, error, end.painleve)
