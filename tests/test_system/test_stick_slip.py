"""Rigid Coulomb friction in mechanisms: stick and slip against formulas and restarted SciPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxcontact as jc
from tests.test_scene.support import check_modes
from tests.test_system.references import DIFFERENCES, plane, restarted

LAW, STIFFNESS, G = jc.HuGuo(e=0.9), 1e5, 9.81
ALPHA = 1.5 * 0.1 / 0.9  # Hu & Guo (2015), equation 38: α = 3 (1 - e)/(2 e)
RTOL = 1e-9

EVENTS = 10 * RTOL  # of the duration: times of changes between stick and slip
CRANK = 1e-7
"""Of the duration: events of a crank, whose contacts amplify errors about a hundredfold."""

DRIFT = 1e-9  # of the speeds: the slip of contacts that stick


def mass(t, q, args):
    return jnp.diag(jnp.stack([jnp.ones_like(t), jnp.ones_like(t), args["inertia"]]))


def force(t, q, v, args):
    tilt = args["tilt"]
    return G * jnp.stack([jnp.sin(tilt), -jnp.cos(tilt), jnp.zeros_like(t)])


def slip(t, q, v, args):
    """A body of the radius R on a plane that shakes along itself."""
    shakes = args["speed"] * jnp.cos(args["rate"] * t)
    return (v[0] + args["radius"] * v[2] - shakes)[None]


STILL = {"tilt": 0.0, "inertia": 1.0, "radius": 0.0, "speed": 0.0, "rate": 20.0}


def moved(mu, args, duration, position, velocity, **how):
    """Return a run of the body on the plane."""
    parts = {"law": LAW, "stiffness": STIFFNESS, "friction": jc.RigidCoulomb(mu), "slip": slip}
    start = {"position": position, "velocity": velocity, "args": args}
    system = jc.System(mass, force, plane, **parts)
    return jc.simulate(system, duration, **start, **{"rtol": RTOL, "v0": 0.05} | how)


def rested(tilt):
    """Return the position at the static depth."""
    return [0.0, -((G * np.cos(tilt) / STIFFNESS) ** (2 / 3)), 0.0]


def assert_phases(run, times, directions, **tolerance):
    np.testing.assert_array_equal(run.phases.direction, directions)
    np.testing.assert_allclose(run.phases.time, times, **tolerance)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_block_slides_on_a_plane_steeper_than_mu(part):
    mu, duration = 0.3, 0.5
    tilt = part * np.arctan(mu)
    run = moved(mu, STILL | {"tilt": tilt}, duration, rested(tilt), [0.0, 0.0, 0.0])
    pull = max(G * (np.sin(tilt) - mu * np.cos(tilt)), 0)
    np.testing.assert_allclose(run.final.velocity[0], pull * duration, rtol=1e-10)
    np.testing.assert_allclose(run.final.position[0], pull * duration**2 / 2, rtol=1e-10)
    assert_phases(run, [0], [0 if part < 1 else 1])
    # Weight and friction do all the work.
    np.testing.assert_allclose(run.states.work[-1], (pull * duration) ** 2 / 2, atol=1e-12)
    assert run.margin.painleve == (jnp.inf if part < 1 else 1)


def test_disc_thrown_forwards_begins_to_roll():
    """The slip speed falls by 3 μ g: μ g of the centre and 2 μ g of the rim."""
    mu, speed, radius = 0.3, 1.0, 0.1
    args = STILL | {"radius": radius, "inertia": radius**2 / 2}
    run = moved(mu, args, 0.5, rested(0.0), [speed, 0.0, 0.0])
    assert_phases(run, [0, speed / (3 * mu * G)], [1, 0], rtol=EVENTS)
    velocity = np.asarray(run.final.velocity)
    np.testing.assert_allclose(velocity[[0, 2]], [2 / 3, -2 / 3 / radius], rtol=1e-9)


def assert_same_phases(run, found, end, duration, tolerance=EVENTS):
    times, directions = zip(*found, strict=True)
    assert_phases(run, times, directions, atol=tolerance * duration)
    got = run.final.position, run.final.velocity
    for part, expected in zip(got, np.split(end, 2), strict=True):
        atol = 100 * tolerance * np.max(np.abs(expected))
        np.testing.assert_allclose(part, expected, atol=atol)


SHAKEN = STILL | {"tilt": 0.1, "speed": 0.15, "rate": 30.0}
FALLING = {"position": [0.0, 0.0, 0.0], "velocity": [0.02, -0.05, 0.0], "duration": 0.6}


def test_block_on_a_shaken_incline_is_that_of_scipy():
    """The block falls onto the plane and its normal force swings: it sticks and slips both ways."""
    mu = 0.35
    run = moved(mu, SHAKEN, **FALLING, times=np.linspace(0, 0.6, 121))
    weight = G * np.array([np.sin(SHAKEN["tilt"]), -np.cos(SHAKEN["tilt"]), 0])
    start = np.array(FALLING["position"]), np.array(FALLING["velocity"])
    touches, found, end = restarted(
        lambda t, q: np.eye(3),
        lambda t, q, v: weight,
        lambda t, q: q[1:2],
        start, 0.6, STIFFNESS, ALPHA, mu=mu, touching=True,
        slip=lambda t, q, v: v[0] - SHAKEN["speed"] * np.cos(SHAKEN["rate"] * t),
    )  # fmt: skip
    assert {what for _, what in found[1:]} == {-1, 0, 1}
    assert len(touches) == 1 and len(found) > 11
    assert_same_phases(run, found, end, 0.6)
    # In stick the slip speed stays at rounding and tolerance.
    times, directions = map(np.asarray, (run.phases.time, run.phases.direction))
    at = np.asarray(run.states.time)
    sticks = directions[np.searchsorted(times, at, side="right") - 1] == 0
    speeds = np.asarray(run.states.velocity)[:, 0] - 0.15 * np.cos(30 * at)
    assert 10 < np.sum(sticks) < 110
    assert np.max(np.abs(speeds[sticks])) < DRIFT
    # Kinetic and stored energy change by the work less the losses of the contact.
    gained, work = (float(x[-1] - x[0]) for x in (run.states.energy, run.states.work))
    assert abs(gained - work + float(jnp.sum(run.contacts.energy_loss))) < 10 * RTOL


def test_crank_with_a_dry_joint_is_that_of_scipy():
    """The journal slides in the bearing, turns back and sticks."""
    mu, duration, c = 0.3, 1.2e-3, 0.5e-3
    system, start = jc.systems.slider_crank(clearance=c, friction=jc.RigidCoulomb(mu))
    run = jc.simulate(system, duration, **start, rtol=1e-11, v0="touch")
    (crank, rod), (heavy, slider), bearing = (0.05, 0.12), (0.21, 0.14), 10e-3
    inertia, speed = 2.5e-4, 523.5987755982989

    def journal(t, q):
        x = q[1] - crank * np.cos(speed * t) - rod * np.cos(q[0])
        return x, -crank * np.sin(speed * t) - rod * np.sin(q[0])

    def gap(t, q):
        x, y = journal(t, q)
        return c - np.sqrt(np.stack([x**2 + y**2]))

    def drive(t, q, v):
        return np.array([heavy * crank * rod / 2 * speed**2 * np.sin(speed * t - q[0]), 0.0])

    def slides(t, q, v):
        x, y = journal(t, q)
        away, turn = np.sqrt(x**2 + y**2), speed * t
        pin_x = -crank * speed * np.sin(turn) - rod * v[0] * np.sin(q[0])
        pin_y = crank * speed * np.cos(turn) + rod * v[0] * np.cos(q[0])
        return (-(v[1] - pin_x) * y - pin_y * x) / away - bearing * v[0]

    matrix = np.diag([inertia + heavy * rod**2 / 4, slider])
    first = np.array([0.0, crank + rod]), np.array([-speed * crank / rod, 0.0])
    how = {"stiffness": 6.6101984e10, "alpha": ALPHA, "slip": slides, "mu": mu}
    touches, found, end = restarted(lambda t, q: matrix, drive, gap, first, duration, **how)
    assert 0 in [what for _, what in found]
    assert_same_phases(run, found, end, duration, CRANK)
    times = [t for _, t, _ in touches]
    np.testing.assert_allclose(run.contacts.time, times, atol=CRANK * duration)


def outcome(vector):
    """Return times of phases and the end of a run in which the block sticks and slips."""
    mu, tilt, speed, rate, sideways = vector
    args = SHAKEN | {"tilt": tilt, "speed": speed, "rate": rate}
    velocity = jnp.stack([sideways, jnp.full_like(mu, -0.05), jnp.zeros_like(mu)])
    run = moved(mu, args, 0.3, [0.0, 0.0, 0.0], velocity, rtol=1e-11, max_impacts=16)
    times, ends = run.phases.time[1:6], [run.final.position, run.final.velocity]
    return jnp.concatenate([times, *ends, run.states.work[1:]]), times


def test_both_modes_are_differences():
    vector = np.array([0.35, 0.1, 0.15, 30.0, 0.02])
    times = check_modes(jax.jit(outcome), vector, vector, 2e-5, DIFFERENCES)
    assert np.all(np.diff(times) > 0)


def test_shaken_incline_turns_where_its_slip_is_zero():
    tilt, (amplitude, rate), mu = 0.1, (5e-3, 30.0), 0.3
    system, start = jc.systems.shaken_incline(tilt, (amplitude, rate), friction=jc.RigidCoulomb(mu))
    run = jc.simulate(system, 0.1, **start, rtol=RTOL, v0=0.1)
    gains = G * (np.sin(tilt) + mu * np.cos(tilt))
    turn = brentq(lambda t: gains * t - amplitude * rate * np.cos(rate * t), 0, 0.05, xtol=1e-15)
    assert_phases(run, [0, turn], [-1, 1], atol=EVENTS * 0.1)


def test_rods_whose_ends_both_stick_are_named():
    """Both friction forces hold the same motion."""
    system, start = jc.systems.bouncing_rod(friction=jc.RigidCoulomb(0.5), height=0.1, angle=0.0)
    run = jc.simulate(system, 0.3, **start, v0=0.1, throw=False)
    assert run.status == jc.Ending.REDUNDANT_STICKING
    assert float(run.reached) == pytest.approx(np.sqrt(2 * 0.09 / G), rel=1e-9)
    with pytest.raises(jc.NumericalError, match=r"REDUNDANT_STICKING\. .*Remove a gap"):
        jc.simulate(system, 0.3, **start, v0=0.1)


@pytest.mark.parametrize("mu", [1.2, 2.0])
def test_painleve_rod_is_flagged(mu):
    """J_n M⁻¹ (J_n - μ J_t)ᵀ m = 1 + 3 cos φ (cos φ - μ sin φ) for the end of a rod, which leans
    forwards as it slides; it is negative for some angles if μ > 4/3.
    """
    radius, angle = 1e-6, 0.7
    system, start = jc.systems.bouncing_rod(
        radius=radius, friction=jc.RigidCoulomb(mu), height=0.1 * np.sin(angle) + radius,
        angle=angle, law=jc.HuGuo(e=0.2),
    )  # fmt: skip
    start = start | {"velocity": [-2.0, 0.0, 0.0]}
    run = jc.simulate(system, 2e-4, **start, v0=0.1)
    assert run.ok and len(run.contacts) >= 1
    angle = float(run.at(run.contacts.time[0]).position[0, 2])
    cosine, sine = np.cos(angle), np.sin(angle)
    expected = (1 + 3 * cosine * (cosine - mu * sine)) / (1 + 3 * cosine**2)
    np.testing.assert_allclose(run.margin.painleve, expected, rtol=1e-3)
    assert ("painleve" in repr(run)) == (mu > 4 / 3) == (run.margin.painleve <= 0)
