"""The bouncing ball, against a loop in plain Python; the series of flights and contacts; rest."""

import math

import equinox as eqx
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
ROUNDED = 2e-11  # of a logarithmic difference that is zero: measured 8e-12

MASS, STIFFNESS, GRAVITY = 0.5, 1e8, 9.8
CONTACT = jc.Contact(mass=MASS, stiffness=STIFFNESS)
DROP = jc.Contact(1.0, 1.4e8)


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


def drop(law, height, contact=CONTACT, **how):
    """A run as NumPy arrays."""
    return jax.tree.map(np.asarray, jc.bounce(law, contact, height, **how))


@pytest.mark.parametrize(("law", "alpha"), [(jc.Damped(alpha=0.5), "0.5"), (jc.Hertz(), "0")])
def test_constant_restitution(law, alpha):
    run = drop(law, 2.0, gravity=GRAVITY, bounces=20)
    time, height, velocity, e = plain(2.0, 20, alpha)
    assert run.time.shape == (20,)
    np.testing.assert_allclose(run.time, time, rtol=LOOP)
    np.testing.assert_allclose(run.height, height, rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity, velocity, rtol=LOOP)
    np.testing.assert_allclose(run.restitution, e, rtol=LOOP)
    assert np.all(run.status == jc.Status.SEPARATED)
    assert np.isinf(run.remaining_flight) == (alpha == "0")


@pytest.mark.parametrize("law", [jc.ConstantDamping(c=2e7), jc.KuwabaraKono(A=1e-5)])
def test_each_impact_has_its_own_speed(law):
    run = drop(law, 1.0, bounces=6)
    e = run.restitution
    assert run.remaining_flight is None
    assert np.all(np.diff(e) > 1e-4)
    again = jc.restitution(law, CONTACT, run.impact_velocity)
    np.testing.assert_allclose(e, again, rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity[1:], (e * run.impact_velocity)[:-1], rtol=LOOP)
    np.testing.assert_allclose(run.impact_velocity[0], math.sqrt(2 * 9.81), rtol=LOOP)


def test_bad_lanes():
    e = np.array([0.8, 0.8, 0.8, 1.5, 0.6, 0.8])
    height = np.array([1.0, -1.0, np.nan, 1.0, 2.0, 1.0])
    gravity = np.array([9.8, 9.8, 9.8, 9.8, 9.8, 0.0])
    run = drop(jc.HuGuo(e=e), height, gravity=gravity, bounces=4)
    bad = np.array([False, True, True, True, False, True])
    assert run.time.shape == (6, 4)
    expected = np.where(bad, int(jc.Status.INVALID_INPUT), int(jc.Status.SEPARATED))
    np.testing.assert_array_equal(run.status, np.repeat(expected[:, None], 4, axis=1))
    for field in (run.height, run.impact_velocity, run.restitution, run.time):
        np.testing.assert_array_equal(np.isnan(field), np.broadcast_to(bad[:, None], field.shape))
    for lane in (0, 4):
        # Among lanes that are well.
        asked, high, pull = (np.full(6, x[lane]) for x in (e, height, gravity))
        well = drop(jc.HuGuo(e=asked), high, gravity=pull, bounces=4)
        for name in ("time", "height", "impact_velocity", "restitution"):
            np.testing.assert_allclose(getattr(run, name)[lane], getattr(well, name)[0], rtol=LOOP)

    @jax.jit
    @jax.grad
    def slope(height):
        return jnp.nansum(jc.bounce(jc.HuGuo(e=e), CONTACT, height, bounces=4).height)

    assert np.all(np.isfinite(slope(height)))


def test_derivatives_by_every_parameter():
    def last(point):
        out = run(*point, bounces=6)
        return jnp.stack([out.time[..., -1], out.height[..., -1]])

    point = [list(POINT.values())]
    assert_slopes(slopes_of_lanes(last), point, 1e-5, ROUNDED, SLOPE, rtol=MODES)


def test_a_ball_that_stops():
    law = jc.Damped(alpha=200.0)
    how = {"gravity": GRAVITY, "bounces": 10, "rest_velocity": jc.VELOCITY_THRESHOLD}
    run = drop(law, 1.0, **how)
    moving = run.status == jc.Status.SEPARATED
    count = int(moving.sum())
    assert 3 <= count <= 6
    assert np.all(moving[:count]) and np.all(run.status[count:] == jc.Status.SETTLED)
    assert np.all(run.impact_velocity[:count] >= jc.VELOCITY_THRESHOLD)
    assert run.impact_velocity[count - 1] * run.restitution[count - 1] < jc.VELOCITY_THRESHOLD
    assert 0 < run.impact_velocity[count] < jc.VELOCITY_THRESHOLD
    assert np.all(run.impact_velocity[count + 1 :] == 0)
    for field in (run.height, run.restitution):
        assert np.all(field[count:] == 0)
    assert np.all(np.isinf(run.duration[count:])) and np.all(np.isfinite(run.duration[:count]))
    assert np.all(run.time[count:] == run.time[count])
    assert np.all(np.isfinite(run.time))
    slope = jax.jit(jax.grad(lambda h: jc.bounce(law, CONTACT, h, **how).time[-1]))(1.0)
    assert np.isfinite(slope) and slope > 0


