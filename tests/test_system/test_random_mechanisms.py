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
from tests.oracle.stored import stored

SHALLOW = 1e-9  # the least depth in m that must be seen
WIGGLES = 1e-3  # how far a wall vibrates, in m
LANES = 400

SWING = jc.System(
    lambda t, q, args: jnp.eye(1),
    lambda t, q, v, args: -args["gravity"] * jnp.sin(q),
    lambda t, q, args: q + args["wall"] - WIGGLES * jnp.sin(args["rate"] * t),
    law=jc.HuGuo(e=0.5),
    stiffness=1e8,
)


@jax.jit
@jax.vmap
def first_touch(place, duration, args):
    start = {"position": place[None], "velocity": jnp.zeros(1), "args": args}
    run = jc.simulate(SWING, duration, **start, max_impacts=1, throw=False)
    return run.contacts.valid[0], run.contacts.time[0]


def first_touches(place, duration, **args):
    every = {"gravity": 0.0, "wall": 0.0, "rate": 0.0} | args
    lanes = {name: np.full(LANES, value, float) for name, value in every.items()}
    return map(np.asarray, first_touch(place, np.full(LANES, duration), lanes))


def test_turns_beyond_a_wall_touch_and_others_do_not():
    """A pendulum released at A turns at -A, so that a wall at -A + d is touched d deep."""
    random = np.random.default_rng(0)
    amplitudes = random.uniform(0.05, 2.8, LANES)
    depths = 10 ** random.uniform(np.log10(SHALLOW), -2, LANES)
    depths *= np.where(np.arange(LANES) % 2, 1, -1)
    seen, times = first_touches(amplitudes, 0.9 * 2.5, gravity=9.81, wall=amplitudes - depths)
    period = 4 * ellipk(np.sin(amplitudes / 2) ** 2) / np.sqrt(9.81)
    due = (depths > 0) & (period / 2 < 2.2)
    np.testing.assert_array_equal(seen[due], True)
    np.testing.assert_array_equal(seen[depths < 0], False)
    assert np.all(times[due] < period[due] / 2)
    assert due.sum() > 100


def test_gaps_that_wiggle_within_a_step_are_seen():
    """A wall that vibrates fast reaches a body at rest, although nothing else moves."""
    rates = np.repeat(np.linspace(3.0, 60.0, LANES // 2), 2)
    reached = np.arange(LANES) % 2 == 0
    places = WIGGLES * np.where(reached, 1 - 1e-6, 1 + 1e-6)
    seen, times = first_touches(places, 10.0, rate=rates)
    np.testing.assert_array_equal(seen, reached)
    np.testing.assert_allclose(times[seen], np.arcsin(1 - 1e-6) / rates[seen], rtol=1e-6)


LAWS = "HuGuo", "KelvinVoigt, no tension", "ThorntonPlastic", "Luding", "JKR"
EACH = 8  # mechanisms for each law: two that move, two at rest, two pressed, two that touch
LEFT_OUT = 6
"""Contacts of each law whose sequence or slope changes within the differences: at most 3 of 25."""
BOOKS = 1e-10  # of the energy, at rtol 1e-10. Measured 7e-12.
SLOPES = 1e-5
"""Of derivative and value, at steps of 3e-4 and rtol 1e-10, hence 1e-10/3e-4 times the growth of a
perturbation. Measured 1.2e-6."""
READ = 3e-4
"""Of largest force and depth, whose values are read between steps. Measured 5e-5, which falls with
longer steps of the differences."""
SAME = 1e-6  # of numbers beside those of another program; largest depths differ by 2e-8


@stored()
def neighbours(name, x, along):
    """The outcomes of a mechanism a step forwards and one backwards."""
    numbers = random_mechanisms.Numbers(*x), random_mechanisms.Numbers(*along)
    steps = random_mechanisms.STEP, -random_mechanisms.STEP
    return [random_mechanisms.outcomes(name, *numbers, step) for step in steps]


@functools.cache
def found(name):
    random = np.random.default_rng(0)
    x = random_mechanisms.drawn(random, name, EACH)
    along, rows = random_mechanisms.directions(random, x), []
    for k in range(EACH):
        one = [jax.tree.map(lambda a, k=k: a[k : k + 1], each) for each in (x, along)]
        rows.append([random_mechanisms.outcomes(name, *one), *neighbours(name, *one)])
    runs = jax.tree.map(lambda *each: np.concatenate(each), *rows)
    return x, random_mechanisms.beside_differences(runs)


@pytest.mark.parametrize("name", LAWS)
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
    x, runs = found("JKR")
    for k, kind in enumerate(random_mechanisms.KINDS):
        alone = random_mechanisms.simulated("JKR", jax.tree.map(lambda a, k=k: a[k], x))
        table, keep = alone.contacts.to_dict(), runs.others["valid"][k]
        for column in random_mechanisms.COLUMNS:
            expected, words = runs.table[column][k][keep], f"{kind} {column}"
            np.testing.assert_allclose(table[column], expected, rtol=SAME, err_msg=words)
