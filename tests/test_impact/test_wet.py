"""Wet contacts: e (1 - v_c/v0) beside lubrication, and bodies that stick."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.stored import stored
from tests.test_impact.support import assert_same, impacts, slopes_of_lanes
from tests.test_laws.table import exact_alpha

LUBRICATION = 1e-14  # beside the equation of the film at 25 digits, by 1 - v_c/v0: measured 4e-16
FORMULA = 1e-13  # of an impact beside its law alone: measured 2e-16

E, VISCOSITY, RADIUS, MASS = 0.9, 0.05, 2e-3, 1e-4
FILM, ROUGHNESS = 1e-4, 1e-6
CONTACT = jc.Contact(mass=MASS, stiffness=1e9)
LAW = jc.WetRestitution(e=E, critical_speed=0.1)


@stored()
def through_the_film(speed, resists):
    """The speed after the film, which resists with 6πμa² v/x on the way in, or on both ways.

    Newton's equation over τ, dt = x dτ, which is regular: the gap and the speed over FILM.
    """
    with mp.workdps(25):
        drag = 6 * mp.pi * mp.mpf(VISCOSITY) * mp.mpf(RADIUS) ** 2 / mp.mpf(MASS)
        ratio = mp.mpf(ROUGHNESS) / mp.mpf(FILM)

        def leave(speed, begin, end, sign):
            path = mp.odefun(lambda _, y: [sign * y[1] * y[0], -drag * y[1]], 0, [begin, speed])
            guess = abs(mp.log(end / begin)) / speed
            return path(mp.findroot(lambda tau: path(tau)[0] / end - 1, (guess, 1.01 * guess)))[1]

        inside = leave(mp.mpf(speed), mp.mpf(1), ratio, -1)
        out = E * inside
        return float(leave(out, ratio, mp.mpf(1), 1) if resists else out)


@pytest.mark.parametrize("resists", [False, True])
def test_the_equation_of_the_film(resists):
    stokes = np.log(FILM / ROUGHNESS) * (1 + 1 / E if resists else 1)
    law = jc.WetRestitution.of_liquid(E, stokes, VISCOSITY, RADIUS, MASS)
    np.testing.assert_allclose(
        law.critical_speed, 6 * np.pi * VISCOSITY * RADIUS**2 * stokes / MASS, rtol=LUBRICATION
    )
    for times in (30.0, 1.5, 1.01):
        speed = float(times * law.critical_speed)
        np.testing.assert_allclose(
            law.restitution_at(speed) * speed,
            through_the_film(speed, resists),
            rtol=LUBRICATION / (1 - 1 / times),
        )


SPEEDS = 0.1 * np.array([0.01, 0.999, 1.0, 1 + 2**-52, 1 + 1e-9, 1.1, 3.0, 1e4])
STICKS = SPEEDS <= 0.1


def test_slow_bodies_stick():
    hit = impacts(LAW, CONTACT, SPEEDS)
    expected = [max(0, 0.9 * (1 - 0.1 / v)) for v in SPEEDS]
    np.testing.assert_allclose(hit.restitution, expected, rtol=FORMULA)
    np.testing.assert_array_equal(hit.status, np.where(STICKS, 1, 0))
    np.testing.assert_array_equal(jc.restitution(LAW, velocity=SPEEDS), hit.restitution)
    np.testing.assert_array_equal(np.isinf(hit.duration), STICKS)
    np.testing.assert_allclose(hit.energy_loss[STICKS], MASS * SPEEDS[STICKS] ** 2 / 2)
    for name in ("max_force", "max_indentation", "compression_time"):
        np.testing.assert_array_equal(np.isnan(getattr(hit, name)), STICKS)
    # A single impact that sticks raises nothing.
    assert jc.impact(LAW, CONTACT, 0.05).status == jc.Status.SETTLED
    followed = impacts(LAW, CONTACT, SPEEDS, method="event")
    np.testing.assert_allclose(followed.restitution, expected, rtol=FORMULA)
    np.testing.assert_array_equal(followed.status, hit.status)


def test_a_soft_ball_comes_to_rest_on_a_wall():
    """It leaves each time with what the film leaves of its speed, until it sticks."""
    ball = jc.Sphere(mass=0.5, radius=0.1, position=(0.15,))
    wall, law = jc.Plane(point=(0.0,), normal=(1.0,)), jc.WetRestitution(e=0.9, critical_speed=0.2)
    scene = jc.Scene([ball, wall], law, stiffness=1e9, gravity=(-9.81,))
    run = jc.simulate(scene, 1.0)
    speeds = np.asarray(run.impacts.closing_speed)
    # The weight takes more from the last one.
    np.testing.assert_allclose(speeds[1:-1], 0.9 * (speeds[:-2] - 0.2), rtol=2e-2)
    assert speeds[-1] < 0.2
    np.testing.assert_allclose(run.velocity[-1], 0, atol=1e-6)


def test_derivatives_in_both_modes():
    def numbers(given):
        e, critical, speed = given
        hit = jc.impact(jc.WetRestitution(e=e, critical_speed=critical), CONTACT, speed)
        columns = hit.restitution, hit.rebound_velocity, hit.energy_loss, hit.status.astype(float)
        return jnp.stack(columns)

    solve, at = slopes_of_lanes(numbers), np.stack([np.full(8, 0.9), np.full(8, 0.1), SPEEDS], 1)
    values, slopes, backward = solve(at)
    np.testing.assert_array_equal(values[:, 3], np.where(STICKS, 1, 0))
    np.testing.assert_allclose(slopes, backward, rtol=FORMULA, atol=1e-20)
    # Of e, and of the rebound velocity e (v - v_c).
    np.testing.assert_array_equal(slopes[STICKS][:, :2], 0)
    v, moves = SPEEDS[~STICKS], slopes[~STICKS]
    one = np.ones_like(v)
    by_hand = np.stack([1 - 0.1 / v, -0.9 / v, 0.09 / v**2], axis=1)
    np.testing.assert_allclose(moves[:, 0], by_hand, rtol=FORMULA, atol=1e-15)
    by_hand = np.stack([v - 0.1, -0.9 * one, 0.9 * one], axis=1)
    np.testing.assert_allclose(moves[:, 1], by_hand, rtol=FORMULA, atol=1e-15)
    # The loss m v² (1 - e²)/2, by e and by its own v.
    e = values[~STICKS][:, :1]
    by_hand = -MASS * (v**2)[:, None] * e * moves[:, 0] + MASS * v[:, None] * (1 - e**2) * [0, 0, 1]
    np.testing.assert_allclose(moves[:, 2], by_hand, rtol=FORMULA, atol=1e-20)


def test_the_force_is_that_of_the_exact_law():
    """Above v_c the impact is that of `ExactRestitution`; at v_c the force stays finite."""
    hit, exact = (impacts(law, CONTACT, 0.3) for law in (LAW, jc.ExactRestitution(e=0.6)))
    names = ("duration", "compression_time", "max_force", "max_indentation", "energy_loss")
    assert_same(hit, exact, names, rtol=FORMULA)
    with mp.workdps(30):
        factor = float(exact_alpha(mp.mpf("0.001")))
    np.testing.assert_allclose(LAW.damping_factor(velocity=0.1), factor, rtol=1e-14)
    np.testing.assert_allclose(LAW.damping_factor(velocity=1e-30), factor, rtol=1e-14)


def test_a_ball_sticks_in_its_bounce():
    """It leaves with e (v - v_c) as long as it is faster than v_c."""
    speeds, law = [np.sqrt(2 * 9.81 * 0.1)], jc.WetRestitution(e=E, critical_speed=0.3)
    while speeds[-1] > 0.3:
        speeds.append(E * (speeds[-1] - 0.3))
    run = jc.bounce(law, CONTACT, height=0.1)
    np.testing.assert_allclose(run.impact_velocity, speeds, rtol=1e-12)
    assert run.at_rest and run.status[-1] == jc.Status.SETTLED and run.restitution[-1] == 0
    # Weight in the contact: it sticks as well.
    heavy = jc.bounce(law, CONTACT, height=0.1, gravity_in_contact=True)
    assert heavy.at_rest and heavy.impact_velocity.shape == run.impact_velocity.shape
