"""The derivative of a run that begins inside of a contact."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

STEP, DIFFERENCES = 1e-4, 1e-6
"""Of central differences, relative: measured 1e-8."""

AT_REST = 1e-8
"""Of places, speeds and work, beside statics; a solve whose end in time has a derivative of its own
is 1e-4 off."""

SPEED = 0.2


def _final(scale):
    """A ball on a lift, amid its contact, in which stiffness and speed vary together."""
    lift = jc.Plane([0.0], [1.0], motion=jc.Steady([SPEED * scale]))
    scene = jc.Scene(
        [jc.Sphere(0.1, 1.0, [0.11], [-0.5]), lift],
        jc.HuGuo(e=0.5),
        stiffness=1e6 * scale,
        gravity=[-9.81],
    )
    return jc.simulate(scene, 0.016).final


def _end(scene, duration):
    run = jc.simulate(scene, duration, max_impacts=8)
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.wall_work])


def test_derivatives_by_the_contact_that_a_run_begins_in():
    """All that a run goes on from varies, the indentation and v0 as well; to flight and to rest."""
    ends = [_final(1 + sign * STEP) for sign in (1, -1, 0)]
    parts = [eqx.partition(scene, eqx.is_inexact_array) for scene in ends]
    rest = parts[2][1]
    moves = jax.tree.map(lambda a, b: (a - b) / (2 * STEP), parts[0][0], parts[1][0])
    assert float(moves._start.contacts.state.indentation[0]) != 0

    @jax.jit
    def both(numbers, along, duration):
        return jax.jvp(lambda x: _end(eqx.combine(x, rest), duration), (numbers,), (along,))

    value, found = both(parts[2][0], moves, 0.03)
    # It is up again.
    assert float(value[1]) > SPEED + 0.05
    after = [both(numbers, moves, 0.03)[0] for numbers, _ in parts[:2]]
    np.testing.assert_allclose(found, (after[0] - after[1]) / (2 * STEP), rtol=DIFFERENCES)
    # It is carried: all that varies then is how high it is lifted, and how deep it sinks in.
    duration = 1.5
    value, found = both(parts[2][0], moves, duration)
    np.testing.assert_allclose(value[1], SPEED, atol=AT_REST)
    sinks = 2 / 3 * (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(found[0], SPEED * (0.016 + duration) + sinks, rtol=AT_REST)
    np.testing.assert_allclose(found[1], SPEED, rtol=AT_REST)
    start = [_end_of_first(1 + sign * STEP) for sign in (1, -1, 0)]
    slope = (start[0] - start[1]) / (2 * STEP)
    # Speed times the momentum that it gave and the weight, and what both vary by.
    gives = SPEED * (SPEED - start[2] + 9.81 * duration)
    np.testing.assert_allclose(value[2], gives, rtol=AT_REST)
    np.testing.assert_allclose(found[2], gives + SPEED * (SPEED - slope), rtol=1e-7)


def _end_of_first(scale):
    return float(_final(scale).spheres[0].velocity[0])
