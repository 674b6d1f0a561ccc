"""Runs that begin inside contacts: they continue like one run, as do their derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import central, missing

STEP, DIFFERENCES = 1e-4, 1e-6
"""Of central differences, relative: measured 1e-8."""

AT_REST = 1e-8
"""Of places, speeds and work, beside statics."""

SLOPES_AT_REST = 1e-7
"""Of their derivatives: measured 2e-8. A solve whose end in time has a derivative of its own is
1e-4 off."""

GOES_ON = 1e-10
"""Of a run in two parts, relative."""

BRIEFLY, BY_DURATION = 1e-6, 1e-6
"""In s, and of differences over it, relative: measured 1.4e-7."""

SPEED, UNTIL = 0.2, 0.016


def _ends(scale, duration=UNTIL, **more):
    """A ball on a lift, amid its contact, and two high above it amid theirs, which is isolated;
    stiffness and speeds vary together.
    """
    balls = [
        jc.Sphere(0.1, 1.0, [0.11], [-0.5]),
        jc.Sphere(0.1, 1.0, [5.0], [20.0 + scale]),
        jc.Sphere(0.1, 2.0, [5.21], [20.0]),
    ]
    lift = jc.Plane([0.0], [1.0], motion=jc.Steady([SPEED * scale]))
    scene = jc.Scene([*balls, lift], jc.HuGuo(e=0.5), stiffness=1e6 * scale, gravity=[-9.81])
    return jc.simulate(scene, duration, rtol=1e-11, **more)


def _numbers(run, first=None):
    """What a run gives, less what the `first` part of it did, and with its energies."""
    lost = jnp.sum(jnp.where(run.impacts.valid, run.impacts.energy_loss, 0))
    work, time = run.wall_work, run.impacts.time[:2]
    if first is not None:
        lost = lost - jnp.sum(first.impacts.energy_loss)
        work, time = work - first.wall_work, time - UNTIL
    numbers = [run.position[-1, 0], run.velocity[-1, 0], work[None], run.position[-1, 1:]]
    numbers += [run.velocity[-1, 1:], run.energy[-1:], lost[None], time]
    return jnp.concatenate([jnp.ravel(x) for x in numbers])


@pytest.mark.slow(reason="derivatives of a soft run in two pieces")
def test_a_run_goes_on_from_contacts_with_their_derivatives():
    """All that a run goes on from varies, the indentation and v0 as well; to flight and to rest."""
    parts = [eqx.partition(_ends(1 + h).final, eqx.is_inexact_array) for h in (STEP, -STEP, 0)]
    rest = parts[2][1]
    moves = jax.tree.map(lambda a, b: (a - b) / (2 * STEP), parts[0][0], parts[1][0])
    assert np.any(moves._start.contacts.state.indentation != 0)
    assert eqx.combine(*parts[2])._start.underway.partner.tolist() == [-1, 2, 1]

    @jax.jit
    def both(numbers, along, duration):
        def end(x):
            return jc.simulate(eqx.combine(x, rest), duration, rtol=1e-11, max_impacts=8)

        return jax.jvp(lambda x: _numbers(end(x)), (numbers,), (along,))

    value, found = both(parts[2][0], moves, 0.03)
    first = _ends(1.0)
    expected = _numbers(_ends(1.0, UNTIL + 0.03), first)
    np.testing.assert_allclose(value, expected, rtol=GOES_ON)
    # Both contacts are in both parts, each with its loss there.
    assert np.all(expected[-2:] < 0)
    assert missing(first) < GOES_ON * first.energy[0]
    # It is up again.
    assert float(value[1]) > SPEED + 0.05
    after = [both(numbers, moves, 0.03)[0] for numbers, _ in parts[:2]]
    np.testing.assert_allclose(found, (after[0] - after[1]) / (2 * STEP), rtol=DIFFERENCES)
    # It is carried: only its lift and its indentation vary then.
    duration = 1.5
    value, found = both(parts[2][0], moves, duration)
    np.testing.assert_allclose(value[1], SPEED, atol=AT_REST)
    sinks = 2 / 3 * (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(found[0], SPEED * (UNTIL + duration) + sinks, rtol=SLOPES_AT_REST)
    np.testing.assert_allclose(found[1], SPEED, rtol=SLOPES_AT_REST)
    slope = central(lambda h: float(_ends(1 + h).velocity[-1, 0, 0]), STEP)
    # Speed times the transferred momentum and the weight, and their variations.
    gives = SPEED * (SPEED - float(first.velocity[-1, 0, 0]) + 9.81 * duration)
    np.testing.assert_allclose(value[2], gives, rtol=AT_REST)
    np.testing.assert_allclose(found[2], gives + SPEED * (SPEED - slope), rtol=SLOPES_AT_REST)


def test_a_derivative_by_the_duration_includes_the_contact_forces():
    """At the end of a run inside contacts, coupled and isolated; beside differences."""

    def end(duration):
        run = _ends(1.0, duration, max_impacts=8)
        return jnp.concatenate([run.position[-1, :, 0], run.velocity[-1, :, 0], run.energy[-1:]])

    # The differences are those of the same program.
    both = jax.jit(lambda duration: jax.jvp(end, (duration,), (1.0,)))
    along, slope = both(UNTIL)[1], central(lambda h: both(UNTIL + h)[0], BRIEFLY)
    assert np.abs(along[3]) > 10 * 9.81
    np.testing.assert_allclose(along, slope, rtol=BY_DURATION)
