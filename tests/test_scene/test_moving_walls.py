"""Walls with a prescribed motion: a shaking table, a wall at constant velocity, a moved box."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
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
    pressed,
    sine,
)
from tests.test_impact.support import both_jacobians

EXACT = 1e-11
"""Ten impacts on a table that shakes, whose errors grow a hundredfold: measured 1e-12."""

SOFT = 1e-8
"""Ten times `rtol`."""

FRAME = 1e-12
"""What a moving frame changes but for rounding: measured 1e-16."""

REST = 1e-8
"""Ten times `rtol`: of places in m, speeds in m/s, and work."""


def on_a_table(amplitude, phase, height, law):
    return over(jc.Vibration(amplitude, FREQUENCY, phase), height, law)


def test_a_ball_on_a_table_that_shakes():
    run = jc.simulate(
        on_a_table(1e-4, 0.3, 0.02, jc.ExactRestitution(e=0.8)), 0.5, instantaneous=True
    )
    touches, height, velocity = bounces(sine(1e-4, 0.3), 0.02, 0.8, 0.5)
    assert len(run.impacts) == len(touches) > 8
    np.testing.assert_allclose(run.impacts.time, touches[:, 0], rtol=EXACT)
    np.testing.assert_allclose(run.impacts.closing_speed, touches[:, 1], rtol=EXACT)
    assert abs(run.position[-1, 0, 0] - RADIUS - height) < EXACT
    assert abs(run.velocity[-1, 0, 0] - velocity) < EXACT
    lost = jnp.sum(run.impacts.energy_loss)
    assert abs(run.energy[0] + run.wall_work - lost - run.energy[1]) < 1e-14 * run.energy[0]


def test_what_a_table_leaves_behind_meets_it_again():
    """A ball at rest on a table that is at its highest, and falls faster than the ball."""
    amplitude = 1e-3
    scene = on_a_table(amplitude, np.pi / 2, amplitude, jc.ExactRestitution(e=0.8))
    run = jc.simulate(scene, 0.02, instantaneous=True)

    def gap(t):
        return amplitude - GRAVITY / 2 * t**2 - amplitude * np.cos(RATE * t)

    touch = brentq(gap, 0.005, 0.02, xtol=1e-16, rtol=1e-15)
    np.testing.assert_allclose(run.impacts.time, [touch], rtol=EXACT)


def test_a_run_on_a_moving_table_can_be_continued():
    law = jc.ExactRestitution(e=0.8)
    whole = jc.simulate(on_a_table(1e-4, 0.3, 0.02, law), 0.3, instantaneous=True)
    half = jc.simulate(on_a_table(1e-4, 0.3, 0.02, law), 0.15, instantaneous=True)
    rest = jc.simulate(half.final, 0.15, instantaneous=True)
    np.testing.assert_allclose(rest.velocity[-1], whole.velocity[-1], atol=EXACT)
    np.testing.assert_allclose(half.wall_work + rest.wall_work, whole.wall_work, atol=EXACT)


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
        scene = jc.Scene(
            [
                jc.Sphere(RADIUS, MASS, [amplitude * math.sin(phase) + RADIUS], [leaves * 1.0001]),
                jc.Plane([0.0], [1.0], motion=jc.Vibration(amplitude, FREQUENCY, phase)),
            ],
            jc.ExactRestitution(e=e),
            gravity=[-GRAVITY],
        )
        run = jc.simulate(scene, 1500 / FREQUENCY, instantaneous=True)
        speed = np.asarray(run.impacts.closing_speed)
        assert 1400 < len(speed) < 1600
        alternate = np.abs(np.diff(speed)) / speed[1:]
        return np.max(alternate[:20]), np.max(alternate[-20:])

    before, after = spread(bound * (1 - 1e-3)), spread(bound * (1 + 1e-3))
    assert before[1] < before[0] / 2
    assert after[1] > after[0] * 2


def _state(numbers):
    run = jc.simulate(
        on_a_table(*numbers, jc.ExactRestitution(e=0.8)), 0.2, instantaneous=True, max_impacts=8
    )
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.wall_work])


@pytest.mark.slow(reason="derivatives of a soft scene")
def test_derivatives_by_the_motion_of_a_table():
    numbers = jnp.asarray([1e-4, 0.3, 0.02])
    _, forward, reverse = jax.jit(functools.partial(both_jacobians, _state))(numbers)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    for k, step in enumerate([1e-9, 1e-6, 1e-8]):
        change = np.eye(3)[k] * step
        both = [np.asarray(numbers) + s * change for s in (1, -1)]
        ends = [bounces(sine(*x[:2]), x[2], 0.8, 0.2)[1:] for x in both]
        # A step of 1e-9 m leaves some seven digits of the reference.
        np.testing.assert_allclose(
            forward[:2, k], (np.array(ends[0]) - np.array(ends[1])) / (2 * step), rtol=1e-5
        )


def _goes_on(speed, velocity, gravity, *, e=0.7, duration=0.02, instantaneous=False):
    """A ball and a floor, both seen from a frame in which the floor moves at `speed`."""
    scene = jc.Scene(
        bodies=[
            jc.Sphere(RADIUS, MASS, [0.0, 0.012], [0.2, velocity + speed]),
            jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady([0.0, speed])),
        ],
        law=jc.HuGuo(e=e),
        stiffness=STIFFNESS,
        gravity=gravity,
    )
    return jc.simulate(scene, duration, instantaneous=instantaneous)


@pytest.mark.slow("gravity0-5", reason="two soft scenes")
@pytest.mark.parametrize(
    ("gravity", "way"),
    [([0.0, -GRAVITY], jc.SolvedBy.COUPLED), ([GRAVITY, 0.0], jc.SolvedBy.CLOSED_FORM)],
)
def test_soft_impacts_do_not_know_the_frame(gravity, way):
    still, moving = _goes_on(0.0, -1.0, gravity), _goes_on(0.37, -1.0, gravity)
    assert moving.impacts.solved_by[0] == way
    shift = np.array([0.0, 0.37 * 0.02])
    np.testing.assert_allclose(moving.position[-1, 0], still.position[-1, 0] + shift, atol=FRAME)
    np.testing.assert_allclose(
        moving.velocity[-1, 0], still.velocity[-1, 0] + np.array([0.0, 0.37]), atol=FRAME
    )
    assert abs(still.wall_work) < 1e-14 * still.energy[0]
    lost = jnp.sum(moving.impacts.energy_loss)
    missing = moving.energy[0] + moving.wall_work - lost - moving.energy[-1]
    assert abs(missing) < 100 * 1e-9 * moving.energy[0]


@pytest.mark.parametrize("instantaneous", [False, True])
def test_a_lift_carries_what_rests_on_it(instantaneous):
    speed, fall, duration = 0.37, -0.3, 1.0
    given = {"e": 0.3, "duration": duration, "instantaneous": instantaneous}
    gravity = [0.1, -GRAVITY]
    still = _goes_on(0.0, fall, gravity, **given)
    run = _goes_on(speed, fall, gravity, **given)
    assert run.status == jc.Ending.COMPLETED
    # It rests long before the end.
    assert run.impacts.time[-1] < 0.2
    assert np.isinf(run.impacts.duration[-1]) or instantaneous
    up = np.array([0.0, speed])
    np.testing.assert_allclose(
        run.position[-1, 0], still.position[-1, 0] + up * duration, atol=REST, rtol=0
    )
    np.testing.assert_allclose(run.velocity[-1, 0], still.velocity[-1, 0] + up, atol=REST, rtol=0)
    # The lift moves by its speed times the time, against the transferred momentum and the weight.
    gained = MASS * (run.velocity[-1, 0, 1] - (fall + speed) + GRAVITY * duration)
    np.testing.assert_allclose(run.wall_work, speed * gained, rtol=REST)
    lost = jnp.sum(run.impacts.energy_loss)
    missing = run.energy[0] + run.wall_work - lost - run.energy[-1]
    assert abs(missing) < 100 * 1e-9 * run.energy[0]
    # It continues from rest, and the lift does the same work per second.
    more = jc.simulate(run.final, 0.5, instantaneous=instantaneous)
    assert len(more.impacts) == 0
    moved = np.array([0.0, speed]) * 0.5
    moved[0] = run.velocity[-1, 0, 0] * 0.5 + gravity[0] * 0.5**2 / 2
    np.testing.assert_allclose(more.position[-1] - run.position[-1], moved[None], atol=REST)
    np.testing.assert_allclose(more.wall_work, MASS * GRAVITY * speed * 0.5, rtol=REST)


@pytest.mark.slow(reason="a soft scene with a moving wall")
def test_a_soft_ball_on_a_table_that_shakes():
    law = jc.HuGuo(e=0.7)
    scene = on_a_table(1e-4, 0.3, 0.002, law)
    run = jc.simulate(scene, 0.08, v0="touch")
    assert len(run.impacts) >= 2
    alpha = float(law.damping_factor())
    height, velocity = pressed(sine(1e-4, 0.3), 0.002, 0.08, alpha)
    fastest = np.max(run.impacts.closing_speed)
    assert abs(run.velocity[-1, 0, 0] - velocity) < SOFT * fastest
    assert abs(run.position[-1, 0, 0] - RADIUS - height) < SOFT * fastest * 0.08
    lost = jnp.sum(run.impacts.energy_loss)
    missing = run.energy[0] + run.wall_work - lost - run.energy[-1]
    assert abs(missing) < 100 * 1e-9 * run.energy[0]
    assert abs(run.wall_work) > 1e-3 * run.energy[0]


def test_a_box_that_is_moved_carries_its_balls():
    """In its own frame the box stands, and an elastic ball goes to and fro."""
    box = jc.Box([0.0, 0.0], [1.0, 1.0], motion=jc.Steady([0.5, 0.0]))
    ball = jc.Sphere(0.1, 1.0, [0.5, 0.5], [1.5, 0.2])
    run = jc.simulate(jc.Scene([ball, box], jc.ExactRestitution(e=1.0)), 8.0, instantaneous=True)
    # Over 0.8 m and back in 1.6 s at 1 m/s, in 8 s at 0.2 m/s.
    np.testing.assert_allclose(run.position[-1, 0], [0.5 + 4.0, 0.5], atol=1e-13)
    np.testing.assert_allclose(run.velocity[-1, 0], [1.5, 0.2], atol=1e-13)
    np.testing.assert_allclose(run.final.bodies[1].low, [4.0, 0.0], atol=1e-13)


def test_what_moves_wrongly_is_refused():
    shake = jc.Vibration(0.1, 1.0)
    with pytest.raises(ValueError, match=r"`motion` must have 2 numbers"):
        jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady([1.0]))
    with pytest.raises(ValueError, match=r"`motion` of a box must have a list of numbers"):
        jc.Box([0.0], [1.0], motion=shake)
    ball = jc.Sphere(0.1, 1.0, [1.0])
    closing = [
        jc.Plane([0.0], [1.0], name="piston", motion=jc.Steady([0.5])),
        jc.Plane([2.0], [-1.0], name="wall"),
    ]
    with pytest.raises(ValueError, match=r"Plane 'piston' .* and Plane 'wall' .* meet at 4 s"):
        jc.simulate(jc.Scene([ball, *closing], jc.ExactRestitution(e=0.5)), 5.0, instantaneous=True)
