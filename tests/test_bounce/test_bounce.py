"""The bouncing ball, against a loop in plain Python; the series of flights and contacts; rest."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

import jaxcontact as jc
from tests import oracle
from tests.test_impact.support import assert_slopes, both_jacobians, slopes_of_lanes

LOOP = 5e-15  # times, heights and speeds of twenty bounces: measured 2e-16
SLOPE = 2e-8  # central differences with relative step 1e-5: measured 2e-9, in a height of 1e-2 m
MODES = 1e-14  # forward against reverse: measured 2e-16

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


# --- A whole run ----------------------------------------------------------------------------------

SERIES, BY_DIGITS = 1e-12, 1e-8
"""Times and heights, and their derivatives, against forty digits: measured 7e-16 and 1e-12."""

ROUNDING = 1e-14  # what is left of a derivative that is zero, times its parameter over the value

DIFFERENCE = 1e-6
"""Derivatives with gravity in contact at rtol 1e-12, against central differences of step 1e-2 and
Richardson's extrapolation."""

POINT = {"e": 0.8, "K": 1e8, "m": 0.5, "g": 9.8, "h": 1.3}
COUNT = 8


def run(e, K, m, g, h, **options):
    return jc.bounce(jc.HuGuo(e=e), jc.Contact(m, K), h, gravity=g, **options)


def series(e, K, m, g, h):
    """Times and heights from flights and scaled contacts, to forty digits."""
    hit = oracle.hunt_crossley(3 * (1 - e) / (2 * e), "1.5")
    v, out = mp.sqrt(2 * g * h), []
    t = v / g
    for _ in range(COUNT):
        rebound = hit.e * v
        out.append((t, rebound**2 / (2 * g)))
        t += hit.duration * (m / K) ** mpf("0.4") * v ** mpf("-0.2") + 2 * rebound / g
        v = rebound
    return np.array(out, dtype=object).T


@pytest.mark.slow(reason="derivatives of a whole run")
def test_series_and_its_derivatives():
    def both(point):
        out = run(*point, bounces=COUNT)
        return jnp.stack([out.time, out.height])

    point = tuple(POINT.values())
    value, *slopes = both_jacobians(both, jnp.array(point))
    forward, reverse = (np.moveaxis(slope, -1, 0) for slope in slopes)
    with mp.workdps(40):
        exact = [mpf(x) for x in point]
        np.testing.assert_allclose(value, series(*exact).astype(float), rtol=SERIES)
        for i in range(5):
            step = exact[i] * mpf("1e-9")
            up, down = list(exact), list(exact)
            up[i], down[i] = up[i] + step, down[i] - step
            slope = ((series(*up) - series(*down)) / (2 * step)).astype(float)
            size = np.abs(slope).max(axis=1, keepdims=True)
            floor = ROUNDING * np.abs(value) / point[i]
            assert np.all(np.abs(reverse[i] - slope) <= BY_DIGITS * np.abs(slope) + floor)
            assert np.all(np.abs(reverse[i] - forward[i]) <= 1e-10 * size + floor)


@pytest.mark.slow(reason="derivatives of a whole run with weight in contact")
def test_derivatives_with_gravity_in_contact():
    options = {"bounces": 3, "gravity_in_contact": True, "method": jc.Event(rtol=1e-12)}

    def both(*point):
        out = run(*point, **options)
        return jnp.stack([out.time, out.height])

    point = tuple(POINT.values())
    # The point itself and all shifted ones in one batch: ± one step and ± half a step each.
    shifts = np.array([1e-2, -1e-2, 5e-3, -5e-3])
    lanes = [np.full((5, 5), x) for x in point]
    for i in range(5):
        lanes[i][i, :4] *= 1 + shifts
    found, pull = jax.vjp(both, *map(jnp.asarray, lanes))
    # Each result of the point, represented by its last lane.
    results = np.zeros((2, 3, *found.shape))
    for one, bounce in np.ndindex(2, 3):
        results[one, bounce, one, 0, 4, bounce] = 1
    slopes = [np.asarray(by[..., 0, 4]) for by in jax.vmap(jax.vmap(pull))(jnp.asarray(results))]
    values = np.asarray(found)
    for i in range(5):
        whole = (values[:, i, 0] - values[:, i, 1]) / (2e-2 * point[i])
        half = (values[:, i, 2] - values[:, i, 3]) / (1e-2 * point[i])
        difference = (4 * half - whole) / 3
        # The first touch is independent of e, K and m: its slope is zero.
        size = np.abs(difference).max(axis=1, keepdims=True)
        assert np.all(np.abs(slopes[i] - difference) <= DIFFERENCE * size)


