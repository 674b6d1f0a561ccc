"""Mechanisms whose contacts remember their largest indentation."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.oracle.plastic_chain import follow, thornton

BY_SCIPY = 5e-10
"""Of the speed at rtol 1e-10 beside steps at 1e-12: measured 3e-11."""
SLOPES = 1e-5
"""Beside central differences of SciPy with h = 1e-4: measured 1.4e-6."""

MASS, STIFFNESS, YIELDS, DAMPING = 0.3, 2e8, 0.3, 3e7
SPEED, PUSH, RATE = 0.5, 2e4, 2e4
"""In m/s, m/s² and 1/s: strong and fast enough to press the bodies together again."""


@functools.cache
def pressed():
    """The speed of a body on a wall under a push that swings, with its derivatives."""

    def speed(yields, strength):
        law = jc.Viscoplastic(yield_speed=yields, c=DAMPING)
        system = jc.System(
            mass=lambda t, q, args: jnp.full((1, 1), MASS),
            force=lambda t, q, v, args: -MASS * args * jnp.sin(RATE * t)[None],
            gap=lambda t, q, args: q,
            law=law,
            stiffness=STIFFNESS,
            exponent=1.5,
        )
        run = jc.simulate(
            system, 0.0025, position=jnp.zeros(1), velocity=jnp.array([-SPEED]), args=strength,
            rtol=1e-10,
        )  # fmt: skip
        return run.velocity[-1, 0], (run.velocity[-1, 0], run.contacts.energy_loss)

    return jax.jit(jax.jacrev(speed, argnums=(0, 1), has_aux=True))(YIELDS, PUSH)


def by_scipy(yields=YIELDS, strength=PUSH):
    """The wall is a ball of a mass of 1e30 kg."""
    return follow(
        [thornton(MASS, STIFFNESS, yields, DAMPING)],
        [MASS, 1e30],
        [0.0],
        [SPEED, 0.0],
        0.0025,
        lambda t: np.array([strength * np.sin(RATE * t), 0.0]),
    )


def test_a_body_that_is_pressed_again():
    found = by_scipy()
    assert found.reloads[0] > 0
    np.testing.assert_allclose(pressed()[1][0], -found.velocity[0], atol=BY_SCIPY)


def test_derivatives_across_turn_and_reload():
    by_yield, by_push = pressed()[0]
    h = 1e-4
    up, down = (by_scipy(YIELDS + sign * h).velocity[0] for sign in (1, -1))
    np.testing.assert_allclose(by_yield, -(up - down) / (2 * h), atol=SLOPES)
    up, down = (by_scipy(strength=PUSH * (1 + sign * h)).velocity[0] for sign in (1, -1))
    np.testing.assert_allclose(by_push * PUSH, -(up - down) / (2 * h), atol=SLOPES)
