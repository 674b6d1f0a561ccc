"""A body in touch with another at rest, which begins to move later."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc

BEGINS, RETURNS, STRENGTH = 0.2345, 0.3, 4.0

EXACT = 1e-12
"""Of a time and a speed at a touch that are known."""

SOFT = 1e-8
"""Ten times `rtol`, beside an integration at 1e-12."""


def later(t, args):
    """Stands, and then moves away and comes back, or the other way round."""
    strength, jolt, along = args
    u = jnp.maximum(t - BEGINS, 0)
    return (jolt * u**2 / 2 + strength * u**3 * (1 - u / RETURNS)) * along


def motion(strength, along=1.0, jolt=0.0):
    return jc.Prescribed(later, 12 * STRENGTH, (strength, jolt, jnp.asarray(along)))


def scene(count, strength, jolt=0.0):
    """Balls at rest beside a plane, a fixed sphere and a shell, which they touch but for rounding;
    the first ones of these, far from each other.
    """
    along = [0.0, 1.0]
    bodies = [
        jc.Plane([0.0, 0.2], along, motion=motion(strength, 1.0, jolt)),
        jc.Sphere(0.2, position=[5.0, 3.0], fixed=True, motion=motion(strength, along, jolt)),
        jc.Shell([-20.0, 1.0], 30.0, motion=motion(strength, [-1.0, 0.0], jolt)),
    ]
    places = [[0.0, 0.3], [5.0, 3.3], [9.9, 1.0]]
    balls = [jc.Sphere(0.1, 1.0, place) for place in places[:count]]
    return jc.Scene([*balls, *bodies[:count]], jc.Hertz(), stiffness=1e4)


@pytest.mark.slow(reason="a soft scene of its own, 24 s of CPU")
def test_what_leaves_and_comes_back_is_met():
    """At the time and with the speed at which its displacement vanishes again."""
    run = jc.simulate(scene(3, -STRENGTH), 0.54, instantaneous=True)
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) == 3
    np.testing.assert_allclose(run.impacts.time, BEGINS + RETURNS, rtol=EXACT)
    closing = STRENGTH * RETURNS**2
    np.testing.assert_allclose(run.impacts.closing_speed, closing, rtol=EXACT)
    gained = 2 * closing * np.array([[0.0, 1.0], [0.0, 1.0], [-1.0, 0.0]])
    np.testing.assert_allclose(run.velocity[-1, :3], gained, atol=EXACT)
    # An immediate push would be an impact after the other one, which is reported.
    pushed = jc.simulate(scene(3, STRENGTH), 0.54, instantaneous=True, throw=False)
    assert pushed.status == jc.Ending.ACCUMULATED
    assert abs(pushed.reached - BEGINS) < 1e-4


@pytest.mark.parametrize("jolt", [2.0, 0.0])
def test_what_begins_to_push_is_followed(jolt):
    """From an acceleration that is there at once, and from one that grows."""
    run = jc.simulate(scene(1, STRENGTH, jolt), 0.4)
    assert run.status == jc.Ending.COMPLETED

    def rates(t, state):
        height, speed = state
        u = t - BEGINS
        lifted = jolt * u**2 / 2 + STRENGTH * u**3 * (1 - u / RETURNS)
        depth = max(0.3 + lifted - height, 0.0)
        return speed, 1e4 * depth**1.5

    exact = solve_ivp(rates, (BEGINS, 0.4), (0.3, 0.0), "DOP853", rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(run.position[-1, 0, 1], exact.y[0, -1], atol=SOFT)
    np.testing.assert_allclose(run.velocity[-1, 0, 1], exact.y[1, -1], atol=SOFT)
    assert exact.y[1, -1] > 0.05