@pytest.mark.parametrize("bounces", [3, 60])
def test_all_flights_together(bounces):
    """√(2h/g) (1+e)/(1-e), few bounces or so many that the ball came to rest on the way."""
    e_in = jnp.array([0.9, 0.6, 0.3])
    out = run(e_in, 1e8, 0.5, 9.8, 1.3, bounces=bounces)
    e = np.asarray(jc.restitution(jc.HuGuo(e=e_in)))
    assert np.all(np.isfinite(out.rest_time) == (bounces == 60))
    flights = 2 * np.sqrt(2 * np.asarray(out.height) / 9.8)
    flights[:, -1] *= np.isinf(np.asarray(out.duration)[:, -1])  # it is in the tail
    total = np.sqrt(2 * 1.3 / 9.8) + flights.sum(axis=-1) + np.asarray(out.remaining_flight)
    np.testing.assert_allclose(total, np.sqrt(2 * 1.3 / 9.8) * (1 + e) / (1 - e), rtol=SERIES)


def test_where_there_is_no_series():
    def flight(law, **how):
        # No program is needed to say so.
        run = jax.eval_shape(lambda: jc.bounce(law, CONTACT, 1.0, bounces=3, **how))
        return run.remaining_flight

    assert jnp.isinf(jc.bounce(jc.Hertz(), CONTACT, 1.0, bounces=5).remaining_flight)
    assert flight(jc.HuGuo(e=0.7)) is not None
    assert flight(jc.ConstantDamping(c=1e7)) is None
    assert flight(jc.HuGuo(e=0.7), gravity_in_contact=True) is None


class Slow(jc.HuGuo):
    """Hu-Guo's law, hiding that its α does not depend on the speed."""

    def damping_factor(self, contact=None, velocity=None):
        if velocity is None:
            raise ValueError("no speed")
        return super().damping_factor(contact, velocity)


def test_the_shortcut_changes_nothing():
    e = jnp.array([0.3, 0.8, 2.0])
    short, long = (jc.bounce(law(e=e), CONTACT, 1.0, bounces=30) for law in (jc.HuGuo, Slow))
    assert short.remaining_flight is not None and long.remaining_flight is None
    assert np.unique(short.status).tolist() == [0, 1, 3]
    for name in ("time", "duration", "impact_velocity", "restitution", "height", "rest_time"):
        np.testing.assert_allclose(getattr(short, name), getattr(long, name), rtol=SERIES)
    np.testing.assert_array_equal(short.status, long.status)


def test_rest_with_gravity_in_contact():
    law = jc.HuGuo(e=jnp.array([0.8, 1.5, 1.0]))
    options = {"gravity": 9.8, "bounces": 30, "gravity_in_contact": True}
    out = jc.bounce(law, DROP, 0.9, **options)
    assert np.isnan(out.time[1]).all() and (out.status[1] == jc.Status.INVALID_INPUT).all()
    assert np.isnan(out.rest_time[2]) and (out.status[2] == jc.Status.SEPARATED).all()
    left = np.asarray(out.status[0] == jc.Status.SEPARATED)
    count = int(left.sum())
    assert left[:count].all() and 15 < count < 25
    assert out.rest_time[0] == out.time[0, count]
    assert np.all(out.time[0, count:] == out.time[0, count])
    assert out.impact_velocity[0, count] > 0 and np.all(out.impact_velocity[0, count + 1 :] == 0)
    # The weight reduces every rebound, and slower ones more.
    e = np.asarray(out.restitution[0, :count])
    free = float(jc.restitution(jc.HuGuo(e=0.8)))
    assert e[0] < free and np.all(np.diff(e) < 0)
    np.testing.assert_allclose(out.rest_indentation[0], (9.8 / 1.4e8) ** (2 / 3), rtol=SERIES)
    # An impact at the speed of the settling touch, by `impact` itself.
    last = jc.impact(jc.HuGuo(e=0.8), DROP, out.impact_velocity[0, count], external_force=9.8)
    assert last.status == jc.Status.SETTLED


