"""What contacts inside of any engine must do: the height of a rebound, and its derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.test_impact.support import both_jacobians

HERTZ = jc.Contact(mass=0.5, stiffness=1e6)
LINEAR = jc.Contact(mass=0.5, stiffness=1e5, exponent=1)
GRAVITY, STEP = 9.81, 1e-3

ERROR = 0.01  # of e, which the time step is chosen for

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


# Below `moved(law, contact, step, height, speed)` returns the height and the vertical velocity of a
# ball of 0.5 kg at the end of a fall at a speed.


def require_restitution(moved, laws):
    """Check the e of laws at the step that `time_step` states, at speeds and parts of a step."""
    lanes = [(law, v, phase) for law in laws for v in (0.5, 1.0, 3.0) for phase in (0.1, 0.6)]
    steps = [jc.mjx.time_step(law, HERTZ, v, error=ERROR) for law, v, _ in lanes]
    every = jax.tree.map(lambda *x: jnp.stack(x), *[law for law, *_ in lanes])
    v, phase = (jnp.array([lane[k] for lane in lanes]) for k in (1, 2))

    def e_of(law, step, v, phase):
        return moved(law, HERTZ, step, phase * v * step, v)[1] / v

    e = jax.jit(jax.vmap(e_of))(every, jnp.array(steps), v, phase)
    expected = [jc.restitution(law, HERTZ, v) for law, v, _ in lanes]
    np.testing.assert_allclose(e, jnp.array(expected), rtol=ERROR)


def require_derivatives(moved, fall):
    """Check the height after a fall at 1 m/s from a height, by e and stiffness."""

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
