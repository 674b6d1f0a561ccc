"""Scenes whose contacts remember their largest indentation."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.pair_impact.oblique import oblique
from tests.test_scene.support import missing, spheres

BALANCE = 1e-9
"""Of energies at rtol 1e-10: measured 1e-11."""

RADIUS, MASS, STIFFNESS, SPEED = 0.01, 0.03, 2e8, 2.0
ISOLATED = jc.ThorntonPlastic(yield_speed=0.3), jc.Contact(mass=0.3, stiffness=STIFFNESS)


@pytest.fixture(scope="module")
def pushed():
    """One program for all pushes."""
    speeds = map(jnp.asarray, (SPEED, 0.0, jnp.inf))
    return jax.jit(functools.partial(oblique, *ISOLATED, *speeds, rtol=1e-10))


@pytest.mark.parametrize("pull", [0.0, 3.0, -300.0])
def test_an_isolated_impact_under_a_push(pull, pushed):
    """The radial problem beside the event solve of one impact, until the force ends."""
    rebound = pushed(jnp.asarray(pull))
    hit = jc.impact(*ISOLATED, SPEED, external_force=pull, method="event")
    for name in ("duration", "max_force", "max_indentation", "energy_loss"):
        np.testing.assert_allclose(getattr(rebound, name), getattr(hit, name), rtol=1e-8)


def above_a_floor(yield_speed, place, speed, gravity):
    """Two discs above a floor, one of them or the floor far away. All runs share their programs."""
    law = jc.ThorntonPlastic(yield_speed=yield_speed)
    bodies = [*spheres(RADIUS, MASS, place, speed), jc.Plane([0.0, 0.0], [0.0, 1.0])]
    return jc.Scene(bodies, law, stiffness=STIFFNESS, gravity=[0.0, -gravity]), law


def test_a_bouncing_ball_of_metal():
    """Each e is that of the impact at its speed, as gravity changes it little; the ball goes on to
    the end, although its impacts become elastic.
    """
    scene, law = above_a_floor(0.05, [(0.0, 0.05), (0.0, 9.0)], np.zeros((2, 2)), 9.81)
    run = jc.simulate(scene, 0.5, rtol=1e-9)
    assert run.ok
    known = law.restitution_at(run.impacts.closing_speed)
    np.testing.assert_allclose(run.impacts.restitution, known, rtol=2e-2)
    assert missing(run) < 1e-8 * np.sum(run.impacts.energy_loss)


def test_a_run_that_cuts_an_unloading_impact_does_not_invent_its_loss():
    """Until the turn nothing is lost; from then on the part of the loss is not known."""
    place, speed = [(0.0, 1.0), (0.0201, 1.002)], [(SPEED, 0.0), (0.0, 0.0)]
    scene, _ = above_a_floor(0.1, place, speed, 0.0)
    # The touch is at .1001 ms, the turn at .28 ms, and the end at .3956 ms.
    loads, unloads = (jc.simulate(scene, time, rtol=1e-10) for time in (0.0002, 0.0003375))
    np.testing.assert_allclose(loads.energy[-1], 0.06, rtol=BALANCE)
    np.testing.assert_allclose(loads.impacts.energy_loss, 0, atol=BALANCE)
    assert np.isnan(unloads.impacts.energy_loss[0])
