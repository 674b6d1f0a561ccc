"""The tangential motion of one spring and slider beside any normal motion, by event solves."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._forms import AbstractForm
from ..._forms.base import Exponent
from ..._friction.base import ScaledSpring, TangentialOutcome
from ..._solver import Packed, Tolerance, land, march
from ..derivatives import over_lanes, with_sensitivity
from ..front_door import Lanes
from ..methods.event import Event

Number = Float[Array, ""]

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


class _State(NamedTuple):
    """w and v of the normal motion (x = w^k), ψ of the slip, and the spring's variable
    s in stick: φ, or φ/x^(n-1) for "displacement".
    """

    w: Number
    v: Number
    psi: Number
    spring: Number


class _Numbers(NamedTuple):
    form: AbstractForm
    exponent: Any
    psi: Number
    chi: Number


class _Phase(eqx.Module):
    """The motion in one phase: `sign` is that of the slip, 0 in stick."""

    numbers: _Numbers
    sign: Number
    held: str = eqx.field(static=True)

    one_way = False
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

    def stick_rate(self, state: _State, spring: Number) -> Number:
        """Return ds/dτ in stick."""
        n = self._n
        k = self.numbers.form.order(n)
        if self.held == "displacement":
            return n * state.w ** (k - 1) * state.psi
        grows = n * jnp.maximum(state.w, 0) ** (k * n - 1) * state.psi
        if self.held == "force":
            return grows
        # While unloading a force that is held falls with the radius of the contact.
        unloads = (state.v < 0) & (state.w > 0)
        return grows + jnp.where(
            unloads, (n - 1) * state.v * spring / jnp.where(unloads, state.w, 1), 0
        )

    def rate(self, state: _State) -> _State:
        k, force = self.numbers.form.order(self._n), self.normal_force(state.w, state.v)
        sliding = self.sign != 0
        phi = jnp.where(sliding, self.sign * force, self.lever(state.w) * state.spring)
        pace = state.w ** (k - 1)
        sticks = jnp.where(sliding, 0, self.stick_rate(state, state.spring))
        return _State(state.v / k, -pace * force, -2 * self.numbers.chi * pace * phi, sticks)

    def limit(self, w: Number, v: Number) -> Number:
        """Return the largest |s|, that of slip."""
        lever = self.lever(w)
        return self.normal_force(w, v) / jnp.where(lever > 0, lever, 1)

    def guards(self, state: _State) -> tuple[Number, ...]:
        slope, n = self.rate(state), self._n
        most, grows = jax.jvp(self.limit, (state.w, state.v), (slope.w, slope.v))
        pulled = self.sign * self.stick_rate(state, self.sign * most)
        # Both rates vanish with w. Their quotient keeps this guard from closing at the end, where
        # it would have no slope.
        k = self.numbers.form.order(n)
        inside = state.w > 0
        unit = jnp.where(inside, state.w, 1) ** (
            k - 1 if self.held == "displacement" else k * n - 1
        )
        goes_on = jnp.where(inside, (pulled - grows) / unit, 1)
        slips = most - jnp.abs(state.spring)
        return state.w, jnp.where(self.sign != 0, goes_on, slips)

    def continued(self, inside: _State) -> _Phase:
        return self

    def jumps(self, inside: _State, end: _State, closed: Array) -> Bool[Array, ""]:
        return jnp.asarray(False)


class _Followed(NamedTuple):
    state: _State
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
    numbers = _Numbers(lanes.form, lanes.exponent, spring.psi, spring.chi)
    course = over_lanes(with_sensitivity(eqx.Partial(_course, held=held, how=how)), numbers)
    slid = (course.count == 1) & (course.sign > 0)
    return TangentialOutcome(
        slip=spring.slip(course.state.psi),
        slid=slid | spring.free,
        stop=jnp.where(slid, -e, course.stop),
        start=jnp.where(slid, -e, course.start),
        converged=course.converged & _possible(course, spring),
    )


def _possible(course: _Followed, spring: ScaledSpring) -> Bool[Array, "..."]:
    """Return whether the tangential impulse is at most μ times the normal one."""
    most = 2 * spring.chi * (1 - course.state.v)
    return jnp.abs(course.state.psi - spring.psi) <= (1 + _ROUNDING) * most


def _course(numbers: _Numbers, *, held: str, how: Event) -> _Followed:
    zero = jnp.zeros_like(numbers.psi)
    rtol, atol = how.tolerances(zero.dtype)
    tolerance = Tolerance(jnp.asarray(_SAFETY * rtol, zero.dtype), _SAFETY * atol, how.max_steps)
    begin = _State(zero, zero + 1, numbers.psi, zero)
    first = _Phase(numbers, zero, held)
    n = numbers.exponent.value
    k = numbers.form.order(n)
    touch = first.normal_force(zero + _TOUCH ** (1 / k), zero + 1)
    # At touch a "displacement" force is n times as large as one that was added up.
    eager = n if held == "displacement" else 1.0
    slides = eager * numbers.psi * _TOUCH**n > touch
    sign = jax.lax.stop_gradient(jnp.where(slides, zero + 1, zero))
    none = jnp.zeros((), int)
    start = _Followed(
        begin, sign, none, none > 0, none > 0, jnp.where(slides, zero, zero + 1), zero - 1
    )

    def unfinished(course: _Followed) -> Bool[Array, ""]:
        return ~course.done & (course.count < _PHASES)

    def advance(course: _Followed) -> _Followed:
        phase = _Phase(numbers, course.sign, held)
        packed = Packed.of(course.state)
        last = march(phase, packed, tolerance, (), lambda seen, before, now: seen)
        end, _ = land(phase, packed, last)
        state = packed.state(end)
        arrived, over = jnp.any(last.closed), jax.lax.stop_gradient(state.w) < _ENDED
        sliding = course.sign != 0
        most = phase.limit(state.w, state.v)
        spring = jnp.where(sliding, course.sign * most, state.spring)
        sign = jax.lax.stop_gradient(jnp.where(sliding, 0, jnp.where(spring < 0, -1.0, 1.0)))
        opened = sliding & (course.count == 0)
        return _Followed(
            state=state._replace(spring=spring),
            sign=jnp.where(over, course.sign, sign.astype(spring.dtype)),
            count=course.count + 1,
            done=over | ~arrived,
            converged=over & arrived,
            stop=jnp.where(opened, state.v, course.stop),
            start=jnp.where(sliding, course.start, state.v),
        )

    return jax.lax.while_loop(unfinished, advance, start)
