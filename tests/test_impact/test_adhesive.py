"""Adhesive contacts: Johnson, Kendall and Roberts; Derjaguin, Muller and Toporov."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from mpmath import cos, findroot, mpf, pi, quad, sin, sqrt, workdps
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.oracle.stored import stored
from tests.test_impact.support import assert_same, assert_slopes, impacts, slopes_of_lanes

FORMULA = 1e-12  # of published numbers with 12 digits, and of formulas
BY_SCIPY = 1e-9  # beside DOP853 at rtol 1e-12: measured 2e-11, 3e-10 just above the sticking speed
SLOW = 1e-8
"""Of the duration of slow impacts with adhesion, by mpmath at `rtol` 1e-9: measured 1.4e-9."""
SLOPES = 1e-7  # central differences with h = 1e-6: measured 1e-9

W, RADIUS, MODULUS, MASS = 0.1, 1e-5, 1e9, 1e-11
CONTACT = jc.Contact(mass=MASS, stiffness=4 / 3 * MODULUS * np.sqrt(RADIUS), exponent=1.5)
LAW = jc.JKR.of_surfaces(W, RADIUS)
UNIT = np.cbrt(W**5 * RADIUS**4 / MODULUS**2)  # of energy
SNAP = -0.75 * np.cbrt(np.pi**2 * W**2 * RADIUS / MODULUS**2)
STICKS = np.sqrt(2 * 7.09219597186 * UNIT / MASS)


@stored()
def by_contact_radius(speed, work, push):
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


@jax.jit
@jax.vmap
@jax.value_and_grad
def force_and_slope(indentation):
    return LAW.force(indentation, 0.0, CONTACT, 1.0)


def test_published_numbers():
    pull_off = 1.5 * np.pi * W * RADIUS
    np.testing.assert_allclose(LAW.pull_off, pull_off, rtol=FORMULA)
    np.testing.assert_allclose(jc.DMT.of_surfaces(W, RADIUS).pull_off, 2 * np.pi * W * RADIUS)
    np.testing.assert_allclose(LAW.sticking_speed(CONTACT), STICKS, rtol=FORMULA)
    # At zero load the contact has the radius a0 and the stiffness 1.2 E* a0.
    radius = np.cbrt(9 * np.pi * W * RADIUS**2 / (2 * MODULUS))
    rest = radius**2 / RADIUS - np.sqrt(2 * np.pi * W * radius / MODULUS)
    force, stiffness = force_and_slope(np.array([0.0, SNAP * (1 - 1e-14), SNAP * 1.0001, rest]))
    np.testing.assert_allclose(force[:3] / pull_off, [-8 / 9, -5 / 9, 0], atol=1e-6)
    np.testing.assert_allclose(force[0] / pull_off, -8 / 9, rtol=FORMULA)
    np.testing.assert_allclose(force[3] / pull_off, 0, atol=FORMULA)
    np.testing.assert_allclose(stiffness[3], 1.2 * MODULUS * radius, rtol=FORMULA)


def test_impacts_beside_scipy():
    times = np.array([30.0, 2.0, 1.05, 1.0001])
    hit = impacts(LAW, CONTACT, times * STICKS)
    by_scipy = np.transpose([by_contact_radius(float(t * STICKS), W, 0.0) for t in times])
    found = hit.duration, hit.compression_time, hit.max_indentation
    np.testing.assert_allclose(found, by_scipy[1:], rtol=BY_SCIPY)
    np.testing.assert_allclose(hit.restitution**2, by_scipy[0] ** 2, atol=BY_SCIPY)
    np.testing.assert_allclose(hit.restitution**2, 1 - (1 / times) ** 2, atol=FORMULA)
    np.testing.assert_allclose(hit.energy_loss, 7.09219597186 * UNIT, rtol=FORMULA)
    np.testing.assert_allclose(hit.min_force, -LAW.pull_off, rtol=FORMULA)
    np.testing.assert_allclose(hit.max_force, force_and_slope(hit.max_indentation)[0], rtol=1e-12)


def test_slow_bodies_stick_by_formula_and_by_event():
    """Below 1e-2 they take the speed of their adhesion at once."""
    times = np.array([1e-6, 1e-4, 1e-2, 0.3, 0.999, 0.9999, 1.0001, 1.001, 1.5, 30.0])
    speed, sticks = STICKS * times, times < 1
    by_formula, by_event = (impacts(LAW, CONTACT, speed, method=m) for m in ("auto", "event"))
    np.testing.assert_array_equal(jc.restitution(LAW, CONTACT, speed) > 0, ~sticks)
    # An event solve does not know the speed at which bodies stick to all digits.
    clear = np.abs(times - 1) > 5e-4
    for hit, at in ((by_formula, times > 0), (by_event, clear)):
        np.testing.assert_array_equal(hit.status[at], sticks[at])
        np.testing.assert_array_equal(hit.restitution[sticks & at], 0)
        np.testing.assert_array_equal(hit.duration[sticks & at], np.inf)
    names = ("restitution", "duration", "compression_time", "max_indentation", "max_force")
    assert_same(by_event, by_formula, names, at=clear & (times > 0.1), rtol=1e-8)
    assert_same(by_event, by_formula, ["max_force"], at=clear, rtol=1e-8)
    assert_same(
        by_event, by_formula, ("energy_loss", "min_force"), at=clear & ~sticks, rtol=BY_SCIPY
    )


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
        e, duration, *_ = by_contact_radius(speed, W, push)
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
    """A pull beyond the pull-off force gives its work along the neck, whatever the speed."""
    speed = STICKS * np.array([1e-2, 1e-4, 1e-6, 1e-4, 1e-6])
    held, torn = (
        pushed()(speed, share * PULL_OFF * np.ones(5), PULL_OFF) for share in (-0.25, -1.5)
    )
    np.testing.assert_array_equal(held[1][1], 1)
    np.testing.assert_array_equal(torn[1][1], 0)
    work = 1.5 * PULL_OFF * -SNAP - 7.09219597186 * UNIT
    gained = np.square(torn[1][0][:, 0] * speed)
    np.testing.assert_allclose(gained, 2 * work / MASS + np.square(speed), rtol=1e-7)


def test_trajectories_end_at_the_snap():
    speed = STICKS * np.array([2.0, 0.5])
    path, hit = jc.trajectory(LAW, CONTACT, speed, samples=33), impacts(LAW, CONTACT, speed)
    path = jax.tree.map(np.asarray, path)
    np.testing.assert_array_equal(path.status, [0, 1])
    total = path.energy.total / path.energy.total[:, :1]
    np.testing.assert_allclose(total, 1, atol=BY_SCIPY)
    np.testing.assert_allclose(path.time[0, -1], hit.duration[0], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.indentation[0, [0, -1]], [0, SNAP], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.velocity[0, -1] / speed[0], -hit.restitution[0], rtol=BY_SCIPY)
    np.testing.assert_allclose(path.force[0, 0], -8 / 9 * PULL_OFF, rtol=FORMULA)
    np.testing.assert_allclose(path.energy.elastic[0, -1], hit.energy_loss[0], rtol=BY_SCIPY)


def test_derivatives_in_both_modes():
    """Also without adhesion, where they are Hertz's."""
    names = ("restitution", "duration", "compression_time", "max_force")

    def numbers(given):
        speed, pull_off = given
        hit = jc.impact(jc.JKR(pull_off=pull_off), CONTACT, speed)
        return jnp.stack([getattr(hit, name) for name in names])

    at = np.array([[1.3 * STICKS, PULL_OFF], [20 * STICKS, PULL_OFF], [0.1, 0.0]])
    values, slopes = assert_slopes(slopes_of_lanes(numbers), at, 1e-6, SLOPES, rtol=1e-10)
    assert np.all(np.isfinite(slopes))
    hertz = impacts(jc.Hertz(), CONTACT, 0.1)
    np.testing.assert_allclose(values[2], [getattr(hertz, name) for name in names], rtol=1e-12)