# --- A whole run ----------------------------------------------------------------------------------

SERIES = 1e-12  # times and heights of runs that are followed in two ways: measured 7e-16
DIFFERENCE = 1e-6  # central differences with gravity in contact, relative step 3e-4

POINT = {"e": 0.8, "K": 1e8, "m": 0.5, "g": 9.8, "h": 1.3}


def run(e, K, m, g, h, **options):
    return jc.bounce(jc.HuGuo(e=e), jc.Contact(m, K), h, gravity=g, **options)


@pytest.mark.slow(reason="derivatives of a whole run with weight in contact")
def test_derivatives_with_gravity_in_contact():
    how = {"bounces": 3, "gravity_in_contact": True, "method": jc.Event(rtol=1e-12)}

    def both(point):
        out = run(*point, **how)
        return jnp.stack([out.time, out.height]).ravel()

    solve, at = slopes_of_lanes(both), [list(POINT.values())]
    assert_slopes(solve, at, 3e-4, DIFFERENCE, DIFFERENCE, rtol=DIFFERENCE, atol=DIFFERENCE)


def test_all_flights_together():
    """√(2h/g) (1+e)/(1-e), few bounces or so many that the ball came to rest on the way."""
    e_in = np.array([0.97, 0.6, 0.3])
    out = jax.tree.map(np.asarray, run(e_in, 1e8, 0.5, 9.8, 1.3, bounces=30))
    e = jc.restitution(jc.HuGuo(e=e_in))
    assert np.isfinite(out.rest_time).tolist() == [False, True, True]
    flights = 2 * np.sqrt(2 * out.height / 9.8)
    flights[:, -1] *= np.isinf(out.duration[:, -1])  # it is in the tail
    total = np.sqrt(2 * 1.3 / 9.8) + flights.sum(axis=-1) + out.remaining_flight
    np.testing.assert_allclose(total, np.sqrt(2 * 1.3 / 9.8) * (1 + e) / (1 - e), rtol=SERIES)


class Slow(jc.HuGuo):
    """Hu-Guo's law, hiding that its α does not depend on the speed."""

    def damping_factor(self, contact=None, velocity=None):
        if velocity is None:
            raise ValueError("no speed")
        return super().damping_factor(contact, velocity)


def test_the_shortcut_changes_nothing():
    e = np.array([0.3, 0.8, 2.0])
    short, long = (drop(law(e=e), 1.0, bounces=30) for law in (jc.HuGuo, Slow))
    assert short.remaining_flight is not None and long.remaining_flight is None
    assert np.unique(short.status).tolist() == [0, 1, 3]
    for name in ("time", "duration", "impact_velocity", "restitution", "height", "rest_time"):
        np.testing.assert_allclose(getattr(short, name), getattr(long, name), rtol=SERIES)
    np.testing.assert_array_equal(short.status, long.status)


def test_height_at_any_time():
    out = run(np.array([0.3, 0.6, 1.0]), 1e8, 0.5, 9.8, 1.3, bounces=30)
    height_at = eqx.filter_jit(lambda time: out.height_at(time))
    early = [-1.0, 0.0, 0.25]
    found = np.asarray(height_at(jnp.array([*early, *np.linspace(0.0, 5.0, 46), 100.0])))
    assert found.shape == (3, 50)
    np.testing.assert_allclose(found[:, :3], [[1.3, 1.3, 1.3 - 9.8 * 0.0625 / 2]] * 3, rtol=1e-14)
    assert found[0, -1] == 0 and np.isnan(found[2, -1])  # at rest, and after the last flight
    time, duration, height = (np.asarray(x) for x in (out.time, out.duration, out.height))
    np.testing.assert_allclose(height_at(jnp.asarray(time + duration / 2))[2], 0, atol=0)
    rise = np.where(height > 0, time + duration + np.sqrt(2 * height / 9.8), 0)
    tops = np.asarray(height_at(jnp.asarray(rise)))
    # One run at times of any shape.
    one = jax.tree.map(lambda x: np.asarray(x)[0], out)
    again = jax.jit(lambda run, at: run.height_at(at))(one, rise[0].reshape(5, 6))
    np.testing.assert_array_equal(np.asarray(again).ravel(), tops[0])
    np.testing.assert_allclose(tops[height > 0], height[height > 0], rtol=SERIES)


