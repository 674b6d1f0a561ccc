"""The solve of the event method: from touch to the turn, and from there to the end."""

from __future__ import annotations

import dataclasses
import functools
import operator
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._forms import Flag, HuntCrossleyForm, ScaledImpact
from ..._functions import power
from ..._solver import Marched, Packed, Record, Tolerance, chosen, land, march
from ..._solver.runge_kutta import step
from ..motion.ending import Balance, at_end, balance_of
from ..motion.force_return import onward
from ..motion.motion import Motion, Number, State
from ..motion.peak import is_rising, largest_near
from ..motion.under_push import end_is_sharp, force_is_sharp, is_spent, turn_is_sharp
from ..motion.watch import Nearest, Watch, Way
from .stiff import Followed, follow_on

# The controller bounds the error of a step. The measured error of the outcome is up to twenty times
# larger.
_SAFETY = 0.02
# A larger energy imbalance, in units of rtol, means that the solve missed something. The largest
# one measured is 12.
_IMBALANCE = 100

if TYPE_CHECKING:
    import diffrax

# Measured: 32 steps of order 8 have an error of 1e-13 from Γ = 1e-6 to 1e3.
_STEPS = 32


class Options(Protocol):
    """The options that a solve needs from its method, `Event`."""

    @property
    def solver(self) -> diffrax.AbstractSolver | None:
        """A diffrax solver; None for the library's own loop."""

    @property
    def adjoint(self) -> diffrax.AbstractAdjoint | None:
        """A diffrax adjoint; None for sensitivities carried along."""

    @property
    def max_steps(self) -> int:
        """The largest number of steps of each half."""
        ...

    def tolerances(self, dtype: Any) -> tuple[float, float]:
        """Return the relative and absolute tolerance in a precision."""
        ...


class Steps(NamedTuple):
    """All accepted states of a leg and their regularised times; `taken` marks the real ones."""

    moments: Float[Array, " steps"]
    states: State
    taken: Bool[Array, " steps"]


class Leg(eqx.Module):
    """One half of an impact: its last state, whether its event ended it, and its number of steps.

    `nearest` holds the states around the largest force. `least` holds those around the least force,
    None if the contact cannot pull. `creeps`: whether the bodies were found to creep to rest.
    `path` holds all states, None unless requested.
    """

    end: State
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]
    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    path: Steps | None


class Solve(NamedTuple):
    """The settings of a leg's solve: method, whether for many lanes, whether to keep states."""

    how: Options
    many: bool
    keep: bool = False


def solve_leg(motion: Motion, start: State, compressing: Flag, solve: Solve) -> Leg:
    """Solve from touch to the turn if `compressing`, else from the turn to the end."""
    how, dtype = solve.how, start.w.dtype
    way = Way(motion, compressing)
    packed = Packed.of(start, solve.many, how.adjoint is not None)
    begun = Watch.begin(motion, packed)

    def see(watch: Watch, last: Record, now: Record) -> Watch:
        return watch.seen(way, packed, last, now)

    tolerance = _tolerance(motion, how, dtype)
    given = way, packed, tolerance, begun, see, solve.keep
    if how.solver is None and how.adjoint is None:
        last = march(*given)
    else:
        from ..._solver.by_diffrax import march_by_diffrax

        last = march_by_diffrax(*given, how.solver, how.adjoint)
    # If no step was accepted, the leg stays at its start.
    watch, moved = last.seen, last.steps > 0
    if watch.dip is not None:
        frozen, after = jax.lax.stop_gradient((way, last.after))
        seen = watch.dip.seen(frozen.motion, packed, last.before, after)
        closes, bottom = seen.bottom(frozen, packed)
        dipped = closes & ~compressing
        guards = functools.partial(packed.guards, frozen)
        opened, left = packed.each(guards, seen.start, bottom)
        closed = (opened > 0) & (left <= 0)
        dip = last._replace(before=seen.start, after=bottom, closed=closed)
        last = chosen(dipped, dip, last)
    end, smooth = land(way, packed, last)
    watch = see(watch, last.before, end)
    # A creeping contact may come so close to its end that a step does not show whether it ends.
    clear = compressing | (packed.state(last.before).w > tolerance.atol)
    return Leg(
        end=packed.state(end),
        arrived=jnp.any(last.closed) & smooth & moved & clear,
        steps=last.steps,
        nearest=watch.nearest,
        least=watch.least,
        creeps=watch.creeps,
        path=None if last.path is None else _kept(packed, last, end),
    )


