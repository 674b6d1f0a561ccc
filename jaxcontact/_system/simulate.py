"""The simulation of a mechanism."""

from __future__ import annotations

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._coupled.modes import (
    NOT_FINITE,
    PAUSED,
    REDUNDANT,
    TIME_IS_UP,
    TOO_MANY_STEPS,
    Flag,
    Number,
    least_v0,
)
from .._entry import as_parameter, as_parameters, is_list, is_plain, refusal
from .._program import quick, traced
from .._scene.result import Ending, nan_unless
from .._text.failure import checked
from .._text.progress import TellRun
from .mechanics import Mechanics, Vector, solve_mass
from .problem import SystemLog, SystemProblem, SystemState
from .reading import contacts_of, phases_of, reading_of, solved
from .result import SystemContacts, SystemMargin, SystemPhases, SystemRun, read_states
from .solve import SystemEnd, SystemRules
from .start import StartChecks, require_shapes, require_start, start_of
from .system import System

ROOM = 64
"""The number of contacts that a traced run can hold, and a piece of any other."""

_ENDINGS = {
    TIME_IS_UP: Ending.COMPLETED,
    PAUSED: Ending.TOO_MANY_IMPACTS,
    REDUNDANT: Ending.REDUNDANT_STICKING,
    NOT_FINITE: Ending.NOT_FINITE,
    TOO_MANY_STEPS: Ending.TOO_MANY_STEPS,
}
"""The endings of a run by the status of its solve; NOT_CONVERGED for all others."""


def simulate_system(
    system: System,
    length: Array,
    *,
    position: Any,
    velocity: Any,
    args: Any,
    times: Array | None,
    tolerance: float,
    v0: str | float,
    breakpoints: Any,
    most: int | None,
    tell: TellRun,
    throw: bool,
) -> SystemRun:
    """Simulate a mechanism; see `simulate`."""
    q, v = _vector("position", position), _vector("velocity", velocity)
    dtype = jnp.result_type(q, v)
    args = as_parameters(args, "args")
    system, args, q, v, length, times = _cast(dtype, (system, args, q, v, length, times))
    gaps = require_shapes(Mechanics(system, args), q, v)
    each = functools.partial(_for_each, gaps)
    system = eqx.tree_at(lambda s: (s.law, s.stiffness, s._exponent), system, replace_fn=each)
    mechanics = Mechanics(system, args)
    peak, floor = v0 == "peak", np.asarray(least_v0(v0), dtype)
    stops = _stops(breakpoints, length, dtype)
    within = np.asarray(max(tolerance / 100, 20 * float(jnp.finfo(dtype).eps)), dtype)
    numbers = jax.device_put((floor, within))
    plain = not traced((mechanics, q, v, length, stops))
    has_v0 = v0 != "touch"
    if plain:
        tell.says("compiling")
    state, checks, valid = _begin(mechanics, q, v, numbers[0], length, peak, has_v0)
    if plain:
        require_start(checks, has_v0)
    problem = SystemProblem(mechanics, state, stops, numbers[1], numbers[0])
    room = ROOM if most is None else most
    # One row more than contacts need shows whether there is another contact.
    rules = SystemRules(peak, 2 * (min(room, ROOM) if plain else room) + 1)
    end = _pieces(problem, rules, most, tell) if plain else _from_start(problem, rules)
    read, least = _read(problem, end, valid, None if plain and most is None else room)
    if plain:
        read["contacts"], read["phases"] = map(_trimmed, (read["contacts"], read["phases"]))
    if times is not None:
        read["states"] = read_states(problem, end.log, read["reached"], peak, times)
    run = SystemRun(
        steps=end.steps,
        error_estimate=end.error,
        duration=length,
        margin=SystemMargin(*least, problem, end.log, peak, end.painleve),
        **read,
    )
    return checked(run, throw, "simulate")


def _trimmed(table: Any) -> Any:
    """Return a table, if there is one, without blank rows."""
    kept = 0 if table is None else int(np.sum(np.asarray(table.valid)))
    return jax.device_put(jax.tree.map(lambda x: np.asarray(x)[:kept], table))


