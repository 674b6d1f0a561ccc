"""Scenes whose contacts have necks, from δ = 0 to a snap at δ < 0, or remember their depth."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.pair_impact.oblique import oblique
from tests.oracle.chains import NECK
from tests.test_scene.support import GRAVITY, in_a_line, missing, spheres

SAME = 1e-9  # between two solves of one motion, relative: measured 3e-11
BALANCE = 1e-9  # of energies at rtol 1e-10: measured 1e-11

LAW, STIFFNESS, RADIUS = jc.JKR(pull_off=NECK.pull_off), NECK.stiffness, 0.1
MASS, HEIGHT = 0.5, 0.01
CONTACT = jc.Contact(mass=MASS, stiffness=STIFFNESS)


def above_a_floor(
    place, speed, gravity=GRAVITY, mass=MASS, floor=0.0, *, law=LAW, stiffness=STIFFNESS,
    radius=RADIUS,
):  # fmt: skip
    """Two discs above a floor, of which one or the floor may be far away. All scenes of a law share
    their programs. Without any gravity there would be others.
    """
    bodies = [*spheres(radius, mass, place, speed), jc.Plane([0.0, floor], [0.0, 1.0])]
    return jc.Scene(bodies, law, stiffness=stiffness, gravity=[0.0, -gravity])


def dropped(height=HEIGHT):
    return above_a_floor([(0.0, RADIUS + height), (0.0, 50.0)], np.zeros((2, 2)))


followed = functools.partial(jc.simulate, rtol=1e-10)


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
    np.testing.assert_allclose(run.impacts.max_force, hit.max_force, rtol=1e-8)
    rest = followed(followed(dropped(1e-9), 0.1).final, 0.2)
    np.testing.assert_allclose(rest.position[-1], run.position[-1], atol=1e-11)


def test_a_run_is_the_path_of_the_ball_and_continues_from_a_stretched_neck():
    speed, touch = float(np.sqrt(2 * GRAVITY * HEIGHT)), np.sqrt(2 * HEIGHT / GRAVITY)
    path = jc.trajectory(LAW, CONTACT, speed, samples=99, external_force=MASS * GRAVITY)
    times = np.array([0.0, *(touch + path.time[1:-1]), 0.2])
    whole = followed(dropped(), 0.2, times=times)
    depth = RADIUS - np.asarray(whole.position[:, 0, 1])
    np.testing.assert_allclose(depth[1:-1], path.indentation[1:-1], atol=1e-11)
    np.testing.assert_allclose(-whole.velocity[1:-1, 0, 1], path.velocity[1:-1], atol=1e-9)
    stretched = np.flatnonzero((depth < 0) & (depth > NECK.snap) & (times > 0.1))
    moment = float(times[stretched[0]])
    second = followed(followed(dropped(), moment).final, 0.2 - moment)
    np.testing.assert_allclose(second.position[-1], whole.position[-1], atol=1e-12)
    np.testing.assert_allclose(second.velocity[-1], whole.velocity[-1], atol=1e-10)


def test_discs_that_stick_turn_and_part():
    """Momentum, angular momentum and energy; the motion along the line of centres stretches it."""
    place, speed = [(-0.22, 0.05), (0.0, 0.0)], [(0.15, 0.0), (0.0, 0.0)]
    run = followed(above_a_floor(place, speed, gravity=1e-15, mass=1.0, floor=-9.0), 0.5)
    assert run.impacts.duration.shape == (1,)
    np.testing.assert_allclose(run.energy[0] - run.energy[-1], NECK.lost, rtol=1e-8)
    (x, y), (u, v) = (np.moveaxis(np.asarray(end), -1, 0) for end in (run.position, run.velocity))
    for conserved in (u.sum(1), v.sum(1), (x * v - y * u).sum(1)):
        np.testing.assert_allclose(conserved[1], conserved[0], atol=1e-13)


SPEED = 2.0
ISOLATED = jc.ThorntonPlastic(yield_speed=0.3), jc.Contact(mass=0.3, stiffness=2e8)


def test_isolated_impacts_under_a_push():
    """The radial problem beside the event solve of one impact, until the force ends."""
    pulls, speeds = jnp.array([0.0, 3.0, -300.0]), map(jnp.asarray, (SPEED, 0.0, jnp.inf))
    solve = functools.partial(oblique, *ISOLATED, *speeds, rtol=1e-10)
    rebound = jax.jit(jax.vmap(solve))(pulls)
    hit = jc.impact(*ISOLATED, SPEED, external_force=pulls, method="event")
    for name in ("duration", "max_force", "max_indentation", "energy_loss"):
        np.testing.assert_allclose(getattr(rebound, name), getattr(hit, name), rtol=1e-8)


def of_metal(yield_speed, place, speed, gravity):
    law = jc.ThorntonPlastic(yield_speed=yield_speed)
    given = {"law": law, "stiffness": 2e8, "radius": 0.01}
    return above_a_floor(place, speed, gravity, mass=0.03, **given), law


def test_a_bouncing_ball_of_metal():
    """Each e is that of the impact at its speed, as gravity changes it little; the ball goes on to
    the end, although its impacts become elastic.
    """
    scene, law = of_metal(0.05, [(0.0, 0.05), (0.0, 9.0)], np.zeros((2, 2)), 9.81)
    run = jc.simulate(scene, 0.5, rtol=1e-9)
    assert run.ok
    known = law.restitution_at(run.impacts.closing_speed)
    np.testing.assert_allclose(run.impacts.restitution, known, rtol=2e-2)
    assert missing(run) < 1e-8 * np.sum(run.impacts.energy_loss)


def test_a_run_that_cuts_an_unloading_impact_does_not_invent_its_loss():
    """Until the turn nothing is lost; from then on the part of the loss is not known."""
    place, speed = [(0.0, 1.0), (0.0201, 1.002)], [(SPEED, 0.0), (0.0, 0.0)]
    scene, _ = of_metal(0.1, place, speed, 1e-15)
    # The touch is at .1001 ms, the turn at .28 ms, and the end at .3956 ms.
    loads, unloads = (followed(scene, time) for time in (0.0002, 0.0003375))
    np.testing.assert_allclose(loads.energy[-1], 0.06, rtol=BALANCE)
    np.testing.assert_allclose(loads.impacts.energy_loss, 0, atol=BALANCE)
    assert np.isnan(unloads.impacts.energy_loss[0])


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
    discs = spheres(RADIUS, 1.0, [(0.0, 0.0), (0.3, 0.0)], [(0.0, 0.0), (-0.1, 0.0)])
    for law, n in ((LAW, 1.5), (jc.Luding(ratio=1.5, slope=0.0, adhesion=0.3), 1.0)):
        of = functools.partial(jc.Scene, bodies=discs, law=law, stiffness=1e4, exponent=n)
        with pytest.raises(ValueError, match=match):
            jc.simulate(of(), 0.1, instantaneous=True)
        with pytest.raises(ValueError, match=match):
            of(friction=jc.RigidCoulomb(mu=0.1))
