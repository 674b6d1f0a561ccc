"""The public function `oblique_impact`, and the motion of one spring and slider by event solves."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..._contact import Contact
from ..._entry import refuses_unknown, require_flag, sanitised
from ..._forms import AbstractForm
from ..._forms.base import Exponent
from ..._friction import AbstractFriction
from ..._friction.base import ScaledSpring, Tangential, TangentialOutcome
from ..._friction.spring_slider import spring_of
from ..._laws import AbstractLaw
from ..._program import program
from ..._solver import Packed, Tolerance, land, march
from ..._text.failure import checked
from ..derivatives import common_shape, over_lanes, with_sensitivity
from ..front_door import (
    Lanes,
    ObliqueProblem,
    lanes_of,
    oblique_problem_of,
    sliding_of,
    uniform,
)
from ..impact import summary
from ..methods.auto import method_of
from ..methods.event import Event
from ..methods.method import AbstractMethod
from ..motion.coordinates import Number
from ..result import Impact, Status
from .bodies import RoundBodies
from .result import ObliqueImpact, Slip


@refuses_unknown
def oblique_impact(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: AbstractFriction,
    bodies: RoundBodies | str | None = None,
    spin: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    method: str | AbstractMethod = "auto",
    throw: bool = True,
) -> ObliqueImpact:
    """Solve an oblique impact of two round bodies: δ'' as in `impact`, and u' = -λ f/m.

    u = v_t + R1 ω1 + R2 ω2 is the velocity of the contact point along the surface, f the friction,
    and λ = 1 + m (R1²/I1 + R2²/I2): 7/2 for solid spheres, 5/2 for shells, 3 for discs.

    - `law`, `contact`, `velocity`: as for `impact`, the normal motion.
    - `tangential_velocity`: v_t of the centres relative to each other, in m/s, of any sign.
    - `friction`: a friction law. One with a spring takes its stiffness ratio from a contact of
      materials, if it has none of its own.
    - `bodies`: a `RoundBodies`; or "sphere", "shell" or "disc" without radii; None for spheres.
    - `spin`: ω1 and ω2 in rad/s about the axis normal to the plane of motion; other than zero they
      need radii.
    - `method`: as for `impact`. "auto" takes formulas, tables and phases; "event", or a `jc.Event`
      with options, also follows a `SpringSlider`, which "auto" does for other forces than K δ^1.5
      (1 + α δ'/v0). The other laws have formulas for every force, or none.

    All numbers broadcast. The normal is that at touch, which holds as far as the bodies move little
    beside their radii during the contact. Spin about the normal is kept.

    Returns an `ObliqueImpact`. Lanes fail as in `impact`. Raises ValueError for a Python scalar out
    of range, a spin without radii and a spring without a stiffness ratio. It also raises it for a
    friction law that has no solution for the normal force. Source: Maw, Barber & Fawcett (1976),
    doi 10.1016/0043-1648(76)90201-5, and the references of the friction laws.
    """
    given = oblique_problem_of(law, contact, velocity, tangential_velocity, friction, bodies, spin)
    throw = require_flag("throw", throw)
    result = _oblique(given, method_of(method))
    return checked(result, throw, "oblique_impact", lambda: _uncovered(given, result))


def _uncovered(given: ObliqueProblem, result: ObliqueImpact) -> str | None:
    """Return why a friction law has no outcome, in words; None if the failure is another one."""
    given, normal = uniform(given), result.normal
    sliding = sliding_of(given)
    if not sliding.valid or normal.status != int(Status.SEPARATED):
        return None
    lanes = lanes_of(given.problem)
    why = given.friction.uncovered(sliding.problem(lanes, normal.restitution, given.ratio))
    return why and f"{Status(int(result.status)).name}. {why}"


@program
def _oblique(given: ObliqueProblem, method: AbstractMethod) -> ObliqueImpact:
    given, fill = uniform(given), functools.partial(jnp.broadcast_to, shape=common_shape(given))
    lanes = dataclasses.replace(lanes_of(given.problem), shape=common_shape(given))
    how = method.chosen(lanes.form, pushed=False)
    normal = summary(lanes, how, how.solve(lanes))
    sliding = sliding_of(given)
    # A failed normal impact has no e; its lanes are flagged below.
    e = jnp.where(normal.ok, normal.restitution, 0)
    problem = sliding.problem(lanes, e, given.ratio)
    found, name = _outcome(sanitised(given.friction), lanes, problem, method)
    status = status_of(normal, found, sliding.valid)
    good = (status != int(Status.INVALID_INPUT)) & (status != int(Status.NOT_CONVERGED))

    def result(value: Float[Array, "..."] | None) -> Any:
        return None if value is None else fill(jnp.where(good, value, jnp.nan))

    scale, after = lanes.scale, jnp.where(good, found.slip, 0)
    change = (after - problem.slip) / problem.mobility
    along = sliding.sign * scale.speed * change
    impulse = sliding.mass * along
    # Both bodies turn the same way: the arms point to opposite sides, as the impulses do.
    turned = [spin + arm * impulse for spin, arm in zip(sliding.spins, sliding.arms, strict=False)]
    turned += sliding.spins[len(sliding.arms) :]
    regime = jnp.where(after < 0, int(Slip.REVERSED), int(Slip.STUCK))
    first_slide, stick, last_slide = map(result, _phases(lanes, found, normal.duration))
    loss = scale.energy * (problem.slip - after) * (problem.slip + after) / problem.mobility
    return ObliqueImpact(
        tangential_velocity=result(sliding.velocity + along),
        slip_velocity=result(sliding.sign * scale.speed * after),
        spin=(result(turned[0]), result(turned[1])) if sliding.arms else None,
        impulse_ratio=result(-change / (1 + problem.restitution)),
        sliding_loss=result(loss),
        damping_loss=normal.energy_loss,
        spring_energy=result(jnp.zeros_like(after)),
        slip=fill(jnp.where(found.slid, int(Slip.SLID), regime)),
        sliding_time=first_slide,
        sticking_time=stick,
        final_sliding_time=last_slide,
        margin=result(found.margin),
        normal=normal,
        status=fill(status),
        method=name,
    )


def _outcome(
    friction: AbstractFriction, lanes: Lanes, problem: Tangential, method: AbstractMethod
) -> tuple[TangentialOutcome, str]:
    """Return the tangential outcome, and how it was solved."""
    by_event = isinstance(method, Event)
    if friction.held is not None and (by_event or not friction.has_formula(problem)):
        how, spring = method if by_event else Event(), spring_of(friction, problem)
        return follow(lanes, spring, friction.held, how, problem.restitution), "event"
    found = friction.rebound(problem)
    return found, "formula" if found.converged is None else "phase"


def status_of(
    normal: Impact, found: TangentialOutcome, valid: Bool[Array, "..."]
) -> Int[Array, "..."]:
    """Return the status: that of the normal impact, unless the tangential motion failed."""
    status = jnp.where(valid, normal.status, int(Status.INVALID_INPUT))
    parted = status == int(Status.SEPARATED)
    if found.converged is not None:
        status = jnp.where(parted & ~found.converged, int(Status.NOT_CONVERGED), status)
    # Out of the range of a table the outcome is not a number.
    lost = parted & ~jnp.isfinite(found.slip)
    return jnp.where(lost, int(Status.INVALID_INPUT), status)


def _phases(
    lanes: Lanes, found: TangentialOutcome, duration: Float[Array, "..."]
) -> list[Array | None]:
    """Return the durations of sliding, sticking and sliding again; None if unknown."""
    stop, start, form = found.stop, found.start, lanes.form
    if stop is None or start is None or form.hysteresis_factor is None:
        return [None, None, None]
    speeds = jnp.stack(jnp.broadcast_arrays(stop, start))
    unit = lanes.scale.time
    # One quadrature for both moments.
    moments = form.time_at(speeds, lanes.n, duration / unit)
    assert moments is not None
    first, last = unit * moments[0], unit * moments[1]
    return [jnp.maximum(lasts, 0) for lasts in (first, last - first, duration - last)]


_ROUNDING = 1e-3
"""Relative, far above the error of a solve and far below that of a failed one."""

_PHASES = 12
"""The most phases of slip and stick that are followed."""

_SAFETY = 0.01
"""The error allowed to a step, in units of the tolerance of the outcome."""

_TOUCH = 1e-6
"""The indentation at which the forces at touch are compared."""

_ENDED = 1e-9
"""A w below which the end of a phase is the end of the contact."""


class _SlidingState(NamedTuple):
    """w and v of the normal motion (x = w^k), ψ of the slip, and the spring's variable
    s in stick: φ, or φ/x^(n-1) for "displacement".
    """

    w: Number
    v: Number
    psi: Number
    spring: Number


class _ObliqueNumbers(NamedTuple):
    form: AbstractForm
    exponent: Any
    psi: Number
    chi: Number


class _SlidingMotion(eqx.Module):
    """The motion in one phase: `sign` is that of the slip, 0 in stick; `loads` of "rescaled"."""

    numbers: _ObliqueNumbers
    sign: Number
    held: str = eqx.field(static=True)
    loads: Any = None

    smooth = True
    clamped = False

    @property
    def _n(self) -> Exponent:
        return self.numbers.exponent.value

    def normal_force(self, w: Number, v: Number) -> Number:
        """Return F, without a pull."""
        form, k = self.numbers.form, self.numbers.form.order(self._n)
        return jnp.maximum(form.force(jnp.maximum(w, 0) ** k, v, self._n, v > 0), 0)

    def lever(self, w: Number) -> Number:
        """Return φ/s, the force of a unit of the spring's variable."""
        n = self._n
        if self.held != "displacement":
            return jnp.ones_like(w)
        return jnp.maximum(w, 0) ** (self.numbers.form.order(n) * (n - 1))

    def stick_rate(self, state: _SlidingState, spring: Number) -> Number:
        """Return ds/dτ in stick."""
        n = self._n
        k = self.numbers.form.order(n)
        if self.held == "displacement":
            return n * state.w ** (k - 1) * state.psi
        grows = n * jnp.maximum(state.w, 0) ** (k * n - 1) * state.psi
        if self.held == "force":
            return grows
        # While unloading a held force falls with the contact's radius. Its kink ends a phase.
        unloads = (state.v <= 0) & (state.w > 0) & ~self.loads
        falls = (n - 1) * state.v * spring / jnp.where(unloads, state.w, 1)
        return grows + jnp.where(unloads, falls, 0)

    def rate(self, state: _SlidingState) -> _SlidingState:
        k, force = self.numbers.form.order(self._n), self.normal_force(state.w, state.v)
        sliding = self.sign != 0
        phi = jnp.where(sliding, self.sign * force, self.lever(state.w) * state.spring)
        pace = state.w ** (k - 1)
        sticks = jnp.where(sliding, 0, self.stick_rate(state, state.spring))
        return _SlidingState(state.v / k, -pace * force, -2 * self.numbers.chi * pace * phi, sticks)

    def limit(self, w: Number, v: Number) -> Number:
        """Return the largest |s|, that of slip."""
        lever = self.lever(w)
        return self.normal_force(w, v) / jnp.where(lever > 0, lever, 1)

    def guards(self, state: _SlidingState) -> tuple[Number, ...]:
        slope, n = self.rate(state), self._n
        most, grows = jax.jvp(self.limit, (state.w, state.v), (slope.w, slope.v))
        pulled = self.sign * self.stick_rate(state, self.sign * most)
        # Both rates vanish with w. Their quotient keeps this guard from closing at the end, where
        # it would have no slope.
        k = self.numbers.form.order(n)
        inside = state.w > 0
        power = k - 1 if self.held == "displacement" else k * n - 1
        unit = jnp.where(inside, state.w, 1) ** power
        goes_on = jnp.where(inside, (pulled - grows) / unit, 1)
        ends = state.w, jnp.where(self.sign != 0, goes_on, most - jnp.abs(state.spring))
        return ends if self.loads is None else (*ends, jnp.where(self.loads, state.v, 1))

    def continued(self, inside: _SlidingState) -> _SlidingMotion:
        return self

    def jumps(self, inside: _SlidingState, end: _SlidingState, closed: Array) -> Bool[Array, ""]:
        return jnp.asarray(False)


class _PhaseChain(NamedTuple):
    state: _SlidingState
    sign: Number
    count: Int[Array, ""]
    done: Bool[Array, ""]
    converged: Bool[Array, ""]
    stop: Number
    start: Number


def follow(
    lanes: Lanes, spring: ScaledSpring, held: str, how: Event, e: Array
) -> TangentialOutcome:
    """Return the outcome of a spring and slider beside the normal motion of any form."""
    numbers = _ObliqueNumbers(lanes.form, lanes.exponent, spring.psi, spring.chi)
    course = over_lanes(with_sensitivity(eqx.Partial(_course, held=held, how=how)), numbers)
    slid = (course.count == 1) & (course.sign > 0)
    # The tangential impulse is at most μ times the normal one.
    most = (1 + _ROUNDING) * 2 * spring.chi * (1 - course.state.v)
    return TangentialOutcome(
        slip=spring.slip(course.state.psi),
        slid=slid | spring.free,
        stop=jnp.where(slid, -e, course.stop),
        start=jnp.where(slid, -e, course.start),
        converged=course.converged & (jnp.abs(course.state.psi - spring.psi) <= most),
    )


def _course(numbers: _ObliqueNumbers, *, held: str, how: Event) -> _PhaseChain:
    zero = jnp.zeros_like(numbers.psi)
    rtol, atol = how.tolerances(zero.dtype)
    tolerance = Tolerance(jnp.asarray(_SAFETY * rtol, zero.dtype), _SAFETY * atol, how.max_steps)
    begin = _SlidingState(zero, zero + 1, numbers.psi, zero)
    first = _SlidingMotion(numbers, zero, held)
    n = numbers.exponent.value
    k = numbers.form.order(n)
    touch = first.normal_force(zero + _TOUCH ** (1 / k), zero + 1)
    # At touch a "displacement" force is n times as large as one that was added up.
    eager = n if held == "displacement" else 1.0
    slides = eager * numbers.psi * _TOUCH**n > touch
    sign = jax.lax.stop_gradient(jnp.where(slides, zero + 1, zero))
    none = jnp.zeros((), int)
    start = _PhaseChain(
        begin, sign, none, none > 0, none > 0, jnp.where(slides, zero, zero + 1), zero - 1
    )

    def unfinished(course: _PhaseChain) -> Bool[Array, ""]:
        return ~course.done & (course.count < _PHASES)

    def advance(course: _PhaseChain) -> _PhaseChain:
        loads = (course.sign == 0) & (course.state.v > 0) if held == "rescaled" else None
        phase = _SlidingMotion(numbers, course.sign, held, loads)
        packed = Packed.of(course.state)
        last = march(phase, packed, tolerance, (), lambda seen, before, now: seen)
        end, _ = land(phase, packed, last)
        state = packed.state(end)
        arrived, over = jnp.any(last.closed), jax.lax.stop_gradient(state.w) < _ENDED
        sliding = course.sign != 0
        most = phase.limit(state.w, state.v)
        spring = jnp.where(sliding, course.sign * most, state.spring)
        sticks = sliding
        if loads is not None:
            # It sticks on after the turn, from v = 0 without rounding.
            turned = last.closed[2] & (state.v < phase.guards(state)[1])
            state, sticks = state._replace(v=jnp.where(turned, 0, state.v)), sliding | turned
        sign = jax.lax.stop_gradient(jnp.where(sticks, 0, jnp.where(spring < 0, -1.0, 1.0)))
        opened = sliding & (course.count == 0)
        return _PhaseChain(
            state=state._replace(spring=spring),
            sign=jnp.where(over, course.sign, sign.astype(spring.dtype)),
            count=course.count + 1,
            done=over | ~arrived,
            converged=over & arrived,
            stop=jnp.where(opened, state.v, course.stop),
            start=jnp.where(sticks, course.start, state.v),
        )

    return jax.lax.while_loop(unfinished, advance, start)
