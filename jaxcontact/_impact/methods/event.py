"""The event method: an adaptive solve from touch to the turn, and from there to the end."""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._entry import require_kind
from ..._forms import AbstractForm, Flag, HuntCrossleyForm, ScaledImpact
from ..._functions import power
from ..._solver import Marched, Packed, Record, Tolerance, chosen, land, march
from ..._solver.few_or_many import MANY
from ..._solver.runge_kutta import step
from ..derivatives import common_shape, over_lanes, with_sensitivity
from ..front_door import Lanes
from ..motion.coordinates import Number, State
from ..motion.ends import (
    Followed,
    Way,
    at_end,
    has_settled,
    may_return,
    onward,
    spare_energy,
    verdict_of,
)
from ..motion.equation import Motion
from ..motion.errors import balance_of, finest, smallness
from ..motion.peak import Nearest, Watch, is_rising, largest_near
from .method import AbstractMethod, count_field, tolerance_field
from .stiff import follow_on

if TYPE_CHECKING:
    import diffrax

Out = TypeVar("Out")

# Measured: 32 steps of order 8 have an error of 1e-13 from Γ = 1e-6 to 1e3.
_STEPS = 32

# At this rtol and below, derivatives are assumed to matter: then x is a higher power of w, which
# costs steps.
_FOR_SLOPES = 1e-10


def _of_diffrax(kind: str, name: str) -> Any:
    """Return a field for a diffrax object of some kind; None for the default."""

    def convert(value: Any) -> Any:
        if value is None:
            return None
        import diffrax

        return require_kind(name, value, getattr(diffrax, kind), f"a diffrax {kind} or None")

    return eqx.field(default=None, converter=convert)


class Event(AbstractMethod):
    """An adaptive solve that ends with the contact, for every law and with an external force.

    - `rtol`, `atol`: tolerances of the outcome in scaled units, in (0, 1). The default `rtol` is
      1e-9, and 1e-5 in float32, whose rounding allows no less. The default `atol` is `rtol`. Use
      1e-11 for derivatives.
    - `solver`: a diffrax solver. Default: the library's own loop, with the coefficients of Dopri8.
    - `adjoint`: a diffrax adjoint. Default: sensitivities for forward and reverse mode.
    - `max_steps`: the largest number of steps of each half, at least 2.

    A given `solver` or `adjoint` runs in `diffrax.diffeqsolve`, an adjoint alone with Dopri8.
    Numbers may be Python, NumPy or JAX scalars. Raises ValueError for an option out of its range.
    Source: diffrax, Kidger (2021), doi 10.48550/arXiv.2202.02435.
    """

    rtol: float | None = tolerance_field("rtol")
    atol: float | None = tolerance_field("atol")
    solver: diffrax.AbstractSolver[Any] | None = _of_diffrax("AbstractSolver", "solver")
    adjoint: diffrax.AbstractAdjoint | None = _of_diffrax("AbstractAdjoint", "adjoint")
    max_steps: int = count_field("max_steps", 256)
    name: ClassVar[str] = "event"

    @property
    def solved_by(self) -> str:
        """What takes the steps, in words."""
        if self.solver is None and self.adjoint is None:
            return "the library's own loop with Dopri8's coefficients"
        solver = "Dopri8" if self.solver is None else type(self.solver).__name__
        return f"diffrax.diffeqsolve with {solver}"

    def __repr__(self) -> str:
        return f"{super().__repr__()} by {self.solved_by}"

    def chosen(self, form: AbstractForm, pushed: bool) -> Event:
        """Return the method itself."""
        return self

    def error(self, dtype: Any) -> float:
        """Return a hundred times the relative tolerance."""
        return 100 * self.tolerances(dtype)[0]

    def solve(self, lanes: Lanes) -> ScaledImpact:
        """Return the outcome of every distinct lane."""
        return self.over(lanes.motion(), solve_event)

    def over(self, motion: Motion, solve_lane: Callable[..., Out]) -> Out:
        """Apply `solve_lane(motion, how=self, many=)` to every distinct lane, with derivatives."""
        # A CPU takes lanes in chunks, which are few.
        ours = self.solver is None and self.adjoint is None and jax.default_backend() != "cpu"
        many = ours and math.prod(common_shape(motion)) >= MANY
        lane = eqx.Partial(solve_lane, how=self, many=many)
        rtol, _ = self.tolerances(jax.tree.leaves(motion)[0].dtype)
        motion = dataclasses.replace(motion, smooth=rtol <= _FOR_SLOPES)
        # A user's adjoint provides its own derivatives.
        lane = lane if self.adjoint is not None else with_sensitivity(lane)
        return over_lanes(lane, motion)

    def tolerances(self, dtype: Any) -> tuple[float, float]:
        """Return the relative and absolute tolerance in a precision."""
        double = dtype == jnp.float64
        floor = 0.0 if double else 1e-5
        rtol = max(self.rtol or (1e-9 if double else 1e-5), floor)
        return rtol, max(self.atol or rtol, floor)


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

    how: Event
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


