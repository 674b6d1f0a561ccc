"""Derivatives of mechanisms, against central differences and between both modes."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

DIFFERENCES = 2e-6
"""Central differences of a run at rtol 1e-11 are right to about this, relative to the largest."""


def unit(t, q, args):
    return jnp.eye(2)


def swings(t, q, v, args):
    return -args["gravity"] * jnp.sin(q) - 0.1 * v


def to_wall(t, q, args):
    return jnp.stack([q[0] + 0.2, q[1] - q[0] + args["offset"]])


NUMBERS = {"gravity": 9.81, "offset": 0.1, "e": 0.7, "stiffness": 1e6, "place": 0.8, "speed": 0.3}
ORDER = sorted(NUMBERS)


def outcome(vector):
    """Return times, speeds, restitutions and forces of the first contacts, and the final state."""
    values = dict(zip(ORDER, vector, strict=True))
    system = jc.System(
        unit, swings, to_wall, law=jc.HuGuo(e=values["e"]), stiffness=values["stiffness"]
    )
    run = jc.simulate(
        system,
        1.6,
        position=jnp.stack([values["place"], 1.1 * values["place"]]),
        velocity=jnp.stack([values["speed"], jnp.zeros_like(values["speed"])]),
        args={"gravity": values["gravity"], "offset": values["offset"]},
        rtol=1e-11,
        v0="touch",
        max_impacts=8,
    )
    table = run.contacts
    count = 3
    parts = [table.time, table.closing_speed, table.restitution, table.max_depth, table.energy_loss]
    parts = [part[:count] for part in parts]
    return jnp.concatenate([*parts, run.final.position, run.final.velocity])


def value_and_slopes(function):
    """Return a program for a function's value, its slopes, and those of a weighted sum of it in
    reverse mode.
    """

    def every(vector, weights):
        value, forward = jax.linearize(function, vector)
        slopes = jax.vmap(forward, out_axes=-1)(jnp.eye(vector.size))
        return value, slopes, jax.linear_transpose(forward, vector)(weights)[0]

    return jax.jit(every)


def test_both_modes_are_differences():
    vector, solve = jnp.array([NUMBERS[name] for name in ORDER]), value_and_slopes(outcome)
    base, forward, reverse = map(np.asarray, solve(vector, weights))
    assert np.all(np.isfinite(base))
    np.testing.assert_allclose(reverse, weights @ forward, rtol=1e-9)
    for k, name in enumerate(ORDER):
        # Longer steps than these bend, and shorter ones show the interpolation of depths.
        step = 5e-5 * NUMBERS[name]
        shift = np.zeros(len(ORDER))
        shift[k] = step
        high, low = (np.asarray(solve(vector + s * shift, weights)[0]) for s in (1, -1))
        slope = (high - low) / (2 * step)
        scale = np.max(np.abs(forward[:, k]))
        np.testing.assert_allclose(forward[:, k], slope, atol=DIFFERENCES * scale, err_msg=name)


weights = np.random.default_rng(0).normal(size=19)


def test_states_at_times_have_derivatives():
    """Also in contact and near its end, where a time is met by steps of any size."""
    times = np.linspace(2.3e-4, 3e-4, 40)

    def states(clearance):
        system, start = jc.systems.slider_crank(clearance)
        how = {"times": times, "rtol": 1e-11, "v0": "touch", "max_impacts": 4}
        found = jc.simulate(system, times[-1], **start, **how).states
        return jnp.concatenate([found.position, found.velocity, found.force], axis=1)

    here, step = 0.4995e-3, 1e-9

    # Not under `jit`: one program of all its parts compiles for longer.
    def both(clearance):
        return jax.jvp(states, (clearance,), (1.0,))

    high, low = (np.asarray(both(here + s * step)[0]) for s in (1, -1))
    slope, forward = (high - low) / (2 * step), np.asarray(both(here)[1])
    assert np.sum(forward[:, 4] != 0) > 20
    scale = np.max(np.abs(slope), axis=0)
    np.testing.assert_allclose(forward / scale, slope / scale, atol=DIFFERENCES)
