"""The coupled solve of several touching bodies: its start, the loop, and its end; and its entry
point, with tolerance, units of input and start.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._coupled.carry import SIZES, Carry, CoupledSolve
from ..._coupled.clock import ContactClock
from ..._coupled.energies import attracts
from ..._coupled.field import TIME, WORK, LoopRules, W
from ..._coupled.loop import balance, first_carry, modes_of, records_of, run_to_end, status_of
from ..._coupled.modes import NOT_CONVERGED, TIME_IS_UP, Number, least_v0
from ..._coupled.rows import rows_of
from ..._functions import moving, ratio
from ..._impact.derivatives import with_sensitivity
from .field import ASLEEP, ClusterField, field_of
from .friction import Rubbing
from .problem import (
    ClusterEnd,
    ClusterPairs,
    ClusterProblem,
    ClusterState,
    PerBody,
    PerPair,
    Rubbed,
    units_of,
)

_stop = jax.lax.stop_gradient


@dataclasses.dataclass(frozen=True)
class _ClusterSolve(CoupledSolve):
    """The solve of a problem. `frame` is the velocity of the cluster in m/s."""

    field: ClusterField
    problem: ClusterProblem
    frame: PerBody


def solve_cluster(problem: ClusterProblem, rules: LoopRules, in_line: bool) -> ClusterEnd:
    """Solve a cluster from its state to its end. `in_line`: see `ClusterField`."""
    solve = _solve_of(problem, rules, in_line)
    first = _first(solve)
    kept = {name: getattr(first, name) for name in SIZES}
    end = run_to_end(solve, moving(problem, first)._replace(**kept))
    return _assess(solve, first, end, *_state_at(solve, end))


def _solve_of(problem: ClusterProblem, rules: LoopRules, in_line: bool) -> _ClusterSolve:
    free = (problem.inverse_mass > 0)[:, None]
    velocity = problem.state.velocity
    frame = jnp.sum(jnp.where(free, _stop(velocity), 0), axis=0, keepdims=True)
    frame = frame / jnp.sum(free, dtype=velocity.dtype)
    return _ClusterSolve(
        field=field_of(problem, rules, units_of(problem), frame, in_line),
        tolerance=problem.tolerance,
        floor=problem.floor,
        start=problem.state.time,
        to_the_end=problem.to_the_end,
        problem=problem,
        frame=frame,
    )


def _first(solve: _ClusterSolve) -> Carry:
    """Return the loop at the start of the solve."""
    field, state, units = solve.field, solve.problem.state, solve.units
    modes = modes_of(field, state._replace(closed=state.closed & field.pairs.used))
    rubbing, friction, rubbed = state.rubbing, solve.problem.friction, {}
    if rubbing is not None and friction is not None:
        spin = friction.radius[:, None] * rubbing.spin / units.speed
        # The last event may have been the touch of a pair.
        taken = jnp.where(state.since < state.time, rubbing.taken, 0)
        rubbed = Rubbed(spin, rubbing.spring / units.force, taken / units.energy)._asdict()
        modes = modes._replace(slide=rubbing.slides)
    y = field.parts.pack(
        [jnp.zeros((), state.position.dtype)] * 3,
        moved=jnp.zeros_like(state.position),
        velocity=(state.velocity - solve.frame) / units.speed,
        lost=state.lost / units.energy,
        **rubbed,
    )
    if friction is not None:
        nobody = jnp.zeros_like(modes.closed)
        y, modes, *_ = field.settled(y, modes, friction.begins, nobody, state.latched)
        # A spring that took the place of a law slides only if its limit grows less than its force.
        grip = field.look(y, modes, ContactClock(jnp.asarray(True), nobody)).grip
        assert grip is not None and modes.slide is not None
        slides = modes.closed & ~friction.begins & (modes.slide == 1)
        y, modes, *_ = field.settled(y, modes, nobody, slides, state.latched)
        # All have the force at the limit now, from which those go on sliding.
        slides = slides & (grip.hold >= 0)
        y, modes, *_ = field.settled(y, modes, nobody, slides, state.latched)
    return first_carry(solve, y, modes, state)


def _state_at(solve: _ClusterSolve, end: Carry) -> tuple[ClusterState, Array]:
    """Return the final state of a solve in SI units, and its status."""
    problem, units, frame = solve.problem, solve.units, solve.frame
    state, free = problem.state, (problem.inverse_mass > 0)[:, None]
    (moved, velocity), lasts = solve.field.bodies(end.y), units.time * end.y[TIME]
    done = ClusterState(
        time=state.time + lasts,
        position=state.position + units.length * moved + frame * lasts,
        velocity=frame + units.speed * velocity,
        indentation=units.length * solve.field.indentations(end.y)[0],
        rubbing=_rubbing_at(solve, end),
        **records_of(solve, end),
    )
    asleep = end.status == ASLEEP
    # A body with constant velocity keeps it without rounding.
    steady = ~free if problem.drive is None else ~free & ~problem.drive.shakes[:, None]
    velocity = jnp.where(steady, state.velocity, done.velocity)
    done = done._replace(
        time=jnp.where(asleep, problem.until, done.time),
        velocity=jnp.where(asleep & free, 0, velocity),
    )
    if done.rubbing is not None:
        still = done.rubbing._replace(spin=jnp.where(asleep & free, 0, done.rubbing.spin))
        done = done._replace(rubbing=still)
    return done, jnp.where(asleep, TIME_IS_UP, status_of(end))


def _rubbing_at(solve: _ClusterSolve, end: Carry) -> Rubbing | None:
    """Return the state of friction in SI units; None without it."""
    units, rubbed = solve.units, solve.field.rubbed(end.y)
    friction, slides = solve.problem.friction, end.modes.slide
    if rubbed is None or friction is None or slides is None:
        return None
    spin = units.speed * rubbed.spin / friction.radius[:, None]
    return Rubbing(spin, units.force * rubbed.spring, slides, units.energy * rubbed.taken)


def _assess(
    solve: _ClusterSolve, first: Carry, end: Carry, done: ClusterState, status: Array
) -> ClusterEnd:
    """Return the end with its work and its error estimate, which determines convergence."""
    problem, units, tolerance = solve.problem, solve.units, solve.problem.tolerance
    missing, turnover = balance(solve, first, end)
    last = _stop(end)
    # The energy of bodies that stick may vanish.
    most = jnp.maximum(*turnover) if attracts(problem.law) else turnover[0]
    # Bodies that move alike have no energy in their frame.
    most = jnp.maximum(jnp.maximum(most, jnp.abs(last.y[WORK])), 1)
    error = jnp.maximum(last.error, missing / most)
    sound = jnp.all(jnp.isfinite(last.y)) & (error <= 1e5 * tolerance)
    status = jnp.where(sound, status, NOT_CONVERGED)
    # The work differs in the frame of the cluster, by the frame velocity times the momentum change.
    mass = ratio(1.0, problem.inverse_mass[:, None])
    gain = jnp.sum(mass * solve.frame * (done.velocity - problem.state.velocity))
    work, taken = units.energy * end.y[WORK] + gain, None
    rubbed, start = (solve.field.rubbed(c.y) for c in (end, first))
    if rubbed is not None and start is not None:
        taken = units.energy * jnp.sum(rubbed.taken - start.taken)
    return ClusterEnd(done, work, status, end.steps, error, error * units.speed, taken)


MOST_STEPS = 4096


def cluster(
    problem: ClusterProblem,
    *,
    v0: str | float = "peak",
    until_change: bool = False,
    in_line: bool = False,
    max_steps: int = MOST_STEPS,
) -> ClusterEnd:
    """Follow a cluster of touching bodies until all its pairs are open, or until its end time.

    - `v0`: "peak", the largest closing speed since touch; "touch", the speed at touch; a number,
      the least speed at touch in m/s.
    - `until_change`: if True, the solve also ends if a pair touches or opens.
    - `in_line`: if True, a shorter computation in one dimension without shells is used.

    One lane; batch with `vmap`. Differentiable in both modes: the solve carries the sensitivities
    to all varying numbers. Nothing is raised; see `ClusterEnd.status`.
    """
    problem, rules = _prepared(problem, v0, until_change, max_steps)
    return with_sensitivity(eqx.Partial(solve_cluster, rules=rules, in_line=in_line))(problem)


def rates_at_start(
    problem: ClusterProblem, *, v0: str | float, in_line: bool
) -> tuple[ClusterState, Number, Array | None]:
    """Return the rates at which the initial state changes, with the flags of this state; and the
    powers in W of bodies in prescribed motion, and taken by friction. `v0` and `in_line` as in
    `cluster`.
    """
    solve = _solve_of(*_prepared(problem, v0), in_line)
    first, state, unit = _first(solve), problem.state, 1 / solve.units.time
    # A pair that just touches had no force until now, even if it jumps.
    before = first.modes._replace(closed=first.modes.closed & (state.since < state.time))
    # With w = 1/2 the time of the loop is that of the motion.
    pace = solve.field.rate(first.y.at[W].set(0.5), before, first.clock).at[W].set(0)

    def later(time: Number) -> tuple[ClusterState, Number, Array | None]:
        end = first._replace(y=first.y + time * pace)
        end = _assess(solve, first, end, *_state_at(solve, end))
        return end.state._replace(closed=None, rising=None), end.work, end.rubbed

    rates, work, taken = jax.jvp(later, (jnp.zeros_like(unit),), (unit,))[1]
    rates = rates._replace(closed=state.closed, rising=state.rising)
    momentum = ratio(1.0, problem.inverse_mass)[:, None] * state.velocity
    return _stop((rates, work - jnp.sum(momentum * problem.acceleration), taken))


def _prepared(
    problem: ClusterProblem,
    v0: str | float,
    until_change: bool = False,
    max_steps: int = MOST_STEPS,
) -> tuple[ClusterProblem, LoopRules]:
    """Return a problem with a number for each pair, and the rules of its loop."""
    state, dtype = problem.state, problem.state.position.dtype

    def per_pair(leaf: Any) -> Any:
        return jnp.broadcast_to(jnp.asarray(leaf, dtype), problem.pairs.used.shape)

    law, contact = jax.tree.map(per_pair, (problem.law, problem.contact))
    finest = 20 * float(jnp.finfo(dtype).eps)
    tolerance = jnp.maximum(jnp.asarray(problem.tolerance, dtype) / 100, finest)
    problem = problem._replace(
        law=law,
        contact=contact,
        until=jnp.asarray(problem.until, dtype),
        tolerance=_stop(tolerance),
        to_the_end=jnp.asarray(problem.to_the_end),
        floor=jnp.asarray(least_v0(v0), dtype),
    )
    sticks = problem.friction is not None
    rules = LoopRules(v0 == "peak", until_change, max_steps, sticks=sticks)
    if law.remembers and state.deepest is None:
        fresh = state._replace(deepest=jnp.zeros_like(state.indentation))
        problem = problem._replace(state=fresh)
    return problem, rules


def cluster_at_touch(
    pairs: ClusterPairs,
    position: PerBody,
    velocity: PerBody,
    closed: Bool[Array, " pairs"],
    *,
    v0: str | float = "peak",
    drift: PerPair | float = 0.0,
) -> ClusterState:
    """Return a cluster at time 0, with some pairs just touching (δ = 0) and the others open. v0
    rises for pairs that touch without closing yet. `drift` is the rate at which the speed of
    opening changes before the touch, which only derivatives need.
    """
    relative = rows_of(velocity, pairs.first) - rows_of(velocity, pairs.second)
    gap, opening = pairs.gaps(pairs.between(position), relative)
    closed, rate, zero = closed & pairs.used, -opening, jnp.zeros_like(gap)
    # The depth of a pair that just touches is rounding, but has a derivative.
    depth = jnp.where(closed, jax.lax.stop_gradient(gap) - gap, jnp.minimum(-gap, 0))
    # So has the time of the touch, where the time of this state has none.
    meets = closed & (rate > 0)
    since = -jnp.where(meets, depth, 0) / jax.lax.stop_gradient(jnp.where(meets, rate, 1))
    latched = jnp.maximum(rate - since * drift, least_v0(v0))
    return ClusterState(
        time=jnp.zeros((), position.dtype),
        position=position,
        velocity=velocity,
        indentation=jnp.where(pairs.used, depth, 0),
        closed=closed,
        rising=closed & (rate <= 0) & (v0 == "peak"),
        latched=jnp.where(closed, latched, 0),
        since=since,
        force_until=since,
        parting=zero,
        max_force=zero,
        lost=zero,
    )