def _tolerance(motion: Motion, how: Event, dtype: Any) -> Tolerance:
    """Return the tolerance of a step; neither a step nor a root is more accurate than rounding."""
    least = 10 * float(jnp.finfo(dtype).eps)
    rtol, atol = (finest(tolerance, dtype) for tolerance in how.tolerances(dtype))
    ending, speed = jax.lax.stop_gradient(smallness(motion))
    rtol = jnp.maximum(jnp.asarray(rtol * ending, dtype), least)
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
    third = may_return(motion) and not solve.keep
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
        returns, state = onward(now, leg.end, deepest)
        returned = returns & leg.arrived & ~compressing & ~has_settled(now, leg.end)
        back = chosen(returned, state, now.parting(leg.end))
        following = chosen(compressing, following, back)
        return (following, deepest), (leg, returned)

    flags = jnp.asarray([True, False, False][: 3 if third else 2])
    legs, returned = jax.lax.scan(run, (start, start.w), flags)[1]
    return Legs(legs, flags, None if returned is None else returned[1])


def follow(motion: Motion, legs: Leg, creeps: Bool[Array, ""], how: Event) -> Followed:
    """Return both legs solved to their ends; stiff ones are continued by implicit steps."""
    turn, end = (jax.tree.map(operator.itemgetter(leg), legs.end) for leg in (0, 1))
    followed = Followed(turn, end, legs.arrived[:2], creeps, jnp.sum(legs.steps[:2]))
    # A user's solver or adjoint is not replaced.
    if not motion.may_creep or how.solver is not None or how.adjoint is not None:
        return followed
    dtype = turn.w.dtype
    return follow_on(motion, followed, finest(how.tolerances(dtype)[0], dtype))


