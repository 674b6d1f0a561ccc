"""Coupled contacts with friction: beside SciPy, instantaneous impacts, and their invariants."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import integrated
from tests.test_scene.support import check_modes, go, missing, simulate, spheres
from tests.test_scene.test_gradients import DIFFERENCES

AGREES = 1e-10
"""Speeds and surface speeds at rtol 1e-9 beside the integration, in m/s: measured 2e-12."""

KEPT = 1e-12  # angular momentum and energy of a run, relative: measured 4e-15 and 2e-12

LAW, MU, KAPPA, STIFFNESS = jc.HuGuo(e=0.8), 0.3, 0.8, 1e7
NUMBERS = STIFFNESS, float(LAW.damping_factor()), MU, KAPPA
RAMP = jc.RegularizedCoulomb(MU, v_d=0.05)
RADIUS, MASS = np.array([0.1, 0.12, 0.09]), np.array([0.5, 0.8, 0.4])
PLACE = np.array([[-0.5, 0.02], [0.0, 0.0], [0.2095, 0.03]])
SPEED, SPIN = np.array([[2.0, 0.3], [0.0, 0.0], [0.0, 0.0]]), np.array([20.0, -5.0, 3.0])
AWAY = np.array([0.0, 50.0])


def in_space(place, speed, spin):
    """A motion in a plane as one in space."""
    place, speed = (np.pad(x, ((0, 0), (0, 1))) for x in (place, speed))
    return place, speed, np.pad(np.reshape(spin, (-1, 1)), ((0, 0), (2, 0)))


def compare(found, known, radius, within=AGREES):
    """Compare velocities and spins."""
    np.testing.assert_allclose(found[0], known[0], rtol=0, atol=within)
    surface = np.reshape(found[1], known[1].shape) - known[1]
    assert np.max(np.abs(surface) * radius[:, None]) < within


FLOOR, STILL = ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]), (0.0, 0.0, 0.0)


def six_balls(
    radius, mass, place, speed, spin, duration, *, wall=([0.0, -900.0, 0.0], [0.0, 1.0, 0.0]),
    drift=STILL, gravity=(0.0, -1e-15, 0.0), mu=MU, ramp=RAMP, law=LAW, stiffness=STIFFNESS,
    rtol=1e-9,
):  # fmt: skip
    """The run of balls and a wall, of which the first three and the wall rub by a ramp, and all
    others by springs. What is missing of six is far away. Without any gravity there would be
    another program.
    """
    more = range(6 - len(place))
    place = [*place, *([50.0 + k, 50.0, 0.0] for k in more)]
    fills = (radius, 0.1), (mass, 1.0), (speed, STILL), (spin, STILL)
    radius, mass, speed, spin = ([*x, *(fill for _ in more)] for x, fill in fills)
    names = [f"{row} {k}" for row in ("ramp", "spring") for k in range(3)]
    friction = dict.fromkeys(itertools.combinations([*names[:3], "wall"], 2), ramp)
    friction["default"] = jc.SpringSlider(mu, ratio=KAPPA)
    wall = jc.Plane(*wall, motion=jc.Steady(drift), name="wall")
    scene = jc.Scene(
        [*spheres(radius, mass, place, speed, spin, names), wall], law, stiffness=stiffness,
        friction=friction, gravity=gravity,
    )  # fmt: skip
    return simulate(scene, duration, v0="touch", rtol=rtol)


@functools.cache
def three_discs(mu):
    """A disc hits another one that nearly touches a third: two contacts at once, three modes. The
    run of two such rows far from each other, one with a ramp and one with springs.
    """
    state = in_space([*(PLACE + AWAY), *PLACE], [*SPEED, *SPEED], [*SPIN, *SPIN])
    return six_balls([*RADIUS, *RADIUS], [*MASS, *MASS], *state, 0.25, mu=mu)


@pytest.mark.parametrize("ramp", [None, 0.05], ids=["spring", "ramp"])
def test_three_discs_agree_with_an_integration(ramp):
    rows = three_discs(MU)
    part = slice(3, 6) if ramp is None else slice(0, 3)
    place, speed = (np.asarray(x[-1, part, :2]) for x in (rows.position, rows.velocity))
    spin = np.asarray(rows.spin[-1, part, 2])
    place = place if ramp is None else place - AWAY
    of_row = np.asarray(rows.impacts.first) // 3 == part.start // 3
    assert np.all(rows.impacts.solved_by == jc.SolvedBy.COUPLED) and np.sum(of_row) == 2
    start = PLACE, SPEED, SPIN[:, None]
    known = integrated(RADIUS, MASS, np.zeros(2), start, 0.25, NUMBERS, {"ramp": ramp})
    compare((speed, spin), known, RADIUS, AGREES if ramp is None else 1e-8)

    def momentum(place, speed, spin):
        orbital = place[:, 0] * speed[:, 1] - place[:, 1] * speed[:, 0]
        return np.sum(MASS * orbital + 0.4 * MASS * RADIUS**2 * spin)

    assert abs(momentum(place, speed, spin) - momentum(PLACE, SPEED, SPIN)) < KEPT * 0.1
    assert missing(rows) < 10 * KEPT * rows.energy[0]
    # The slip at touch is that of the flight; the contact point has reversed, or not.
    touch = rows.impacts.time[of_row][0]
    apart = PLACE[0] + SPEED[0] * touch - PLACE[1]
    normal = apart / np.linalg.norm(apart)
    tangent = np.array([-normal[1], normal[0]])
    slip = SPEED[0] @ tangent - RADIUS[:2] @ SPIN[:2]
    np.testing.assert_allclose(rows.impacts.slip[of_row][0], abs(slip), rtol=1e-9)


def test_without_friction_spins_are_kept():
    """μ = 0 has no direction of friction, and small μ one that would turn without limit."""
    none, weak = (three_discs(mu) for mu in (0.0, 1e-6))
    # Only their units are changed and changed back.
    np.testing.assert_allclose(none.spin[-1, 3:, 2], SPIN, rtol=4e-16)
    assert 0 < np.max(np.abs(weak.spin[-1, 3:, 2] - SPIN)) < 1e-3
    assert np.max(np.abs(weak.velocity[-1, 3:] - none.velocity[-1, 3:])) < 1e-4


RTOL = 1e-6  # the tolerance of the runs below; impacts agree with their references within ten of it
DOUBT = 3
"""The largest error of the frozen normal over its estimate: measured 1.05 in 12 random pairs, 0.1
to 1 in most."""

ENERGY = 1e-7  # energy in J that runs of a few J miss at that tolerance: measured 5e-9

HARDER = {"law": jc.HuGuo(e=0.6), "stiffness": 1e8}
WEAK = jc.RegularizedCoulomb(0.2, 0.02)


class Formula(jc.RegularizedCoulomb):
    """A law that is not known to act alike in coupled contacts, so that its formula is used."""


def followed(radius, mass, *state, **wall):
    state, more = in_space(*state), HARDER | wall
    return six_balls(radius, mass, *state, 0.3, ramp=WEAK, rtol=RTOL, **more)


def by_formula(radius, mass, *state, duration=0.3):
    balls, friction = spheres(radius, mass, *in_space(*state)), Formula(WEAK.mu, WEAK.v_d)
    scene = jc.Scene(balls, **HARDER, friction=friction)
    return simulate(scene, duration, v0="touch", rtol=RTOL)


def test_impacts_on_a_wall_are_oblique_impacts():
    """A ball with spin, three speeds of sliding: it sticks, slides throughout, or reverses."""
    for v, w in (([1.0, -2.0], 0.0), ([5.0, -1.0], 20.0), ([0.0, -3.0], -15.0)):
        run = followed([0.1], [1.0], [[0.0, 0.2]], [v], [w], wall=FLOOR)
        hit = jc.oblique_impact(
            HARDER["law"], jc.Contact(1.0, HARDER["stiffness"]), -v[1], v[0], friction=WEAK,
            bodies=jc.RoundBodies(0.1), spin=(w, 0.0),
        )  # fmt: skip
        speed = [hit.tangential_velocity, hit.normal.rebound_velocity]
        assert np.max(np.abs(run.velocity[-1, 0, :2] - np.array(speed))) < 10 * RTOL * -v[1]
        assert np.abs(run.spin[-1, 0, 2] - hit.spin[0]) * 0.1 < 10 * RTOL * -v[1]


def random_pairs(simulated, count):
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
    numbers = 1e8, float(HARDER["law"].damping_factor()), 0.2, 1.0

    errors, estimates, ways = [], [], []
    for k in range(count):
        run = simulated(radius[k], mass[k], place[k], velocity[k], spin[k])
        assert missing(run) < ENERGY
        if not len(run.impacts):
            continue
        start = place[k], velocity[k], spin[k][:, None]
        ramp = {"ramp": 0.02}
        speed, turned = integrated(radius[k], mass[k], np.zeros(2), start, 0.3, numbers, ramp)
        surface = np.abs(run.spin[-1, :2, 2] - turned[:, 0]) * radius[k]
        error = max(np.max(np.abs(run.velocity[-1, :2, :2] - speed)), np.max(surface))
        errors.append(error / run.impacts.closing_speed[0])
        estimates.append(run.impacts.error_estimate[0])
        ways.append(run.impacts.solved_by[0])
    assert len(errors) >= 0.8 * count
    return np.array(errors), np.array(estimates), np.array(ways)


def test_the_error_of_the_frozen_normal_is_estimated():
    errors, estimates, ways = random_pairs(by_formula, 12)
    assert np.all(errors < DOUBT * estimates) and np.all(ways != jc.SolvedBy.COUPLED)


def test_an_impact_beyond_the_frozen_normal_is_followed():
    errors, estimates, ways = random_pairs(followed, 4)
    assert np.max(errors) < 10 * RTOL and np.all(estimates < 10 * RTOL)
    assert np.all(ways == jc.SolvedBy.COUPLED)


@jax.jit
def parts(numbers):
    """Place, velocity and spin of a ball, and what follows; as one program, and so its slopes."""
    return *numbers[:9].reshape(3, 3), *numbers[9:]


@jax.jit
def last(velocity, spin):
    """Velocities and speeds of the surface at the end."""
    return jnp.concatenate([velocity[-1].ravel(), spin[-1].ravel() * 0.1])


def meeting(numbers):
    """Two spheres in space that meet softly: the last velocities and spins."""
    x, v, w, mu, v_d, inertia, e = parts(numbers)
    balls = [
        jc.Sphere(0.1, 0.5, x, v, spin=w, inertia=inertia),
        jc.Sphere(0.12, 0.8, [0.5, 0.05, 0.0], [-0.5, 0.0, 0.1], spin=[3.0, 0.0, -8.0]),
    ]
    scene = jc.Scene(balls, jc.HuGuo(e=e), friction=Formula(mu, v_d), stiffness=1e7)
    run = simulate(scene, 0.5, v0="touch", max_impacts=2, rtol=1e-9)
    return last(run.velocity, run.spin), None


def test_a_soft_impact_in_space():
    place, velocity, spin = [0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [0.0, 10.0, -5.0]
    numbers = np.array([*place, *velocity, *spin, 0.2, 0.5, 0.004, 0.7])
    check_modes(meeting, numbers, np.maximum(np.abs(numbers), 0.1), 1e-5, DIFFERENCES)


def test_no_run_continues_from_within_the_impact_of_a_formula():
    """It has an outcome alone; its states within are unknown."""
    balls = 0.1, 0.5, [[0.0, 0.0], [0.3, 0.0]], [[1.0, 0.1], [-1.0, 0.1]], [3.0, 3.0]
    within = by_formula(*balls, duration=0.05 + 1e-4)
    assert np.all(np.isnan(within.velocity[-1])) and within.reached == within.duration
    with pytest.raises(ValueError, match=r"sphere 0 is in an impact that began at 0\.05 s"):
        _ = within.final
    later = by_formula(*balls)
    assert np.all(np.isfinite(later.velocity[-1])) and later.final.spheres[0].spin is not None


LIMIT = 1e-3
"""Speeds at K = 1e12 beside those of instantaneous impacts, in m/s: measured 2e-4. Most of it is
the way in the duration of 4e-5 s; a tangential spring leaves .3 m/s."""

MISSED = 2e-11  # energy in J that runs of some J miss at the default tolerance: measured 5e-12

FRICTIONS = [jc.WaltonFriction(0.3, 0.4), jc.MawBarberFawcett(0.2, 0.8)]
FRICTIONS += [jc.SpringSlider(MU, ratio=KAPPA)]


def around_a_peg(place, speed, spin, low, high, peg, *, radius, mass, mu, e, stiffness):
    """Discs, a peg and a box. Three discs have a friction law of their own on the peg."""
    names = [f"disc {k}" for k in range(len(place))]
    laws = {(name, "peg"): law for name, law in zip(names, FRICTIONS, strict=False)}
    discs = spheres(radius, mass, place, speed, spin, names)
    peg = jc.Sphere(0.2, None, peg, fixed=True, name="peg")
    return jc.Scene(
        [*discs, peg, jc.Box(low, high)], jc.HuGuo(e=e), stiffness=stiffness,
        gravity=[0.0, -9.81], friction={**laws, "default": jc.RigidCoulomb(mu)},
    )  # fmt: skip


def test_hard_contacts_have_the_instantaneous_outcome():
    """Five discs meet a peg from all sides, by four laws. A ramp has its tests above."""
    angle = 0.3 + 2 * np.pi / 5 * np.arange(5)
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    state, far = (0.32 * out, 0.3 * out[:, ::-1] * [-1, 1] - out, 5.0), [9.0, 9.0]
    how = {"radius": 0.1, "mass": 0.5, "mu": 0.4, "e": 0.7}

    def scene(stiffness):
        return around_a_peg(*state, np.negative(far), far, [0, 0], stiffness=stiffness, **how)

    hard, rigid = simulate(scene(1e12), 0.06), go(scene(1e6), 0.06)
    assert list(hard.impacts.solved_by) == [jc.SolvedBy.COUPLED] * 5 and len(rigid.impacts) == 5
    np.testing.assert_allclose(hard.velocity[-1], rigid.velocity[-1], atol=LIMIT)
    np.testing.assert_allclose(0.1 * hard.spin[-1], 0.1 * rigid.spin[-1], atol=LIMIT)
    # Those at the same time have no order.
    slip = [run.impacts.slip_after[np.argsort(run.impacts.first)] for run in (hard, rigid)]
    np.testing.assert_allclose(*slip, atol=LIMIT)
    assert missing(hard) < 4 * MISSED
    assert "friction" not in str(hard)


@pytest.mark.parametrize(
    ("count", "width"),
    [(5, 0.09), pytest.param(6, 0.1, marks=pytest.mark.slow(reason="a larger bed"))],
)
def test_beds_complete(count, width):
    """A clamped force has a kink, which an event may lie behind: it stopped these beds."""
    box = {"low": [0.0, 0.0], "high": [width, 0.3]}
    discs = jc.random_spheres(count, **box, radius=0.02, mass=0.02, speed=0.1, seed=3)
    place, speed = ([getattr(disc, x) for disc in discs] for x in ("position", "velocity"))
    how = {"radius": 0.02, "mass": 0.02, "mu": 0.3, "e": 0.6, "stiffness": 1e6}
    run = simulate(around_a_peg(place, speed, None, **box, peg=[9.0, 9.0], **how), 0.6)
    assert run.status == jc.Ending.COMPLETED and len(run.impacts) > 30


UP, DRIFT = np.array([0.0, 0.0, 1.0]), np.array([0.5, -0.3, 0.0])
PULL = np.array([0.0, 0.0, -9.8])


def on_a_belt(place, speed, spin, mu):
    """The run of two balls in space above a belt."""
    far = [[90.0 + k, 0.0, 0.2] for k in range(4)]
    place, speed, spin = (
        [*x[:3], *y, x[3]] for x, y in ((far, place), ([STILL] * 4, speed), ([STILL] * 4, spin))
    )
    sizes = [0.1, 0.1, 0.1, *RADIUS[:2], 0.1], [1.0, 1.0, 1.0, *MASS[:2], 1.0]
    belt = {"wall": (STILL, UP), "drift": DRIFT, "gravity": PULL}
    return six_balls(*sizes, place, speed, spin, 0.02, mu=mu, **belt)


def test_balls_on_a_belt_agree_with_an_integration():
    """They touch each other and a belt at once; spins have three components."""
    place = np.array([[0.0, 0.0, 0.1005], [0.2195, 0.02, 0.121]])
    speed = np.array([[1.0, 0.2, -1.0], [-1.0, 0.3, -1.0]])
    spin, planes = np.array([[20.0, -5.0, 3.0], [1.0, 2.0, -3.0]]), ((UP, 0.0, DRIFT),)
    run, start = on_a_belt(place, speed, spin, MU), (place, speed, spin)
    known = integrated(RADIUS[:2], MASS[:2], PULL, start, 0.02, NUMBERS, {"planes": planes})
    compare((run.velocity[-1, 3:5], run.spin[-1, 3:5]), known, RADIUS[:2])
    assert run.wall_work > 0.3 and missing(run) < KEPT * run.energy[0]


TURN = 2e-3  # the arm R - δ of the spin turns the slip by about δ/R = 5e-4


def test_side_spin_far_faster_than_the_closing_speed():
    """Friction in space keeps the direction of the slip, which is 10,000 times μ v0."""
    place, speed = np.array([[0.0, 0.0, 0.10001], [9.0, 0.0, 0.2]]), np.zeros((2, 3))
    spin = np.array([[50.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    speed[0] = [5.0, 0.0, -0.03]
    run = on_a_belt(place, speed, spin, 0.02)
    slip = speed[0] - DRIFT - np.cross(RADIUS[0] * spin[0], UP)
    change = run.velocity[-1, 3] - speed[0]
    along = change[:2] @ slip[:2] / np.linalg.norm(slip[:2])
    assert along < -1e-3
    across = change[0] * slip[1] - change[1] * slip[0]
    assert abs(across) < TURN * abs(along) * np.linalg.norm(slip)
    assert missing(run) < KEPT * run.energy[0]


SAME = 1e-13  # speeds in m/s with another order of the balls: measured 1e-15

ORDER, FLIP = [2, 0, 1], np.array([-1.0, 1.0, 1.0])


def in_a_shell(numbers):
    """Three balls above a peg in a shell, of radii, masses, K, μ, places, velocities and spins."""
    state = numbers[8:].reshape(3, 3, 3)
    peg = jc.Sphere(0.2, None, [0.0, -0.7, 0.0], fixed=True)
    return jc.Scene(
        [*spheres(numbers[:3], numbers[3:6], *state), peg, jc.Shell(np.zeros(3), 1.0)],
        jc.HuGuo(e=0.7), stiffness=numbers[6], gravity=[0.0, -9.81, 0.0],
        friction=jc.RigidCoulomb(numbers[7]),
    )  # fmt: skip


@jax.jit
@jax.vmap
def ended(numbers):
    """The last positions, velocities and surface speeds, the energy that is missing, how contacts
    were solved, and their slip.
    """
    run = simulate(in_a_shell(numbers), 0.15, max_impacts=16, throw=False)
    lost = jnp.sum(jnp.where(run.impacts.solved_by >= 0, run.impacts.energy_loss, 0))
    kept = run.energy[0] - run.energy[-1] - lost - run.sliding_loss
    ends = jnp.stack([run.position[-1, :3], run.velocity[-1, :3], 0.1 * run.spin[-1, :3]])
    return ends, kept, run.impacts.solved_by, run.impacts.slip_after


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
    mirror, (ends, kept, ways, _) = in_shells
    first, other, mirrored = (ends[k:18:3] for k in range(3))
    np.testing.assert_allclose(first[:, :, ORDER], other, atol=SAME)
    np.testing.assert_allclose(mirror * first, mirrored, atol=SAME)
    assert np.max(np.abs(kept[:18])) < MISSED
    # Some contacts are of two bodies, and some of more.
    assert {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING} <= set(ways[:18].ravel())


@pytest.mark.parametrize(("mu", "lane"), [(0.5, 18), (0.05, 19)])
def test_hard_contacts_in_space_have_the_instantaneous_outcome(mu, lane, in_shells):
    (_, speed, surface), kept, way, slip = (x[lane] for x in in_shells[1])
    rigid = simulate(in_a_shell(hard(mu, 1e6)), 0.15, instantaneous=True)
    assert way[way >= 0].tolist() == [jc.SolvedBy.COUPLED] * 2 and len(rigid.impacts) == 2
    np.testing.assert_allclose(speed, rigid.velocity[-1, :3], atol=LIMIT)
    np.testing.assert_allclose(surface, 0.1 * rigid.spin[-1, :3], atol=LIMIT)
    np.testing.assert_allclose(slip[:2], rigid.impacts.slip_after, atol=LIMIT)
    assert abs(kept) < 2 * MISSED
