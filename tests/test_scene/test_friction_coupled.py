"""Coupled contacts with friction: beside an integration by SciPy, beside instantaneous impacts, and
their invariants.
"""

import itertools

import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import integrated
from tests.test_scene.support import go, missing, spheres

AGREES = 1e-10
"""Speeds and surface speeds at rtol 1e-9 beside the integration, in m/s: measured 2e-12."""

KEPT = 1e-12
"""Angular momentum and energy of a run, relative: measured 4e-15 and 2e-12."""

LAW, MU, KAPPA, STIFFNESS = jc.HuGuo(e=0.8), 0.3, 0.8, 1e7
NUMBERS = STIFFNESS, float(LAW.damping_factor()), MU, KAPPA
RAMP = jc.RegularizedCoulomb(MU, v_d=0.05)
RADIUS, MASS = np.array([0.1, 0.12, 0.09]), np.array([0.5, 0.8, 0.4])
PLACE = np.array([[-0.5, 0.02], [0.0, 0.0], [0.2095, 0.03]])
SPEED, SPIN = np.array([[2.0, 0.3], [0.0, 0.0], [0.0, 0.0]]), np.array([20.0, -5.0, 3.0])
AWAY = np.array([0.0, 50.0])


def compare(run, who, known, radius, within=AGREES):
    speed, spin = known
    np.testing.assert_allclose(run.velocity[-1, who], speed, rtol=0, atol=within)
    surface = np.asarray(run.spin[-1, who]).reshape(spin.shape) - spin
    assert np.max(np.abs(surface) * radius[:, None]) < within


def six_discs(
    radius, mass, place, speed, spin, duration,
    mu=MU, ramp=RAMP, floor=-900.0, law=LAW, stiffness=STIFFNESS, rtol=1e-9,
):  # fmt: skip
    """The run of discs over a floor, of which the first three and the floor rub by a ramp, and all
    others by springs. What is missing of six is far away.
    """
    more = 6 - len(place)
    place = [*place, *([50.0 + k, 50.0] for k in range(more))]
    columns = [[*x, *[fill] * more] for x, fill in ((radius, 0.1), (mass, 1.0), (spin, 0.0))]
    names = [f"{row} {k}" for row in ("ramp", "spring") for k in range(3)]
    speed = [*speed, *[[0.0, 0.0]] * more]
    discs = spheres(*columns[:2], place, speed, columns[2], names)
    friction = dict.fromkeys(itertools.combinations([*names[:3], "floor"], 2), ramp)
    friction["default"] = jc.SpringSlider(mu, ratio=KAPPA)
    bodies = [*discs, jc.Plane([0.0, floor], [0.0, 1.0], name="floor")]
    scene = jc.Scene(bodies, law, stiffness=stiffness, friction=friction)
    return jc.simulate(scene, duration, v0="touch", rtol=rtol)


def three_discs(mu):
    """A disc hits another one that nearly touches a third: two contacts at once, three modes. The
    run of two such rows far from each other, one with a ramp and one with springs.
    """
    columns = RADIUS, MASS, [*(PLACE + AWAY), *PLACE], SPEED, SPIN
    radius, mass, place, speed, spin = (x if len(x) == 6 else [*x, *x] for x in columns)
    return six_discs(radius, mass, place, speed, spin, 0.25, mu)


@pytest.fixture(scope="module")
def rows():
    return three_discs(MU)


@pytest.mark.parametrize("ramp", [None, 0.05], ids=["spring", "ramp"])
def test_three_discs_agree_with_an_integration(ramp, rows):
    part = slice(3, 6) if ramp is None else slice(0, 3)
    place, speed, spin = (
        np.asarray(x[-1, part]) for x in (rows.position, rows.velocity, rows.spin)
    )
    place = place if ramp is None else place - AWAY
    of_row = np.asarray(rows.impacts.first) // 3 == part.start // 3
    assert np.all(rows.impacts.solved_by == jc.SolvedBy.COUPLED) and np.sum(of_row) == 2
    start = PLACE, SPEED, SPIN[:, None]
    known = integrated(RADIUS, MASS, np.zeros(2), start, 0.25, NUMBERS, {"ramp": ramp})
    compare(rows, part, known, RADIUS, AGREES if ramp is None else 1e-8)

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
    np.testing.assert_allclose(none.spin[-1, 3:], SPIN, rtol=4e-16)
    assert 0 < np.max(np.abs(weak.spin[-1, 3:] - SPIN)) < 1e-3
    assert np.max(np.abs(weak.velocity[-1, 3:] - none.velocity[-1, 3:])) < 1e-4


