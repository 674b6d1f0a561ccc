"""Rigid Coulomb friction in mechanisms: stick and slip against formulas and restarted SciPy."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcontact as jc
from tests.test_system.test_derivatives import value_and_slopes

LAW, STIFFNESS, G = jc.HuGuo(e=0.9), 1e5, 9.81
ALPHA = 1.5 * 0.1 / 0.9
"""Hu & Guo (2015), equation 38: α = 3 (1 - e)/(2 e)."""

RTOL = 1e-9

EVENTS = 10 * RTOL
"""Of the duration: times of changes between stick and slip."""

CRANK = 1e-7
"""Of the duration: events of a crank, whose contacts amplify errors about a hundredfold."""

DRIFT = 1e-9
"""Of the speeds: the slip of contacts that stick."""

DIFFERENCES = 2e-6
"""Central differences of a run at rtol 1e-11 are right to about this, relative to the largest."""


def mass(t, q, args):
    return jnp.diag(jnp.stack([jnp.ones_like(t), jnp.ones_like(t), args["inertia"]]))


def force(t, q, v, args):
    tilt = args["tilt"]
    return G * jnp.stack([jnp.sin(tilt), -jnp.cos(tilt), jnp.zeros_like(t)])


def gap(t, q, args):
    return q[1:2]


def slip(t, q, v, args):
    """A body of the radius R on a plane that shakes along itself."""
    shakes = args["speed"] * jnp.cos(args["rate"] * t)
    return (v[0] + args["radius"] * v[2] - shakes)[None]


STILL = {"tilt": 0.0, "inertia": 1.0, "radius": 0.0, "speed": 0.0, "rate": 20.0}


def moved(mu, args, duration, position, velocity, **how):
    """Return a run of the body on the plane."""
    friction = jc.RigidCoulomb(mu)
    system = jc.System(mass, force, gap, law=LAW, stiffness=STIFFNESS, friction=friction, slip=slip)
    how = {"rtol": RTOL, "v0": 0.05} | how
    return jc.simulate(system, duration, position=position, velocity=velocity, args=args, **how)


def rested(tilt):
    """Return the position at the static depth."""
    return [0.0, -((G * np.cos(tilt) / STIFFNESS) ** (2 / 3)), 0.0]


def phases(run):
    keep = np.asarray(run.phases.valid)
    return np.asarray(run.phases.time)[keep], np.asarray(run.phases.direction)[keep]


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_block_slides_on_a_plane_steeper_than_mu(part):
    mu, duration = 0.3, 0.5
    tilt = part * np.arctan(mu)
    run = moved(mu, STILL | {"tilt": tilt}, duration, rested(tilt), [0.0, 0.0, 0.0])
    pull = max(G * (np.sin(tilt) - mu * np.cos(tilt)), 0)
    np.testing.assert_allclose(run.final.velocity[0], pull * duration, rtol=1e-10)
    np.testing.assert_allclose(run.final.position[0], pull * duration**2 / 2, rtol=1e-10)
    np.testing.assert_array_equal(phases(run)[1], [0 if part < 1 else 1])
    # Weight and friction do all the work.
    np.testing.assert_allclose(run.states.work[-1], (pull * duration) ** 2 / 2, atol=1e-12)
    assert run.margin.painleve == (jnp.inf if part < 1 else 1)


def test_block_thrown_upwards_stops_and_stays():
    mu, tilt, speed = 0.3, 0.2, -1.0
    run = moved(mu, STILL | {"tilt": tilt}, 0.5, rested(tilt), [speed, 0.0, 0.0])
    slows = G * (np.sin(tilt) + mu * np.cos(tilt))
    np.testing.assert_allclose(phases(run)[0], [0, -speed / slows], rtol=EVENTS)
    np.testing.assert_array_equal(phases(run)[1], [-1, 0])
    np.testing.assert_allclose(run.final.position[0], -(speed**2) / 2 / slows, rtol=1e-9)
    # Friction has taken what is left of the kinetic energy.
    climbs = G * np.sin(tilt) * speed**2 / 2 / slows
    lost = speed**2 / 2 - climbs
    np.testing.assert_allclose(run.states.work[-1] + climbs, -lost, rtol=1e-9)


def test_disc_thrown_forwards_begins_to_roll():
    """The slip speed falls by 3 μ g: μ g of the centre and 2 μ g of the rim."""
    mu, speed, radius = 0.3, 1.0, 0.1
    args = STILL | {"radius": radius, "inertia": radius**2 / 2}
    run = moved(mu, args, 0.5, rested(0.0), [speed, 0.0, 0.0])
    times, directions = phases(run)
    np.testing.assert_allclose(times, [0, speed / (3 * mu * G)], rtol=EVENTS)
    np.testing.assert_array_equal(directions, [1, 0])
    velocity = np.asarray(run.final.velocity)
    np.testing.assert_allclose(velocity[[0, 2]], [2 / 3, -2 / 3 / radius], rtol=1e-9)


def derivative(function, at, along):
    """Return the derivative of a function that is written with analytic operations."""
    step = 1e-30
    moved = [x + 1j * step * d for x, d in zip(at, along, strict=True)]
    return np.imag(function(*moved)) / step


def restarted(body, mu, stiffness, alpha, start, duration, touches_now=False):
    """Return changes (time, what) of one contact, by DOP853 restarted at each, and the end.

    `body` has the functions `mass`, `force`, `gap` and `slip` of numbers that may be complex. What
    happens is "touch", "open", 0 for stick, or the sign of the slip.
    """
    mass, force, gap, slip = body
    n = len(start[0])
    t, y = 0.0, np.concatenate(start)
    basis, still = np.eye(n), np.zeros(n)

    def forces(t, y):
        """Return M, drive, F, J_n, J_t and the slip speed."""
        q, v = y[:n], y[n:]
        normal = np.array([derivative(gap, (t, q), (0.0, e)) for e in basis])
        tangent = np.array([derivative(slip, (t, q, v), (0.0, still, e)) for e in basis])
        closing = -derivative(gap, (t, q), (1.0, v))
        depth = max(-gap(t, q), 0.0)
        pressed = stiffness * depth**1.5 * (1 + alpha * closing / speed) if closed else 0.0
        return force(t, q, v) + pressed * normal, pressed, tangent, slip(t, q, v), closing

    def held(t, y):
        """Return the friction with which the slip speed does not change."""
        drive, _, tangent, _, _ = forces(t, y)
        inverse = np.linalg.inv(mass(t, y[:n]))
        rate = derivative(slip, (t, y[:n], y[n:]), (1.0, y[n:], inverse @ drive))
        return -rate / (tangent @ inverse @ tangent)

    def right(t, y):
        drive, pressed, tangent, _, _ = forces(t, y)
        if closed:
            drive = drive + tangent * (held(t, y) if sign == 0 else -sign * mu * pressed)
        return np.concatenate([y[n:], np.linalg.solve(mass(t, y[:n]), drive)])

    def meets(t, y):
        return gap(t, y[:n])

    def changes(t, y):
        if not closed:
            return 1.0
        return sign * slip(t, y[:n], y[n:]) if sign else mu * forces(t, y)[1] - abs(held(t, y))

    meets.terminal = changes.terminal = True
    closed, sign, speed, log = touches_now, 1, 1.0, []
    if closed:
        speed, sign = forces(t, y)[4], np.sign(slip(0.0, *start))
        log = [(0.0, "touch"), (0.0, sign)]
    while t < duration:
        meets.direction = 1 if closed else -1
        changes.direction = -1
        # The first step that SciPy tries may be absurdly long.
        with np.errstate(all="ignore"):
            how = {"rtol": 1e-12, "atol": 1e-14, "max_step": duration / 20}
            end = solve_ivp(right, (t, duration), y, "DOP853", events=[meets, changes], **how)
        t, y = end.t[-1], end.y[:, -1]
        if len(end.t_events[0]):
            closed = not closed
            log.append((t, "touch" if closed else "open"))
            if closed:
                speed, sign = forces(t, y)[4], np.sign(slip(t, y[:n], y[n:]))
                log.append((t, sign))
        elif len(end.t_events[1]):
            hold = held(t, y)
            # After a change the event function is 0 up to rounding, on either side.
            slides = sign == 0 or abs(hold) > mu * forces(t, y)[1]
            sign = -np.sign(hold) if slides else 0
            log.append((t, sign))
    return log, y


def assert_same_phases(run, log, end, duration, tolerance=EVENTS):
    expected = [(t, what) for t, what in log if not isinstance(what, str)]
    times, directions = phases(run)
    np.testing.assert_array_equal(directions, [what for _, what in expected])
    np.testing.assert_allclose(times, [t for t, _ in expected], atol=tolerance * duration)
    n = len(end) // 2
    got = np.concatenate([run.final.position, run.final.velocity])
    for part in (slice(0, n), slice(n, None)):
        scale = np.max(np.abs(end[part]))
        np.testing.assert_allclose(got[part], end[part], atol=100 * tolerance * scale)


SHAKEN = STILL | {"tilt": 0.1, "speed": 0.15, "rate": 30.0}
FALLING = {"position": [0.0, 0.0, 0.0], "velocity": [0.02, -0.05, 0.0], "duration": 0.6}


def test_block_on_a_shaken_incline_is_that_of_scipy():
    """The block falls onto the plane and its normal force swings: it sticks and slips both ways."""
    mu = 0.35
    run = moved(mu, SHAKEN, **FALLING, times=np.linspace(0, 0.6, 121))

    def drive(t, q, v):
        return G * np.array([np.sin(SHAKEN["tilt"]), -np.cos(SHAKEN["tilt"]), 0])

    def slides(t, q, v):
        return v[0] - SHAKEN["speed"] * np.cos(SHAKEN["rate"] * t)

    body = (lambda t, q: np.eye(3), drive, lambda t, q: q[1], slides)
    start = np.array(FALLING["position"]), np.array(FALLING["velocity"])
    log, end = restarted(body, mu, STIFFNESS, ALPHA, start, 0.6, touches_now=True)
    assert {what for _, what in log[2:]} == {-1, 0, 1} and len(log) > 12
    assert_same_phases(run, log, end, 0.6)
    # In stick the slip speed stays at rounding and tolerance.
    times, directions = phases(run)
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
        return c - np.sqrt(x**2 + y**2)

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
    body = (lambda t, q: matrix, drive, gap, slides)
    log, end = restarted(body, mu, 6.6101984e10, 1.5 * 0.1 / 0.9, first, duration)
    assert len([what for _, what in log if what == 0]) > 0
    assert_same_phases(run, log, end, duration, CRANK)
    touches = [t for t, what in log if what == "touch"]
    np.testing.assert_allclose(run.contacts.time, touches, atol=CRANK * duration)


def outcome(vector):
    """Return times of phases and the end of a run in which the block sticks and slips."""
    mu, tilt, speed, rate, sideways = vector
    args = SHAKEN | {"tilt": tilt, "speed": speed, "rate": rate}
    velocity = jnp.stack([sideways, jnp.full_like(mu, -0.05), jnp.zeros_like(mu)])
    run = moved(mu, args, 0.3, [0.0, 0.0, 0.0], velocity, rtol=1e-11, max_impacts=16)
    return jnp.concatenate(
        [run.phases.time[1:6], run.final.position, run.final.velocity, run.states.work[1:]]
    )


def test_both_modes_are_differences():
    vector = jnp.array([0.35, 0.1, 0.15, 30.0, 0.02])
    weights = np.random.default_rng(0).normal(size=12)
    solve = value_and_slopes(outcome)
    base, forward, reverse = map(np.asarray, solve(vector, weights))
    assert np.all(np.isfinite(base)) and np.all(np.diff(base[:5]) > 0)
    np.testing.assert_allclose(reverse, weights @ forward, rtol=1e-9)
    for k in range(len(vector)):
        step = 2e-5 * float(vector[k])
        shift = np.zeros(len(vector))
        shift[k] = step
        high, low = (np.asarray(solve(vector + s * shift, weights)[0]) for s in (1, -1))
        slope = (high - low) / (2 * step)
        scale = np.max(np.abs(forward[:, k]))
        np.testing.assert_allclose(forward[:, k], slope, atol=DIFFERENCES * scale, err_msg=str(k))


def test_shaken_incline_turns_where_its_slip_is_zero():
    tilt, (amplitude, rate), mu = 0.1, (5e-3, 30.0), 0.3
    system, start = jc.systems.shaken_incline(tilt, (amplitude, rate), friction=jc.RigidCoulomb(mu))
    run = jc.simulate(system, 0.1, **start, rtol=RTOL, v0=0.1)
    gains = G * (np.sin(tilt) + mu * np.cos(tilt))
    turn = brentq(lambda t: gains * t - amplitude * rate * np.cos(rate * t), 0, 0.05, xtol=1e-15)
    np.testing.assert_allclose(phases(run)[0], [0, turn], atol=EVENTS * 0.1)
    np.testing.assert_array_equal(phases(run)[1], [-1, 1])


def test_rods_whose_ends_both_stick_are_named():
    """Both friction forces hold the same motion."""
    system, start = jc.systems.bouncing_rod(friction=jc.RigidCoulomb(0.5), height=0.1, angle=0.0)
    run = jc.simulate(system, 0.3, **start, throw=False)
    assert run.status == jc.Ending.REDUNDANT_STICKING
    assert float(run.reached) == pytest.approx(np.sqrt(2 * 0.09 / G), rel=1e-9)
    with pytest.raises(jc.NumericalError, match=r"REDUNDANT_STICKING\. .*Remove a gap"):
        jc.simulate(system, 0.3, **start)


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


def test_wrong_friction_is_named():
    parts = {"law": LAW, "stiffness": STIFFNESS, "slip": slip}
    for friction in (jc.WaltonFriction(0.3, 0.4), jc.MawBarberFawcett(0.3)):
        with pytest.raises(ValueError, match=f"{type(friction).__name__}.*outcome of an impact"):
            jc.System(mass, force, gap, friction=friction, **parts)
    parts["slip"] = lambda t, q, v, args: v[None, :2]
    system = jc.System(mass, force, gap, friction=jc.RigidCoulomb(0.3), **parts)
    with pytest.raises(ValueError, match=r"`slip` must return the shape \(1,\) with `RigidCou"):
        jc.simulate(system, 0.1, position=[0.0] * 3, velocity=[0.0] * 3, args=STILL)
