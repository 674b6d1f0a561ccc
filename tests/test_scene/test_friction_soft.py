"""Friction in soft scenes: coupled solves of two bodies and of more, in a shell and on a peg."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import missing, spheres

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
ORDER, FLIP = [2, 0, 1], np.array([-1.0, 1.0, 1.0])


def in_a_shell(numbers):
    """Three balls above a peg in a shell, of their radii, masses, K, μ, positions, velocities and
    spins.
    """
    state = numbers[8:].reshape(3, 3, 3)
    peg = jc.Sphere(0.2, None, [0.0, -0.7, 0.0], fixed=True)
    return jc.Scene(
        [*spheres(numbers[:3], numbers[3:6], *state), peg, jc.Shell(np.zeros(3), 1.0)], LAW,
        stiffness=numbers[6], gravity=GRAVITY, friction=jc.RigidCoulomb(numbers[7]),
    )  # fmt: skip


@jax.jit
@jax.vmap
def ended(numbers):
    """The last positions, velocities and surface speeds, the energy that is missing, how contacts
    were solved, and their slip.
    """
    run = jc.simulate(in_a_shell(numbers), 0.15, max_impacts=16, throw=False)
    lost = jnp.sum(jnp.where(run.impacts.solved_by >= 0, run.impacts.energy_loss, 0))
    missing = run.energy[0] - run.energy[-1] - lost - run.sliding_loss
    ends = jnp.stack([run.position[-1, :3], run.velocity[-1, :3], 0.1 * run.spin[-1, :3]])
    return ends, missing, run.impacts.solved_by, run.impacts.slip_after


def drawn(seed):
    """The radii, masses, μ, positions, velocities and spins of a ball that hits one of two that
    nearly touch.
    """
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


# One falls on the peg, one passes along the shell around both, and one is far from them.
HARD = np.zeros((3, 3, 3))
HARD[:, :2] = [
    [[0.1, -0.4, 0.07], [0.75, 0.3, 0.0]],
    [[0.3, -1.0, 0.4], [1.5, -1.5, 0.3]],
    [[3.0, -4.0, 5.0], [-6.0, 2.0, -4.0]],
]
HARD[0, 2] = [-0.4, 0.5, -0.2]


def hard(mu, stiffness):
    return np.array([0.1, 0.1, 0.1, 0.5, 0.4, 0.4, stiffness, mu, *HARD.ravel()])


@pytest.fixture(scope="module")
def in_shells():
    """Six random scenes, each in another order and in a mirror; and two with hard contacts."""
    # Spins are axial.
    mirror, lanes = np.stack([FLIP, FLIP, -FLIP])[:, None], []
    for seed in range(6):
        radius, mass, mu, state = drawn(seed)
        for order, turned in (([0, 1, 2], state), (ORDER, state), ([0, 1, 2], mirror * state)):
            balls = [*radius[order], *mass[order]]
            lanes.append([*balls, 1e6, mu, *turned[:, order].ravel()])
    lanes += [hard(mu, 1e12) for mu in (0.5, 0.05)]
    return mirror, [np.asarray(x) for x in ended(jnp.asarray(lanes))]


def test_ends_do_not_depend_on_the_order_of_the_balls_or_on_a_mirror(in_shells):
    mirror, (ends, missing, ways, _) = in_shells
    first, other, mirrored = (ends[k:18:3] for k in range(3))
    np.testing.assert_allclose(first[:, :, ORDER], other, atol=SAME)
    np.testing.assert_allclose(mirror * first, mirrored, atol=SAME)
    assert np.max(np.abs(missing[:18])) < KEPT
    # Some contacts are of two bodies, and some of more.
    assert {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING} <= set(ways[:18].ravel())


@pytest.mark.parametrize(("mu", "lane"), [(0.5, 18), (0.05, 19)])
def test_hard_contacts_have_the_instantaneous_outcome(mu, lane, in_shells):
    (_, speed, surface), missing, way, slip = (x[lane] for x in in_shells[1])
    rigid = jc.simulate(in_a_shell(hard(mu, 1e6)), 0.15, instantaneous=True)
    assert way[way >= 0].tolist() == [jc.SolvedBy.COUPLED] * 2 and len(rigid.impacts) == 2
    np.testing.assert_allclose(speed, rigid.velocity[-1, :3], atol=LIMIT)
    np.testing.assert_allclose(surface, 0.1 * rigid.spin[-1, :3], atol=LIMIT)
    np.testing.assert_allclose(slip[:2], rigid.impacts.slip_after, atol=LIMIT)
    assert abs(missing) < 2 * KEPT


def on_a_peg(place, speed, spin, mu, stiffness=1e6, e=0.7):
    """Two balls above a peg in the plane, or one, and one that falls far from them."""
    if len(place) == 1:
        place, speed, spin = [*place, [5.0, 0.0]], [*speed, [0.0, 0.0]], [*spin, 0.0]
    peg = jc.Sphere(0.3, None, [0.0, 0.0], fixed=True)
    return jc.Scene(
        [*spheres(0.1, 0.5, place, speed, spin), peg], jc.HuGuo(e=e),
        stiffness=stiffness, gravity=GRAVITY[:2], friction=jc.RigidCoulomb(mu),
    )  # fmt: skip


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_run_that_ends_within_a_contact_goes_on(share):
    scene = on_a_peg([[0.1, 0.42]], [[0.3, -1.0]], [5.0], 0.05)
    whole = jc.simulate(scene, 0.08)
    within = whole.impacts.time[0] + share * whole.impacts.duration[0]
    begun = jc.simulate(scene, float(within))
    rest = jc.simulate(begun.final, 0.08 - float(within))
    np.testing.assert_allclose(rest.velocity[-1], whole.velocity[-1], atol=LAST)
    np.testing.assert_allclose(0.1 * rest.spin[-1], 0.1 * whole.spin[-1], atol=LAST)
    assert missing(begun) < KEPT and missing(rest) < KEPT
    np.testing.assert_allclose(rest.impacts.slip_after[0], whole.impacts.slip_after[0], atol=LAST)


def test_a_ball_rolls_off_a_peg():
    """A contact that lasts has a spring, and says so. A ball that rolls from rest at the angle a
    leaves where cos is 10/17 cos a.
    """
    angle = 0.4
    place = 0.4 * np.array([[np.sin(angle), np.cos(angle)]])
    scene = on_a_peg(place, [[0.0, 0.0]], [0.0], 5.0, 1e8, e=0.3)
    run = jc.simulate(scene, 1.5)
    assert run.ok and run.impacts.solved_by[0] == jc.SolvedBy.SPRING
    assert "a spring for its law in 1 contacts that lasted or were of several bodies" in str(run)
    left = run.impacts.time[-1] + run.impacts.duration[-1]
    x, y = jc.simulate(scene, float(left)).position[-1, 0]
    assert abs(np.arctan2(x, y) - np.arccos(10 / 17 * np.cos(angle))) < FALLING
    assert missing(run) < KEPT


def bounced(numbers):
    """A ball hits one that nearly touches a peg, on which it falls later: the ends, and how
    contacts were solved.
    """
    mu, stiffness, rest = numbers[0], numbers[1], numbers[2:]
    place, speed = rest[:4].reshape(2, 2), rest[4:8].reshape(2, 2)
    run = jc.simulate(on_a_peg(place, speed, rest[8:], mu, stiffness), 0.25, max_impacts=16)
    parts = run.position[-1, :2], run.velocity[-1, :2], 0.1 * run.spin[-1, :2]
    return jnp.concatenate([part.ravel() for part in parts]), run.impacts.solved_by


def test_derivatives():
    near = 0.4003 * np.array([np.sin(0.3), np.cos(0.3)])
    state = [0.16, 0.58, *near, 0.2, -2.0, 0.1, -0.2, 5.0, -3.0]
    numbers, rng = np.array([0.3, 1e6, *state]), np.random.default_rng(1)
    way, weights = rng.normal(size=12) * np.maximum(np.abs(numbers), 0.1), rng.normal(size=10)
    # Not under `jit`: one program of all its parts compiles for three times as long.
    _, forward, ways = jax.linearize(bounced, numbers, has_aux=True)
    along, (slope,) = forward(way), jax.linear_transpose(forward, numbers)(weights)
    assert {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING} == set(ways[ways >= 0].tolist())
    moved = [numbers + k * 1e-6 * way for k in (-2, -1, 1, 2)]
    ends = [np.asarray(jax.linearize(bounced, x, has_aux=True)[0]) for x in moved]
    differences = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / 12e-6
    size = np.max(np.abs(differences))
    np.testing.assert_allclose(along, differences, atol=SLOPE * size)
    np.testing.assert_allclose(slope @ way, weights @ along, rtol=1e-10)