def _tolerance(motion: Motion, how: Options, dtype: Any) -> Tolerance:
    """Return the tolerance of a step; neither a step nor a root is more accurate than rounding."""
    finest = 10 * float(jnp.finfo(dtype).eps)
    rtol, atol = (_finest(tolerance, dtype) for tolerance in how.tolerances(dtype))
    ending, speed = jax.lax.stop_gradient(motion.smallness())
    rtol = jnp.maximum(jnp.asarray(rtol * ending, dtype), finest)
    return Tolerance(rtol, atol * ending * speed, how.max_steps)


def _kept(packed: Packed[State], last: Marched, end: Record) -> Steps:
    """Return all states up to the start of the last step, and the end after them."""
    moments = jax.vmap(packed.moment)(last.path)
    index = jnp.arange(moments.tau.size)
    steps = jnp.sum((index < last.steps) & (moments.tau <= packed.tau(last.before)))
    moments = jax.vmap(lambda here, at: chosen(here, packed.moment(end), at))(
        index == steps, moments
    )
    return Steps(moments.tau, moments.state, index <= steps)


class Legs(NamedTuple):
    """The legs of an impact, stacked: compression, restitution and possibly a second way out.

    The second way out starts where a force that vanished returns before the bodies are apart.
    `compressing`: whether each leg is the compression. `returned`: whether the last leg took place;
    None if there are only two.
    """

    leg: Leg
    compressing: Bool[Array, " legs"]
    returned: Bool[Array, ""] | None


def solve_legs(motion: Motion, solve: Solve, start: State | None = None) -> Legs:
    """Solve all legs of an impact, from touch or a later `start`, with one compiled solve."""
    # A sampled motion has two legs.
    third = motion.may_return and not solve.keep
    start = motion.start() if start is None else start

    # A contact without a memory does not take its largest indentation.
    motion = motion.remembering(jnp.zeros_like(start.w))

    def run(carry: tuple[State, Number], compressing: Flag) -> tuple[Any, Any]:
        state, deepest = carry
        now = motion.remembering(deepest)
        leg = solve_leg(now, state, compressing, solve)
        # The event finds the velocity at the turn within its tolerance of zero. Here it is set to
        # zero.
        _, following = motion.after_turn(leg.end)
        deepest = jnp.where(compressing, motion.indentation(leg.end.w), deepest)
        if not third:
            return (following, deepest), (leg, None)
        on = onward(now, leg.end, deepest)
        returned = on.returns & leg.arrived & ~compressing & ~now.settled(leg.end)
        back = chosen(returned, on.state, now.parting(leg.end))
        following = chosen(compressing, following, back)
        return (following, deepest), (leg, returned)

    flags = jnp.asarray([True, False, False][: 3 if third else 2])
    legs, returned = jax.lax.scan(run, (start, start.w), flags)[1]
    return Legs(legs, flags, None if returned is None else returned[1])


def was_followed(
    motion: Motion, arrived: Bool[Array, "2"], end: State, balance: Balance, how: Options
) -> Bool[Array, ""]:
    """Return whether both legs reached their ends, and their energies balance. A contact that must
    separate but reversed because of rounding counts as not converged. A contact that creeps forever
    has no end time.
    """
    allowed = _IMBALANCE * how.tolerances(end.t.dtype)[0]
    good = jnp.all(arrived) & (balance.error <= allowed)
    if motion.always_parts:
        good = good & ~motion.settled(end) & ~motion.creeps_back()
    return good


def follow(motion: Motion, legs: Leg, creeps: Bool[Array, ""], how: Options) -> Followed:
    """Return both legs solved to their ends; stiff ones are continued by implicit steps."""
    turn, end = (jax.tree.map(operator.itemgetter(leg), legs.end) for leg in (0, 1))
    followed = Followed(turn, end, legs.arrived[:2], creeps, jnp.sum(legs.steps[:2]))
    # A user's solver or adjoint is not replaced.
    if not motion.may_creep or how.solver is not None or how.adjoint is not None:
        return followed
    dtype = turn.w.dtype
    return follow_on(motion, followed, _finest(how.tolerances(dtype)[0], dtype))


