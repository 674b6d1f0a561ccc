"""Runs whose law adds energy are flagged, as `impact` flags them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc


class Driven(jc.AbstractLaw):
    """A law that adds energy for a positive `gain` in s/m."""

    gain: jax.Array
    tension: bool = False

    def force(self, indentation, velocity, contact, impact_velocity):
        return contact.stiffness * indentation**1.5 * (1 - self.gain * velocity)


def run(gain, **how):
    balls = [jc.Sphere(0.1, 1.0, position=[0.3 * k], velocity=[1.0 - k]) for k in (0, 1)]
    scene = jc.Scene(balls, Driven(jnp.asarray(gain)), stiffness=1e5)
    return jc.simulate(scene, 0.5, progress=False, **how)


@pytest.mark.parametrize("instantaneous", [True, False])
def test_a_run_that_gains_energy_is_flagged(instantaneous):
    how = {"instantaneous": instantaneous, "throw": False}
    # A millionth of the energy is more than the error of the impact, and a loss is none.
    for gain, status in (
        (0.1, "GAINED"),
        (1e-6, "GAINED"),
        (0.0, "COMPLETED"),
        (-0.1, "COMPLETED"),
    ):
        found = run(gain, **how)
        assert jc.Ending(int(found.status)).name == status, gain
        assert bool(found.ok) == (status == "COMPLETED")
    # The values hold up to the end.
    gained = run(0.1, **how)
    assert gained.reached == 0.5 and np.isfinite(gained.position).all()
    np.testing.assert_allclose(gained.energy[0] - gained.energy[-1], gained.impacts.energy_loss[0])
    with pytest.raises(jc.NumericalError, match=r"`simulate` failed: GAINED\. An impact adds"):
        run(0.1, instantaneous=instantaneous)