def _vector(name: str, value: Any) -> Array:
    """Return a vector of numbers; raise ValueError otherwise."""
    vector = as_parameter(value, name)
    if vector.ndim != 1 or vector.shape[0] == 0:
        raise refusal(name, "be a list of numbers", value)
    return vector


def _cast(dtype: Any, tree: Any) -> Any:
    """Return a tree whose floats have one precision."""

    def cast(leaf: Any) -> Any:
        other = eqx.is_inexact_array(leaf) and leaf.dtype != dtype
        return leaf.astype(dtype) if other else leaf

    return jax.tree.map(cast, tree)


def _for_each(gaps: int, numbers: Any) -> Any:
    """Return law, stiffness and exponent with one number for each gap."""

    def spread(leaf: Any) -> Array:
        leaf = as_parameter(leaf, "law") if is_plain(leaf) else leaf
        if leaf.ndim > 1 or leaf.shape not in ((), (1,), (gaps,)):
            raise ValueError(
                f"Law, stiffness and exponent must hold one number, or one for each of {gaps} "
                f"gaps, but hold an array of the shape {leaf.shape}."
            )
        if traced(leaf):
            return jnp.broadcast_to(leaf, (gaps,))
        return jax.device_put(np.broadcast_to(np.asarray(leaf), (gaps,)))

    return jax.tree.map(spread, numbers)


def _stops(breakpoints: Any, length: Array, dtype: Any) -> Array:
    """Return the times at which the force may jump within the run, and its end."""
    none = is_list(breakpoints) and len(breakpoints) == 0
    given: Any = np.zeros(0) if none else breakpoints
    points = as_parameter(given, "breakpoints")
    if points.ndim != 1:
        raise refusal("breakpoints", "be a list of times", breakpoints)
    if traced((points, length)):
        inside = jnp.clip(points.astype(dtype), 0, length)
        return jnp.concatenate([jnp.sort(inside), length[None]])
    inside, end = np.asarray(points, dtype), np.asarray(length, dtype)
    if not (np.all(np.isfinite(inside)) and np.all(inside >= 0)):
        raise refusal("breakpoints", "be at least 0", breakpoints)
    inside = np.unique(inside[(inside > 0) & (inside < end)])
    return jax.device_put(np.append(inside, end))


@quick
def _begin(
    mechanics: Mechanics,
    q: Vector,
    v: Vector,
    floor: Number,
    length: Number,
    peak: bool,
    has_v0: bool,
) -> tuple[SystemState, StartChecks, Flag]:
    state, checks = start_of(mechanics, jnp.zeros((), q.dtype), q, v, floor, peak)
    return state, checks, checks.valid(has_v0) & (length > 0)


_COMPILED: set[Any] = set()
"""The kinds of problems for which `_solved` is compiled."""

_solved = eqx.filter_jit(solved)
_from_start = eqx.filter_jit(functools.partial(solved, from_start=True))


def _pieces(
    problem: SystemProblem, rules: SystemRules, most: int | None, tell: TellRun
) -> SystemEnd:
    """Return the end of a run from Python, whose log grows by pieces."""
    pieces: list[SystemEnd] = []
    rest, contacts = problem, 0
    leaves, structure = jax.tree.flatten(problem)
    kind = rules, structure, *((x.shape, x.dtype) if hasattr(x, "dtype") else x for x in leaves)
    tell.says("running" if kind in _COMPILED else "compiling")
    while True:
        pieces.append(_solved(rest, rules))
        end = pieces[-1]
        _COMPILED.add(kind)
        contacts += int(np.sum(np.asarray(end.log.touches)))
        tell(contacts, "contacts", float(end.state.time), float(problem.stops[-1]))
        if int(end.status) != PAUSED or (
            most is not None and len(pieces) * (rules.rows - 1) >= 2 * most
        ):
            break
        rest = eqx.tree_at(lambda p: p.state, rest, end.state)
    return end if len(pieces) == 1 else _one_end(pieces)


