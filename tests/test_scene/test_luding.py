"""Scenes of Luding's contacts, whose memory may shrink."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.oracle.luding_chain import Powder, follow

BY_SCIPY = 1e-9
"""Of velocities in m/s at rtol 1e-10 beside steps at 1e-12: measured 8e-11."""
SLOPES = 1e-4
"""Beside central differences of SciPy with h = 1e-4: measured 5e-6."""

STIFFNESS, RADIUS, MASSES, GAPS, LASTS = 1e5, 0.05, [1.0, 0.3, 2.0], [1e-3, 5e-4], 0.05
RATIO, SLOPE, ADHESION, SPEED = 6.0, 200.0, 0.9, 0.8


def by_scipy(adhesion=ADHESION, speed=SPEED):
    powder = Powder(STIFFNESS, RATIO, SLOPE, adhesion)
    return follow([powder] * 2, MASSES, GAPS, [speed, 0.0, 0.0], LASTS)


@functools.cache
def three_balls():
    """Velocities, energies and losses, with derivatives by adhesion and speed."""
    places = np.cumsum([0.0, *(2 * RADIUS + gap for gap in GAPS)])

    def velocities(adhesion, speed):
        balls = [
            jc.Sphere(
                radius=RADIUS,
                mass=MASSES[k],
                position=(places[k],),
                velocity=(0.0 if k else speed,),
            )
            for k in range(3)
        ]
        law = jc.Luding(ratio=RATIO, slope=SLOPE, adhesion=adhesion)
        scene = jc.Scene(bodies=balls, law=law, stiffness=STIFFNESS, exponent=1.0)
        times = jnp.linspace(0, LASTS, 21)
        run = jc.simulate(scene, LASTS, rtol=1e-10, times=times)
        found = run.velocity[-1].ravel()
        return found, (found, run.energy, run.impacts.energy_loss)

    return jax.jacfwd(velocities, argnums=(0, 1), has_aux=True)(ADHESION, SPEED)


def test_balls_that_stick_together():
    found = by_scipy()
    assert found.shrunk > 1
    velocity, energy, lost = three_balls()[1]
    np.testing.assert_allclose(velocity, found.velocity, atol=BY_SCIPY)
    assert np.all(np.diff(energy) < 1e-12)
    np.testing.assert_allclose(energy[0] - energy[-1], np.nansum(lost), rtol=1e-10)


def test_derivatives_across_a_memory_that_shrinks():
    by_adhesion, by_speed = three_balls()[0]
    h = 1e-4
    for slope, ends in (
        (by_adhesion, [by_scipy(adhesion=ADHESION + sign * h).velocity for sign in (1, -1)]),
        (by_speed, [by_scipy(speed=SPEED + sign * h).velocity for sign in (1, -1)]),
    ):
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * h), atol=SLOPES)
