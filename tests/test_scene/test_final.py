"""The derivative of a run that begins inside of a contact."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

STEP, DIFFERENCES = 1e-4, 1e-6
"""Of central differences, relative: measured 1e-8."""


def _final(stiffness):
    """A ball on a floor, amid its contact."""
    scene = jc.Scene(
        [jc.Sphere(0.1, 1.0, [0.11], [-0.5]), jc.Plane([0.0], [1.0])],
        jc.HuGuo(e=0.5),
        stiffness=stiffness,
        gravity=[-9.81],
    )
    return jc.simulate(scene, 0.022).final


def _end(scene):
    run = jc.simulate(scene, 0.03, max_impacts=2)
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0]])


def test_the_derivative_by_the_contact_that_a_run_begins_in():
    """All that a run goes on from varies with the stiffness, the indentation and v0 as well."""
    ends = [_final(1e6 * (1 + sign * STEP)) for sign in (1, -1, 0)]
    parts = [eqx.partition(scene, eqx.is_inexact_array) for scene in ends]
    rest = parts[2][1]
    moves = jax.tree.map(lambda a, b: (a - b) / (2 * STEP), parts[0][0], parts[1][0])
    assert float(moves._start.contacts.state.indentation[0]) != 0

    @jax.jit
    def both(numbers, along):
        return jax.jvp(lambda x: _end(eqx.combine(x, rest)), (numbers,), (along,))

    value, found = both(parts[2][0], moves)
    # It is up again.
    assert float(value[1]) > 0.05
    after = [both(numbers, moves)[0] for numbers, _ in parts[:2]]
    np.testing.assert_allclose(found, (after[0] - after[1]) / (2 * STEP), rtol=DIFFERENCES)
