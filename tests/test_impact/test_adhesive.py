"""Adhesive contacts: Johnson, Kendall and Roberts; Derjaguin, Muller and Toporov."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import cos, findroot, mpf, pi, quad, sin, sqrt, workdps
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.test_impact.support import central, slopes_of_lanes

FORMULA = 1e-12
"""Of published numbers with 12 digits, and of formulas."""
BY_SCIPY = 1e-9
"""Beside DOP853 at rtol 1e-12: measured 2e-11, 3e-10 just above the sticking speed."""
SLOW = 1e-8
"""Of the duration of slow impacts with adhesion, by mpmath at `rtol` 1e-9: measured 1.4e-9."""
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


def by_contact_radius(speed, work=W, push=0.0):
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
        return [v, (push * time**2 / length - force) * slope / mass, slope]

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


def test_the_event_solve_beside_the_formulas():
    speed = STICKS * jnp.array([0.3, 0.999, 1.001, 1.5, 30.0])
    by_formula, by_event = (jc.impact(LAW, CONTACT, speed, method=m) for m in ("auto", "event"))
    np.testing.assert_array_equal(by_event.status, [1, 1, 0, 0, 0])
    np.testing.assert_array_equal(by_event.status, by_formula.status)
    for name in ("restitution", "duration", "compression_time", "max_indentation", "max_force"):
        found, exact = getattr(by_event, name), getattr(by_formula, name)
        np.testing.assert_allclose(found, exact, rtol=1e-8)
    for name in ("energy_loss", "min_force"):
        found, exact = getattr(by_event, name), getattr(by_formula, name)
        np.testing.assert_allclose(found[2:], exact[2:], rtol=BY_SCIPY)


PULL_OFF = float(LAW.pull_off)
PUSHES = PULL_OFF * np.array([1.5, -0.25, -0.75, -0.75, -1.5])
"""Of -3/4 of the pull-off force the equilibrium that bodies must pass is not at the snap."""
FAST = STICKS * np.array([3.0, 1.2, 0.7, 1.6, 0.2])


@functools.cache
def pushed():
    def numbers(speed, push, pull_off):
        law, how = jc.JKR(pull_off=pull_off), jc.Event(rtol=1e-11)
        hit = jc.impact(law, CONTACT, speed, external_force=push, method=how)
        found = jnp.stack([hit.restitution, hit.duration])
        return found, (found, hit.status)

    return jax.jit(jax.vmap(jax.jacfwd(numbers, (0, 1, 2), has_aux=True), (0, 0, None)))


def test_pushes_and_pulls_beside_scipy():
    slopes, (found, status) = pushed()(FAST, PUSHES, PULL_OFF)
    np.testing.assert_array_equal(status, 0)
    for lane, (speed, push) in enumerate(zip(FAST, PUSHES, strict=True)):
        e, duration, *_ = by_contact_radius(speed, push=push)
        np.testing.assert_allclose(found[lane], [e, duration], rtol=BY_SCIPY)
    for k, at in enumerate((FAST, PUSHES, PULL_OFF)):
        h = 1e-5
        arguments = [FAST, PUSHES, PULL_OFF]
        ends = []
        for sign in (1, -1):
            arguments[k] = at * (1 + sign * h)
            ends.append(pushed()(*arguments)[1][0])
        slope = (ends[0] - ends[1]) / (2 * h)
        steps = np.broadcast_to(at, FAST.shape)[:, None]
        np.testing.assert_allclose(slopes[k] * steps / found, slope / found, atol=SLOPES)


def test_what_a_push_and_adhesion_hold_has_settled():
    """A pull weaker than the pull-off force holds slow bodies, a stronger one none."""
    pushes = PULL_OFF * np.array([1.5, 0.1, -0.25, -0.75, -0.85])
    status = pushed()(STICKS * np.array([1.0, 0.9, 0.5, 0.3, 0.02]), pushes, PULL_OFF)[1][1]
    np.testing.assert_array_equal(status, 1)


def test_bodies_slower_than_their_adhesion():
    """They take its speed at once; energies are much larger than that of the impact."""
    speed = STICKS * jnp.array([1e-2, 1e-4, 1e-6])
    by_formula, by_event = (jc.impact(LAW, CONTACT, speed, method=m) for m in ("auto", "event"))
    np.testing.assert_array_equal(by_event.status, 1)
    np.testing.assert_allclose(by_event.max_force, by_formula.max_force, rtol=1e-8)
    held = pushed()(np.asarray(speed)[[0, 1, 2, 1, 2]], -0.25 * PULL_OFF * np.ones(5), PULL_OFF)
    np.testing.assert_array_equal(held[1][1], 1)
    # Beyond the pull-off force the pull gives its work along the neck, whatever the speed.
    torn = pushed()(np.asarray(speed)[[0, 1, 2, 1, 2]], -1.5 * PULL_OFF * np.ones(5), PULL_OFF)
    np.testing.assert_array_equal(torn[1][1], 0)
    gained = torn[1][0][:, 0] * np.asarray(speed)[[0, 1, 2, 1, 2]]
    work = 1.5 * PULL_OFF * -SNAP - 7.09219597186 * UNIT
    own = np.square(np.asarray(speed)[[0, 1, 2, 1, 2]])
    np.testing.assert_allclose(np.square(gained), 2 * work / MASS + own, rtol=1e-7)


def test_trajectories_end_at_the_snap():
    speed = STICKS * jnp.array([2.0, 0.5])
    path, hit = jc.trajectory(LAW, CONTACT, speed, samples=33), jc.impact(LAW, CONTACT, speed)
    np.testing.assert_array_equal(path.status, [0, 1])
    total = path.energy.total / path.energy.total[:, :1]
    np.testing.assert_allclose(total, 1, atol=BY_SCIPY)
    np.testing.assert_allclose(path.time[0, -1], hit.duration[0], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.indentation[0, [0, -1]], [0, SNAP], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.velocity[0, -1] / speed[0], -hit.restitution[0], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.force[0, 0], -8 / 9 * PULL_OFF, rtol=FORMULA)
    np.testing.assert_allclose(path.energy.elastic[0, -1], hit.energy_loss[0], rtol=BY_SCIPY)


@functools.cache
def derivatives():
    def numbers(given):
        speed, pull_off = given
        hit = jc.impact(jc.JKR(pull_off=pull_off), CONTACT, speed)
        return jnp.stack([hit.restitution, hit.duration, hit.compression_time, hit.max_force])

    return slopes_of_lanes(numbers)


def test_derivatives_in_both_modes():
    pull_off = float(LAW.pull_off)
    at = np.array([[1.3 * STICKS, pull_off], [20 * STICKS, pull_off]])
    values, forward, backward = derivatives()(at)
    np.testing.assert_allclose(forward, backward, rtol=1e-10)
    for k in range(2):
        slope = central(derivatives(), at, k, 1e-6) / values
        np.testing.assert_allclose(forward[:, :, k] * at[:, k : k + 1] / values, slope, atol=SLOPES)


def test_without_adhesion_they_are_hertz():
    # As many lanes as above.
    values, slopes, _ = derivatives()([[0.1, 0.0]] * 2)
    hertz = jc.impact(jc.Hertz(), CONTACT, 0.1)
    e, duration, compression, force = values[0]
    np.testing.assert_allclose(
        [e, duration, compression, force],
        [1, hertz.duration, hertz.compression_time, hertz.max_force],
        rtol=1e-12,
    )
    assert np.all(np.isfinite(slopes))
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


def test_a_slow_dmt_impact_is_judged_by_the_energy_of_its_well():
    """Adhesion makes the bodies hundreds of times as fast as they came, and slow again."""
    law, contact = jc.DMT.of_surfaces(0.1, 1e-5), jc.Contact(mass=1e-11, stiffness=4e6)
    slow = jnp.array([5e-5, 2e-4, 5e-4])
    hit = jc.impact(law, contact, slow)
    assert hit.ok.all()
    np.testing.assert_allclose(hit.restitution, 1, rtol=1e-9)
    np.testing.assert_array_equal(jc.restitution(law, contact, slow / 1e3), 1)
    mass, stiffness, pull = (mpf(float(x)) for x in (contact.mass, contact.stiffness, law.pull_off))
    for v, duration in zip(slow.tolist(), hit.duration, strict=True):

        def square(depth, v=v):
            return mpf(v) ** 2 + 2 / mass * (pull * depth - stiffness * depth ** mpf("2.5") / 2.5)

        with workdps(30):
            deepest = findroot(square, (5 * pull / (2 * stiffness)) ** mpf(2 / 3))
            # δ = δ_max sin²θ takes the root out of the end.
            half = quad(
                lambda a, d=deepest: 2 * d * sin(a) * cos(a) / sqrt(square(d * sin(a) ** 2)),
                [0, 1e-4, 1e-2, 0.3, pi / 2 - mpf(10) ** -11],
            )
        np.testing.assert_allclose(duration, float(2 * half), rtol=SLOW)


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
    """The phase angle follows a contact to δ = 0."""
    with pytest.raises(ValueError, match="`method` must be"):
        jc.impact(LAW, CONTACT, 1.0, method="phase")
    with pytest.raises(ValueError, match="`tension` must be True for `JKR`"):
        jc.JKR(pull_off=1e-6, tension=False)
