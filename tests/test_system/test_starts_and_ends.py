"""Starts at rest without forces, and runs that end before their time: all lanes of one batch."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

LAW = jc.HuGuo(e=0.7)

TOUCH = 1e-11
"""Times of touch at rtol 1e-9, relative: measured 1e-12."""


def unit(t, q, args):
    return jnp.eye(1)


def drive(t, q, v, args):
    one, ten, square, step, spring = args[:5]
    waves = one * jnp.sin(t) + ten * jnp.sin(10 * t)
    return waves + square * t**2 + step * jnp.where(t < 1, 0.0, 1.0) - spring * q


def wall(t, q, args):
    far, cubic, shaken = args[5:]
    return far - cubic * t**3 + shaken * jnp.cos(t) - q


def test_starts_at_rest_without_forces():
    """The first touches: closed forms, and the root of (10 sin t - sin 10 t)/99 = .05."""
    lanes = {
        1.93456321075: [1, 0, 0, 0, 0, 1.0, 0, 0],
        12**0.25: [0, 0, 1, 0, 0, 1.0, 0, 0],
        1 + 2**0.5: [0, 0, 0, 1, 0, 1.0, 0, 0],
        0.4200584211237859: [0, 1, 0, 0, 1, 0.05, 0, 0],
        0.5 ** (1 / 3): [0, 0, 0, 0, 1, 0.05, 0.1, 0],
        np.arccos(-5 / 6): [0, 0, 0, 0, 0, 0.5, 0, 0.6],
    }
    system = jc.System(unit, drive, wall, law=LAW, stiffness=1e4)

    def first_touch(args):
        start = {"position": [0.0], "velocity": [0.0], "args": args, "breakpoints": [1.0]}
        run = jc.simulate(system, 2.6, **start, throw=False)
        return run.contacts.time[0], run.ok

    times, ok = jax.jit(jax.vmap(first_touch))(jnp.array(list(lanes.values()), float))
    assert np.all(ok)
    np.testing.assert_allclose(times, list(lanes), rtol=TOUCH)


def test_runs_that_end_before_their_time():
    """NaN and negative numbers begin at given times; a mass of q - .005 vanishes on the way."""

    def of_time(t, value, usual):
        return jnp.where(t > 0.03, value, usual)

    system = jc.System(
        lambda t, q, a: jnp.eye(1) * of_time(t, a[0], 1.0) * jnp.where(a[3] > 0, q[0] - 0.005, 1.0),
        lambda t, q, v, a: of_time(t, a[1], -9.81) + a[4] * v * jnp.abs(v),
        lambda t, q, a: q + of_time(t, a[2], 0.0),
        law=LAW,
        stiffness=1e6,
    )
    nan, ends = np.nan, jc.Ending
    lanes = {
        (1, -9.81, 0, 0, 0): (ends.COMPLETED, 0.04),
        (-1, -9.81, 0, 0, 0): (ends.SINGULAR_MASS, 0.03),
        (nan, -9.81, 0, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, nan, 0, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, -9.81, nan, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, -9.81, 0, 1, 0): (ends.SINGULAR_MASS, 0.0020007620406),
        (1, -9.81, 0, 0, 1e5): (ends.TOO_MANY_STEPS, None),
    }

    def ended(args):
        start = {"position": [0.01], "velocity": [0.0], "args": args}
        run = jc.simulate(system, 0.04, **start, throw=False)
        return run.status, run.reached

    status, reached = jax.jit(jax.vmap(ended))(jnp.array(list(lanes), float))
    for got, at, (expected, when) in zip(status, reached, lanes.values(), strict=True):
        assert got == expected
        assert when is None or abs(at - when) < 1e-12