RTOL = 1e-6
"""The tolerance of the runs below; impacts agree with their references within ten of it."""

DOUBT = 3
"""The largest error of the frozen normal over its estimate: measured 1.05 in 12 random pairs, 0.1
to 1 in most."""

ENERGY = 1e-7
"""Energy in J that runs of a few J miss at that tolerance: measured 5e-9."""

HARDER = {"law": jc.HuGuo(e=0.6), "stiffness": 1e8}
WEAK = jc.RegularizedCoulomb(0.2, 0.02)


class Formula(jc.RegularizedCoulomb):
    """A law that is not known to act alike in coupled contacts, so that its formula is used."""


def followed(*state, floor=-900.0):
    return six_discs(*state, 0.3, ramp=WEAK, floor=floor, rtol=RTOL, **HARDER)


def by_formula(*state, duration=0.3):
    scene = jc.Scene(spheres(*state), **HARDER, friction=Formula(WEAK.mu, WEAK.v_d))
    return jc.simulate(scene, duration, v0="touch", rtol=RTOL)


def test_impacts_on_a_wall_are_oblique_impacts():
    """A ball with spin, three speeds of sliding: it sticks, slides throughout, or reverses."""
    for v, w in (([1.0, -2.0], 0.0), ([5.0, -1.0], 20.0), ([0.0, -3.0], -15.0)):
        run = followed([0.1], [1.0], [[0.0, 0.2]], [v], [w], floor=0.0)
        hit = jc.oblique_impact(
            HARDER["law"], jc.Contact(1.0, HARDER["stiffness"]), -v[1], v[0], friction=WEAK,
            bodies=jc.RoundBodies(0.1), spin=(w, 0.0),
        )  # fmt: skip
        speed = [hit.tangential_velocity, hit.normal.rebound_velocity]
        assert np.max(np.abs(run.velocity[-1, 0] - np.array(speed))) < 10 * RTOL * -v[1]
        assert np.abs(run.spin[-1, 0] - hit.spin[0]) * 0.1 < 10 * RTOL * -v[1]


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
        surface = np.abs(run.spin[-1, :2] - turned[:, 0]) * radius[k]
        error = max(np.max(np.abs(run.velocity[-1, :2] - speed)), np.max(surface))
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


def test_no_run_continues_from_within_the_impact_of_a_formula():
    """It has an outcome alone; its states within are unknown."""
    balls = 0.1, 0.5, [[0.0, 0.0], [0.3, 0.0]], [[1.0, 0.1], [-1.0, 0.1]], 3.0
    within = by_formula(*balls, duration=0.05 + 1e-4)
    assert np.all(np.isnan(within.velocity[-1])) and within.reached == within.duration
    with pytest.raises(ValueError, match=r"sphere 0 is in an impact that began at 0\.05 s"):
        _ = within.final
    later = by_formula(*balls)
    assert np.all(np.isfinite(later.velocity[-1])) and later.final.spheres[0].spin is not None


LIMIT = 1e-3
"""Speeds at K = 1e12 beside those of instantaneous impacts, in m/s: measured 2e-4. Most of it is
the way in the duration of 4e-5 s; a tangential spring leaves .3 m/s."""


