"""The start of a pushed contact, while the closing speed still increases.

The damping of the Hunt-Crossley family refers to the largest closing speed since touch. While the
speed rises, that is the current speed, and the force is xⁿ (1 + α(v)). The force grows from 0 to
the push Γ, where the speed is largest. It serves as the independent variable, Γ s^(2n) with s from
0 to 1. The motion is smooth in s and needs neither an event nor a step control.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp

from ..._forms import HuntCrossleyForm
from ..._functions import power
from ..._solver.runge_kutta import step
from .motion import Motion, Number, State

# Measured: 32 steps of order 8 have an error of 1e-13 from Γ = 1e-6 to 1e3.
_STEPS = 32


class _Risen(NamedTuple):
    """The integration variable `place`, v, t and the energy taken by damping."""

    place: Number
    velocity: Number
    time: Number
    loss: Number


def risen(motion: Motion) -> tuple[Motion, State]:
    """Return the motion and the state at the largest closing speed, to which damping now refers."""
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
