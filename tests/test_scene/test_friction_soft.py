"""Friction in soft scenes: coupled solves of two bodies, where the law acts, and a restarted
integration.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import RubbingSpheres
from tests.oracle.stored import stored
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


def in_a_shell(stiffness, friction, flat=False):
    """A ball that falls on a fixed sphere, and one that passes along the shell around both; if
    `flat`, in a plane.
    """
    place = np.array([[0.1, -0.5, 0.07], [0.75, 0.3, 0.0]])
    speed = np.array([[0.3, -1.0, 0.4], [1.5, -1.5, 0.3]])
    spin = np.array([[3.0, -4.0, 5.0], [-6.0, 2.0, -4.0]])
    if flat:
        place[:, 2], speed[:, 2], spin[:, :2] = 0, 0, 0
    balls = spheres([0.1] * 2, [0.5, 0.4], place, speed, spin)
    peg = jc.Sphere(0.2, None, [0.0, -0.8, 0.0], fixed=True)
    return jc.Scene(
        [*balls, peg, jc.Shell(np.zeros(3), 1.0)], LAW, stiffness=stiffness,
        gravity=GRAVITY, friction=friction,
    )  # fmt: skip


FRICTIONS = [
    jc.WaltonFriction(0.3, 0.4),
    jc.MawBarberFawcett(0.2, 0.8),
    jc.SpringSlider(0.3, ratio=0.8),
    jc.RegularizedCoulomb(0.3, v_d=0.05),
]


def on_pegs(stiffness):
    """Balls far from each other, each with a friction law of its own on the sphere below it."""
    bodies, laws = [], {"default": jc.RigidCoulomb(0.5)}
    for k, friction in enumerate(FRICTIONS):
        ball = [3.0 * k + 0.1, -0.5, 0.07], [0.3, -1.0, 0.4]
        bodies += [
            jc.Sphere(0.1, 0.5, *ball, spin=[3.0, -4.0, 5.0], name=f"ball {k}"),
            jc.Sphere(0.2, None, [3.0 * k, -0.8, 0.0], fixed=True, name=f"peg {k}"),
        ]
        laws[f"ball {k}", f"peg {k}"] = friction
    return jc.Scene(bodies, LAW, stiffness=stiffness, gravity=GRAVITY, friction=laws)


@pytest.mark.parametrize("mu", [0.5, 0.05, None])
def test_hard_contacts_have_the_instantaneous_outcome(mu):
    hard, rigid = (
        on_pegs(k) if mu is None else in_a_shell(k, jc.RigidCoulomb(mu)) for k in (1e12, 1e6)
    )
    count = 2 if mu else len(FRICTIONS)
    hard, rigid = jc.simulate(hard, 0.15), jc.simulate(rigid, 0.15, instantaneous=True)
    assert list(hard.impacts.solved_by) == [jc.SolvedBy.COUPLED] * count
    assert len(rigid.impacts) == count
    np.testing.assert_allclose(hard.velocity[-1], rigid.velocity[-1], atol=LIMIT)
    np.testing.assert_allclose(0.1 * hard.spin[-1], 0.1 * rigid.spin[-1], atol=LIMIT)
    # Those at the same time have no order.
    slip = [run.impacts.slip_after[np.argsort(run.impacts.first)] for run in (hard, rigid)]
    np.testing.assert_allclose(*slip, atol=LIMIT)
    assert abs(balance(hard)) < count * KEPT
    assert "friction" not in str(hard)


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_run_that_ends_within_a_contact_goes_on(share):
    scene = in_a_shell(1e6, jc.RigidCoulomb(0.05), flat=True)
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


MU, V_D, STIFFNESS, E = 0.2, 0.02, 1e8, 0.6

RTOL = 1e-6
"""The tolerance of the runs; impacts on planes agree with the integration within ten of it."""

DOUBT = 3
"""The largest error of the frozen normal over its estimate: measured 1.05 in 12 random pairs, 0.1
to 1 in most."""

ENERGY = 1e-7
"""Energy in J that runs of a few J miss at that tolerance: measured 5e-9."""


def test_impacts_on_a_wall_are_oblique_impacts():
    """A ball with spin, three speeds of sliding: it sticks, slides throughout, or reverses."""
    law, friction = jc.HuGuo(e=E), jc.RegularizedCoulomb(MU, V_D)
    for v, w in (([1.0, -2.0], 0.0), ([5.0, -1.0], 20.0), ([0.0, -3.0], -15.0)):
        ball = jc.Sphere(0.1, 1.0, [0.0, 0.2], v, spin=w)
        scene = jc.Scene(
            [ball, jc.Plane([0.0, 0.0], [0.0, 1.0])], law, stiffness=STIFFNESS, friction=friction
        )
        run = jc.simulate(scene, 0.2, rtol=RTOL)
        hit = jc.oblique_impact(
            law, jc.Contact(1.0, STIFFNESS), -v[1], v[0], friction=friction,
            bodies=jc.RoundBodies(0.1), spin=(w, 0.0),
        )  # fmt: skip
        speed = [hit.tangential_velocity, hit.normal.rebound_velocity]
        assert np.max(np.abs(run.velocity[-1, 0] - np.array(speed))) < 10 * RTOL * -v[1]
        assert np.abs(run.spin[-1, 0] - hit.spin[0]) * 0.1 < 10 * RTOL * -v[1]


@stored()
def integrated(mass, radius, place, velocity, spin, duration):
    """Velocities and spins of two discs at the end."""
    inertia, alpha = 0.4 * mass * radius**2, 1.5 * (1 - E) / E
    spheres = RubbingSpheres(
        radius, mass, inertia, np.zeros(2), STIFFNESS, alpha, MU, 1.0, ramp=V_D
    )
    return spheres.run(place, velocity, spin[:, None], duration)[1:3]


class Formula(jc.RegularizedCoulomb):
    """A law that is not known to act alike in coupled contacts, so that its formula is used."""


def random_pairs(friction, count):
    """The errors of runs in which two discs meet, beside an integration, their estimates, and how
    the impacts were solved.
    """
    random = np.random.default_rng(1)
    mass, radius = random.uniform(0.3, 1, (12, 2)), random.uniform(0.05, 0.15, (12, 2))
    place = np.zeros((12, 2, 2))
    place[:, 1] = np.stack([np.full(12, 0.4), random.uniform(-0.12, 0.12, 12)], axis=1)
    velocity = np.stack([np.full((12, 2), [2.0, -1.0]), random.uniform(-1, 1, (12, 2))], 2)
    velocity[:, :, 1] *= 0.3
    spin = random.normal(size=(12, 2)) * 30

    errors, estimates, ways = [], [], []
    for k in range(count):
        start = place[k], velocity[k], spin[k]
        balls = [
            jc.Sphere(radius[k, j], mass[k, j], place[k, j], velocity[k, j], spin=spin[k, j])
            for j in range(2)
        ]
        scene = jc.Scene(balls, jc.HuGuo(e=E), stiffness=STIFFNESS, friction=friction)
        run = jc.simulate(scene, 0.3, rtol=RTOL, v0="touch")
        lost = jnp.sum(run.impacts.energy_loss) + run.sliding_loss
        assert abs(run.energy[0] - run.energy[1] - lost) < ENERGY
        if not len(run.impacts):
            continue
        speed, turned = integrated(mass[k], radius[k], *start, 0.3)
        turned = turned[:, 0]
        parts = np.abs(run.velocity[-1] - speed), np.abs(run.spin[-1] - turned) * radius[k]
        errors.append(max(np.max(part) for part in parts) / run.impacts.closing_speed[0])
        estimates.append(run.impacts.error_estimate[0])
        ways.append(run.impacts.solved_by[0])
    assert len(errors) >= 0.8 * count
    return np.array(errors), np.array(estimates), np.array(ways)


def test_the_error_of_the_frozen_normal_is_estimated():
    errors, estimates, ways = random_pairs(Formula(MU, V_D), 12)
    assert np.all(errors < DOUBT * estimates) and np.all(ways != jc.SolvedBy.COUPLED)


def test_no_run_continues_from_within_the_impact_of_a_formula():
    """It has an outcome alone; its states within are unknown."""
    balls = [jc.Sphere(0.1, 0.5, [0.3 * k, 0.0], [1.0 - 2 * k, 0.1], spin=3.0) for k in range(2)]
    scene = jc.Scene(balls, jc.HuGuo(e=E), stiffness=STIFFNESS, friction=Formula(MU, V_D))
    within = jc.simulate(scene, 0.05 + 1e-4, rtol=RTOL, v0="touch")
    assert np.all(np.isnan(within.velocity[-1])) and within.reached == within.duration
    with pytest.raises(ValueError, match=r"sphere 0 is in an impact that began at 0\.05 s"):
        _ = within.final
    later = jc.simulate(scene, 0.3, rtol=RTOL, v0="touch")
    assert np.all(np.isfinite(later.velocity[-1])) and later.final.spheres[0].spin is not None


def test_an_impact_beyond_the_frozen_normal_is_followed():
    errors, estimates, ways = random_pairs(jc.RegularizedCoulomb(MU, V_D), 4)
    assert np.max(errors) < 10 * RTOL and np.all(estimates < 10 * RTOL)
    assert np.all(ways == jc.SolvedBy.COUPLED)
