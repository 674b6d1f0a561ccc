"""Friction in soft scenes whose contacts of two bodies are coupled solves: there the law acts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.test_friction_coupled import balance, spheres

LIMIT = 1e-3
"""Speeds at K = 1e12 beside those of instantaneous impacts, in m/s: measured 2e-4. Most of it is
the way in the duration of 4e-5 s; a tangential spring leaves .3 m/s."""

LAST = 2e-6
"""A run that ends within a contact and goes on, beside one in a piece, in m/s: measured 4e-7. The
second half then belongs to the normal of that moment."""

FALLING = 4e-3
"""The angle at which a ball leaves a peg, beside that of a rigid one, in rad: measured 3e-3, as the
ball slips and bounces a little. Without friction it would be 0.06."""

KEPT = 2e-11
"""Energy in J that runs of some J miss at the default tolerance: measured 5e-12."""

SAME = 1e-13
"""Speeds in m/s with another order of the balls: measured 1e-15."""

SLOPE = 1e-7
"""Derivatives beside differences of fourth order, relative: measured 4e-9."""

LAW, GRAVITY = jc.HuGuo(e=0.7), np.array([0.0, -9.81, 0.0])


def in_a_shell(stiffness, friction, axes=3):
    """A ball that falls on a fixed sphere, and one that passes along the shell around both."""
    place = np.array([[0.1, -0.5, 0.07], [0.75, 0.3, 0.0]])[:, :axes]
    speed = np.array([[0.3, -1.0, 0.4], [1.5, -1.5, 0.3]])[:, :axes]
    spin = [5.0, -4.0] if axes == 2 else [[3.0, -4.0, 5.0], [-6.0, 2.0, -2.0]]
    balls = spheres([0.1] * 2, [0.5, 0.4], place, speed, spin)
    peg = jc.Sphere(0.2, None, [0.0, -0.8, 0.0][:axes], fixed=True)
    return jc.Scene(
        [*balls, peg, jc.Shell(np.zeros(axes), 1.0)], LAW, stiffness=stiffness,
        gravity=GRAVITY[:axes], friction=friction,
    )  # fmt: skip


FRICTIONS = [
    jc.RigidCoulomb(0.5),
    jc.RigidCoulomb(0.05),
    jc.WaltonFriction(0.3, 0.4),
    jc.MawBarberFawcett(0.2, 0.8),
    jc.SpringSlider(0.3, ratio=0.8),
    jc.RegularizedCoulomb(0.3, v_d=0.05),
]


@pytest.mark.parametrize("friction", FRICTIONS, ids=repr)
def test_hard_contacts_have_the_instantaneous_outcome(friction):
    hard = jc.simulate(in_a_shell(1e12, friction), 0.15)
    rigid = jc.simulate(in_a_shell(1e6, friction), 0.15, instantaneous=True)
    assert list(hard.impacts.solved_by) == [jc.SolvedBy.COUPLED] * 2 and len(rigid.impacts) == 2
    np.testing.assert_allclose(hard.velocity[-1], rigid.velocity[-1], atol=LIMIT)
    np.testing.assert_allclose(0.1 * hard.spin[-1], 0.1 * rigid.spin[-1], atol=LIMIT)
    np.testing.assert_allclose(hard.impacts.slip_after, rigid.impacts.slip_after, atol=LIMIT)
    assert abs(balance(hard)) < KEPT
    assert "friction" not in str(hard)


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_run_that_ends_within_a_contact_goes_on(share):
    scene = in_a_shell(1e6, jc.RigidCoulomb(0.05), axes=2)
    whole = jc.simulate(scene, 0.08)
    within = whole.impacts.time[0] + share * whole.impacts.duration[0]
    begun = jc.simulate(scene, float(within))
    rest = jc.simulate(begun.final, 0.08 - float(within))
    np.testing.assert_allclose(rest.velocity[-1], whole.velocity[-1], atol=LAST)
    np.testing.assert_allclose(0.1 * rest.spin[-1], 0.1 * whole.spin[-1], atol=LAST)
    assert abs(balance(begun)) < KEPT and abs(balance(rest)) < KEPT
    np.testing.assert_allclose(rest.impacts.slip_after[0], whole.impacts.slip_after[0], atol=LAST)


def on_a_peg(place, speed, spin, mu, stiffness=1e6, e=0.7):
    """Two balls, or one, above a peg in the plane."""
    balls = spheres([0.1] * len(place), [0.5] * len(place), place, speed, spin)
    return jc.Scene(
        [*balls, jc.Sphere(0.3, None, [0.0, 0.0], fixed=True)], jc.HuGuo(e=e),
        stiffness=stiffness, gravity=GRAVITY[:2], friction=jc.RigidCoulomb(mu),
    )  # fmt: skip


def test_a_ball_rolls_off_a_peg():
    """A contact that lasts has a spring, and says so. A ball that rolls from rest at the angle a
    leaves where cos is 10/17 cos a.
    """
    angle = 0.4
    place = 0.4 * np.array([[np.sin(angle), np.cos(angle)]])
    run = jc.simulate(on_a_peg(place, [[0.0, 0.0]], [0.0], 5.0, 1e8, e=0.3), 1.5)
    assert run.ok and run.impacts.solved_by[0] == jc.SolvedBy.SPRING
    assert "a spring for its law in 1 contacts that lasted or were of several bodies" in str(run)
    left = run.impacts.time[-1] + run.impacts.duration[-1]
    gone = jc.simulate(on_a_peg(place, [[0.0, 0.0]], [0.0], 5.0, 1e8, e=0.3), float(left))
    x, y = gone.position[-1, 0]
    assert abs(np.arctan2(x, y) - np.arccos(10 / 17 * np.cos(angle))) < FALLING
    assert abs(balance(run)) < KEPT


ORDER, FLIP = [2, 0, 1], np.array([-1.0, 1.0, 1.0])


@jax.jit
@jax.vmap
def ended(numbers):
    """A ball hits one of two that nearly touch, above a peg in a shell: the last positions,
    velocities and surface speeds, the energy that is missing, and how contacts were solved.
    """
    radius, mass, mu = numbers[:3], numbers[3:6], numbers[6]
    state = numbers[7:].reshape(3, 3, 3)
    peg = jc.Sphere(0.2, None, [0.0, -0.7, 0.0], fixed=True)
    scene = jc.Scene(
        [*spheres(radius, mass, *state), peg, jc.Shell(np.zeros(3), 1.0)], LAW, stiffness=1e6,
        gravity=GRAVITY, friction=jc.RigidCoulomb(mu),
    )  # fmt: skip
    run = jc.simulate(scene, 0.15, max_impacts=16, throw=False)
    lost = jnp.sum(jnp.where(run.impacts.solved_by >= 0, run.impacts.energy_loss, 0))
    missing = run.energy[0] - run.energy[-1] - lost - run.sliding_loss
    ends = jnp.stack([run.position[-1, :3], run.velocity[-1, :3], 0.1 * run.spin[-1, :3]])
    return ends, missing, run.impacts.solved_by


def drawn(seed):
    """The radii, masses, μ, positions, velocities and spins of three balls."""
    rng = np.random.default_rng(seed)
    radius, mass, place = rng.uniform(0.08, 0.1, 3), rng.uniform(0.4, 0.6, 3), np.zeros((3, 3))
    toward, away = rng.normal(size=(2, 3))
    toward /= np.linalg.norm(toward)
    away = 0.6 * away / np.linalg.norm(away) - toward
    place[0], place[2] = (
        0.25 * toward,
        (radius[1] + radius[2] + 3e-4) * away / np.hypot.reduce(away),
    )
    speed, spin = rng.uniform(-0.3, 0.3, (3, 3)), rng.uniform(-10, 10, (3, 3))
    speed[0] -= 2 * toward
    speed[:, 1] -= 1
    return radius, mass, rng.choice([0.05, 0.5]), np.stack([place, speed, spin])


def test_ends_do_not_depend_on_the_order_of_the_balls_or_on_a_mirror():
    # Spins are axial.
    mirror = np.stack([FLIP, FLIP, -FLIP])[:, None]
    lanes = []
    for seed in range(6):
        radius, mass, mu, state = drawn(seed)
        lanes.append([*radius, *mass, mu, *state.ravel()])
        lanes.append([*radius[ORDER], *mass[ORDER], mu, *state[:, ORDER].ravel()])
        lanes.append([*radius, *mass, mu, *(mirror * state).ravel()])
    ends, missing, ways = (np.asarray(x) for x in ended(jnp.asarray(lanes)))
    first, other, mirrored = (ends[k::3] for k in range(3))
    np.testing.assert_allclose(first[:, :, ORDER], other, atol=SAME)
    np.testing.assert_allclose(mirror * first, mirrored, atol=SAME)
    assert np.max(np.abs(missing)) < KEPT
    # Some contacts are of two bodies, and some of more.
    assert {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING} <= set(ways.ravel())


def bounced(numbers):
    """A ball hits one that nearly touches a peg, on which it falls later."""
    mu, stiffness, rest = numbers[0], numbers[1], numbers[2:]
    place, speed = rest[:4].reshape(2, 2), rest[4:8].reshape(2, 2)
    return jc.simulate(on_a_peg(place, speed, rest[8:], mu, stiffness), 0.25)


def end_of(numbers):
    run = bounced(numbers)
    parts = run.position[-1, :2], run.velocity[-1, :2], 0.1 * run.spin[-1, :2]
    return jnp.concatenate([part.ravel() for part in parts])


def test_derivatives():
    near = 0.4003 * np.array([np.sin(0.3), np.cos(0.3)])
    state = [0.16, 0.58, *near, 0.2, -2.0, 0.1, -0.2, 5.0, -3.0]
    numbers, rng = np.array([0.3, 1e6, *state]), np.random.default_rng(1)
    ways = set(bounced(numbers).impacts.solved_by.tolist())
    assert ways == {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING}
    way, weights = rng.normal(size=12) * np.maximum(np.abs(numbers), 0.1), rng.normal(size=10)
    along = jax.jvp(end_of, (jnp.asarray(numbers),), (jnp.asarray(way),))[1]
    slope = jax.grad(lambda numbers: weights @ end_of(numbers))(jnp.asarray(numbers))
    ends = [np.asarray(end_of(numbers + k * 1e-6 * way)) for k in (-2, -1, 1, 2)]
    differences = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / 12e-6
    size = np.max(np.abs(differences))
    np.testing.assert_allclose(along, differences, atol=SLOPE * size)
    np.testing.assert_allclose(slope @ way, weights @ along, rtol=1e-10)