def test_rest_is_a_threshold_without():
    static = (9.8 / 1.4e8) ** (2 / 3)
    out = jc.bounce(jc.HuGuo(e=0.6), DROP, 0.9, gravity=9.8)
    np.testing.assert_allclose(out.rest_velocity, np.sqrt(9.8 * static), rtol=SERIES)
    settled = np.asarray(out.status == jc.Status.SETTLED)
    assert np.all((np.asarray(out.impact_velocity) < out.rest_velocity) == settled)
    other = jc.bounce(jc.HuGuo(e=0.6), DROP, 0.9, gravity=9.8, rest_velocity=0.5)
    assert other.rest_velocity == 0.5 and other.rest_time < out.rest_time


def test_height_at_any_time():
    out = run(jnp.array([0.3, 0.6, 1.0]), 1e8, 0.5, 9.8, 1.3, bounces=12)
    height_at = eqx.filter_jit(out.height_at)
    time, duration, height = (np.asarray(x) for x in (out.time, out.duration, out.height))
    assert height_at(jnp.linspace(0.0, 5.0, 50)).shape == (3, 50)
    assert np.all(height_at(jnp.array([-1.0, 0.0])) == 1.3)
    np.testing.assert_allclose(height_at(jnp.asarray(time + duration / 2))[2], 0, atol=0)
    rise = np.where(height > 0, time + duration + np.sqrt(2 * height / 9.8), 0)
    tops = np.asarray(height_at(jnp.asarray(rise)))
    np.testing.assert_allclose(tops[height > 0], height[height > 0], rtol=SERIES)
    late = np.asarray(height_at(jnp.array([100.0])))
    assert late[0] == 0 and np.isnan(late[2])  # at rest, and after the last listed flight
    np.testing.assert_allclose(height_at(jnp.array([0.25])), 1.3 - 9.8 * 0.0625 / 2, rtol=1e-14)


def test_single_precision_stays():
    law = jc.HuGuo(e=jnp.array(0.7, jnp.float32))
    contact = jc.Contact(jnp.array(0.5, jnp.float32), jnp.array(1e8, jnp.float32))
    out = jc.bounce(law, contact, jnp.array(1.0, jnp.float32), bounces=5)
    assert out.time.dtype == out.remaining_flight.dtype == jnp.float32
    double = jc.bounce(jc.HuGuo(e=0.7), CONTACT, 1.0, bounces=5)
    np.testing.assert_allclose(out.time, double.time, rtol=1e-5)


def test_by_default_every_ball_is_followed_to_rest():
    """From Python through as many touches as it takes; a ball that never rests is said to."""
    out = jc.bounce(jc.HuGuo(e=jnp.array([0.5, 0.8, 1.0, 2.0])), DROP, 0.9)
    settled = np.asarray(out.status == jc.Status.SETTLED)
    count = np.argmax(settled, axis=-1)
    assert out.at_rest.tolist() == [True, True, False, False]
    assert out.time.shape == (4, count.max() + 1) and count[1] > 20
    speed, e = out.impact_velocity, out.restitution
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
    assert repr(jc.bounce(jc.Hertz(), DROP, 0.9)).endswith("not at rest after 20 bounces")
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
    height = jax.grad(lambda h: jc.bounce(jc.HuGuo(e=e), DROP, h, bounces=20).rest_time[0])(0.9)
    alone = jax.grad(lambda h: jc.bounce(jc.HuGuo(e=0.5), DROP, h, bounces=20).rest_time)(0.9)
    np.testing.assert_allclose(height, alone, rtol=SERIES)


def test_rest_jumps_where_the_margin_is_zero():
    """By e of a threshold: one touch more, and the margin goes through zero there."""

    def run(e):
        return jc.bounce(jc.HuGuo(e=e), DROP, 0.9, bounces=40)

    e = jnp.linspace(0.70, 0.76, 61)
    out = run(e)
    touches = np.sum(np.asarray(out.status) == jc.Status.SEPARATED, axis=-1)
    (jump,) = np.flatnonzero(np.diff(touches))[:1]
    low, high = float(e[jump]), float(e[jump + 1])
    for _ in range(5):
        e = jnp.linspace(low, high, 61)
        out = run(e)
        touches = np.sum(np.asarray(out.status) == jc.Status.SEPARATED, axis=-1)
        jump = int(np.argmax(np.diff(touches)))
        low, high = float(e[jump]), float(e[jump + 1])
    assert touches[jump + 1] == touches[jump] + 1
    assert max(out.margin[jump], out.margin[jump + 1]) < 1e-9
    assert out.rest_time[jump + 1] - out.rest_time[jump] > 1e-3
