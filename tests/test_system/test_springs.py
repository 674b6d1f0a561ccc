"""Tangential springs and sliders in mechanisms: a table of impacts, and restarted SciPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import RubbingSpheres
from tests.test_friction.test_slider_phases import FORCE_FORM, NU_3
from tests.test_scene.support import check_modes
from tests.test_system.references import DIFFERENCES, plane

MU, STIFFNESS = 0.3, 1e7
KAPPA = 2 * NU_3 / 3.5  # of like spheres with ν = 0.3, whose slip has λ = 7/2
CLOSE = 1e-9  # of ψ2 at rtol 1e-11


def sphere(t, q, args):
    return jnp.diag(jnp.array([1.0, 1.0, 0.4]))


def slip(t, q, v, args):
    return (v[0] + v[2])[None]


def free(t, q, v, args):
    return jnp.zeros(3)


@jax.jit
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
    found = outcome(np.array([MU, KAPPA, psi * MU / KAPPA]))
    velocity, _, directions, lost = np.split(np.asarray(found), [3, 6, 10])
    psi2 = (velocity[0] + velocity[2]) * KAPPA / MU
    np.testing.assert_allclose(psi2, FORCE_FORM[psi], atol=CLOSE)
    # Above ψ1 = 1 it slides first; every contact slides before it ends.
    np.testing.assert_array_equal(directions, [1, 0, 1, -1] if psi > 1 else [0, 1, -1, -1])
    assert abs(lost[0]) < 1e-9


def test_both_modes_are_differences():
    numbers = np.array([MU, KAPPA, 1.5 * MU / KAPPA])
    check_modes(lambda numbers: (outcome(numbers), None), numbers, numbers, 2e-5, DIFFERENCES)


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
    # A sphere that touches a plane and cannot turn.
    one, plane, push = np.ones(1), ([0.0, 0.0, 1.0], 0.0, [0.0] * 3), np.array([*pull, 0.0])
    point = RubbingSpheres(one, one, 1e300 * one, push, STIFFNESS, 0.0, MU, KAPPA, (plane,))
    end, _, changes = point.run([[0.0, 0.0, 1.0]], [velocity], [[0.0] * 3], within)[1:]
    assert changes >= 2
    np.testing.assert_array_equal(run.phases.direction, np.arange(changes) % 2)
    np.testing.assert_allclose(run.final.velocity, end[0], atol=CLOSE)
