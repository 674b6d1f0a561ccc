"""Contacts with necks, or that remember their largest indentation: bodies on walls beside SciPy."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.oracle import luding_chain, neck_chain, plastic_chain

BY_SCIPY = 1e-10
BY_SCIPY_PLASTIC = 5e-10
"""Of the speed in m/s at rtol 1e-10 beside steps at 1e-12: measured 3e-12 and 3e-11."""
SLOPES = 1e-5  # beside central differences of SciPy with steps of 1e-4: measured 1.4e-6


class Body(NamedTuple):
    """In SI units, with the rate of its shaking and a constant acceleration towards the wall."""

    mass: float
    gap: float
    speed: float
    rate: float
    pulled: float
    duration: float
    stiffness: float
    exponent: float


def simulated(body, law, shake):
    """Return the speed at the end, and that with the losses of the contacts."""
    system = jc.System(
        lambda t, q, args: jnp.full((1, 1), body.mass),
        lambda t, q, v, args: body.mass * (args * jnp.sin(body.rate * t) - body.pulled)[None],
        lambda t, q, args: q,
        law=law, stiffness=body.stiffness, exponent=body.exponent,
    )  # fmt: skip
    start = {"position": jnp.array([body.gap]), "velocity": jnp.array([-body.speed])}
    run = jc.simulate(system, body.duration, **start, args=shake, rtol=1e-10)
    return run.velocity[-1, 0], (run.velocity[-1, 0], run.contacts.energy_loss)


def by_scipy(follow, contact, body, shake):
    """The wall is a ball of a mass of 1e30 kg."""
    return follow(
        [contact], [body.mass, 1e30], [body.gap], [body.speed, 0.0], body.duration,
        lambda t: np.array([body.pulled - shake * np.sin(body.rate * t), 0.0]),
    )  # fmt: skip


def difference(function, h=1e-4):
    """The slope of a speed away from the wall, of runs by SciPy, over a relative step."""
    return (function(1 - h).velocity[0] - function(1 + h).velocity[0]) / (2 * h)


NECK = neck_chain.Neck(work=2 / (1.5 * np.pi), radius=1.0, modulus=7500.0)
NECKED = Body(0.5, 1e-3, 0.2, 60.0, 9.81, 0.5, NECK.stiffness, 1.5)
SHAKE = 20.0


def test_a_neck_that_is_shaken_apart_twice():
    speed, (_, lost) = simulated(NECKED, jc.JKR(pull_off=NECK.pull_off), SHAKE)
    found = by_scipy(neck_chain.follow, NECK, NECKED, SHAKE)
    assert len(found.moments[0]) == 4
    np.testing.assert_allclose(speed, -found.velocity[0], atol=BY_SCIPY)
    np.testing.assert_allclose(lost[:2], NECK.lost, rtol=1e-9)


def test_powder_that_is_shaken():
    """Luding's contact turns back from its adhesion and is opened again."""
    body = Body(0.5, 0.0, 0.2, 280.0, 0.0, 0.3, 1e4, 1.0)
    speed, _ = simulated(body, jc.Luding(ratio=4.0, slope=0.0, adhesion=0.8), SHAKE)
    powder = luding_chain.Powder(1e4, 4.0, 0.0, 0.8)
    found = by_scipy(luding_chain.follow, powder, body, SHAKE)
    assert found.shrunk > 0
    assert found.openings > 0
    np.testing.assert_allclose(speed, -found.velocity[0], atol=BY_SCIPY)


PLASTIC = Body(0.3, 0.0, 0.5, 2e4, 0.0, 0.0025, 2e8, 1.5)
YIELDS, DAMPING, PUSH = 0.3, 3e7, -2e4
"""In m/s, and the push in m/s²: strong enough to press the bodies together again."""


def test_a_body_that_is_pressed_again():
    """Also derivatives across turn and reload."""

    def ends(yields, push):
        return simulated(PLASTIC, jc.Viscoplastic(yield_speed=yields, c=DAMPING), push)

    def followed(part_of_yield, part_of_push):
        law = plastic_chain.thornton(0.3, 2e8, YIELDS * part_of_yield, DAMPING)
        return by_scipy(plastic_chain.follow, law, PLASTIC, PUSH * part_of_push)

    (by_yield, by_push), (speed, _) = jax.jit(jax.jacrev(ends, (0, 1), has_aux=True))(YIELDS, PUSH)
    found = followed(1.0, 1.0)
    assert found.reloads[0] > 0
    np.testing.assert_allclose(speed, -found.velocity[0], atol=BY_SCIPY_PLASTIC)
    slope = difference(lambda part: followed(part, 1.0), 1e-4 / YIELDS) / YIELDS
    np.testing.assert_allclose(by_yield, slope, atol=SLOPES)
    slope = difference(lambda part: followed(1.0, part))
    np.testing.assert_allclose(by_push * PUSH, slope, atol=SLOPES)
