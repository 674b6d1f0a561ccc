"""Soft impacts with friction beside a restarted integration."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc

RTOL = 1e-6
"""The tolerance of the runs; impacts on planes agree with the integration within ten of it."""

DOUBT = 3
"""The largest error of the frozen normal over its estimate: measured 1.05 in 12 random pairs, 0.1
to 1 in most."""

ENERGY = 1e-7
"""Energy in J that runs of a few J miss at that tolerance: measured 5e-9."""

MU, V_D, STIFFNESS = 0.2, 0.02, 1e8
ALPHA = float(jc.HuGuo(e=0.6).damping_factor())


def rates(y, spheres, wall, v0):
    """Newton's equations of two spheres in the plane, or of one on a wall at y = 0."""
    (m, n), (r, s) = spheres
    x, v, w = y[:4].reshape(2, 2), y[4:8].reshape(2, 2), y[8:]
    apart = x[0] * [0, 1] if wall else x[0] - x[1]
    length = np.hypot(*apart)
    normal, distance = apart / length, r if wall else r + s
    relative = v[0] - (0 if wall else v[1])
    force = STIFFNESS * max(distance - length, 0) ** 1.5
    force *= max(1 - ALPHA * (relative @ normal) / v0, 0)
    # On a wall the arm is the radius; between spheres both add up to the distance.
    arms = np.array([r, 0.0] if wall else [r, s]) - (0 if wall else (distance - length) / 2)
    tangent = np.array([-normal[1], normal[0]])
    slip = relative @ tangent - arms @ w
    rub = -MU * force * np.clip(slip / V_D, -1, 1)
    push = force * normal + rub * tangent
    inertia = 0.4 * np.array([m * r**2, n * s**2])
    second = np.zeros(2) if wall else -push / n
    return np.concatenate([v.ravel(), push / m, second, -arms * rub / inertia])


def integrated(spheres, x, v, w, duration, wall):
    """The state of the run, restarted at each touch and at each end of a contact."""
    y = np.concatenate([np.ravel(x), np.ravel(v), w])
    r, s = spheres[1]

    def gap(t, y):
        if wall:
            return y[1] - r
        return np.hypot(*(y[:2] - y[2:4])) - r - s

    gap.terminal = True
    t, inside = 0.0, False
    while t < duration:
        gap.direction = 1 if inside else -1
        away = y[0:2] * [0, 1] if wall else y[:2] - y[2:4]
        closes = -(y[4:6] - (0 if wall else y[6:8])) @ away / np.hypot(*away)
        if inside:

            def right(t, y, closes=closes):
                return rates(y, spheres, wall, closes)
        else:

            def right(t, y):
                return np.concatenate([y[4:8], np.zeros(6)])

        # The slope of friction jumps where sliding ends.
        step = 2e-5 if inside else 0.01
        out = solve_ivp(
            right, (t, duration), y, method="DOP853", rtol=1e-12, atol=1e-14, events=gap,
            max_step=step,
        )  # fmt: skip
        t, y = out.t[-1], out.y[:, -1]
        if out.status == 1:
            inside = not inside
    return y[4:8].reshape(2, 2), y[8:]


def test_impacts_on_a_wall_agree_with_an_integration():
    """A ball with spin, three speeds of sliding: it sticks, slides throughout, or reverses."""
    for v, w in (([1.0, -2.0], 0.0), ([5.0, -1.0], 20.0), ([0.0, -3.0], -15.0)):
        ball = jc.Sphere(0.1, 1.0, [0.0, 0.2], v, spin=w)
        scene = jc.Scene(
            [ball, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.HuGuo(e=0.6), stiffness=STIFFNESS,
            friction=jc.RegularizedCoulomb(MU, V_D),
        )  # fmt: skip
        run = jc.simulate(scene, 0.2, rtol=RTOL)
        start = ([[0.0, 0.2], [9.0, 9.0]], [v, [0.0, 0.0]], [w, 0.0])
        speed, spin = integrated(((1.0, 1.0), (0.1, 0.1)), *start, 0.2, wall=True)
        assert np.max(np.abs(run.velocity[-1, 0] - speed[0])) < 10 * RTOL * -v[1]
        assert np.abs(run.spin[-1, 0] - spin[0]) * 0.1 < 10 * RTOL * -v[1]


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
        scene = jc.Scene(balls, jc.HuGuo(e=0.6), stiffness=STIFFNESS, friction=friction)
        run = jc.simulate(scene, 0.3, rtol=RTOL, v0="touch")
        lost = jnp.sum(run.impacts.energy_loss) + run.sliding_loss
        assert abs(run.energy[0] - run.energy[1] - lost) < ENERGY
        if not len(run.impacts):
            continue
        speed, turned = integrated((mass[k], radius[k]), *start, 0.3, wall=False)
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
    scene = jc.Scene(balls, jc.HuGuo(e=0.6), stiffness=STIFFNESS, friction=Formula(MU, V_D))
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
