"""Scenes whose contacts have necks: they form at δ = 0 and snap at δ < 0."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.neck_chain import Neck, follow

BY_SCIPY = 1e-10
"""Of velocities in m/s at rtol 1e-10 beside steps at 1e-12: measured 2e-12."""
SLOPES = 1e-5
"""Beside central differences of SciPy with h = 1e-4: measured 1e-7."""
BALANCE = 1e-9
"""Of energies at rtol 1e-10: measured 1e-11."""
SAME = 1e-9
"""Between two solves of one motion, relative: measured 3e-11."""

NECK = Neck(work=2 / (1.5 * np.pi), radius=1.0, modulus=7500.0)
LAW, STIFFNESS = jc.JKR(pull_off=NECK.pull_off), NECK.stiffness
RADIUS, GAPS, MASSES = 0.1, [1e-3, 5e-4], [1.0, 1.0, 2.0]
SPEED, LASTS = 0.3, 0.15


def row_of_balls(pull_off, speed):
    places = np.cumsum([0.0, *(2 * RADIUS + gap for gap in GAPS)])
    balls = [
        jc.Sphere(
            radius=RADIUS, mass=MASSES[k], position=(places[k],), velocity=(0.0 if k else speed,)
        )
        for k in range(3)
    ]
    return jc.Scene(bodies=balls, law=jc.JKR(pull_off=pull_off), stiffness=STIFFNESS)


def by_scipy(neck=NECK, speed=SPEED):
    return follow([neck] * 2, MASSES, GAPS, [speed, 0.0, 0.0], LASTS)


@functools.cache
def three_balls():
    """Velocities and the energy lost, with derivatives by pull-off force and speed."""

    def velocities(pull_off, speed):
        run = jc.simulate(row_of_balls(pull_off, speed), LASTS, rtol=1e-10)
        found = run.velocity[-1].ravel()
        return found, (found, run.energy, run.impacts.energy_loss)

    return jax.jacfwd(velocities, argnums=(0, 1), has_aux=True)(NECK.pull_off, SPEED)


def test_necks_that_form_and_snap_together():
    """The first ball stays at the second, and the neck to the third snaps."""
    found = by_scipy()
    assert [len(moments) for moments in found.moments] == [1, 2]
    velocity, energy, lost = three_balls()[1]
    np.testing.assert_allclose(velocity, found.velocity, atol=BY_SCIPY)
    np.testing.assert_allclose(energy[0] - energy[-1], NECK.lost, rtol=BALANCE)
    np.testing.assert_allclose(lost[:2], [0, NECK.lost], rtol=BALANCE)


def test_derivatives_across_touch_and_snap():
    by_pull_off, by_speed = three_balls()[0]
    h = 1e-4
    per_work = NECK.pull_off / NECK.work
    ends = [by_scipy(NECK._replace(work=NECK.work + sign * h)).velocity for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * h * per_work)
    np.testing.assert_allclose(by_pull_off, slope, atol=SLOPES)
    ends = [by_scipy(speed=SPEED + sign * h).velocity for sign in (1, -1)]
    np.testing.assert_allclose(by_speed, (ends[0] - ends[1]) / (2 * h), atol=SLOPES)


MASS, HEIGHT, GRAVITY = 0.5, 0.01, 9.81


def dropped(height=HEIGHT):
    ball = jc.Sphere(radius=RADIUS, mass=MASS, position=(RADIUS + height,))
    wall = jc.Plane(point=(0.0,), normal=(1.0,))
    return jc.Scene(bodies=[ball, wall], law=LAW, stiffness=STIFFNESS, gravity=(-GRAVITY,))


def followed(scene, duration, times=None):
    return jc.simulate(scene, duration, rtol=1e-10, times=times)


def test_a_bouncing_ball_sticks():
    """Beside the event solves of one impact after the other, until it sticks."""
    contact = jc.Contact(mass=MASS, stiffness=STIFFNESS)
    run = followed(dropped(), 1.35)
    ball = jc.bounce(LAW, contact, HEIGHT, gravity=GRAVITY, gravity_in_contact=True)
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
    contact = jc.Contact(mass=MASS, stiffness=STIFFNESS)
    hit = jc.impact(LAW, contact, np.sqrt(2 * GRAVITY * 1e-9), external_force=MASS * GRAVITY)
    np.testing.assert_allclose(run.impacts.max_force, hit.max_force, rtol=1e-5)
    first = followed(dropped(1e-9), 0.1)
    np.testing.assert_allclose(
        followed(first.final, 0.2).position[-1], run.position[-1], atol=1e-11
    )


def test_a_trajectory_is_the_path_of_the_ball():
    speed = float(np.sqrt(2 * GRAVITY * HEIGHT))
    contact = jc.Contact(mass=MASS, stiffness=STIFFNESS)
    path = jc.trajectory(LAW, contact, speed, samples=9, external_force=MASS * GRAVITY)
    touch = np.sqrt(2 * HEIGHT / GRAVITY)
    run = followed(dropped(), 0.2, times=jnp.concatenate([jnp.zeros(1), touch + path.time[1:-1]]))
    np.testing.assert_allclose(RADIUS - run.position[1:, 0, 0], path.indentation[1:-1], atol=1e-11)
    np.testing.assert_allclose(-run.velocity[1:, 0, 0], path.velocity[1:-1], atol=1e-9)


def test_a_run_continues_from_a_stretched_neck():
    times = jnp.linspace(0, 0.2, 201)
    whole = followed(dropped(), 0.2, times)
    depth = RADIUS - np.asarray(whole.position[:, 0, 0])
    stretched = np.flatnonzero((depth < 0) & (depth > NECK.snap) & (times > 0.1))
    moment = float(times[stretched[0]])
    first = followed(dropped(), moment)
    second = followed(first.final, 0.2 - moment)
    np.testing.assert_allclose(second.position[-1], whole.position[-1], atol=1e-12)
    np.testing.assert_allclose(second.velocity[-1], whole.velocity[-1], atol=BY_SCIPY)


def test_discs_that_stick_turn_and_part():
    """Momentum, angular momentum and energy; the motion along the line of centres stretches it."""
    discs = [
        jc.Sphere(radius=RADIUS, mass=1.0, position=(-0.22, 0.05), velocity=(0.15, 0.0)),
        jc.Sphere(radius=RADIUS, mass=1.0, position=(0.0, 0.0)),
    ]
    run = jc.simulate(jc.Scene(bodies=discs, law=LAW, stiffness=STIFFNESS), 0.5, rtol=1e-10)
    assert run.impacts.duration.shape == (1,)
    np.testing.assert_allclose(run.energy[0] - run.energy[-1], NECK.lost, rtol=1e-8)
    ends = run.position[jnp.array([0, -1])], run.velocity[jnp.array([0, -1])]
    (x, y), (u, v) = (np.moveaxis(np.asarray(end), -1, 0) for end in ends)
    for conserved in (u.sum(1), v.sum(1), (x * v - y * u).sum(1)):
        np.testing.assert_allclose(conserved[1], conserved[0], atol=1e-13)


def test_necks_and_memories_in_one_scene():
    """A ball of lead on a floor, and one that sticks to it; all energies add up."""
    laws = {
        ("a", "b"): LAW,
        ("a", "floor"): jc.Viscoplastic(yield_speed=0.05, c=100.0),
        ("b", "floor"): jc.HuGuo(e=0.6),
    }
    bodies = [
        jc.Sphere(mass=1.0, radius=RADIUS, position=(0.11,), velocity=(-0.3,), name="a"),
        jc.Sphere(mass=1.0, radius=RADIUS, position=(0.32,), velocity=(-0.6,), name="b"),
        jc.Plane(point=(0.0,), normal=(1.0,), name="floor"),
    ]
    scene = jc.Scene(bodies=bodies, law=laws, stiffness=STIFFNESS, gravity=(-GRAVITY,))
    run = jc.simulate(scene, 0.4, rtol=1e-9)
    lost = np.sum(run.impacts.energy_loss)
    assert lost > 1
    np.testing.assert_allclose(run.energy[0] - run.energy[-1], lost, rtol=1e-8)


def test_where_necks_are_refused():
    match = "must be a law whose bodies do not stick"
    with pytest.raises(ValueError, match=match):
        jc.simulate(dropped(), 0.1, instantaneous=True)
    discs = [
        jc.Sphere(radius=RADIUS, mass=1.0, position=(0.3 * k, 0.0), velocity=(-0.1 * k, 0.0))
        for k in range(2)
    ]
    with pytest.raises(ValueError, match=match):
        jc.Scene(bodies=discs, law=LAW, stiffness=1e4, friction=jc.RigidCoulomb(mu=0.1))
