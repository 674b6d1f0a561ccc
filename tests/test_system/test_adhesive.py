"""Mechanisms whose contacts have necks."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle import luding_chain as powders
from tests.oracle.neck_chain import Neck, follow

BY_SCIPY = 1e-10
"""Of the speed in m/s at rtol 1e-10 beside steps at 1e-12: measured 3e-12."""
SLOPES = 1e-4
"""Beside central differences of SciPy with h = 1e-4: measured 5e-6."""

NECK = Neck(work=2 / (1.5 * np.pi), radius=1.0, modulus=7500.0)
MASS, GAP, SPEED, SHAKE, RATE, LASTS = 0.5, 1e-3, 0.2, 20.0, 60.0, 0.5
SHAKEN, QUICK = 20.0, 280.0


def mechanism(pull_off, **friction):
    return jc.System(
        mass=lambda t, q, args: jnp.full((1, 1), MASS),
        force=lambda t, q, v, args: MASS * (args * jnp.sin(RATE * t) - 9.81)[None],
        gap=lambda t, q, args: q,
        law=jc.JKR(pull_off=pull_off),
        stiffness=NECK.stiffness,
        **friction,
    )


@functools.cache
def shaken():
    """The speed of a body that a wall holds by its neck, with its derivative by the shaking."""

    def speed(shake):
        run = jc.simulate(
            mechanism(NECK.pull_off), LASTS, position=jnp.array([GAP]),
            velocity=jnp.array([-SPEED]), args=shake, rtol=1e-10,
        )  # fmt: skip
        return run.velocity[-1, 0], (run.velocity[-1, 0], run.contacts.energy_loss)

    return jax.jit(jax.jacfwd(speed, has_aux=True))(SHAKE)


def by_scipy(shake=SHAKE):
    """The wall is a ball of a mass of 1e30 kg."""
    return follow(
        [NECK], [MASS, 1e30], [GAP], [SPEED, 0.0], LASTS,
        lambda t: np.array([9.81 - shake * np.sin(RATE * t), 0.0]),
    )  # fmt: skip


def test_a_neck_that_is_shaken_apart_twice():
    found = by_scipy()
    assert len(found.moments[0]) == 4
    slope, (speed, lost) = shaken()
    np.testing.assert_allclose(speed, -found.velocity[0], atol=BY_SCIPY)
    np.testing.assert_allclose(lost[:2], NECK.lost, rtol=1e-9)
    h = 1e-4
    up, down = (by_scipy(SHAKE + sign * h).velocity[0] for sign in (1, -1))
    np.testing.assert_allclose(slope, -(up - down) / (2 * h), atol=SLOPES)


def test_powder_that_is_shaken():
    """Luding's contact turns back from its adhesion and is opened again."""
    system = jc.System(
        mass=lambda t, q, args: jnp.full((1, 1), MASS),
        force=lambda t, q, v, args: MASS * (args * jnp.sin(QUICK * t))[None],
        gap=lambda t, q, args: q,
        law=jc.Luding(ratio=4.0, slope=0.0, adhesion=0.8),
        stiffness=1e4,
        exponent=1.0,
    )
    run = jc.simulate(
        system, 0.3, position=jnp.array([0.0]), velocity=jnp.array([-SPEED]), args=SHAKEN,
        rtol=1e-10,
    )  # fmt: skip
    found = powders.follow(
        [powders.Powder(1e4, 4.0, 0.0, 0.8)], [MASS, 1e30], [0.0], [SPEED, 0.0], 0.3,
        lambda t: np.array([-SHAKEN * np.sin(QUICK * t), 0.0]),
    )  # fmt: skip
    assert found.shrunk > 0
    assert found.openings > 0
    np.testing.assert_allclose(run.velocity[-1, 0], -found.velocity[0], atol=BY_SCIPY)


def test_friction_is_refused():
    with pytest.raises(ValueError, match="must be a law whose bodies do not stick"):
        mechanism(2.0, friction=jc.RigidCoulomb(mu=0.1), slip=lambda t, q, v, args: v)
