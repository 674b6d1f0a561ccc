"""Touches at the turn of a pendulum, however shallow, and touches between long steps."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ellipk

import jaxcontact as jc

SHALLOW = 1e-9
"""The least depth in m that must be seen."""


def unit(t, q, args):
    return jnp.eye(1)


def swings(t, q, v, args):
    return -9.81 * jnp.sin(q)


def to_wall(t, q, args):
    return q + args


PENDULUM = jc.System(unit, swings, to_wall, law=jc.HuGuo(e=0.5), stiffness=1e8)


def touches(amplitudes, walls, duration, rtol=1e-9):
    def first(amplitude, wall):
        run = jc.simulate(
            PENDULUM,
            duration,
            position=amplitude[None],
            velocity=jnp.zeros(1),
            args=wall,
            rtol=rtol,
            max_impacts=1,
            throw=False,
        )
        return run.contacts.valid[0], run.contacts.time[0]

    return jax.jit(jax.vmap(first))(jnp.asarray(amplitudes), jnp.asarray(walls))


def test_turns_beyond_a_wall_touch_and_others_do_not():
    """A pendulum released at A turns at -A, so that a wall at -A + d is touched d deep."""
    random = np.random.default_rng(0)
    amplitudes = random.uniform(0.05, 2.8, 400)
    depths = 10 ** random.uniform(np.log10(SHALLOW), -2, 400) * np.where(np.arange(400) % 2, 1, -1)
    seen, times = touches(amplitudes, amplitudes - depths, duration=0.9 * 2.5)
    period = 4 * ellipk(np.sin(amplitudes / 2) ** 2) / np.sqrt(9.81)
    due = (depths > 0) & (period / 2 < 2.2)
    np.testing.assert_array_equal(np.asarray(seen)[due], True)
    np.testing.assert_array_equal(np.asarray(seen)[depths < 0], False)
    assert np.all(np.asarray(times)[due] < period[due] / 2)
    assert due.sum() > 100


def test_gaps_that_wiggle_within_a_step_are_seen():
    """A wall that vibrates fast reaches a body at rest, although nothing else moves."""

    def wiggling(t, q, args):
        return q - 1e-3 * jnp.sin(args * t)

    still = jc.System(
        unit, lambda t, q, v, args: jnp.zeros(1), wiggling, law=jc.Hertz(), stiffness=1e8
    )

    def seen(place, rate):
        run = jc.simulate(
            still,
            10.0,
            position=place[None],
            velocity=jnp.zeros(1),
            args=rate,
            max_impacts=1,
            throw=False,
        )
        return run.contacts.valid[0], run.contacts.time[0]

    rates = jnp.linspace(3.0, 60.0, 40)
    places = jnp.full(40, 1e-3 * (1 - 1e-6))
    found, times = jax.jit(jax.vmap(seen))(places, rates)
    assert np.all(found)
    expected = np.arcsin(1 - 1e-6) / np.asarray(rates)
    np.testing.assert_allclose(times, expected, rtol=1e-6)
    found, _ = jax.jit(jax.vmap(seen))(jnp.full(40, 1e-3 * (1 + 1e-6)), rates)
    assert not np.any(found)
