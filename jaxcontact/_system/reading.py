"""The tables of contacts and of their phases, from the log of a run, and states at any times.

A state at any time is solved from the last event or the last time before it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.energies import ends_of, in_contact, stored_energy
from .._coupled.modes import SLOWEST, TIME_IS_UP, Number
from .._coupled.rows import rows_of
from .._impact.derivatives import with_sensitivity
from .._laws import adhesion_below, force_of_closed
from .problem import SystemLog, SystemProblem, SystemState
from .solve import SystemEnd, SystemRules, solve_system
from .start import start_of


class SystemStates(NamedTuple):
    """States at given times (T,).

    - `time`: in s.
    - `position` (T, nq), `velocity` (T, nv): q and v.
    - `gap`, `closing_speed`, `force` (T, m): in m, m/s and N.
    - `energy`: in J. It is v·∂L/∂v - L of a Lagrangian, else the kinetic energy, with the energy
      stored in contacts.
    - `work`: in J since the start, of all forces but normal contact forces. Kinetic and stored
      energy change by `work` less the losses of contacts.
    """

    time: Float[Array, " T"]
    position: Float[Array, "T nq"]
    velocity: Float[Array, "T nv"]
    gap: Float[Array, "T m"]
    closing_speed: Float[Array, "T m"]
    force: Float[Array, "T m"]
    energy: Float[Array, " T"]
    work: Float[Array, " T"]


def solved(problem: SystemProblem, rules: SystemRules, from_start: bool = False) -> SystemEnd:
    """Return the end of a solve, differentiable in both modes. `from_start`: the rest of the state
    follows from position and velocity alone, so that fewer numbers vary.
    """
    start, state = None, problem.state
    if from_start:
        start = state.time, state.position, state.velocity
        problem = eqx.tree_at(lambda p: p.state, problem, None)
    numbers, static = eqx.partition(problem, eqx.is_array)
    solve = eqx.Partial(_solve, static=static, rules=rules)
    return with_sensitivity(solve, 1)((numbers, start))


def _solve(given: Any, static: SystemProblem, rules: SystemRules) -> SystemEnd:
    numbers, start = given
    problem = eqx.combine(numbers, static)
    if start is not None:
        time, q, v = start
        state, _ = start_of(problem.mechanics, time, q, v, problem.floor, rules.peak)
        problem = eqx.tree_at(lambda p: p.state, problem, state, is_leaf=lambda leaf: leaf is None)
    return solve_system(problem, rules)


def states_at(
    problem: SystemProblem, log: SystemLog, reached: Number, peak: bool, times: Float[Array, " T"]
) -> SystemStates:
    """Return the states at `times`; NaN outside the run, and after `reached`."""
    before = jax.tree.map(
        lambda first, rows: jnp.concatenate([first[None], rows]), problem.state, log.states
    )

    def at(last: SystemState, time: Number) -> tuple[SystemState, SystemStates]:
        row = jnp.searchsorted(log.times, time, side="right").astype(jnp.int32)
        event: SystemState = rows_of(before, row)
        state = jax.tree.map(lambda x, y: jnp.where(last.time > event.time, x, y), last, event)
        stops = jnp.minimum(problem.stops, time)
        there = eqx.tree_at(lambda p: (p.state, p.stops), problem, (state, stops))
        # No event is expected before that time; one by rounding ends the solve.
        end = solved(there, SystemRules(peak, 1))
        good = (end.status == TIME_IS_UP) | (end.log.count > 0)
        good = good & (time >= problem.state.time) & (time <= reached)
        last = jax.tree.map(lambda x, y: jnp.where(good, x, y), end.state, last)
        read = reading_of(problem, end.state)
        return last, jax.tree.map(lambda x: jnp.where(good, x, jnp.nan), read)

    # From time to time, so that each piece of the motion is solved once.
    order = jnp.argsort(times)
    _, states = jax.lax.scan(at, problem.state, times[order])
    states = jax.tree.map(lambda x: x[jnp.argsort(order)], states)
    return states._replace(time=times)


def reading_of(problem: SystemProblem, state: SystemState) -> SystemStates:
    """Return the public quantities of one state."""
    mechanics = problem.mechanics
    system, at = mechanics.system, (state.time, state.position, state.velocity)
    gap, opening = mechanics.gaps(*at)
    contact = eqx.tree_at(lambda c: c.mass, problem.contact, state.mass)
    ends = ends_of(system.law, contact, jnp.ones_like(state.time), gap.shape[0])
    depth = jnp.where(state.closed, in_contact(-gap, ends), 0)
    rising = jnp.where(state.rising, jnp.maximum(-opening, 0), state.latched)
    speed = jnp.maximum(rising, SLOWEST * jnp.finfo(gap.dtype).eps)
    deepest = state.deepest
    if system.law.forgets and deepest is not None:
        deepest = jnp.where(depth < adhesion_below(system.law, deepest), -deepest, deepest)
    force = force_of_closed(system.law, depth, -opening, contact, speed, deepest)
    force = jnp.where(state.closed & (system.law.tension | (force >= 0)), force, 0)
    stored = jnp.sum(stored_energy(system.law, contact, depth, speed, state.deepest))
    energy = system._energy
    moving = mechanics.kinetic(*at) if energy is None else energy(*at, mechanics.args)
    return SystemStates(
        time=state.time,
        position=state.position,
        velocity=state.velocity,
        gap=gap,
        closing_speed=-opening,
        force=force,
        energy=moving + stored,
        work=state.work,
    )


def growth_of(problem: SystemProblem, peak: bool, rows: int) -> Number:
    """Return the largest factor by which the run amplifies a small change of its start."""
    problem = jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, problem)
    mechanics, state = problem.mechanics, problem.state
    lasts = problem.stops[-1] - state.time
    inertia = jnp.diagonal(mechanics.mass(state.time, state.position))
    alike = state.position.shape == state.velocity.shape
    place = jnp.sqrt(inertia) if alike else jnp.ones_like(state.position)
    scale = jnp.concatenate([place, jnp.sqrt(inertia) * lasts])
    count = state.position.shape[0]

    def outcome(start: Array) -> Array:
        start = start / scale
        there = state._replace(position=start[:count], velocity=start[count:])
        end = solved(eqx.tree_at(lambda p: p.state, problem, there), SystemRules(peak, rows)).state
        return scale * jnp.concatenate([end.position, end.velocity])

    start = scale * jnp.concatenate([state.position, state.velocity])
    slopes = jax.jacfwd(outcome)(start)
    fine = jnp.all(jnp.isfinite(slopes))
    largest = jnp.linalg.svd(jnp.where(fine, slopes, 0), compute_uv=False)[0]
    return jnp.where(fine, largest, jnp.inf)


def contacts_of(log: SystemLog, end: SystemState, rows: int | None) -> dict[str, Array]:
    """Return the columns of the contacts in order of their touches, cut to `rows`. A contact in
    progress at the end has no restitution and no duration yet.
    """
    gaps = jnp.arange(end.closed.shape[0])
    written = log.written[:, None]

    def both(of_log: Array, of_end: Array) -> Array:
        return jnp.concatenate([of_log.ravel(), of_end.ravel()])

    def column(name: str) -> Array:
        return both(getattr(log.states, name), getattr(end, name))

    valid = both(log.opens & written, end.closed)
    ended = both(log.opens & written, jnp.zeros_like(end.closed))
    touch, speed = column("since"), column("touch_speed")
    moves = ended & (speed > 0)
    restitution = column("parting") / jnp.where(moves, speed, 1)
    columns = {
        "gap": both(jnp.broadcast_to(gaps, log.opens.shape), gaps),
        "time": touch,
        "closing_speed": speed,
        "restitution": jnp.where(moves, restitution, jnp.nan),
        "duration": jnp.where(ended, column("force_until") - touch, jnp.nan),
        "max_force": column("max_force"),
        "max_depth": column("max_depth"),
        "energy_loss": column("lost"),
        "valid": valid,
    }
    return _in_order(columns, rows)


def phases_of(log: SystemLog, start: SystemState) -> dict[str, Array]:
    """Return the columns of the phases in order of their starts, blank rows last."""
    rows = jax.tree.map(lambda first, rows: jnp.concatenate([first[None], rows]), start, log.states)
    assert rows.slide is not None
    changes = rows.slide[1:] != rows.slide[:-1]
    begins = jnp.concatenate([start.closed[None], (log.touches | changes) & log.written[:, None]])
    # What changes again at the same time has no duration.
    lasts = jnp.concatenate(
        [~begins[1:] | (rows.time[1:] > rows.time[:-1])[:, None], begins[:1] | True]
    )
    valid = (begins & rows.closed & lasts).ravel()
    gaps = jnp.broadcast_to(jnp.arange(rows.closed.shape[1]), rows.closed.shape)
    columns = {
        "gap": gaps.ravel(),
        "time": jnp.broadcast_to(rows.time[:, None], rows.closed.shape).ravel(),
        "direction": rows.slide.ravel().astype(jnp.int32),
        "valid": valid,
    }
    return _in_order(columns, None)


def _in_order(columns: dict[str, Array], rows: int | None) -> dict[str, Array]:
    """Return the columns in order of time, cut to `rows`; blank rows are last."""
    order = jnp.argsort(jnp.where(columns["valid"], columns["time"], jnp.inf), stable=True)[:rows]
    return {name: values[order] for name, values in columns.items()}