def solve_event(motion: Motion, how: Event, many: bool) -> ScaledImpact:
    """Return the outcome of one lane, of `many` or of few."""
    motion, start = risen(motion) if motion.peak else (motion, None)
    motion = motion.ready()
    legs = solve_legs(motion, Solve(how, many), start)
    early = jnp.asarray(False) if legs.leg.creeps is None else legs.leg.creeps[0]
    followed = follow(motion, legs.leg, early, how)
    turn, creeps = followed.turn, followed.creeps
    max_indentation = motion.indentation(turn.w)
    begun = turn
    if motion.form.remembers:
        # From the turn on, the energy that the contact keeps counts as lost.
        motion, begun = motion.after_turn(turn)
    followed, returned = _with_return(followed, legs)
    end = at_end(motion, followed.end, followed.arrived[1], max_indentation)
    # Separate from the solve, so that it is removed as dead code if the largest force is unused.
    packed = Packed.of(turn, many, how.adjoint is not None)
    first_force, max_force = _largest_force(motion, packed, legs, returned)
    max_force = jnp.maximum(max_force, motion.force(turn, legs.compressing[0]))
    compression_time = turn.t
    balance = balance_of(motion, end, max_indentation)
    rtol, _ = how.tolerances(turn.w.dtype)
    verdict = verdict_of(
        motion, followed._replace(turn=begun, end=end), balance, max_indentation, rtol
    )
    converged, settled = verdict.known, verdict.stays
    if motion.push is not None:
        # A contact that creeps to rest never turns: any turn found is due to rounding, and its way
        # out is invalid.
        static = motion.static_indentation()
        if static is not None:
            max_indentation = jnp.where(creeps, static, max_indentation)
        max_force = jnp.where(creeps, jnp.maximum(first_force, motion.push), max_force)
        compression_time = jnp.where(creeps, jnp.inf, compression_time)
    if motion.may_creep:
        converged = converged & _peak_is_known(motion, legs, early, rtol)
    end_indentation = None
    if motion.form.ends_apart or not motion.form.tension:
        end_indentation = jnp.where(settled, 0, motion.indentation(end.w))
    return ScaledImpact(
        restitution=balance.restitution,
        duration=end.t,
        compression_time=compression_time,
        max_indentation=max_indentation,
        max_force=max_force,
        converged=converged,
        settled=settled,
        min_force=_least_force(motion, packed, legs.leg.least),
        energy_loss=balance.energy_loss,
        steps=followed.steps,
        end_indentation=end_indentation,
        spare_energy=spare_energy(motion, end),
    )


def _with_return(followed: Followed, legs: Legs) -> tuple[Followed, Bool[Array, ""] | None]:
    """Return the ends with those of a second way out, if it took place, and whether it did."""
    if legs.returned is None:
        return followed, None
    # Not if implicit steps have solved the way out again.
    leg = legs.leg
    returned = legs.returned & (followed.end.t == leg.end.t[1])
    last = chosen(returned, jax.tree.map(operator.itemgetter(2), leg.end), followed.end)
    arrived = jnp.stack([legs.compressing[0], ~returned | leg.arrived[2]])
    steps = followed.steps + jnp.where(returned, leg.steps[2], 0)
    return followed._replace(end=last, arrived=followed.arrived & arrived, steps=steps), returned


def _largest_force(
    motion: Motion, packed: Packed[State], legs: Legs, returned: Bool[Array, ""] | None
) -> tuple[Number, Number]:
    """Return the largest force of the compression, and of all legs."""
    forces = jax.lax.map(
        lambda leg: largest_near(Way(motion, leg[1]), packed, leg[0]),
        (legs.leg.nearest, legs.compressing),
    )
    # With damping strong enough for implicit steps, the force is largest at the beginning.
    largest = jnp.maximum(forces[0], forces[1])
    if returned is not None:
        largest = jnp.where(returned, jnp.maximum(largest, forces[2]), largest)
    return forces[0], largest


def _peak_is_known(
    motion: Motion, legs: Legs, creeps: Bool[Array, ""], rtol: float
) -> Bool[Array, ""]:
    """Return whether the explicit solver passed the force peak, unless the solve has not converged
    otherwise. Bodies that creep to rest slow down, so their force finally exceeds the push.
    """
    end = jax.tree.map(operator.itemgetter(0), legs.leg.end)
    # The largest force at the states suffices; that between them is then computed only if used.
    least = (1 - 10 * rtol) * (0 if motion.push is None else motion.push)
    above = creeps & (legs.leg.nearest.force[0] >= least)
    return legs.leg.arrived[0] | above | ~is_rising(motion, end, legs.compressing[0])


def _least_force(motion: Motion, packed: Packed[State], least: Nearest | None) -> Number | None:
    """Return the least force of the way out, which is at most the force at touch."""
    if least is None:
        return None
    near, out = jax.tree.map(operator.itemgetter(1), least), Way(motion, jnp.asarray(False))
    return -jnp.maximum(largest_near(out, packed, near, -1), 0)


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
    return motion, chosen(pushed, state, begun)
