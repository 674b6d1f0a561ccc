"""Walls that move as a user's function prescribes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.moving_table import GRAVITY, RADIUS, RATE, bounces, over, pressed, sine

EXACT = 1e-11
"""Impacts on a table that shakes, whose errors grow: 1.1e-11 after fifteen of them."""

SOFT = 1e-8
"""Ten times `rtol`."""


def two_tones(t, args):
    """A table that shakes with its frequency and three times that."""
    amplitude, other = args
    return amplitude * jnp.sin(RATE * t) + other * jnp.sin(3 * RATE * t + 1.0)


A, B = 1e-4, 2e-5
TWO_TONES = (
    lambda t: A * np.sin(RATE * t) + B * np.sin(3 * RATE * t + 1),
    lambda t: RATE * (A * np.cos(RATE * t) + 3 * B * np.cos(3 * RATE * t + 1)),
)
STRONGEST = RATE**2 * (A + 9 * B)


def test_a_table_that_moves_as_a_function_says():
    law = jc.ExactRestitution(e=0.8)
    motion = jc.Prescribed(two_tones, STRONGEST, (A, B))
    run = jc.simulate(over(motion, 0.02, law), 0.4, instantaneous=True)
    touches, height, velocity = bounces(TWO_TONES, 0.02, 0.8, 0.4)
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) == len(touches) > 6
    np.testing.assert_allclose(run.impacts.time, touches[:, 0], rtol=EXACT)
    np.testing.assert_allclose(run.impacts.closing_speed, touches[:, 1], rtol=EXACT)
    assert abs(run.position[-1, 0, 0] - RADIUS - height) < EXACT
    assert abs(run.velocity[-1, 0, 0] - velocity) < EXACT
    # From halfway on the function continues at its own time.
    half = jc.simulate(over(motion, 0.02, law), 0.2, instantaneous=True)
    rest = jc.simulate(half.final, 0.2, instantaneous=True)
    np.testing.assert_allclose(rest.velocity[-1], run.velocity[-1], atol=EXACT)
    np.testing.assert_allclose(half.wall_work + rest.wall_work, run.wall_work, atol=EXACT)

    def end(numbers):
        motion = jc.Prescribed(two_tones, STRONGEST, (numbers[0], numbers[1]))
        run = jc.simulate(over(motion, 0.02, law), 0.2, instantaneous=True, max_impacts=8)
        return run.velocity[-1, 0, 0]

    along = jnp.array([1e-5, 2e-6])
    found = jax.jit(lambda x: jax.jvp(end, (x,), (along,))[1])(jnp.array([A, B]))
    step, ends = 1e-4, []
    for sign in (1, -1):
        first, third = np.array([A, B]) + sign * step * along
        table = (
            lambda t, a=first, b=third: a * np.sin(RATE * t) + b * np.sin(3 * RATE * t + 1),
            lambda t, a=first, b=third: (
                RATE * (a * np.cos(RATE * t) + 3 * b * np.cos(3 * RATE * t + 1))
            ),
        )
        ends.append(bounces(table, 0.02, 0.8, 0.2)[2])
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * step), rtol=1e-5)


@pytest.mark.slow(reason="a soft scene with a function for a wall")
def test_a_soft_ball_on_a_table_that_moves_as_a_function_says():
    law = jc.HuGuo(e=0.7)
    motion = jc.Prescribed(two_tones, STRONGEST, (A, B))
    run = jc.simulate(over(motion, 0.002, law), 0.08, v0="touch")
    assert len(run.impacts) >= 2
    height, velocity = pressed(TWO_TONES, 0.002, 0.08, float(law.damping_factor()))
    fastest = np.max(run.impacts.closing_speed)
    assert abs(run.velocity[-1, 0, 0] - velocity) < SOFT * fastest
    assert abs(run.position[-1, 0, 0] - RADIUS - height) < SOFT * fastest * 0.08


def test_arguments_of_a_function_that_are_no_numbers():
    """A network has functions among its leaves; a table of names has text."""

    def named(t, args):
        return args["amplitude"] * args["form"](RATE * t) if args["on"] == "yes" else 0 * t

    law = jc.ExactRestitution(e=0.8)
    args = {"amplitude": np.array(1e-4), "form": jnp.sin, "on": "yes"}
    motion = jc.Prescribed(named, 1e-4 * RATE**2, args)
    run = jc.simulate(over(motion, 0.02, law), 0.1, instantaneous=True)
    touches, _, velocity = bounces(sine(1e-4, 0.0), 0.02, 0.8, 0.1)
    assert len(run.impacts) == len(touches) > 0
    assert abs(run.velocity[-1, 0, 0] - velocity) < EXACT


def test_a_wall_that_exceeds_its_acceleration_is_flagged():
    """d = c t³ has the acceleration 6 c t; a jerk within an interval is seen by what it moved."""

    def cubic(t, c):
        return -c * t**3

    law = jc.ExactRestitution(e=0.8)
    motion = jc.Prescribed(cubic, 1.2, 1.0)
    how = {"instantaneous": True, "throw": False}
    times = np.array([0.0, 0.1, 0.19, 0.3])
    run = jc.simulate(over(motion, 0.5, law), 0.4, times=times, **how)
    assert run.status == jc.Ending.WALL_TOO_ABRUPT
    assert 0.2 <= run.reached < 0.2 + 2 * 0.4 / 4096
    np.testing.assert_allclose(
        run.position[:3, 0, 0], 0.5 + RADIUS - GRAVITY / 2 * times[:3] ** 2, rtol=EXACT
    )
    assert np.all(np.isnan(run.position[3])) and "wall too abrupt" in str(run)
    slower = jc.simulate(
        over(jc.Prescribed(cubic, 1.2, 0.4), 0.5, law), 0.4, times=times, instantaneous=True
    )
    assert slower.status == jc.Ending.COMPLETED

    def kick(t, width):
        return -1e-3 * jax.nn.sigmoid((t - 0.1234567) / width)

    # The sampled times are 1e-4 s apart.
    run = jc.simulate(over(jc.Prescribed(kick, 1e3, 1e-7), 0.5, law), 0.4, **how)
    assert run.status == jc.Ending.WALL_TOO_ABRUPT
    assert abs(run.reached - 0.1234567) < 0.4 / 4096


def test_functions_that_are_none_are_refused():
    for wrong in (lambda t, args: 1, lambda t, args: (t, t), lambda t, args: jnp.zeros(4)):
        with pytest.raises(ValueError, match=r"`displacement` must be a function that returns one"):
            jc.Prescribed(wrong, 1.0)
    with pytest.raises(ValueError, match=r"`displacement` must be a function of the time and of"):
        jc.Prescribed(lambda t: t, 1.0)
    with pytest.raises(ValueError, match=r"`motion` must have 2 numbers"):
        jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Prescribed(lambda t, args: t[None], 1.0))
