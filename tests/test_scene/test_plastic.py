"""Scenes whose contacts remember their largest indentation."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.pair_impact.oblique import oblique
from tests.oracle.plastic_chain import follow, thornton, walton_braun

BY_SCIPY = 5e-10
"""Of velocities at rtol 1e-10 beside steps at 1e-12: measured 4e-11."""
SLOPES = 1e-5
"""Beside central differences of SciPy with h = 1e-4: measured 2e-6."""
BALANCE = 1e-9
"""Of energies at rtol 1e-10: measured 1e-11."""

RADIUS, MASS = 0.01, 0.03
MASSES = MASS * np.array([1, 0.05, 0.2, 1])


def chain(law, stiffness, exponent, speed=2.0):
    """Four balls that touch; a light one between heavy ones is pressed several times."""
    speeds = [speed, 0.0, 0.0, 0.0]
    balls = [
        jc.Sphere(radius=RADIUS, mass=MASSES[k], position=(2 * RADIUS * k,), velocity=(speeds[k],))
        for k in range(4)
    ]
    return jc.Scene(bodies=balls, law=law, stiffness=stiffness, exponent=exponent)


def reduced(k):
    return MASSES[k] * MASSES[k + 1] / (MASSES[k] + MASSES[k + 1])


def by_scipy(contacts, speed=2.0):
    return follow(contacts, MASSES, np.zeros(3), [speed, 0.0, 0.0, 0.0], 0.003)


@functools.cache
def yielding():
    """Velocities and their derivatives by yield speed and speed, in forward mode."""

    def velocities(yields, speed):
        law = jc.Viscoplastic(yield_speed=yields, c=2e7)
        run = jc.simulate(chain(law, 2e8, 1.5, speed), 0.003, rtol=1e-10)
        return run.velocity[-1].ravel(), run.velocity[-1].ravel()

    return jax.jacfwd(velocities, argnums=(0, 1), has_aux=True)(0.3, 2.0)


def test_yielding_balls_in_contact_together():
    """Beside SciPy, which starts anew at each touch, turn, reload and opening."""
    contacts = [thornton(reduced(k), 2e8, 0.3, 2e7) for k in range(3)]
    found = by_scipy(contacts)
    assert np.sum(found.reloads) > 0
    np.testing.assert_allclose(yielding()[1], found.velocity, atol=BY_SCIPY)


def test_derivatives_across_yield_turns_and_reloads():
    by_yield, by_speed = yielding()[0]
    h = 1e-4
    ends = [
        by_scipy([thornton(reduced(k), 2e8, 0.3 + sign * h, 2e7) for k in range(3)]).velocity
        for sign in (1, -1)
    ]
    np.testing.assert_allclose(by_yield, (ends[0] - ends[1]) / (2 * h), atol=SLOPES)
    contacts = [thornton(reduced(k), 2e8, 0.3, 2e7) for k in range(3)]
    ends = [by_scipy(contacts, 2.0 + sign * h).velocity for sign in (1, -1)]
    np.testing.assert_allclose(by_speed, (ends[0] - ends[1]) / (2 * h), atol=SLOPES)


@functools.cache
def bilinear():
    law = jc.WaltonBraun(ratio=1.2, slope=3e2)
    times = jnp.linspace(0, 0.003, 31)
    return jc.simulate(chain(law, 2e6, 1.0), 0.003, rtol=1e-10, times=times)


def test_bilinear_balls_in_contact_together():
    run = bilinear()
    found = by_scipy([walton_braun(2e6, 1.2, 3e2)] * 3)
    assert np.sum(found.reloads) > 0
    np.testing.assert_allclose(run.velocity[-1].ravel(), found.velocity, atol=BY_SCIPY)
    np.testing.assert_allclose(np.sum(run.impacts.energy_loss), run.energy[0] - run.energy[-1])


def test_energy_only_falls_where_contacts_unload():
    """Until a contact unloads, all work of loading counts as stored."""
    assert np.all(np.diff(bilinear().energy) < BALANCE)


ISOLATED = jc.ThorntonPlastic(yield_speed=0.3), jc.Contact(mass=0.3, stiffness=2e8, exponent=1.5)


@pytest.mark.parametrize("pull", [0.0, 3.0, -300.0])
def test_an_isolated_impact_under_a_push(pull):
    """The radial problem beside the event solve of one impact, until the force ends."""
    rebound = pushed()(jnp.asarray(pull))
    hit = jc.impact(*ISOLATED, 2.0, external_force=pull, method="event")
    for name in ("duration", "max_force", "max_indentation"):
        np.testing.assert_allclose(getattr(rebound, name), getattr(hit, name), rtol=1e-8)
    np.testing.assert_allclose(rebound.energy_loss, hit.energy_loss, rtol=1e-8)


@functools.cache
def pushed():
    speeds = (jnp.asarray(number) for number in (2.0, 0.0, jnp.inf))
    return jax.jit(functools.partial(oblique, *ISOLATED, *speeds, rtol=1e-10))


def test_a_bouncing_ball_of_metal():
    """Each e is that of the impact at its speed, as gravity changes it little; the ball goes on to
    the end, although its impacts become elastic.
    """
    law = jc.ThorntonPlastic(yield_speed=0.05)
    ball = jc.Sphere(radius=RADIUS, mass=MASS, position=(0.05,), velocity=(0.0,))
    wall = jc.Plane(point=(0.0,), normal=(1.0,))
    scene = jc.Scene(bodies=[ball, wall], law=law, stiffness=2e8, exponent=1.5, gravity=(-9.81,))
    run = jc.simulate(scene, 0.5, rtol=1e-9)
    assert run.ok
    np.testing.assert_allclose(
        run.impacts.restitution, law.restitution_at(run.impacts.closing_speed), rtol=2e-2
    )
    np.testing.assert_allclose(
        run.energy[0] - run.energy[-1], np.sum(run.impacts.energy_loss), rtol=1e-8
    )


def test_laws_with_and_without_a_memory_in_one_scene():
    """Three balls that touch, of which two are of lead."""
    law = jc.ThorntonPlastic(yield_speed=0.3)
    balls = [
        jc.Sphere(
            radius=RADIUS,
            mass=MASS,
            position=(2 * RADIUS * k,),
            velocity=(2.0 * (k == 0),),
            name=name,
        )
        for k, name in enumerate(["lead", "lead", "steel"])
    ]
    laws = {("lead", "lead"): law, "default": jc.Hertz()}
    scene = jc.Scene(bodies=balls, law=laws, stiffness=2e8, exponent=1.5)
    found = follow(
        [thornton(MASS / 2, 2e8, 0.3), thornton(MASS / 2, 2e8, 1e3)],
        [MASS] * 3, [0.0, 0.0], [2.0, 0.0, 0.0], 0.003,
    )  # fmt: skip
    run = jc.simulate(scene, 0.003, rtol=1e-10)
    np.testing.assert_allclose(run.velocity[-1].ravel(), found.velocity, atol=BY_SCIPY)
    lost = np.sum(run.impacts.energy_loss)
    np.testing.assert_allclose(run.energy[0] - run.energy[-1], lost, rtol=BALANCE)


def test_a_run_that_cuts_an_unloading_impact_does_not_invent_its_loss():
    """Until the turn nothing is lost; from then on the part of the loss is not known."""
    balls = [
        jc.Sphere(radius=RADIUS, mass=MASS, position=(0.0, 0.0), velocity=(2.0, 0.0)),
        jc.Sphere(radius=RADIUS, mass=MASS, position=(0.0201, 0.002), velocity=(0.0, 0.0)),
    ]
    law = jc.ThorntonPlastic(yield_speed=0.1)
    scene = jc.Scene(bodies=balls, law=law, stiffness=2e8, exponent=1.5)
    # The touch is at .1001 ms, the turn at .28 ms, and the end at .3956 ms.
    loads, unloads = (jc.simulate(scene, time, rtol=1e-10) for time in (0.0002, 0.0003375))
    np.testing.assert_allclose(loads.energy[-1], 0.06, rtol=BALANCE)
    np.testing.assert_allclose(loads.impacts.energy_loss, 0, atol=BALANCE)
    assert np.isnan(unloads.impacts.energy_loss[0])
