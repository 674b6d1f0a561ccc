"""Soft impacts on accelerated fixed spheres and shells."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.shaken_spheres import circling, pressed, sine

SOFT = 1e-8
"""Ten times `rtol`: measured 4e-12."""

CIRCLE, STIFFNESS, DURATION = 3.0, 1e6, 1.6
START, VELOCITY, PULL = [0.5, 0.1], [-1.5, 0.3], [0.0, -2.0]
LAW = jc.HuGuo(e=0.7)


def circle(t, radius):
    angle = 2 * jnp.pi * CIRCLE * t
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


@pytest.mark.slow(reason="a soft scene with driven shells")
def test_a_soft_ball_between_a_shell_that_shakes_and_a_disc_in_a_circle():
    disc = jc.Prescribed(circle, 0.0501 * (2 * np.pi * CIRCLE) ** 2, 0.05)
    scene = jc.Scene(
        bodies=[
            jc.Sphere(0.2, None, [0.0, 0.0], fixed=True, motion=disc),
            jc.Sphere(0.05, 1.0, START, VELOCITY),
            jc.Shell([0.0, 0.02], 1.0, motion=jc.Vibration([0.03, 0.02], 7.0, 0.4)),
        ],
        law=LAW,
        stiffness=STIFFNESS,
        gravity=PULL,
    )
    # The second one falls into the first contact, which takes 0.012 s from 0.2222 s on.
    times = np.array([0.1, 0.2275, 0.5, DURATION])
    run = jc.simulate(scene, DURATION, times=times, v0="touch")
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) >= 2 and {0, 2} == set(np.asarray(run.impacts.second).tolist())
    assert np.all(run.impacts.solved_by == jc.SolvedBy.COUPLED)
    assert run.impacts.time[0] < times[1] < run.impacts.time[0] + run.impacts.duration[0]
    movers = [
        circling([0.0, 0.0], 0.05, CIRCLE, 0.25),
        sine([0.0, 0.02], [0.03, 0.02], 7.0, 0.4, -0.95),
    ]
    given = (STIFFNESS, float(LAW.damping_factor()), DURATION)
    known = pressed(movers, START, VELOCITY, PULL, *given, times[:-1])
    fastest = np.max(run.impacts.closing_speed)
    np.testing.assert_allclose(run.position[:, 1], known[:, :2], atol=SOFT * fastest)
    np.testing.assert_allclose(run.velocity[:, 1], known[:, 2:], atol=SOFT * fastest)
    np.testing.assert_allclose(run.position[:, 0], movers[0].place(times), atol=1e-15)
    np.testing.assert_allclose(run.velocity[:, 0], movers[0].velocity(times), atol=1e-14)
    lost = np.sum(run.impacts.energy_loss)
    before = 0.5 * np.sum(np.square(VELOCITY)) - np.dot(PULL, START)
    assert abs(before + run.wall_work - lost - run.energy[-1]) < 10 * SOFT * before
    assert abs(run.wall_work) > 0.1 * before