def _one_end(pieces: list[SystemEnd]) -> SystemEnd:
    """Return the end of a run in several pieces, with the log of all."""

    def joined(*parts: Array) -> np.ndarray:
        return np.concatenate([np.asarray(part) for part in parts])

    end, logs = pieces[-1], [piece.log for piece in pieces]
    count = sum(int(log.count) for log in logs)
    states, touches, opens = jax.tree.map(
        joined, *((log.states, log.touches, log.opens) for log in logs)
    )
    log = SystemLog(states, touches, opens, jnp.asarray(count, jnp.int32))
    steps = np.asarray(sum(int(piece.steps) for piece in pieces), np.int32)
    error = np.asarray(sum(float(piece.error) for piece in pieces), end.error.dtype)
    end = end._replace(log=log, steps=steps, error=error)
    if end.painleve is not None:
        least = min(float(piece.painleve) for piece in pieces if piece.painleve is not None)
        end = end._replace(painleve=np.asarray(least, error.dtype))
    return jax.device_put(end)


@quick
def _read(
    problem: SystemProblem, end: SystemEnd, valid: Flag, room: int | None
) -> tuple[dict[str, Any], tuple[Number, Number]]:
    """Return the arguments of a `SystemRun` that are read from its end, with the states at both
    ends, and the least time between events and closing speed.
    """
    total = jnp.sum(end.log.touches) + jnp.sum(problem.state.closed)
    full = total > room if room is not None else jnp.asarray(False)
    over = (end.status == TIME_IS_UP) & ~full
    codes = jnp.asarray([_ENDINGS.get(k, Ending.NOT_CONVERGED) for k in range(max(_ENDINGS) + 1)])
    status = jnp.where(full, int(Ending.TOO_MANY_IMPACTS), codes[end.status])
    singular = _is_singular(problem, end.state) & (status >= int(Ending.NOT_CONVERGED))
    status = jnp.where(singular, int(Ending.SINGULAR_MASS), status)
    status = jnp.where(valid, status, int(Ending.INVALID_INPUT)).astype(jnp.int32)
    reached = jnp.where(over, problem.stops[-1], end.state.time)
    reached = jax.lax.stop_gradient(jnp.where(valid, reached, -1))
    table = contacts_of(end.log, end.state, room)
    table["valid"] = table["valid"] & valid
    blank = {
        name: nan_unless(column, table["valid"]) if column.dtype.kind == "f" else column
        for name, column in table.items()
    }
    between = _between(end.log)
    slowest = jnp.min(jnp.where(blank["valid"], blank["closing_speed"], jnp.inf), initial=jnp.inf)
    both = jax.tree.map(lambda *x: jnp.stack(x), problem.state, end.state)
    ends = jax.vmap(lambda state: reading_of(problem, state))(both)
    good = jnp.stack([valid, valid & over])
    ends = jax.tree.map(lambda x: nan_unless(x, good), ends)
    read = {"status": status, "reached": reached, "contacts": SystemContacts(**blank)}
    read |= {"states": ends, "final": jax.tree.map(lambda x: x[-1], ends), "phases": None}
    if problem.mechanics.system.sticks:
        read["phases"] = SystemPhases(**phases_of(end.log, problem.state))
    return read, (between, slowest)


def _is_singular(problem: SystemProblem, state: SystemState) -> Flag:
    """Return whether the mass matrix is finite but not positive definite just after a state."""
    ahead = jnp.finfo(state.time.dtype).eps ** 0.6 * problem.stops[-1]
    mechanics, q = problem.mechanics, state.position
    q = q + ahead * mechanics.rate(state.time, q, state.velocity)
    mass = mechanics.mass(state.time + ahead, q)
    solved = solve_mass(mass, jnp.ones_like(state.velocity))
    return jnp.all(jnp.isfinite(mass)) & ~jnp.all(jnp.isfinite(solved))


def _between(log: SystemLog) -> Number:
    """Return the least time between events of different gaps."""
    changes = log.touches | log.opens
    written, times = log.written, log.states.time
    if log.states.slide is not None:
        # Rows of changes between stick and slip are no events of gaps.
        events = written & jnp.any(changes, axis=1)
        order = jnp.argsort(~events, stable=True)
        changes, written, times = changes[order], events[order], times[order]
    together = jnp.any(written & (jnp.sum(changes, axis=1) > 1))
    other = jnp.any(changes[1:] != changes[:-1], axis=1) & written[1:]
    apart = jnp.where(other, times[1:] - times[:-1], jnp.inf)
    return jnp.where(together, 0, jnp.min(apart, initial=jnp.inf))
