"""The bouncing ball, against a loop in plain Python."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests import oracle
from tests.test_impact.support import assert_slopes, slopes_of_lanes

LOOP = 5e-15  # times, heights and speeds of twenty bounces: measured 2e-16
SLOPE = 2e-8  # central differences with relative step 1e-5: measured 2e-9, in a height of 1e-2 m
MODES = 1e-14  # forward against reverse: measured 2e-16

MASS, STIFFNESS, GRAVITY = 0.5, 1e8, 9.8
CONTACT = jc.Contact(mass=MASS, stiffness=STIFFNESS)


def plain(height, bounces, alpha):
    """Free fall by Galilei, one number for e and one for the scaled duration by the oracle."""
    scaled = oracle.hunt_crossley(alpha, "1.5")
    e, duration = float(scaled.e), float(scaled.duration)
    v = math.sqrt(2 * GRAVITY * height)
    t, rows = v / GRAVITY, []
    for _ in range(bounces):
        rebound = e * v
        rows.append((t, rebound**2 / (2 * GRAVITY), v, e))
        length = (MASS * v**2 / STIFFNESS) ** 0.4
        t += duration * length / v + 2 * rebound / GRAVITY
        v = rebound
    return np.array(rows).T


def test_constant_restitution():
    run = jc.bounce(jc.Damped(alpha=0.5), CONTACT, height=2.0, gravity=GRAVITY, bounces=20)
    time, height, velocity, e = plain(2.0, 20, "0.5")
    assert run.time.shape == (20,)
    np.testing.assert_allclose(run.time, time, rtol=LOOP)
    np.testing.assert_allclose(run.height, height, rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity, velocity, rtol=LOOP)
    np.testing.assert_allclose(run.restitution, e, rtol=LOOP)
    assert np.all(run.status == jc.Status.SEPARATED)


def test_elastic_ball_comes_back():
    run = jc.bounce(jc.Hertz(), CONTACT, height=2.0, gravity=GRAVITY, bounces=5)
    np.testing.assert_allclose(run.height, 2.0, rtol=LOOP)
    np.testing.assert_allclose(np.diff(run.time), np.diff(run.time)[0], rtol=LOOP)


@pytest.mark.parametrize("law", [jc.ConstantDamping(c=2e7), jc.KuwabaraKono(A=1e-5)])
def test_each_impact_has_its_own_speed(law):
    run = jc.bounce(law, CONTACT, height=1.0, bounces=6)
    e = np.asarray(run.restitution)
    assert np.all(np.diff(e) > 1e-4)
    again = jc.restitution(law, CONTACT, run.impact_velocity)
    np.testing.assert_allclose(e, again, rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity[1:], (e * run.impact_velocity)[:-1], rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity[0], math.sqrt(2 * 9.81), rtol=LOOP)


def test_bad_lanes():
    law = jc.HuGuo(e=jnp.array([0.8, 0.8, 0.8, 1.5, 0.6, 0.8]))
    height = jnp.array([1.0, -1.0, jnp.nan, 1.0, 2.0, 1.0])
    gravity = jnp.array([9.8, 9.8, 9.8, 9.8, 9.8, 0.0])
    run = jc.bounce(law, CONTACT, height, gravity=gravity, bounces=4)
    bad = np.array([False, True, True, True, False, True])
    assert run.time.shape == (6, 4)
    expected = np.where(bad, int(jc.Status.INVALID_INPUT), int(jc.Status.SEPARATED))
    np.testing.assert_array_equal(run.status, np.repeat(expected[:, None], 4, axis=1))
    for field in (run.height, run.impact_velocity, run.restitution, run.time):
        np.testing.assert_array_equal(np.isnan(field), np.broadcast_to(bad[:, None], field.shape))
    for lane in (0, 4):
        alone = jc.bounce(
            jc.HuGuo(e=float(law.e[lane])), CONTACT, float(height[lane]), gravity=9.8, bounces=4
        )
        for name in ("time", "height", "impact_velocity", "restitution"):
            np.testing.assert_allclose(getattr(run, name)[lane], getattr(alone, name), rtol=LOOP)
    slope = jax.grad(lambda h: jnp.nansum(jc.bounce(law, CONTACT, h, bounces=4).height))(height)
    assert np.all(np.isfinite(slope))


def test_derivatives_by_height_and_restitution():
    def last(point):
        height, e = point
        run = jc.bounce(jc.HuGuo(e=e), CONTACT, height, bounces=6)
        return jnp.stack([run.time[..., -1], run.height[..., -1]])

    assert_slopes(slopes_of_lanes(last), [[1.3, 0.7]], 1e-5, 0, SLOPE, rtol=MODES)


def test_a_ball_that_stops():
    law = jc.Damped(alpha=200.0)
    how = {"gravity": GRAVITY, "bounces": 10, "rest_velocity": jc.VELOCITY_THRESHOLD}
    run = jc.bounce(law, CONTACT, height=1.0, **how)
    moving = np.asarray(run.status == jc.Status.SEPARATED)
    count = int(moving.sum())
    assert 3 <= count <= 6
    assert np.all(moving[:count]) and np.all(np.asarray(run.status)[count:] == jc.Status.SETTLED)
    assert np.all(run.impact_velocity[:count] >= jc.VELOCITY_THRESHOLD)
    assert run.impact_velocity[count - 1] * run.restitution[count - 1] < jc.VELOCITY_THRESHOLD
    assert 0 < run.impact_velocity[count] < jc.VELOCITY_THRESHOLD
    assert np.all(run.impact_velocity[count + 1 :] == 0)
    for field in (run.height, run.restitution):
        assert np.all(np.asarray(field)[count:] == 0)
    assert np.all(np.isinf(run.duration[count:])) and np.all(np.isfinite(run.duration[:count]))
    assert np.all(np.asarray(run.time)[count:] == run.time[count])
    assert np.all(np.isfinite(run.time))
    slope = jax.grad(lambda h: jc.bounce(law, CONTACT, h, **how).time[-1])(1.0)
    assert np.isfinite(slope) and slope > 0
