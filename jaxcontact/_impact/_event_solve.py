"""What the event method solves: from touch to the turn, and from there to the end."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from .._forms import Flag, ScaledImpact
from .._varying import varying
from ._balance import Balance, balance_of
from ._ending import at_end
from ._event_in_step import event_in_step
from ._lean_dopri8 import LeanDopri8
from ._motion import Moment, Motion, Number, State
from ._peak import is_rising, largest_near
from ._return import onward
from ._rise import risen
from ._stiff import Followed, follow_on
from ._under_push import end_is_sharp, is_spent, turn_is_sharp
from ._watch import Nearest, Watch, Watching

# Far beyond any contact: a nominal end close to the event makes the step controller stall.
_FAR = 1e12
# The controller bounds the error of a step. Measured, the outcome is up to twenty times worse.
_SAFETY = 0.02
# Energies that differ by more than this, in units of rtol, come from a solve that missed something:
# measured up to 12.
_IMBALANCE = 100


class Options(Protocol):
    """What a solve asks of its method, `Event`."""

    @property
    def solver(self) -> diffrax.AbstractSolver | None:
        """A diffrax solver; None for Dopri8."""

    @property
    def adjoint(self) -> diffrax.AbstractAdjoint | None:
        """A diffrax adjoint; None for sensitivities carried along."""

    @property
    def max_steps(self) -> int:
        """The most steps of each half."""
        ...

    def tolerances(self, dtype: Any) -> tuple[float, float]:
        """The relative and absolute tolerance in a precision."""
        ...


class Steps(NamedTuple):
    """All accepted states of a leg, and when, in regularised time; which of them are real."""

    moments: Float[Array, " steps"]
    states: State
    taken: Bool[Array, " steps"]


class Leg(eqx.Module):
    """One half of an impact: its last state, whether its event ended it, and its number of steps.

    `nearest`: the states around the largest force, and `least` those around the least one, None
    where the contact cannot pull. `creeps`: whether a state showed that the bodies
    creep to rest. `path`: all states, None where nobody asked for them.
    """

    end: State
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]
    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    path: Steps | None


class Solve(NamedTuple):
    """How a leg is solved: the method, whether for many lanes, and whether all states are kept."""

    how: Options
    many: bool
    keep: bool = False


def solve_leg(motion: Motion, start: State, compressing: Flag, solve: Solve) -> Leg:
    """From touch to the turn if `compressing`, from the turn to the end otherwise."""
    how = solve.how

    def rate(t: object, state: State, args: tuple[Motion, Flag]) -> State:
        motion, compressing = args
        return motion.rate(state, compressing)

    def gap(which: int) -> Callable[..., Array]:
        # diffrax compares it with a Python 0.0, which has the default precision.
        dtype = jnp.zeros(()).dtype
        return lambda t, y, args, **kwargs: args[0].gaps(y, args[1])[which].astype(dtype)

    count = len(motion.gaps(start, compressing))
    # Neither a step nor a root can be more accurate than rounding.
    dtype = start.w.dtype
    finest = 10 * float(jnp.finfo(dtype).eps)
    rtol, atol = (_finest(tolerance, dtype) for tolerance in how.tolerances(dtype))
    ending, speed = jax.lax.stop_gradient(motion.smallness())
    rtol, atol = jnp.maximum(rtol * ending, finest), atol * ending * speed
    term = diffrax.ODETerm(rate)
    solver = LeanDopri8(solve.many) if how.solver is None else how.solver
    solver = _ready(solver, rtol, atol, how.adjoint is not None)
    at_end = diffrax.SubSaveAt(t1=True)
    all_states = [diffrax.SubSaveAt(t0=True, steps=True)] if solve.keep else []
    # Python numbers would give the time the default precision, and the state with it. A first step
    # given as an array would be checked at run time, by a callback: the controller chooses it. A
    # root finder of diffrax would bring a callback into the derivative: the event's moment is found
    # below, and the solve ends with the step that contains it.
    solution = diffrax.diffeqsolve(
        term,
        Watching(solver),
        t0=varying(start.w, jnp.zeros((), dtype)),
        t1=jnp.asarray(_FAR, dtype),
        dt0=None,
        y0=start,
        args=(motion, compressing),
        saveat=diffrax.SaveAt(subs=[at_end, *all_states], solver_state=True),
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
        event=diffrax.Event(tuple(map(gap, range(count))), direction=(False,) * count),
        adjoint=diffrax.ForwardMode() if how.adjoint is None else how.adjoint,
        max_steps=how.max_steps,
        throw=False,
    )
    steps = solution.stats["num_accepted_steps"]
    arrived = jnp.asarray(solution.result == diffrax.RESULTS.event_occurred)
    moments, states = cast(Any, solution.ts), cast(Any, solution.ys)
    watch: Watch = cast(Any, solution.solver_state)[1]
    # Where no step was accepted the last one has no length, which would make its lane NaN: the leg
    # stays where it started.
    moved = steps > 0
    after = Moment(*jax.tree.map(lambda leaf: leaf[-1], (moments[0], states[0])))
    after = after._replace(tau=jnp.where(moved, after.tau, 1))
    before = watch.last
    if watch.dip is not None:
        dip = watch.dip.seen(motion, before, after)
        closes, bottom = dip.bottom(motion)
        dipped = closes & ~compressing
        before, after = (
            jax.tree.map(functools.partial(jnp.where, dipped), *both)
            for both in ((dip.start, before), (bottom, after))
        )
        arrived = arrived | dipped
    found, smooth = event_in_step(term, solver, before, after, motion, compressing, arrived)
    end = jax.tree.map(functools.partial(jnp.where, moved), found, before)
    watch = watch.seen(motion, compressing, end)
    path = None
    if solve.keep:
        path = _kept(moments[1], states[1], end, before.tau)
    return Leg(
        end=end.state,
        arrived=arrived & smooth,
        steps=steps,
        nearest=watch.nearest,
        least=watch.least,
        creeps=watch.creeps,
        path=path,
    )


def _kept(moments: Float[Array, " steps"], states: State, end: Moment, last: Number) -> Steps:
    """All states until `last`, the moment of the last but one, and the end after it."""
    steps = jnp.sum(moments <= last)
    is_end = jnp.arange(moments.size) == steps
    return Steps(
        jnp.where(is_end, end.tau, moments),
        jax.tree.map(functools.partial(jnp.where, is_end), end.state, states),
        jnp.arange(moments.size) <= steps,
    )


def _ready(solver: Any, rtol: Number, atol: Number | float, backwards: bool) -> Any:
    """The solver with what diffrax fills in for a whole solve, so that it can take one step."""
    if isinstance(solver, diffrax.AbstractRungeKutta):
        # The fast loop over the stages has no reverse mode, which a given adjoint may need.
        kind = "bounded" if backwards else "lax"
        solver = eqx.tree_at(lambda s: s.scan_kind, solver, kind, is_leaf=lambda x: x is None)
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        defaults = {"rtol": rtol, "atol": atol, "norm": optx.rms_norm}
        for name, default in defaults.items():
            given = getattr(solver.root_finder, name)
            if not (callable(given) or eqx.is_array_like(given)):
                at = operator.attrgetter(f"root_finder.{name}")
                solver = eqx.tree_at(at, solver, default)
    return solver


class Legs(NamedTuple):
    """The legs of an impact, stacked: the way in, the way out and, where the force of a contact may
    vanish and return before the bodies are apart, the way out from there.

    `compressing`: whether each is the way in. `returned`: whether the last leg took place. None
    where there are two.
    """

    leg: Leg
    compressing: Bool[Array, " legs"]
    returned: Bool[Array, ""] | None


def solve_legs(motion: Motion, solve: Solve, start: State | None = None) -> Legs:
    """All legs of an impact, from touch or a later `start`, by the same compiled solve."""
    # A sampled motion has two.
    third = motion.may_return and not solve.keep
    start = motion.start() if start is None else start

    def run(carry: tuple[State, Number], compressing: Flag) -> tuple[Any, Any]:
        state, deepest = carry
        leg = solve_leg(motion, state, compressing, solve)
        # The event puts the velocity at the turn within its tolerance of zero: now it is zero.
        following = motion.still(leg.end)
        if not third:
            return (following, deepest), (leg, None)
        deepest = jnp.where(compressing, leg.end.w**motion.order, deepest)
        on = onward(motion, leg.end, deepest)
        returned = on.returns & leg.arrived & ~compressing & ~motion.settled(leg.end)
        back = _chosen(returned, on.state, motion.parting(leg.end))
        following = _chosen(compressing, following, back)
        return (following, deepest), (leg, returned)

    flags = jnp.asarray([True, False, False][: 3 if third else 2])
    legs, returned = jax.lax.scan(run, (start, start.w), flags)[1]
    return Legs(legs, flags, None if returned is None else returned[1])


def was_followed(
    motion: Motion, arrived: Bool[Array, "2"], end: State, balance: Balance, how: Options
) -> Bool[Array, ""]:
    """Whether both legs reached their ends, and their energies add up.

    What always parts but was turned round, by rounding at the end of a slow way out, was not
    followed to its end; what creeps back for ever has none.
    """
    allowed = _IMBALANCE * how.tolerances(end.t.dtype)[0]
    good = jnp.all(arrived) & (balance.error <= allowed)
    if motion.always_parts:
        good = good & ~motion.settled(end) & ~motion.creeps_back()
    return good


def follow(motion: Motion, legs: Leg, creeps: Bool[Array, ""], how: Options) -> Followed:
    """Both legs to their ends, those that are too stiff for explicit steps by implicit ones."""
    turn, end = (jax.tree.map(operator.itemgetter(leg), legs.end) for leg in (0, 1))
    followed = Followed(turn, end, legs.arrived[:2], creeps, jnp.sum(legs.steps[:2]))
    # A solver or an adjoint of the user's is not replaced.
    if not motion.may_creep or how.solver is not None or how.adjoint is not None:
        return followed
    dtype = turn.w.dtype
    return follow_on(motion, followed, _finest(how.tolerances(dtype)[0], dtype))


def solve_event(motion: Motion, how: Options, many: bool) -> ScaledImpact:
    """The outcome of one lane, of `many` or of few."""
    motion, start = risen(motion) if motion.peak else (motion, None)
    motion = motion.ready()
    legs, flags, returned = solve_legs(motion, Solve(how, many), start)
    creeps_early = jnp.asarray(False) if legs.creeps is None else legs.creeps[0]
    followed = follow(motion, legs, creeps_early, how)
    turn, creeps = followed.turn, followed.creeps
    max_indentation = turn.w**motion.order
    last, arrived = followed.end, followed.arrived
    if returned is not None:
        # Not where implicit steps have taken the way out again.
        returned = returned & (followed.end.t == legs.end.t[1])
        last = _chosen(returned, jax.tree.map(operator.itemgetter(2), legs.end), last)
        arrived = arrived & jnp.stack([flags[0], ~returned | legs.arrived[2]])
    end = at_end(motion, last, arrived[1], max_indentation)
    # Apart from the solve, so that it is removed where the largest force is not used.
    forces = jax.vmap(
        lambda near, flag: largest_near(motion, near.before, near.at, near.after, flag)
    )(legs.nearest, flags)
    # With so much damping that implicit steps are taken the force is largest in the beginning.
    largest = jnp.maximum(forces[0], forces[1])
    if returned is not None:
        largest = jnp.where(returned, jnp.maximum(largest, forces[2]), largest)
    max_force = jnp.maximum(largest, motion.force(turn, flags[0]))
    compression_time = turn.t
    balance = balance_of(motion, end, max_indentation)
    converged = was_followed(motion, arrived, end, balance, how)
    settled = motion.settled(end)
    if motion.push is not None:
        # What has too little energy to part stays, wherever the solve of its way out came to.
        held = followed.arrived[0] & (motion.held(turn) | motion.held(end))
        rtol, _ = how.tolerances(turn.w.dtype)
        known = jnp.where(
            settled | held,
            is_spent(motion, end, rtol),
            end_is_sharp(motion, turn, end, rtol),
        )
        known = known & turn_is_sharp(motion, turn, _finest(rtol, turn.w.dtype), rtol)
        converged = ((converged | held) & known) | creeps
        settled = settled | held | creeps
        # What creeps to rest never turns: where a turn was found it is one of rounding, and the
        # way out of it is none.
        static = motion.static_indentation()
        if static is not None:
            max_indentation = jnp.where(creeps, static, max_indentation)
        max_force = jnp.where(creeps, jnp.maximum(forces[0], motion.push), max_force)
        compression_time = jnp.where(creeps, jnp.inf, compression_time)
    if motion.may_return:
        # A force that returns once more has no leg left.
        onwards = onward(motion, end, max_indentation)
        converged = converged & (settled | ~onwards.returns)
    if motion.always_parts:
        # Nothing but a creep for ever keeps these bodies together.
        settled = motion.creeps_back()
        converged = converged | (settled & followed.arrived[0])
    # Where explicit steps were left before the force was largest nobody has seen how large it was.
    left = jax.tree.map(operator.itemgetter(0), legs.end)
    # What creeps to rest slows down in the end: then its force is more than the push. The largest
    # one among the states will do, so that the one between them is computed only where it is used.
    rtol, _ = how.tolerances(turn.w.dtype)
    above = creeps_early & (
        legs.nearest.force[0] >= (1 - 10 * rtol) * (0 if motion.push is None else motion.push)
    )
    seen = legs.arrived[0] | above | ~is_rising(motion, left, flags[0])
    converged = converged & seen
    steps = followed.steps
    if returned is not None:
        steps = steps + jnp.where(returned, legs.steps[2], 0)
    end_indentation = None if motion.form.tension else jnp.where(settled, 0, end.w**motion.order)
    spare_energy = None if motion.push is None else motion.spare_energy(end)
    return ScaledImpact(
        restitution=balance.restitution,
        duration=end.t,
        compression_time=compression_time,
        max_indentation=max_indentation,
        max_force=max_force,
        converged=converged,
        settled=settled,
        min_force=_least_force(motion, legs.least),
        energy_loss=balance.energy_loss,
        steps=steps,
        end_indentation=end_indentation,
        spare_energy=spare_energy,
    )


def _least_force(motion: Motion, least: Nearest | None) -> Number | None:
    """The least force of the way out, which is not above that at touch."""
    if least is None:
        return None
    near, out = jax.tree.map(operator.itemgetter(1), least), jnp.asarray(False)
    return -jnp.maximum(largest_near(motion, near.before, near.at, near.after, out, -1), 0)


def _chosen(first: Flag, yes: State, no: State) -> State:
    return jax.tree.map(functools.partial(jnp.where, first), yes, no)


def _finest(tolerance: float, dtype: Any) -> float:
    """The tolerance of a step for one of the outcome; no step is more accurate than rounding."""
    return max(_SAFETY * tolerance, 10 * float(jnp.finfo(dtype).eps))