@stored()
def by_quadrature(v, pull):
    """The duration of Hertz's impact with K = 4e6 under a constant pull."""
    mass, stiffness, pull = mpf(MASS), mpf(4e6), mpf(pull)

    def square(depth):
        return mpf(v) ** 2 + 2 / mass * (pull * depth - stiffness * depth ** mpf("2.5") / 2.5)

    with workdps(30):
        deepest = findroot(square, (5 * pull / (2 * stiffness)) ** mpf(2 / 3))
        # δ = δ_max sin²θ takes the root out of the end.
        half = quad(
            lambda a: 2 * deepest * sin(a) * cos(a) / sqrt(square(deepest * sin(a) ** 2)),
            [0, 1e-4, 1e-2, 0.3, pi / 2 - mpf(10) ** -11],
        )
    return float(2 * half)


def test_dmt():
    """Inside the contact its adhesion is a constant push, without a loss: Hertz's impact.

    Slow bodies become hundreds of times as fast, and slow again; without adhesion they are free.
    """
    law, soft, how = jc.DMT.of_surfaces(W, RADIUS), jc.Contact(MASS, 4e6), jc.Event(rtol=1e-10)
    pull, slow = float(law.pull_off), [5e-5, 2e-4, 5e-4]
    speeds, stiffness = np.array([0.05, 0.1, *slow]), np.array([CONTACT.stiffness] * 2 + [4e6] * 3)
    contact, pulls = jc.Contact(MASS, stiffness), pull * np.array([1, 0, 1, 1, 1])
    hit = impacts(jc.DMT(pull_off=pulls), contact, speeds, method=how)
    pushed = impacts(jc.Hertz(), contact, speeds, external_force=pulls, method=how)
    assert hit.ok.all()
    np.testing.assert_allclose(hit.restitution, 1, rtol=1e-9)
    assert_same(hit, pushed, ("duration", "max_indentation"), at=np.s_[:2], rtol=1e-9)
    free = impacts(jc.Hertz(), CONTACT, 0.1)
    np.testing.assert_allclose(hit.duration[1], free.duration, rtol=1e-8)
    np.testing.assert_allclose(hit.min_force[0], -pull, rtol=1e-12)
    np.testing.assert_array_equal(jc.restitution(law, soft, np.array(slow) / 1e3), 1)
    durations = [by_quadrature(v, pull) for v in slow]
    np.testing.assert_allclose(hit.duration[2:], durations, rtol=SLOW)
