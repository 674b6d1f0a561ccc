"""Derivatives of mechanisms, against central differences and between both modes."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.test_scene.support import check_modes
from tests.test_system.references import DIFFERENCES, unit

PEAK = 1e-5
"""Of slopes of the largest force, which is found between two steps. Measured 6e-7."""


def swings(t, q, v, args):
    return -args["gravity"] * jnp.sin(q) - 0.1 * v


def to_wall(t, q, args):
    return jnp.stack([q[0] + 0.2, q[1] - q[0] + args["offset"]])


def outcome(vector):
    """Return times, speeds, restitutions and forces of the first contacts, and the final state."""
    e, gravity, offset, place, speed, stiffness = vector
    system = jc.System(unit, swings, to_wall, law=jc.HuGuo(e=e), stiffness=stiffness)
    start = {
        "position": jnp.stack([place, 1.1 * place]),
        "velocity": jnp.stack([speed, jnp.zeros_like(speed)]),
        "args": {"gravity": gravity, "offset": offset},
    }
    run = jc.simulate(system, 1.6, **start, rtol=1e-11, v0="touch", max_impacts=8)
    names = "time", "closing_speed", "restitution", "max_depth", "energy_loss"
    parts = [getattr(run.contacts, name)[:3] for name in names]
    return jnp.concatenate([*parts, run.final.position, run.final.velocity]), None


def test_both_modes_are_differences():
    # Longer steps than these bend, and shorter ones show the interpolation of depths.
    numbers = np.array([0.7, 9.81, 0.1, 0.8, 0.3, 1e6])
    check_modes(jax.jit(outcome), numbers, numbers, 5e-5, DIFFERENCES)


def test_states_at_times_have_derivatives():
    """Also in contact and near its end, where a time is met by steps of any size."""
    system = jc.System(
        unit, lambda t, q, v, args: 0 * v, lambda t, q, clearance: clearance - q,
        law=jc.HuGuo(e=0.9), stiffness=1e6,
    )  # fmt: skip
    start, times = {"position": [0.0], "velocity": [1.0]}, np.linspace(9e-3, 24e-3, 40)
    how = {"times": times, "rtol": 1e-11, "v0": "touch", "max_impacts": 4}

    def states(clearance):
        found = jc.simulate(system, times[-1], **start, args=clearance, **how).states
        return jnp.concatenate([found.position, found.velocity, found.force], axis=1)

    here, step = 0.01, 1e-7

    # Not under `jit`: one program of all its parts compiles for longer.
    def both(clearance):
        return jax.jvp(states, (clearance,), (1.0,))

    high, low = (np.asarray(both(here + s * step)[0]) for s in (1, -1))
    slope, forward = (high - low) / (2 * step), np.asarray(both(here)[1])
    assert 20 < np.sum(forward[:, 2] != 0) < 40
    scale = np.max(np.abs(slope), axis=0)
    np.testing.assert_allclose(forward / scale, slope / scale, atol=DIFFERENCES)


def test_two_that_touch_and_part_in_the_same_moment():
    """Each has the slopes of its own height, as if it were alone."""
    weight, gravity = -9.81 * jnp.ones(2), 9.81
    how = {"law": jc.Damped(alpha=0.3), "stiffness": 1e4}
    system = jc.System(unit, lambda t, q, v, args: weight, lambda t, q, args: q, **how)
    along = jnp.array([0.3, 1.0])

    def table(change):
        start = {"position": 0.5 + change * along, "velocity": jnp.zeros(2)}
        found = jc.simulate(system, 0.7, **start, max_impacts=4).contacts
        names = "time", "closing_speed", "restitution", "duration", "max_force", "energy_loss"
        return jnp.stack([getattr(found, name)[:2] for name in names])

    slopes = np.asarray(jax.jvp(table, (0.0,), (1.0,))[1])
    # Of √(2 h/g) and √(2 g h) at h = 1/2 m.
    touch = np.array([1 / np.sqrt(gravity), np.sqrt(gravity)])
    np.testing.assert_allclose(slopes[:2], np.outer(touch, along), rtol=1e-12)
    np.testing.assert_allclose(slopes[:, 1] / slopes[:, 0], along[1] / along[0], rtol=PEAK)
