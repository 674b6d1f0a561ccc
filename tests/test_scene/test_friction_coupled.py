"""Coupled contacts with friction: beside an integration by SciPy, their invariants, and rest."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import RubbingSpheres

AGREES = 1e-10
"""Speeds and surface speeds at rtol 1e-9 beside the integration, in m/s: measured 2e-12."""

KEPT = 1e-12
"""Angular momentum and energy of a run, relative: measured 4e-15 and 2e-12."""

LAW, MU, KAPPA, STIFFNESS = jc.HuGuo(e=0.8), 0.3, 0.8, 1e7
SPRING = jc.SpringSlider(MU, ratio=KAPPA)
RADIUS, MASS = np.array([0.1, 0.12, 0.09]), np.array([0.5, 0.8, 0.4])
PLACE = np.array([[-0.5, 0.02], [0.0, 0.0], [0.2095, 0.03]])
SPEED, SPIN = np.array([[2.0, 0.3], [0.0, 0.0], [0.0, 0.0]]), np.array([20.0, -5.0, 3.0])


def spheres(radius, mass, place, speed, spin):
    numbers = zip(radius, mass, place, speed, spin, strict=True)
    return [jc.Sphere(r, m, x, v, spin=w) for r, m, x, v, w in numbers]


def oracle(radius, mass, gravity, **more):
    alpha = float(LAW.damping_factor())
    stiffness = more.pop("stiffness", STIFFNESS)
    inertia = 0.4 * mass * radius**2
    return RubbingSpheres(radius, mass, inertia, gravity, stiffness, alpha, MU, KAPPA, **more)


def compare(run, found, radius, within=AGREES):
    _, speed, spin, _ = found
    np.testing.assert_allclose(run.velocity[-1], speed, rtol=0, atol=within)
    surface = np.asarray(run.spin[-1]).reshape(spin.shape) - spin
    assert np.max(np.abs(surface) * radius[:, None]) < within


def balance(run):
    """The energy that is missing at the end."""
    lost = jnp.sum(run.impacts.energy_loss) + run.sliding_loss
    return run.energy[0] + run.wall_work - run.energy[-1] - lost


AWAY, RAMP = np.array([0.0, 50.0]), jc.RegularizedCoulomb(MU, v_d=0.05)


def three_discs(mu):
    """A disc hits another one that nearly touches a third: two contacts at once, three modes. The
    run of two such rows far from each other, one with springs and one with a ramp.
    """
    discs = spheres(RADIUS, MASS, PLACE, SPEED, SPIN)
    discs += spheres(RADIUS, MASS, PLACE + AWAY, SPEED, SPIN)
    names = [f"{row} {k}" for row in ("spring", "ramp") for k in range(3)]
    discs = [dataclasses.replace(disc, name=name) for disc, name in zip(discs, names, strict=True)]
    ramps = {(f"ramp {i}", f"ramp {j}"): RAMP for i, j in ((0, 1), (0, 2), (1, 2))}
    friction = ramps | {"default": jc.SpringSlider(mu, ratio=KAPPA)}
    scene = jc.Scene(discs, LAW, stiffness=STIFFNESS, friction=friction)
    return jc.simulate(scene, 0.25, v0="touch", rtol=1e-9)


@pytest.fixture(scope="module")
def rows():
    return three_discs(MU)


@pytest.mark.parametrize("ramp", [None, 0.05], ids=["spring", "ramp"])
def test_three_discs_agree_with_an_integration(ramp, rows):
    part = slice(0, 3) if ramp is None else slice(3, 6)
    place, speed, spin = (
        np.asarray(x[-1, part]) for x in (rows.position, rows.velocity, rows.spin)
    )
    place = place if ramp is None else place - AWAY
    of_row = np.asarray(rows.impacts.first) // 3 == part.start // 3
    assert np.all(rows.impacts.solved_by == jc.SolvedBy.COUPLED) and np.sum(of_row) == 2
    solver = oracle(RADIUS, MASS, np.zeros(2), ramp=ramp)
    _, exact, turned, _ = solver.run(PLACE, SPEED, SPIN[:, None], 0.25)
    within = AGREES if ramp is None else 1e-8
    np.testing.assert_allclose(speed, exact, rtol=0, atol=within)
    assert np.max(np.abs(spin - turned[:, 0]) * RADIUS) < within

    def momentum(place, speed, spin):
        orbital = place[:, 0] * speed[:, 1] - place[:, 1] * speed[:, 0]
        return np.sum(MASS * orbital + 0.4 * MASS * RADIUS**2 * spin)

    assert abs(momentum(place, speed, spin) - momentum(PLACE, SPEED, SPIN)) < KEPT * 0.1
    assert abs(balance(rows)) < 10 * KEPT * rows.energy[0]
    # The slip at touch is that of the flight; the contact point has reversed, or not.
    touch = rows.impacts.time[of_row][0]
    apart = PLACE[0] + SPEED[0] * touch - PLACE[1]
    normal = apart / np.linalg.norm(apart)
    tangent = np.array([-normal[1], normal[0]])
    slip = SPEED[0] @ tangent - RADIUS[:2] @ SPIN[:2]
    np.testing.assert_allclose(rows.impacts.slip[of_row][0], abs(slip), rtol=1e-9)


def test_balls_on_a_belt_agree_with_an_integration():
    """Two balls in space touch each other and a belt at once; spins have three components."""
    radius, mass, gravity = RADIUS[:2], MASS[:2], np.array([0.0, 0.0, -9.8])
    place = np.array([[0.0, 0.0, 0.1005], [0.2195, 0.02, 0.121]])
    speed = np.array([[1.0, 0.2, -1.0], [-1.0, 0.3, -1.0]])
    spin, drift = np.array([[20.0, -5.0, 3.0], [1.0, 2.0, -3.0]]), np.array([0.5, -0.3, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    belt = jc.Plane(np.zeros(3), up, motion=jc.Steady(drift))
    scene = jc.Scene(
        [*spheres(radius, mass, place, speed, spin), belt], LAW, stiffness=STIFFNESS,
        friction=SPRING, gravity=gravity,
    )  # fmt: skip
    run = jc.simulate(scene, 0.02, v0="touch", rtol=1e-9)
    solver = oracle(radius, mass, gravity, planes=((up, 0.0, drift),))
    compare(run, solver.run(place, speed, spin, 0.02), radius)
    assert run.wall_work > 0.3 and abs(balance(run)) < KEPT * run.energy[0]


def test_a_ball_that_spins_along_a_shell_agrees_with_an_integration():
    """The normal turns with the ball, and gravity acts."""
    radius, mass, gravity = RADIUS[:1], MASS[:1], np.array([0.0, -9.8])
    place = np.array([[0.3, -0.8]])
    place *= (0.9 - 1e-4) / np.linalg.norm(place)
    speed, spin = np.array([[0.5, -1.0]]), np.array([30.0])
    scene = jc.Scene(
        [*spheres(radius, mass, place, speed, spin), jc.Shell(np.zeros(2), 1.0)], LAW,
        stiffness=1e6, friction=SPRING, gravity=gravity,
    )  # fmt: skip
    run = jc.simulate(scene, 0.012, v0="touch", rtol=1e-9)
    solver = oracle(radius, mass, gravity, shell=1.0, stiffness=1e6)
    compare(run, solver.run(place, speed, spin[:, None], 0.012), radius)


LEVER = 3e-4
"""Arms are R - δ on a soft floor: the rolling speed differs by about δ/R from 5/7 of the sliding
speed. Measured 8e-5 at δ/R = 5e-4."""


def standing(normal):
    return jc.Plane([0.0, 0.0], normal, motion=jc.Steady([0.0, 0.0]))


def test_a_ball_comes_to_rest_rolls_and_meets_another_one():
    """Bounces, sliding at rest, rolling at rest, and a ball at rest that is hit. The floor, which
    could move, does no work.
    """
    balls = [jc.Sphere(0.1, 0.5, [x, y], [v, 0.0]) for x, y, v in ((0, 0.102, 1.0), (1.2, 0.1, 0))]
    scene = jc.Scene(
        [*balls, standing(np.array([0.0, 1.0]))], jc.HuGuo(e=0.5), stiffness=1e8,
        friction=jc.SpringSlider(0.2, ratio=KAPPA), gravity=[0.0, -9.8],
    )  # fmt: skip
    run = jc.simulate(scene, 3.0, times=[0.0, 0.9, 1.2, 3.0])
    speed, spin = run.velocity[:, :, 0], run.spin
    assert abs(speed[1, 0] - 5 / 7) < LEVER and speed[1, 1] == 0
    # At rest they roll, until one meets the other and afterwards, at the height of their centres.
    np.testing.assert_allclose(speed[1:] + run.position[1:, :, 1] * spin[1:], 0, atol=1e-12)
    assert run.position[3, 1, 0] > run.position[3, 0, 0] + 0.2
    assert 0 < run.velocity[3, 0, 0] < run.velocity[3, 1, 0]
    assert abs(run.wall_work) < KEPT and abs(balance(run)) < KEPT * run.energy[0]


def test_a_wall_that_stands_does_no_work_on_a_ball_at_rest():
    """A slope that could move, whose spring holds the ball below the middle of its swing. Another
    ball, which falls far from it, makes the programs those of the test above.
    """
    along, normal = np.array([np.cos(0.2), -np.sin(0.2)]), np.array([np.sin(0.2), np.cos(0.2)])
    ball = jc.Sphere(0.1, 0.5, 0.102 * normal, along - 0.3 * normal)
    far = jc.Sphere(0.1, 0.5, 100 * normal)
    scene = jc.Scene(
        [ball, far, standing(normal)], jc.HuGuo(e=0.5), stiffness=1e6,
        friction=jc.SpringSlider(0.3, ratio=KAPPA), gravity=[0.0, -9.8],
    )  # fmt: skip
    run = jc.simulate(scene, 2.0, rtol=1e-9, times=[0.0, 1.0, 1.5, 2.0])
    assert abs(run.wall_work) < KEPT and abs(balance(run)) < KEPT * run.energy[0]


def test_without_friction_spins_are_kept():
    """μ = 0 has no direction of friction, and small μ one that would turn without limit."""
    none, weak = (three_discs(mu) for mu in (0.0, 1e-6))
    # Only their units are changed and changed back.
    np.testing.assert_allclose(none.spin[-1, :3], SPIN, rtol=4e-16)
    assert 0 < np.max(np.abs(weak.spin[-1, :3] - SPIN)) < 1e-3
    assert np.max(np.abs(weak.velocity[-1, :3] - none.velocity[-1, :3])) < 1e-4


TURN = 2e-3
"""The arm R - δ of the spin turns the slip by about δ/R = 5e-4."""


def test_side_spin_far_faster_than_the_closing_speed():
    """Friction in space keeps the direction of the slip, which is 10,000 times μ v0."""
    up, drift = np.array([0.0, 0.0, 1.0]), np.array([0.5, -0.3, 0.0])
    place, speed = np.array([[0.0, 0.0, 0.10001], [9.0, 0.0, 9.0]]), np.zeros((2, 3))
    spin = np.array([[50.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    speed[0] = [5.0, 0.0, -0.03]
    belt = jc.Plane(np.zeros(3), up, motion=jc.Steady(drift))
    scene = jc.Scene(
        [*spheres(RADIUS[:2], MASS[:2], place, speed, spin), belt], LAW, stiffness=STIFFNESS,
        friction=jc.SpringSlider(0.02, ratio=KAPPA), gravity=[0.0, 0.0, -9.8],
    )  # fmt: skip
    run = jc.simulate(scene, 0.02, v0="touch", rtol=1e-9)
    slip = speed[0] - drift - np.cross(RADIUS[0] * spin[0], up)
    change = run.velocity[-1, 0] - speed[0]
    along = change[:2] @ slip[:2] / np.linalg.norm(slip[:2])
    assert along < -1e-3
    across = change[0] * slip[1] - change[1] * slip[0]
    assert abs(across) < TURN * abs(along) * np.linalg.norm(slip)
    assert abs(balance(run)) < KEPT * run.energy[0]