def on_pegs(stiffness):
    """Balls far from each other, each with a friction law of its own on the sphere below it."""
    bodies, laws = [], {"default": jc.SpringSlider(MU, ratio=KAPPA)}
    frictions = [jc.WaltonFriction(0.3, 0.4), jc.MawBarberFawcett(0.2, 0.8), RAMP, None]
    for k, friction in enumerate(frictions):
        ball = [3.0 * k + 0.1, -0.5, 0.07], [0.3, -1.0, 0.4]
        bodies += [
            jc.Sphere(0.1, 0.5, *ball, spin=[3.0, -4.0, 5.0], name=f"ball {k}"),
            jc.Sphere(0.2, None, [3.0 * k, -0.8, 0.0], fixed=True, name=f"peg {k}"),
        ]
        if friction is not None:
            laws[f"ball {k}", f"peg {k}"] = friction
    gravity = [0.0, -9.81, 0.0]
    return jc.Scene(bodies, jc.HuGuo(e=0.7), stiffness=stiffness, gravity=gravity, friction=laws)


def test_hard_contacts_have_the_instantaneous_outcome():
    hard, rigid = jc.simulate(on_pegs(1e12), 0.15), go(on_pegs(1e6), 0.15)
    assert list(hard.impacts.solved_by) == [jc.SolvedBy.COUPLED] * 4 and len(rigid.impacts) == 4
    np.testing.assert_allclose(hard.velocity[-1], rigid.velocity[-1], atol=LIMIT)
    np.testing.assert_allclose(0.1 * hard.spin[-1], 0.1 * rigid.spin[-1], atol=LIMIT)
    # Those at the same time have no order.
    slip = [run.impacts.slip_after[np.argsort(run.impacts.first)] for run in (hard, rigid)]
    np.testing.assert_allclose(*slip, atol=LIMIT)
    # In J, of some J at the default tolerance: measured 5e-12.
    assert missing(hard) < 4 * 2e-11
    assert "friction" not in str(hard)


UP, DRIFT = np.array([0.0, 0.0, 1.0]), np.array([0.5, -0.3, 0.0])
PULL = np.array([0.0, 0.0, -9.8])


def on_a_belt(place, speed, spin, mu):
    """The run of two balls in space above a belt."""
    belt = jc.Plane(np.zeros(3), UP, motion=jc.Steady(DRIFT))
    balls, friction = spheres(RADIUS[:2], MASS[:2], place, speed, spin), jc.SpringSlider(mu, KAPPA)
    scene = jc.Scene([*balls, belt], LAW, stiffness=STIFFNESS, friction=friction, gravity=PULL)
    return jc.simulate(scene, 0.02, v0="touch", rtol=1e-9)


def test_balls_on_a_belt_agree_with_an_integration():
    """They touch each other and a belt at once; spins have three components."""
    place = np.array([[0.0, 0.0, 0.1005], [0.2195, 0.02, 0.121]])
    speed = np.array([[1.0, 0.2, -1.0], [-1.0, 0.3, -1.0]])
    spin, planes = np.array([[20.0, -5.0, 3.0], [1.0, 2.0, -3.0]]), ((UP, 0.0, DRIFT),)
    run, start = on_a_belt(place, speed, spin, MU), (place, speed, spin)
    known = integrated(RADIUS[:2], MASS[:2], PULL, start, 0.02, NUMBERS, {"planes": planes})
    compare(run, slice(0, 2), known, RADIUS[:2])
    assert run.wall_work > 0.3 and missing(run) < KEPT * run.energy[0]


TURN = 2e-3
"""The arm R - δ of the spin turns the slip by about δ/R = 5e-4."""


def test_side_spin_far_faster_than_the_closing_speed():
    """Friction in space keeps the direction of the slip, which is 10,000 times μ v0."""
    place, speed = np.array([[0.0, 0.0, 0.10001], [9.0, 0.0, 9.0]]), np.zeros((2, 3))
    spin = np.array([[50.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    speed[0] = [5.0, 0.0, -0.03]
    run = on_a_belt(place, speed, spin, 0.02)
    slip = speed[0] - DRIFT - np.cross(RADIUS[0] * spin[0], UP)
    change = run.velocity[-1, 0] - speed[0]
    along = change[:2] @ slip[:2] / np.linalg.norm(slip[:2])
    assert along < -1e-3
    across = change[0] * slip[1] - change[1] * slip[0]
    assert abs(across) < TURN * abs(along) * np.linalg.norm(slip)
    assert missing(run) < KEPT * run.energy[0]
