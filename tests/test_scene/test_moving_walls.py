"""Walls with a prescribed motion: a shaking table, a lift, a moved box, a user's function."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcontact as jc
from tests.oracle.moving_table import (
    FREQUENCY,
    GRAVITY,
    MASS,
    RADIUS,
    RATE,
    STIFFNESS,
    bounces,
    over,
    sine,
)
from tests.test_scene.support import central, go, missing

EXACT = 1e-11
"""Ten impacts on a table that shakes, whose errors grow a hundredfold: measured 1e-12. After
fifteen by a function 1.1e-11."""

SOFT = 1e-8  # ten times `rtol`: also of places in m, speeds in m/s and work of what rests
FRAME = 1e-12  # what a moving frame changes but for rounding: measured 1e-16

LAW = jc.ExactRestitution(e=0.8)
SHAKEN = jc.Vibration(1e-4, FREQUENCY, 0.3)
A, B, KICK = 1e-4, 2e-5, 0.1234567
STRONGEST = RATE**2 * (A + 9 * B)


def moved(t, args):
    """A table that shakes with its frequency and three times that, by a function among its
    arguments, as a network has them; and falls as t³, and by a kick. It obeys a text.
    """
    first, third, cube, kick = args["numbers"]
    tones = first * args["form"](RATE * t) + third * args["form"](3 * RATE * t + 1.0)
    falls = cube * t**3 + kick * jax.nn.sigmoid((t - KICK) / 1e-7)
    return tones - falls if args["on"] == "yes" else 0 * t


def prescribed(most, first=0.0, third=0.0, cube=0.0, kick=0.0):
    args = {"numbers": (first, third, cube, kick), "form": jnp.sin, "on": "yes"}
    return jc.Prescribed(moved, most, args)


def tones(first, third):
    """The same for the reference."""
    return (
        lambda t: first * np.sin(RATE * t) + third * np.sin(3 * RATE * t + 1),
        lambda t: RATE * (first * np.cos(RATE * t) + 3 * third * np.cos(3 * RATE * t + 1)),
    )


TABLES = {
    "vibration": (SHAKEN, sine(1e-4, 0.3), 0.5, 8),
    "function": (prescribed(STRONGEST, A, B), tones(A, B), 0.4, 6),
}
"""The motion, that of the reference, the duration, and more impacts than so many."""


@pytest.mark.parametrize("kind", TABLES)
def test_a_ball_on_a_table(kind):
    motion, table, duration, least = TABLES[kind]
    run = go(over(motion, 0.02, LAW), duration)
    touches, height, velocity = bounces(table, 0.02, 0.8, duration)
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) == len(touches) > least
    np.testing.assert_allclose(run.impacts.time, touches[:, 0], rtol=EXACT)
    np.testing.assert_allclose(run.impacts.closing_speed, touches[:, 1], rtol=EXACT)
    assert abs(run.position[-1, 0, 0] - RADIUS - height) < EXACT
    assert abs(run.velocity[-1, 0, 0] - velocity) < EXACT
    assert missing(run) < 1e-14 * run.energy[0]
    # From halfway on the table continues at its own time.
    half = go(run.scene, duration / 2)
    rest = go(half.final, duration / 2)
    np.testing.assert_allclose(rest.velocity[-1], run.velocity[-1], atol=EXACT)
    np.testing.assert_allclose(half.wall_work + rest.wall_work, run.wall_work, atol=EXACT)


def test_the_derivative_by_the_arguments_of_a_function():
    def end(numbers):
        scene = over(prescribed(STRONGEST, *numbers), 0.02, LAW)
        return go(scene, 0.2, max_impacts=8).velocity[-1, 0, 0]

    numbers, along = np.array([A, B]), np.array([1e-5, 2e-6])
    found = jax.jit(lambda x: jax.jvp(end, (x,), (jnp.asarray(along),))[1])(jnp.asarray(numbers))
    slope = central(lambda h: bounces(tones(*(numbers + h * along)), 0.02, 0.8, 0.2)[2], 1e-4)
    np.testing.assert_allclose(found, slope, rtol=1e-5)


def test_what_a_table_leaves_behind_meets_it_again():
    """A ball at rest on a table that is at its highest, and falls faster than the ball."""
    amplitude = 1e-3
    motion = jc.Vibration(amplitude, FREQUENCY, np.pi / 2)
    run = go(over(motion, amplitude, LAW), 0.02)

    def gap(t):
        return amplitude - GRAVITY / 2 * t**2 - amplitude * np.cos(RATE * t)

    touch = brentq(gap, 0.005, 0.02, xtol=1e-16, rtol=1e-15)
    np.testing.assert_allclose(run.impacts.time, [touch], rtol=EXACT)


def test_period_one_doubles_where_theory_says():
    """At Γ = √((π(1-e)/(1+e))² + (2(1+e²)/(1+e)²)²) two bounces of the period-one orbit return
    a small change as it was.
    """
    e = 0.8
    start = math.pi * (1 - e) / (1 + e)
    bound = math.hypot(start, 2 * (1 + e * e) / (1 + e) ** 2)

    def spread(strength):
        """Of the closing speeds of alternate bounces, after many that began near the orbit."""
        amplitude = strength * GRAVITY / RATE**2
        # The ball leaves at g T/2 over the table, whose speed is A ω cos φ there.
        leaves = GRAVITY / FREQUENCY / 2
        phase = math.acos(start / strength)
        ball = [amplitude * math.sin(phase) + RADIUS], [leaves * 1.0001]
        table = jc.Plane([0.0], [1.0], motion=jc.Vibration(amplitude, FREQUENCY, phase))
        scene = jc.Scene([jc.Sphere(RADIUS, MASS, *ball), table], LAW, gravity=[-GRAVITY])
        speed = np.asarray(go(scene, 1500 / FREQUENCY).impacts.closing_speed)
        assert 1400 < len(speed) < 1600
        alternate = np.abs(np.diff(speed)) / speed[1:]
        return np.max(alternate[:20]), np.max(alternate[-20:])

    before, after = spread(bound * (1 - 1e-3)), spread(bound * (1 + 1e-3))
    assert before[1] < before[0] / 2
    assert after[1] > after[0] * 2


def _goes_on(speed, velocity, gravity, *, e=0.7, duration=0.02, instantaneous=False):
    """A ball and a floor, both seen from a frame in which the floor moves at `speed`."""
    ball = jc.Sphere(RADIUS, MASS, [0.0, 0.012], [0.2, velocity + speed])
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady([0.0, speed]))
    scene = jc.Scene([ball, floor], jc.HuGuo(e=e), stiffness=STIFFNESS, gravity=gravity)
    return jc.simulate(scene, duration, instantaneous=instantaneous)


def test_closed_forms_do_not_know_the_frame():
    """Coupled solves: the next test."""
    still, moving = (_goes_on(speed, -1.0, [GRAVITY, 0.0]) for speed in (0.0, 0.37))
    assert moving.impacts.solved_by[0] == jc.SolvedBy.CLOSED_FORM
    up = np.array([0.0, 0.37])
    place, speed = still.position[-1, 0] + 0.02 * up, still.velocity[-1, 0] + up
    np.testing.assert_allclose(moving.position[-1, 0], place, atol=FRAME)
    np.testing.assert_allclose(moving.velocity[-1, 0], speed, atol=FRAME)
    assert abs(still.wall_work) < 1e-14 * still.energy[0]
    assert missing(moving) < 100 * 1e-9 * moving.energy[0]


@pytest.mark.parametrize("instantaneous", [False, True])
def test_a_lift_carries_what_rests_on_it(instantaneous):
    speed, fall, duration = 0.37, -0.3, 1.0
    given = {"e": 0.3, "duration": duration, "instantaneous": instantaneous}
    gravity, up = [0.1, -GRAVITY], np.array([0.0, speed])
    still = _goes_on(0.0, fall, gravity, **given)
    run = _goes_on(speed, fall, gravity, **given)
    assert run.status == jc.Ending.COMPLETED
    # It rests long before the end.
    assert run.impacts.time[-1] < 0.2
    assert np.isinf(run.impacts.duration[-1]) or instantaneous
    place, velocity = still.position[-1, 0] + up * duration, still.velocity[-1, 0] + up
    np.testing.assert_allclose(run.position[-1, 0], place, atol=SOFT, rtol=0)
    np.testing.assert_allclose(run.velocity[-1, 0], velocity, atol=SOFT, rtol=0)
    # The lift moves by its speed times the time, against the transferred momentum and the weight.
    gained = MASS * (run.velocity[-1, 0, 1] - (fall + speed) + GRAVITY * duration)
    np.testing.assert_allclose(run.wall_work, speed * gained, rtol=SOFT)
    assert missing(run) < 100 * 1e-9 * run.energy[0]
    # It continues from rest, and the lift does the same work per second.
    more = jc.simulate(run.final, 0.5, instantaneous=instantaneous)
    assert len(more.impacts) == 0
    moved = up * 0.5
    moved[0] = run.velocity[-1, 0, 0] * 0.5 + gravity[0] * 0.5**2 / 2
    np.testing.assert_allclose(more.position[-1] - run.position[-1], moved[None], atol=SOFT)
    np.testing.assert_allclose(more.wall_work, MASS * GRAVITY * speed * 0.5, rtol=SOFT)


def test_a_box_that_is_moved_carries_its_balls():
    """In its own frame the box stands, and an elastic ball goes to and fro."""
    box = jc.Box([0.0, 0.0], [1.0, 1.0], motion=jc.Steady([0.5, 0.0]))
    ball = jc.Sphere(0.1, 1.0, [0.5, 0.5], [1.5, 0.2])
    run = go(jc.Scene([ball, box], jc.ExactRestitution(e=1.0)), 8.0)
    # Over 0.8 m and back in 1.6 s at 1 m/s, in 8 s at 0.2 m/s.
    np.testing.assert_allclose(run.position[-1, 0], [0.5 + 4.0, 0.5], atol=1e-13)
    np.testing.assert_allclose(run.velocity[-1, 0], [1.5, 0.2], atol=1e-13)
    np.testing.assert_allclose(run.final.bodies[1].low, [4.0, 0.0], atol=1e-13)


def test_a_wall_that_exceeds_its_acceleration_is_flagged():
    """d = c t³ has the acceleration 6 c t; a jerk within an interval is seen by what it moved."""

    def run_of(most, **falls):
        scene = over(prescribed(most, **falls), 0.5, LAW)
        return go(scene, 0.4, times=[0.19, 0.3], throw=False)

    run = run_of(1.2, cube=1.0)
    assert run.status == jc.Ending.WALL_TOO_ABRUPT
    assert 0.2 <= run.reached < 0.2 + 2 * 0.4 / 4096
    fallen = 0.5 + RADIUS - GRAVITY / 2 * 0.19**2
    np.testing.assert_allclose(run.position[0, 0, 0], fallen, rtol=EXACT)
    assert np.all(np.isnan(run.position[1])) and "wall too abrupt" in str(run)
    assert run_of(1.2, cube=0.4).status == jc.Ending.COMPLETED
    # The sampled times are 1e-4 s apart.
    run = run_of(1e3, kick=1e-3)
    assert run.status == jc.Ending.WALL_TOO_ABRUPT
    assert abs(run.reached - KICK) < 0.4 / 4096


BEGINS, RETURNS, STRENGTH = 0.2345, 0.3, 4.0


def later(t, args):
    """Stands, and then moves away and comes back, or the other way round."""
    strength, jolt, along = args
    u = jnp.maximum(t - BEGINS, 0)
    return (jolt * u**2 / 2 + strength * u**3 * (1 - u / RETURNS)) * along


def waiting(count, strength, jolt=0.0):
    """Balls at rest beside a plane, a fixed sphere and a shell, which they touch but for rounding;
    the first ones of these, far from each other.
    """

    def motion(along):
        return jc.Prescribed(later, 12 * STRENGTH, (strength, jolt, jnp.asarray(along)))

    along = [0.0, 1.0]
    bodies = [
        jc.Plane([0.0, 0.2], along, motion=motion(1.0)),
        jc.Sphere(0.2, position=[5.0, 3.0], fixed=True, motion=motion(along)),
        jc.Shell([-20.0, 1.0], 30.0, motion=motion([-1.0, 0.0])),
    ]
    places = [[0.0, 0.3], [5.0, 3.3], [9.9, 1.0]]
    balls = [jc.Sphere(0.1, 1.0, place) for place in places[:count]]
    return jc.Scene([*balls, *bodies[:count]], jc.Hertz(), stiffness=1e4)


@pytest.mark.slow(reason="a soft scene of its own, 24 s of CPU")
def test_what_leaves_and_comes_back_is_met():
    """At the time and with the speed at which its displacement vanishes again."""
    exact = 1e-12
    run = go(waiting(3, -STRENGTH), 0.54)
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) == 3
    np.testing.assert_allclose(run.impacts.time, BEGINS + RETURNS, rtol=exact)
    closing = STRENGTH * RETURNS**2
    np.testing.assert_allclose(run.impacts.closing_speed, closing, rtol=exact)
    gained = 2 * closing * np.array([[0.0, 1.0], [0.0, 1.0], [-1.0, 0.0]])
    np.testing.assert_allclose(run.velocity[-1, :3], gained, atol=exact)
    # An immediate push would be an impact after the other one, which is reported.
    pushed = go(waiting(3, STRENGTH), 0.54, throw=False)
    assert pushed.status == jc.Ending.ACCUMULATED
    assert abs(pushed.reached - BEGINS) < 1e-4


@pytest.mark.parametrize("jolt", [2.0, 0.0])
def test_what_begins_to_push_is_followed(jolt):
    """From an acceleration that is there at once, and from one that grows."""
    run = jc.simulate(waiting(1, STRENGTH, jolt), 0.4)
    assert run.status == jc.Ending.COMPLETED

    def rates(t, state):
        height, speed = state
        u = t - BEGINS
        lifted = jolt * u**2 / 2 + STRENGTH * u**3 * (1 - u / RETURNS)
        return speed, 1e4 * max(0.3 + lifted - height, 0.0) ** 1.5

    exact = solve_ivp(rates, (BEGINS, 0.4), (0.3, 0.0), "DOP853", rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(run.position[-1, 0, 1], exact.y[0, -1], atol=SOFT)
    np.testing.assert_allclose(run.velocity[-1, 0, 1], exact.y[1, -1], atol=SOFT)
    assert exact.y[1, -1] > 0.05
