"""Random mechanisms with laws of every family: energies, and derivatives of the contact table.

Touches at the turn of a pendulum, however shallow, and touches between long steps.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

import jaxcontact as jc
from benchmarks import random_mechanisms

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


EACH = 8
"""Mechanisms for each law: two that move, two at rest, two pressed, two that touch."""
LEFT_OUT = 6
"""Contacts of each law whose sequence or slope changes within the differences: at most 3 of 25."""
BOOKS = 1e-10
"""Of the energy, at rtol 1e-10. Measured 7e-12."""
SLOPES = 1e-5
"""Of derivative and value, at steps of 3e-4 and rtol 1e-10, hence 1e-10/3e-4 times the growth of a
perturbation. Measured 1.2e-6."""
READ = 3e-4
"""Of largest force and depth, whose values are read between steps. Measured 5e-5, which falls with
longer steps of the differences."""
SAME = 1e-6
"""Of numbers beside those of another program; largest depths differ by 2e-8."""


@functools.cache
def found(name):
    random = np.random.default_rng(0)
    x = random_mechanisms.drawn(random, name, EACH)
    return x, random_mechanisms.compared(name, x, random_mechanisms.directions(random, x))


@pytest.mark.parametrize(
    "name", ["HuGuo", "KelvinVoigt, no tension", "ThorntonPlastic", "Luding", "JKR"]
)
def test_derivatives_of_the_contact_table(name):
    _, runs = found(name)
    valid, sound = runs.others["valid"], runs.sound
    assert set(runs.others["status"]) <= {jc.Ending.COMPLETED, jc.Ending.TOO_MANY_IMPACTS}
    assert np.max(runs.books) < BOOKS
    assert np.sum(sound) >= 10
    assert np.sum(valid & ~sound) <= LEFT_OUT
    # A contact in progress at the end has neither.
    ends = np.isfinite(runs.table["duration"])
    np.testing.assert_array_equal(np.isfinite(runs.table["restitution"]), ends)
    for column, deviation in runs.deviation.items():
        ended = column in ("restitution", "duration")
        assert ended or np.all(np.isfinite(runs.table[column][valid]))
        compared = np.where(sound & ends if ended else sound, deviation, 0)
        assert np.max(compared) < (READ if column.startswith("max") else SLOPES), column


def test_plain_calls_give_the_same():
    """The numbers of calls from Python are those of the program."""
    x, runs = found("HuGuo")
    for k, kind in enumerate(random_mechanisms.KINDS):
        alone = random_mechanisms.simulated("HuGuo", jax.tree.map(lambda a, k=k: a[k], x))
        table, keep = alone.contacts.to_dict(), runs.others["valid"][k]
        for column in random_mechanisms.COLUMNS:
            expected = runs.table[column][k][keep]
            np.testing.assert_allclose(
                table[column], expected, rtol=SAME, err_msg=f"{kind} {column}"
            )
