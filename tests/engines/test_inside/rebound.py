"""What contacts inside of any engine must do: the height of a rebound, and its derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.test_impact.support import both_jacobians

GRAVITY, STEP = 9.81, 1e-3

DIFFERENCES = 1e-4  # of derivatives from central differences, over the height: 5e-9 measured
CONVERGED = 0.01
"""Of height and derivatives from those of one impact under gravity: 2e-3 and 6e-3 measured."""


def after(acting, engine, data, steps):
    """The state of an engine after so many steps, by one program."""

    @jax.jit
    def end(data):
        def advance(state, _):
            return acting.step(engine, *state), None

        return jax.lax.scan(advance, (data, acting.init(engine, data)), length=steps)[0][0]

    return end(data)


def require_derivatives(moved, fall):
    """Check the height of a ball of 0.5 kg that falls at 1 m/s from a height, by e and stiffness.

    `moved(law, contact, step, height, speed)` returns height and vertical velocity at the end.
    """

    def law_and_contact(x):
        return jc.HuGuo(e=0.8 * (1 + x[0])), jc.Contact(0.5, 1e6 * (1 + x[1]))

    def height(x):
        z, v = moved(*law_and_contact(x), STEP, fall, 1 - GRAVITY * STEP / 2)
        # Velocities of the semi-implicit steps are half a step old.
        return z + (v - GRAVITY * STEP / 2) ** 2 / (2 * GRAVITY)

    def expected(x):
        law, contact = law_and_contact(x)
        fallen = jnp.sqrt(1 + 2 * GRAVITY * fall)
        hit = jc.impact(law, contact, fallen, external_force=GRAVITY * contact.mass)
        return hit.rebound_velocity**2 / (2 * GRAVITY)

    small = 1e-5
    shifts = small * jnp.array([[1.0, 0], [-1, 0], [0, 1], [0, -1], [0, 0]])
    heights, ahead, back = jax.jit(jax.vmap(partial(both_jacobians, height)))(shifts)
    differences = (heights[0:4:2] - heights[1:4:2]) / (2 * small)
    np.testing.assert_allclose(ahead[4], differences, atol=DIFFERENCES * heights[4])
    np.testing.assert_allclose(back[4], ahead[4], rtol=1e-9, atol=1e-12)
    truth, wanted = jax.jacfwd(lambda x: 2 * (expected(x),), has_aux=True)(jnp.zeros(2))
    np.testing.assert_allclose(heights[4], wanted, rtol=CONVERGED)
    np.testing.assert_allclose(ahead[4], truth, atol=CONVERGED * float(truth[0]))
