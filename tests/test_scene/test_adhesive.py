"""Scenes whose contacts have necks: they form at δ = 0 and snap at δ < 0."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import GRAVITY, in_a_line, missing, spheres
from tests.test_scene.test_chains import NECK

SAME = 1e-9
"""Between two solves of one motion, relative: measured 3e-11."""

LAW, STIFFNESS, RADIUS = jc.JKR(pull_off=NECK.pull_off), NECK.stiffness, 0.1
MASS, HEIGHT = 0.5, 0.01
CONTACT = jc.Contact(mass=MASS, stiffness=STIFFNESS)


def above_a_floor(place, speed, gravity=GRAVITY, mass=MASS, floor=0.0):
    """Two discs above a floor, one of which may be far away. All scenes share their programs."""
    bodies = [*spheres(RADIUS, mass, place, speed), jc.Plane([0.0, floor], [0.0, 1.0])]
    return jc.Scene(bodies, LAW, stiffness=STIFFNESS, gravity=[0.0, -gravity])


def dropped(height=HEIGHT):
    return above_a_floor([(0.0, RADIUS + height), (0.0, 50.0)], np.zeros((2, 2)))


def followed(scene, duration, times=None):
    return jc.simulate(scene, duration, rtol=1e-10, times=times)


def test_a_bouncing_ball_sticks():
    """Beside the event solves of one impact after the other, until it sticks."""
    run = followed(dropped(), 1.35)
    ball = jc.bounce(LAW, CONTACT, HEIGHT, gravity=GRAVITY, gravity_in_contact=True)
    count = ball.time.shape[0]
    assert run.impacts.time.shape == (count,)
    np.testing.assert_allclose(run.impacts.time, ball.time, rtol=SAME)
    # Adhesion makes bodies faster after the touch, but v0 is the speed there.
    np.testing.assert_allclose(run.impacts.closing_speed, ball.impact_velocity, rtol=SAME)
    np.testing.assert_allclose(run.impacts.duration[:-1], ball.duration[:-1], rtol=1e-8)
    assert ball.status[-1] == jc.Status.SETTLED
    assert np.isnan(run.impacts.duration[-1])
    lost = run.energy[0] - run.energy[-1]
    np.testing.assert_allclose(lost, (count - 1) * NECK.lost, rtol=1e-8)


def test_a_ball_that_touches_slowly():
    """Its own energy is a millionth of that of its neck; it may also go on from there."""
    run = followed(dropped(1e-9), 0.3)
    hit = jc.impact(LAW, CONTACT, np.sqrt(2 * GRAVITY * 1e-9), external_force=MASS * GRAVITY)
    np.testing.assert_allclose(run.impacts.max_force, hit.max_force, rtol=1e-5)
    rest = followed(followed(dropped(1e-9), 0.1).final, 0.2)
    np.testing.assert_allclose(rest.position[-1], run.position[-1], atol=1e-11)


def test_a_trajectory_is_the_path_of_the_ball():
    speed, touch = float(np.sqrt(2 * GRAVITY * HEIGHT)), np.sqrt(2 * HEIGHT / GRAVITY)
    path = jc.trajectory(LAW, CONTACT, speed, samples=9, external_force=MASS * GRAVITY)
    run = followed(dropped(), 0.2, times=jnp.concatenate([jnp.zeros(1), touch + path.time[1:-1]]))
    np.testing.assert_allclose(RADIUS - run.position[1:, 0, 1], path.indentation[1:-1], atol=1e-11)
    np.testing.assert_allclose(-run.velocity[1:, 0, 1], path.velocity[1:-1], atol=1e-9)


def test_a_run_continues_from_a_stretched_neck():
    times = jnp.linspace(0, 0.2, 201)
    whole = followed(dropped(), 0.2, times)
    depth = RADIUS - np.asarray(whole.position[:, 0, 1])
    stretched = np.flatnonzero((depth < 0) & (depth > NECK.snap) & (times > 0.1))
    moment = float(times[stretched[0]])
    second = followed(followed(dropped(), moment).final, 0.2 - moment)
    np.testing.assert_allclose(second.position[-1], whole.position[-1], atol=1e-12)
    np.testing.assert_allclose(second.velocity[-1], whole.velocity[-1], atol=1e-10)


def test_discs_that_stick_turn_and_part():
    """Momentum, angular momentum and energy; the motion along the line of centres stretches it."""
    place, speed = [(-0.22, 0.05), (0.0, 0.0)], [(0.15, 0.0), (0.0, 0.0)]
    run = followed(above_a_floor(place, speed, gravity=0.0, mass=1.0, floor=-9.0), 0.5)
    assert run.impacts.duration.shape == (1,)
    np.testing.assert_allclose(run.energy[0] - run.energy[-1], NECK.lost, rtol=1e-8)
    (x, y), (u, v) = (np.moveaxis(np.asarray(end), -1, 0) for end in (run.position, run.velocity))
    for conserved in (u.sum(1), v.sum(1), (x * v - y * u).sum(1)):
        np.testing.assert_allclose(conserved[1], conserved[0], atol=1e-13)


def test_necks_and_memories_in_one_scene():
    """A ball of lead on a floor, and one that sticks to it; all energies add up."""
    laws = {
        ("a", "b"): LAW,
        ("a", "floor"): jc.Viscoplastic(yield_speed=0.05, c=100.0),
        ("b", "floor"): jc.HuGuo(e=0.6),
    }
    balls = in_a_line(RADIUS, 1.0, [0.11, 0.32], [-0.3, -0.6], ["a", "b"])
    floor = jc.Plane([0.0], [1.0], name="floor")
    scene = jc.Scene([*balls, floor], laws, stiffness=STIFFNESS, gravity=[-GRAVITY])
    run = jc.simulate(scene, 0.4, rtol=1e-9)
    lost = np.sum(run.impacts.energy_loss)
    assert lost > 1 and missing(run) < 1e-8 * lost


def test_where_necks_are_refused():
    match = "must be a law whose bodies do not stick"
    with pytest.raises(ValueError, match=match):
        jc.simulate(dropped(), 0.1, instantaneous=True)
    discs = spheres(RADIUS, 1.0, [(0.0, 0.0), (0.3, 0.0)], [(0.0, 0.0), (-0.1, 0.0)])
    with pytest.raises(ValueError, match=match):
        jc.Scene(bodies=discs, law=LAW, stiffness=1e4, friction=jc.RigidCoulomb(mu=0.1))