def solve_event(motion: Motion, how: Options, many: bool) -> ScaledImpact:
    """Return the outcome of one lane, of `many` or of few."""
    motion, start = risen(motion) if motion.peak else (motion, None)
    motion = motion.ready()
    legs, flags, returned = solve_legs(motion, Solve(how, many), start)
    creeps_early = jnp.asarray(False) if legs.creeps is None else legs.creeps[0]
    followed = follow(motion, legs, creeps_early, how)
    turn, creeps = followed.turn, followed.creeps
    max_indentation = motion.indentation(turn.w)
    begun = turn
    if motion.form.remembers:
        # From the turn on, the energy that the contact keeps counts as lost.
        motion, begun = motion.after_turn(turn)
    last, arrived = followed.end, followed.arrived
    if returned is not None:
        # Not if implicit steps have solved the way out again.
        returned = returned & (followed.end.t == legs.end.t[1])
        last = chosen(returned, jax.tree.map(operator.itemgetter(2), legs.end), last)
        arrived = arrived & jnp.stack([flags[0], ~returned | legs.arrived[2]])
    end = at_end(motion, last, arrived[1], max_indentation)
    # Separate from the solve, so that it is removed as dead code if the largest force is unused.
    packed = Packed.of(turn, many, how.adjoint is not None)
    forces = jax.lax.map(
        lambda leg: largest_near(Way(motion, leg[1]), packed, leg[0]), (legs.nearest, flags)
    )
    # With damping strong enough for implicit steps, the force is largest at the beginning.
    largest = jnp.maximum(forces[0], forces[1])
    if returned is not None:
        largest = jnp.where(returned, jnp.maximum(largest, forces[2]), largest)
    max_force = jnp.maximum(largest, motion.force(turn, flags[0]))
    compression_time = turn.t
    balance = balance_of(motion, end, max_indentation)
    converged = was_followed(motion, arrived, end, balance, how)
    settled = motion.settled(end)
    if motion.push is not None:
        # A contact with too little energy to separate stays, regardless of its way out.
        rtol, _ = how.tolerances(turn.w.dtype)
        sound = balance_of(motion, begun, max_indentation).error <= _IMBALANCE * rtol
        held = followed.arrived[0] & sound & (motion.held(begun) | motion.held(end))
        spent = is_spent(motion, end, rtol)
        if motion.form.remembers or motion.adheres:
            # Such a contact also stays if its remaining energy is elastic.
            spent = spent | held
        known = jnp.where(settled | held, spent, end_is_sharp(motion, begun, end, rtol))
        if motion.form.remembers:
            known = known & (settled | held | force_is_sharp(motion, end, rtol))
        known = known & turn_is_sharp(motion, begun, _finest(rtol, turn.w.dtype), rtol)
        converged = ((converged | held) & known) | creeps
        settled = settled | held | creeps
        # A contact that creeps to rest never turns: any turn found is due to rounding, and its way
        # out is invalid.
        static = motion.static_indentation()
        if static is not None:
            max_indentation = jnp.where(creeps, static, max_indentation)
        max_force = jnp.where(creeps, jnp.maximum(forces[0], motion.push), max_force)
        compression_time = jnp.where(creeps, jnp.inf, compression_time)
    if motion.may_return:
        # A force that returns a second time has no leg left.
        onwards = onward(motion, end, max_indentation)
        converged = converged & (settled | ~onwards.returns)
    if motion.always_parts:
        # Only creep forever keeps these bodies together.
        settled = motion.creeps_back()
        converged = converged | (settled & followed.arrived[0])
    if motion.may_creep:
        # If the explicit solver stopped before the force peak, the peak is unknown. Otherwise it
        # arrived, or the solve has not converged.
        left = jax.tree.map(operator.itemgetter(0), legs.end)
        # Bodies that creep to rest slow down, so their force finally exceeds the push. The largest
        # force at the states suffices here; the peak between them is then computed only if used.
        rtol, _ = how.tolerances(turn.w.dtype)
        least = (1 - 10 * rtol) * (0 if motion.push is None else motion.push)
        above = creeps_early & (legs.nearest.force[0] >= least)
        converged = converged & (legs.arrived[0] | above | ~is_rising(motion, left, flags[0]))
    steps = followed.steps
    if returned is not None:
        steps = steps + jnp.where(returned, legs.steps[2], 0)
    end_indentation = None
    if motion.form.ends_apart or not motion.form.tension:
        end_indentation = jnp.where(settled, 0, motion.indentation(end.w))
    spare_energy = None if motion.push is None else motion.spare_energy(end)
    return ScaledImpact(
        restitution=balance.restitution,
        duration=end.t,
        compression_time=compression_time,
        max_indentation=max_indentation,
        max_force=max_force,
        converged=converged,
        settled=settled,
        min_force=_least_force(motion, packed, legs.least),
        energy_loss=balance.energy_loss,
        steps=steps,
        end_indentation=end_indentation,
        spare_energy=spare_energy,
    )