def test_single_precision_stays():
    law = jc.HuGuo(e=jnp.array(0.7, jnp.float32))
    contact = jc.Contact(jnp.array(0.5, jnp.float32), jnp.array(1e8, jnp.float32))
    height, gravity = jnp.array([1.0, GRAVITY], jnp.float32)
    out = jc.bounce(law, contact, height, gravity=gravity, bounces=5)
    assert out.time.dtype == out.remaining_flight.dtype == jnp.float32
    time, *_ = plain(1.0, 5, str(3 * (1 - 0.7) / (2 * 0.7)))
    np.testing.assert_allclose(out.time, time, rtol=1e-5)


def test_by_default_every_ball_is_followed_to_rest():
    """From Python through as many touches as it takes; a ball that never rests is said to."""
    out = drop(jc.HuGuo(e=np.array([0.5, 0.8, 1.0, 2.0])), 0.9, DROP)
    settled = out.status == jc.Status.SETTLED
    count = np.argmax(settled, axis=-1)
    assert out.at_rest.tolist() == [True, True, False, False]
    assert out.time.shape == (4, count.max() + 1) and count[1] > 20
    speed, e = out.impact_velocity, out.restitution
    # Without weight in contact rest is a threshold, √(g δ) with the indentation δ at rest.
    threshold = np.sqrt(9.81 * (9.81 / 1.4e8) ** (2 / 3))
    np.testing.assert_allclose(out.rest_velocity[:3], threshold, rtol=SERIES)
    assert np.all((speed < threshold) == settled, where=[[True], [True], [True], [False]])
    for ball in (0, 1):
        last = count[ball]
        assert out.rest_time[ball] == out.time[ball, last]
        bounds = out.rest_velocity[ball] - speed[ball, last], speed[ball, last - 1]
        margin = min(bounds[0], bounds[1] - out.rest_velocity[ball])
        np.testing.assert_allclose(out.margin[ball], margin, rtol=SERIES)
    assert np.isnan(out.rest_time[2]) and np.isfinite(out.height[2]).all()
    above = (e * speed)[2, -1] - out.rest_velocity[2]
    np.testing.assert_allclose(out.margin[2], above, rtol=SERIES)
    words = f"2 balls at rest after {count[0]} to {count[1]} bounces, "
    words += f"1 ball not at rest after {count[1] + 1} bounces, 1 invalid_input"
    assert words in repr(out)
    assert repr(jc.bounce(jc.HuGuo(e=1.0), DROP, 0.9)).endswith("not at rest after 20 bounces")
    slow = jc.bounce(jc.HuGuo(e=0.97), DROP, 0.9)
    assert slow.at_rest and f"at rest after {slow.time.size - 1} bounces" in repr(slow)


def test_a_ball_that_is_not_at_rest_has_no_rest_time_and_no_derivative_of_it():
    e = jnp.array([0.5, 0.8])

    @jax.jit
    def everything(e):
        def rest_time(e):
            return jc.bounce(jc.HuGuo(e=e), DROP, 0.9).rest_time

        value, forward = jax.linearize(rest_time, e)
        return value, forward(jnp.ones(2)), jax.linear_transpose(forward, e)(jnp.ones(2))[0]

    np.testing.assert_array_equal(np.isnan(everything(e)), [[False, True]] * 3)

    # The gradient of a shared number stays finite beside a bad lane.
    @jax.jit
    def slope(e):
        return jax.grad(lambda h: jc.bounce(jc.HuGuo(e=e), DROP, h).rest_time[0])(0.9)

    np.testing.assert_allclose(slope(e), slope(jnp.array([0.5, 0.5])), rtol=SERIES)


def test_rest_jumps_where_the_margin_is_zero():
    """By e of a threshold: one touch more, and the margin goes through zero there."""
    low, high = 0.70, 0.76
    for _ in range(6):
        e = np.linspace(low, high, 61)
        out = drop(jc.HuGuo(e=e), 0.9, DROP, bounces=40)
        touches = np.sum(out.status == jc.Status.SEPARATED, axis=-1)
        jump = int(np.argmax(np.diff(touches)))
        low, high = e[jump : jump + 2]
    assert touches[jump + 1] == touches[jump] + 1
    assert max(out.margin[jump], out.margin[jump + 1]) < 1e-9
    assert out.rest_time[jump + 1] - out.rest_time[jump] > 1e-3
