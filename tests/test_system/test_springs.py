"""Tangential springs and sliders in mechanisms: a table of impacts, and restarted SciPy."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.test_friction.test_slider_phases import FORCE_FORM, NU_3
from tests.test_system.references import assert_slopes_are_differences, linearised

MU, STIFFNESS = 0.3, 1e7
KAPPA = 2 * NU_3 / 3.5  # of like spheres with ν = 0.3, whose slip has λ = 7/2
CLOSE = 1e-9  # of ψ2 at rtol 1e-11


def sphere(t, q, args):
    return jnp.diag(jnp.array([1.0, 1.0, 0.4]))


def plane(t, q, args):
    return q[1:2]


def slip(t, q, v, args):
    return (v[0] + v[2])[None]


def free(t, q, v, args):
    return jnp.zeros(3)


def outcome(vector):
    """Return the final velocity, phases, -1 where there is none, and the energy that is missing, of
    a sphere that hits a plane at 1 m/s with a slip speed.
    """
    mu, kappa, speed = vector
    friction = jc.SpringSlider(mu, ratio=kappa)
    system = jc.System(
        sphere, free, plane, law=jc.Hertz(), stiffness=STIFFNESS, friction=friction, slip=slip
    )
    start = {"position": [0.0, 1e-3, 0.0], "velocity": jnp.stack([speed, -1.0, 0.0])}
    run = jc.simulate(system, 0.02, **start, rtol=1e-11, max_impacts=8)
    lost = run.energy[-1] - run.energy[0] - run.states.work[-1]
    directions = jnp.where(run.phases.valid, run.phases.direction, -1)[:4].astype(float)
    return jnp.concatenate([run.final.velocity, run.phases.time[:3] / 1e-3, directions, lost[None]])


@pytest.mark.parametrize("psi", [0.25, 0.75, 1.25, 2.0, 3.5, 4.5])
def test_impacts_are_those_of_the_table(psi):
    found = linearised(outcome)(np.array([MU, KAPPA, psi * MU / KAPPA]))[0]
    velocity, _, directions, lost = np.split(np.asarray(found), [3, 6, 10])
    psi2 = (velocity[0] + velocity[2]) * KAPPA / MU
    np.testing.assert_allclose(psi2, FORCE_FORM[psi], atol=CLOSE)
    # Above ψ1 = 1 it slides first; every contact slides before it ends.
    np.testing.assert_array_equal(directions, [1, 0, 1, -1] if psi > 1 else [0, 1, -1, -1])
    assert abs(lost[0]) < 1e-9


def test_both_modes_are_differences():
    assert_slopes_are_differences(outcome, np.array([MU, KAPPA, 1.5 * MU / KAPPA]), 2e-5)


def restarted(start, pull, duration):
    """Return phases (time, slides) of a point in space from its touch, and its velocity within the
    contact, by DOP853. In slip the state has the angle of the force.
    """
    t, y, slides = 0.0, np.concatenate([start, [0.0, 0.0]]), False
    log = [(0.0, 0)]

    def parts(y):
        depth = max(-y[2], 0.0)
        k = 1.5 * KAPPA * STIFFNESS * depth**0.5
        return STIFFNESS * depth**1.5, -1.5 * STIFFNESS * depth**0.5 * y[5], k

    def right(t, y):
        force, _, k = parts(y)
        if slides:
            e = np.array([np.cos(y[6]), np.sin(y[6])])
            turn = -k * (e[0] * y[4] - e[1] * y[3]) / (MU * force)
            f, more = MU * force * e, [turn, 0.0]
        else:
            f, more = y[6:], -k * y[3:5]
        return np.concatenate([y[3:6], f + pull, [force], more])

    def changes(t, y):
        force, grows, k = parts(y)
        if slides:
            return -k * (np.cos(y[6]) * y[3] + np.sin(y[6]) * y[4]) - MU * grows
        return MU * force - np.hypot(*y[6:])

    changes.terminal, changes.direction = True, -1
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 1e-5}
    while t < duration:
        # Just after a change its function is zero.
        ahead = solve_ivp(right, (t, t + 1e-7), y, first_step=1e-8, **how)
        t, y = ahead.t[-1], ahead.y[:, -1]
        end = solve_ivp(right, (t, duration), y, first_step=1e-7, events=changes, **how)
        t, y = end.t[-1], end.y[:, -1].copy()
        if not len(end.t_events[0]):
            break
        force = parts(y)[0]
        y[6:] = (
            MU * force * np.array([np.cos(y[6]), np.sin(y[6])])
            if slides
            else [np.arctan2(y[7], y[6]), 0.0]
        )
        slides = not slides
        log.append((t, int(slides)))
    return log, y[3:6]


def test_slip_that_turns_in_space_is_that_of_scipy():
    """A push across the slip turns it while the point slides."""
    pull, velocity = np.array([-150.0, 400.0]), [0.25, 0.1, -1.0]
    friction = jc.SpringSlider(MU, ratio=KAPPA)
    system = jc.System(
        lambda t, q, args: jnp.eye(3),
        lambda t, q, v, args: jnp.array([*pull, 0.0]),
        lambda t, q, args: q[2:],
        law=jc.Hertz(),
        stiffness=STIFFNESS,
        friction=friction,
        slip=lambda t, q, v, args: v[None, :2],
    )
    within = 0.0048
    run = jc.simulate(system, within, position=[0.0] * 3, velocity=velocity, rtol=1e-11)
    log, end = restarted(np.array([0.0, 0.0, 0.0, *velocity]), pull, within)
    assert len(log) >= 2
    np.testing.assert_array_equal(run.phases.direction, [slides for _, slides in log])
    np.testing.assert_allclose(run.phases.time, [t for t, _ in log], atol=CLOSE * within)
    np.testing.assert_allclose(run.final.velocity, end, atol=CLOSE)