def _least_force(motion: Motion, packed: Packed[State], least: Nearest | None) -> Number | None:
    """Return the least force of the way out, which is at most the force at touch."""
    if least is None:
        return None
    near, out = jax.tree.map(operator.itemgetter(1), least), Way(motion, jnp.asarray(False))
    return -jnp.maximum(largest_near(out, packed, near, -1), 0)


def _finest(tolerance: float, dtype: Any) -> float:
    """Return the tolerance of a step for a tolerance of the outcome, not below rounding."""
    return max(_SAFETY * tolerance, 10 * float(jnp.finfo(dtype).eps))


class _Risen(NamedTuple):
    """The integration variable `place`, v, t and the energy taken by damping."""

    place: Number
    velocity: Number
    time: Number
    loss: Number


def risen(motion: Motion) -> tuple[Motion, State]:
    """Return the motion and the state at the largest closing speed, to which damping now refers.

    The damping of the Hunt-Crossley family refers to the largest closing speed since touch. While
    the speed rises, that is the current speed, and the force is xⁿ (1 + α(v)). The force grows from
    0 to the push Γ, where the speed is largest. It serves as the independent variable, Γ s^(2n)
    with s from 0 to 1. The motion is smooth in s and needs neither an event nor a step control.
    """
    form = cast(HuntCrossleyForm, motion.form)
    assert motion.push is not None
    n, pushed = motion.n, motion.push > 0
    push = jnp.where(pushed, motion.push, 1)

    def damping(v: Number) -> tuple[Number, Number]:
        return jax.jvp(form.alpha_at, (v,), (jnp.ones_like(v),))

    start = motion.start()
    one = jnp.ones_like(start.w)
    # A push that makes the bodies much faster does so within a small part of the way. There the
    # places are exponentially closer.
    fastest = 2 * push * power(push / (1 + form.alpha_at(one)), 1 / n)
    grade = jax.lax.stop_gradient(jnp.arcsinh(jnp.sqrt(fastest)))

    def rate(risen: _Risen) -> _Risen:
        y, v, _, _ = risen
        s = jnp.sinh(grade * y) / jnp.sinh(grade)
        alpha, change = damping(v)
        unit = power(push / (1 + alpha), 1 / n)
        left = push * (1 - power(s, 2 * n))
        stiff = n * push / unit * v + jnp.square(s) * power(unit, n) * change * left
        slow = 2 * n * push * s / stiff * grade * jnp.cosh(grade * y) / jnp.sinh(grade)
        return _Risen(one, left * slow, slow, power(unit * jnp.square(s), n) * alpha * v * slow)

    zero = jnp.zeros_like(one)
    first = _Risen(zero, one, zero, zero)
    last, _ = jax.lax.scan(
        lambda at, _: (step(rate, at, one / _STEPS), None), first, None, length=_STEPS
    )
    alpha = form.alpha_at(last.velocity)
    # Without a push the speed does not rise.
    latched = jnp.where(pushed, alpha / last.velocity, form.alpha)
    motion = dataclasses.replace(
        motion, form=HuntCrossleyForm(alpha=latched, tension=form.tension), peak=False
    )
    place = power(push / (1 + alpha), 1 / (n * motion.order))
    begun = motion.start()
    state = State(place, last.velocity + motion.creep(place), last.time, last.loss)
    return motion, jax.tree.map(lambda a, b: jnp.where(pushed, a, b), state, begun)
