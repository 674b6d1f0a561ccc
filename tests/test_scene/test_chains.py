"""Balls in a line whose contacts have necks or memories, beside SciPy from event to event."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.chains import GAPS, LIGHT, NECK, ended
from tests.test_scene.support import central, in_a_line, simulate

BALANCE = 1e-9  # of energies at rtol 1e-10: measured 1e-11
STEP = 1e-4  # of central differences


class Chain(NamedTuple):
    """Balls of which the first one has a speed; and laws of a parameter."""

    law: Callable[[Any], Any]
    parameter: float
    speed: float
    within: float  # of velocities in m/s at rtol 1e-10 beside SciPy's steps at 1e-12
    slopes: float | None  # of their slopes beside differences of SciPy
    mass: Sequence[float]
    gaps: Sequence[float]
    radius: float
    stiffness: float
    exponent: float
    duration: float
    outputs: int
    names: Sequence[str] | None = None


METALS = ["lead", "lead", "steel"]


def lead_and_steel(yields, e):
    """Laws of lead on lead, and of all others."""
    return {("lead", "lead"): jc.ThorntonPlastic(yield_speed=yields), "default": jc.HuGuo(e=e)}


CHAINS = {
    # Measured: 2e-12, 1e-7.
    "necks": Chain(
        lambda pull_off: jc.JKR(pull_off=pull_off), NECK.pull_off, 0.3, 1e-10, 1e-5,
        [1.0, 1.0, 2.0], GAPS, 0.1, NECK.stiffness, 1.5, 0.15, 2,
    ),
    # A memory that shrinks. Measured: 8e-11, 5e-6.
    "powder": Chain(
        lambda adhesion: jc.Luding(ratio=6.0, slope=200.0, adhesion=adhesion), 0.9, 0.8, 1e-9, 1e-4,
        [1.0, 0.3, 2.0], GAPS, 0.05, 1e5, 1.0, 0.05, 21,
    ),
    # SciPy starts anew at each touch, turn, reload and opening. Measured: 4e-11.
    "yielding": Chain(
        lambda yields: jc.Viscoplastic(yield_speed=yields, c=2e7), 0.3, 2.0, 5e-10, 1e-5,
        LIGHT, np.zeros(3), 0.01, 2e8, 1.5, 0.003, 2,
    ),
    # With and without a memory in one scene.
    "lead and steel": Chain(
        lambda yields: lead_and_steel(yields, 1.0), 0.3, 2.0, 5e-10, None,
        [0.03] * 3, np.zeros(2), 0.01, 2e8, 1.5, 0.003, 2, METALS,
    ),
}  # fmt: skip


def simulated(chain, parameter, speed):
    places = np.cumsum([0.0, *(2 * chain.radius + gap for gap in chain.gaps)])
    starts = [speed, *[0.0] * len(chain.gaps)]
    scene = jc.Scene(
        in_a_line(chain.radius, chain.mass, places, starts, chain.names), chain.law(parameter),
        stiffness=chain.stiffness, exponent=chain.exponent,
    )  # fmt: skip
    times = np.linspace(0, chain.duration, chain.outputs)
    return simulate(scene, chain.duration, rtol=1e-10, times=times)


def end(chain, *numbers):
    """Velocities at the end, by a run with no other outputs, whose derivatives take less time."""
    return simulated(chain._replace(outputs=2), *numbers).velocity[-1].ravel()


@pytest.mark.parametrize("name", CHAINS)
def test_velocities_and_energies(name):
    """Until a contact unloads, all work of loading counts as stored, so that energy only falls."""
    chain = CHAINS[name]
    run = simulated(chain, chain.parameter, chain.speed)
    known, happened = ended(name, chain.parameter, chain.speed)
    assert happened
    np.testing.assert_allclose(run.velocity[-1, :, 0], known, atol=chain.within)
    energy, lost = run.energy, run.impacts.energy_loss
    gone = NECK.lost if name == "necks" else np.nansum(lost)
    balance, rise = (1e-10, 1e-12) if name == "powder" else (BALANCE, BALANCE)
    np.testing.assert_allclose(energy[0] - energy[-1], gone, rtol=balance)
    if name == "necks":
        np.testing.assert_allclose(lost[:2], [0, NECK.lost], rtol=BALANCE)
    else:
        assert np.all(np.diff(energy) < rise)


@pytest.mark.parametrize("name", [name for name, chain in CHAINS.items() if chain.slopes])
def test_slopes(name):
    """Across touches, snaps, turns and reloads."""
    chain = CHAINS[name]
    a, v = chain.parameter, chain.speed
    push = jax.linearize(functools.partial(end, chain), jnp.asarray(a), jnp.asarray(v))[1]
    by_parameter, by_speed = push(1.0, 0.0), push(0.0, 1.0)
    slope = central(lambda h: ended(name, a + h, v)[0], STEP)
    np.testing.assert_allclose(by_parameter, slope, atol=chain.slopes)
    slope = central(lambda h: ended(name, a, v + h)[0], STEP)
    np.testing.assert_allclose(by_speed, slope, atol=chain.slopes)


BESIDE = 1e-8  # of e and duration beside `impact`, relative. Measured 2e-11.
SLOPES = 1e-7  # of their slopes by speed, relative. Measured 3e-8.


@pytest.mark.parametrize(("metal", "until"), [("thornton", 1.5e-3), ("hu guo", 0.01)])
def test_coupled_contacts_end_as_impacts_alone(metal, until):
    """The force vanishes before they open. Two balls of three touch; the third is so near that all
    are solved together, but not touched yet.
    """
    laws, places = lead_and_steel(0.1, 0.03), np.array([0.0, 0.0201, 0.0403])
    speeds = np.array([0.5, -0.5, 0.0])
    law = laws["lead", "lead"]
    if metal == "hu guo":
        law, places, speeds = laws["default"], -places[::-1], np.array([0.0, 0.5, -0.5])

    def table(v):
        balls = in_a_line(0.01, 0.02, places, v * speeds, METALS)
        hit = simulate(jc.Scene(balls, laws, stiffness=1e7, exponent=1.5), until).impacts
        return jnp.stack([hit.restitution[0], hit.duration[0]]), hit.solved_by

    def alone(v):
        hit = jc.impact(law, jc.Contact(0.01, 1e7), v)
        return jnp.stack([hit.restitution, hit.duration])

    speed = (jnp.array(1.0),), (jnp.array(1.0),)
    value, slope, way = jax.jvp(table, *speed, has_aux=True)
    expected, rate = jax.jvp(alone, *speed)
    assert way.tolist() == [jc.SolvedBy.COUPLED]
    np.testing.assert_allclose(value, expected, rtol=BESIDE)
    np.testing.assert_allclose(slope, rate, rtol=SLOPES, atol=1e-9)
