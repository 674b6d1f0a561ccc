"""Adhesive contacts: Johnson, Kendall and Roberts; Derjaguin, Muller and Toporov."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc

FORMULA = 1e-12
"""Of published numbers with 12 digits, and of formulas."""
BY_SCIPY = 1e-9
"""Beside DOP853 at rtol 1e-12: measured 2e-11, 3e-10 just above the sticking speed."""
SLOPES = 1e-7
"""Central differences with h = 1e-6: measured 1e-9."""
SINGLE = 1e-5
"""Of float32: measured 2e-6."""

W, RADIUS, MODULUS, MASS = 0.1, 1e-5, 1e9, 1e-11
CONTACT = jc.Contact(mass=MASS, stiffness=4 / 3 * MODULUS * np.sqrt(RADIUS), exponent=1.5)
LAW = jc.JKR.of_surfaces(W, RADIUS)
UNIT = np.cbrt(W**5 * RADIUS**4 / MODULUS**2)
"""Of energy."""
SNAP = -0.75 * np.cbrt(np.pi**2 * W**2 * RADIUS / MODULUS**2)
STICKS = np.sqrt(2 * 7.09219597186 * UNIT / MASS)


def by_contact_radius(speed, work=W):
    """The motion over τ, dt = (dδ/da) dτ, regular at the snap, where dδ/da is zero.

    In units of a length and a time, with the force of the contact radius a as published.
    """
    length, time = 1e-7, 1e-7 / speed
    radius, modulus, mass = RADIUS / length, MODULUS * length * time**2, MASS
    work = work * time**2
    touch = np.cbrt(2 * np.pi * work * radius**2 / modulus)
    snap = np.cbrt(np.pi * work * radius**2 / (8 * modulus))

    def motion(_, y):
        a, v, _ = y
        force = 4 * modulus * a**3 / (3 * radius) - np.sqrt(8 * np.pi * work * modulus * a**3)
        slope = 2 * a / radius - np.sqrt(np.pi * work / (2 * modulus * a))
        return [v, -force * slope / mass, slope]

    def turns(_, y):
        return y[1]

    def snaps(_, y):
        return y[0] - snap

    snaps.terminal, snaps.direction = True, -1
    found = solve_ivp(
        motion, (0, 1e9), [touch, 1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14,
        events=[turns, snaps], first_step=1e-3,
    )  # fmt: skip
    deepest = found.y_events[0][0]
    indentation = deepest[0] ** 2 / radius - np.sqrt(2 * np.pi * work * deepest[0] / modulus)
    return -found.y[1, -1], found.y[2, -1] * time, deepest[2] * time, indentation * length


def test_published_numbers():
    pull_off = 1.5 * np.pi * W * RADIUS
    np.testing.assert_allclose(LAW.pull_off, pull_off, rtol=FORMULA)
    np.testing.assert_allclose(jc.DMT.of_surfaces(W, RADIUS).pull_off, 2 * np.pi * W * RADIUS)
    force = LAW.force(jnp.array([0.0, SNAP * (1 - 1e-14), SNAP * 1.0001]), 0.0, CONTACT, 1.0)
    np.testing.assert_allclose(force / pull_off, [-8 / 9, -5 / 9, 0], atol=1e-6)
    np.testing.assert_allclose(force[0] / pull_off, -8 / 9, rtol=FORMULA)
    np.testing.assert_allclose(LAW.sticking_speed(CONTACT), STICKS, rtol=FORMULA)
    # At zero load the contact has the radius a0 and the stiffness 1.2 E* a0.
    radius = np.cbrt(9 * np.pi * W * RADIUS**2 / (2 * MODULUS))
    rest = radius**2 / RADIUS - np.sqrt(2 * np.pi * W * radius / MODULUS)
    force, stiffness = jax.value_and_grad(lambda d: LAW.force(d, 0.0, CONTACT, 1.0))(rest)
    np.testing.assert_allclose(force / pull_off, 0, atol=FORMULA)
    np.testing.assert_allclose(stiffness, 1.2 * MODULUS * radius, rtol=FORMULA)


@pytest.mark.parametrize("times", [1.0001, 1.05, 2.0, 30.0])
def test_impacts_beside_scipy(times):
    speed = float(times * STICKS)
    hit, by_scipy = jc.impact(LAW, CONTACT, speed), by_contact_radius(speed)
    found = hit.restitution, hit.duration, hit.compression_time, hit.max_indentation
    np.testing.assert_allclose(found[1:], by_scipy[1:], rtol=BY_SCIPY)
    np.testing.assert_allclose(hit.restitution**2, by_scipy[0] ** 2, atol=BY_SCIPY)
    np.testing.assert_allclose(hit.restitution**2, 1 - (1 / times) ** 2, atol=FORMULA)
    np.testing.assert_allclose(hit.energy_loss, 7.09219597186 * UNIT, rtol=FORMULA)
    np.testing.assert_allclose(hit.min_force, -LAW.pull_off, rtol=FORMULA)
    np.testing.assert_allclose(
        hit.max_force, LAW.force(hit.max_indentation, 0.0, CONTACT, 1.0), rtol=1e-12
    )


def test_slow_bodies_stick():
    hit = jc.impact(LAW, CONTACT, STICKS * jnp.array([0.01, 0.9999, 1.0001]))
    np.testing.assert_array_equal(hit.status, [1, 1, 0])
    np.testing.assert_array_equal(hit.restitution[:2], 0)
    np.testing.assert_array_equal(hit.duration[:2], np.inf)
    assert np.all(hit.ok)
    np.testing.assert_array_equal(
        jc.restitution(LAW, CONTACT, STICKS * jnp.array([0.5, 1.0001])) > 0, [False, True]
    )


@functools.cache
def derivatives():
    def numbers(given):
        speed, pull_off = given
        hit = jc.impact(jc.JKR(pull_off=pull_off), CONTACT, speed)
        return jnp.stack([hit.restitution, hit.duration, hit.compression_time, hit.max_force])

    both = jax.jacfwd(numbers), jax.jacrev(numbers)
    return [jax.jit(jax.vmap(function)) for function in (numbers, *both)]


def test_derivatives_in_both_modes():
    values, forward, backward = derivatives()
    pull_off = float(LAW.pull_off)
    at = jnp.array([[1.3 * STICKS, pull_off], [20 * STICKS, pull_off]])
    np.testing.assert_allclose(forward(at), backward(at), rtol=1e-10)
    for k in range(2):
        step = 1e-6 * at[:, k]
        up, down = (values(at.at[:, k].add(sign * step)) for sign in (1, -1))
        slope = (up - down) / 2e-6 / values(at)
        np.testing.assert_allclose(
            forward(at)[:, :, k] * at[:, k : k + 1] / values(at), slope, atol=SLOPES
        )


def test_without_adhesion_they_are_hertz():
    at = jnp.array([[0.1, 0.0]])
    hertz = jc.impact(jc.Hertz(), CONTACT, 0.1)
    e, duration, compression, force = derivatives()[0](at)[0]
    np.testing.assert_allclose(
        [e, duration, compression, force],
        [1, hertz.duration, hertz.compression_time, hertz.max_force],
        rtol=1e-12,
    )
    assert np.all(np.isfinite(derivatives()[1](at)))
    dmt = jc.impact(jc.DMT(pull_off=0.0), CONTACT, 0.1)
    np.testing.assert_allclose(dmt.duration, hertz.duration, rtol=1e-8)


def test_dmt_loses_nothing_and_is_hertz_under_a_push():
    """Inside the contact its adhesion is a constant push."""
    law = jc.DMT.of_surfaces(W, RADIUS)
    hit = jc.impact(law, CONTACT, 0.05, method=jc.Event(rtol=1e-10))
    pushed = jc.impact(
        jc.Hertz(), CONTACT, 0.05, external_force=law.pull_off, method=jc.Event(rtol=1e-10)
    )
    np.testing.assert_allclose(hit.restitution, 1, rtol=1e-9)
    np.testing.assert_allclose(hit.duration, pushed.duration, rtol=1e-9)
    np.testing.assert_allclose(hit.max_indentation, pushed.max_indentation, rtol=1e-9)
    np.testing.assert_allclose(hit.min_force, -law.pull_off, rtol=1e-12)
    assert jc.restitution(law, CONTACT, 0.05) == 1


def test_single_precision():
    single = jc.Contact(
        mass=jnp.float32(MASS), stiffness=CONTACT.stiffness.astype(jnp.float32), exponent=1.5
    )
    law = jc.JKR(pull_off=jnp.asarray([LAW.pull_off, -1.0], jnp.float32))
    hit = jc.impact(law, single, jnp.float32(2 * STICKS))
    np.testing.assert_array_equal(hit.ok, [True, False])
    exact = jc.impact(LAW, CONTACT, float(np.float32(2 * STICKS)))
    for name in ("restitution", "duration", "compression_time", "max_force"):
        np.testing.assert_allclose(getattr(hit, name)[0], getattr(exact, name), rtol=SINGLE)


def test_where_jkr_is_refused():
    """What follows a contact in time ends it at δ = 0."""
    ball = jc.Sphere(radius=0.01, mass=0.1, position=(0.0,), velocity=(1.0,))
    wall = jc.Plane(point=(0.1,), normal=(-1.0,))
    calls = [
        lambda: jc.impact(LAW, CONTACT, 1.0, external_force=1e-3),
        lambda: jc.trajectory(LAW, CONTACT, 1.0),
        lambda: jc.bounce(LAW, CONTACT, height=1.0, gravity=9.81),
        lambda: jc.Scene(bodies=[ball, wall], law=LAW, stiffness=1e5),
        lambda: jc.System(
            mass=lambda t, q, a: jnp.eye(1), force=lambda t, q, v, a: -v, gap=lambda t, q, a: q,
            law=LAW, stiffness=1e5,
        ),
    ]  # fmt: skip
    for call in calls:
        with pytest.raises(ValueError, match=r"must be a law whose contacts end at δ = 0"):
            call()
    for method in ("event", "phase"):
        with pytest.raises(ValueError, match="`method` must be"):
            jc.impact(LAW, CONTACT, 1.0, method=method)
    with pytest.raises(ValueError, match="`tension` must be True for `JKR`"):
        jc.JKR(pull_off=1e-6, tension=False)
