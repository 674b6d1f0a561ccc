"""Coupled contacts whose force vanishes before they open, and beds that used to stop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

BESIDE = 1e-8
"""Of e and duration beside `impact`, relative. Measured 2e-11."""

SLOPES = 1e-7
"""Of their slopes by speed, relative. Measured 3e-8."""


@pytest.mark.parametrize(
    "law", [jc.ThorntonPlastic(yield_speed=0.1), jc.HuGuo(e=0.03)], ids=["thornton", "hu guo"]
)
def test_coupled_contacts_end_as_impacts_alone(law):
    """Two balls of three touch; the third is so near that all are solved together."""

    def table(v):
        starts = (0.0, v / 2), (0.0201, -v / 2), (0.0403, 0 * v)
        balls = [jc.Sphere(0.01, 0.02, [x], jnp.reshape(speed, 1)) for x, speed in starts]
        run = jc.simulate(jc.Scene(balls, law, stiffness=1e7), 0.1, throw=False, max_impacts=4)
        one = run.impacts
        return jnp.stack([one.restitution[0], one.duration[0]]), one.solved_by[0]

    def alone(v):
        hit = jc.impact(law, jc.Contact(0.01, 1e7), v)
        return jnp.stack([hit.restitution, hit.duration])

    speed = (jnp.array(1.0),), (jnp.array(1.0),)
    value, slope, way = jax.jvp(table, *speed, has_aux=True)
    expected, rate = jax.jvp(alone, *speed)
    assert way == jc.SolvedBy.COUPLED
    np.testing.assert_allclose(value, expected, rtol=BESIDE)
    np.testing.assert_allclose(slope, rate, rtol=SLOPES, atol=1e-9)


@pytest.mark.parametrize(
    ("count", "width"),
    [(5, 0.09), pytest.param(6, 0.1, marks=pytest.mark.slow(reason="a larger bed"))],
)
def test_beds_complete(count, width):
    """A clamped force has a kink, which an event may lie behind: it stopped these beds."""
    box = {"low": [0.0, 0.0], "high": [width, 0.3]}
    discs = jc.random_spheres(count, **box, radius=0.02, mass=0.02, speed=0.1, seed=3)
    law, friction = jc.HuGuo(e=0.6), jc.RigidCoulomb(mu=0.3)
    scene = jc.Scene(
        [*discs, jc.Box(**box)], law, stiffness=1e6, gravity=[0.0, -9.81], friction=friction
    )
    run = jc.simulate(scene, 0.6)
    assert run.status == jc.Ending.COMPLETED and len(run.impacts) > 30
