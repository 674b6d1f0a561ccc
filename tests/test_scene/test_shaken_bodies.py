"""Accelerated fixed spheres and shells, with instantaneous impacts on them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle import moving_table
from tests.oracle.moving_table import FREQUENCY, GRAVITY, MASS, RADIUS, RATE
from tests.oracle.shaken_spheres import bounces, circling, sine

EXACT = 1e-11
"""Ten impacts, whose errors grow: measured 1.5e-13 in a plane."""

BALANCE = 1e-12
"""Of energies: measured 4e-14."""

CIRCLE, SWING, PHASE = 3.0, 7.0, 0.4
START, PULL, DURATION, E = [0.5, 0.1], [0.0, -2.0], 2.0, 0.8


def circle(t, args):
    """Around a circle of the radius that is given."""
    angle = 2 * jnp.pi * CIRCLE * t
    return args["radius"] * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def bowl(velocity, radius, amplitude, bound=1.001):
    """A ball in a shell that shakes, around a disc that goes in a circle."""
    strongest = bound * 0.05 * (2 * np.pi * CIRCLE) ** 2
    disc = jc.Prescribed(circle, strongest, {"radius": radius})
    return jc.Scene(
        bodies=[
            jc.Sphere(0.05, 1.0, START, velocity),
            jc.Sphere(0.2, None, [0.0, 0.0], fixed=True, motion=disc),
            jc.Shell([0.0, 0.02], 1.0, motion=jc.Vibration(amplitude, SWING, PHASE)),
        ],
        law=jc.ExactRestitution(e=E),
        gravity=PULL,
    )


def reference(velocity, radius, amplitude, duration=DURATION):
    movers = [
        circling([0.0, 0.0], radius, CIRCLE, 0.25),
        sine([0.0, 0.02], amplitude, SWING, PHASE, -0.95),
    ]
    return movers[0], bounces(movers, START, velocity, PULL, E, duration)


def balance(run):
    """The energy that is missing at the end."""
    lost = np.sum(run.impacts.energy_loss)
    return abs(run.energy[0] + run.wall_work - lost - run.energy[-1])


def test_a_ball_over_a_sphere_that_shakes_in_a_line():
    """As over a table that does."""
    amplitude, phase, high = 1e-4, 0.3, 0.02
    motion = jc.Vibration([amplitude], FREQUENCY, phase)
    scene = jc.Scene(
        bodies=[
            jc.Sphere(0.5, None, [-0.5], fixed=True, motion=motion),
            jc.Sphere(RADIUS, MASS, [high + RADIUS]),
        ],
        law=jc.ExactRestitution(e=0.8),
        gravity=[-GRAVITY],
    )
    run = jc.simulate(scene, 0.5, times=[0.0, 0.2, 0.5], instantaneous=True)
    table = moving_table.sine(amplitude, phase)
    touches, height, velocity = moving_table.bounces(table, high, 0.8, 0.5)
    assert len(run.impacts) == len(touches) > 8
    np.testing.assert_allclose(run.impacts.time, touches[:, 0], rtol=EXACT)
    np.testing.assert_allclose(run.impacts.closing_speed, touches[:, 1], rtol=EXACT)
    assert abs(run.position[-1, 1, 0] - RADIUS - height) < EXACT
    assert abs(run.velocity[-1, 1, 0] - velocity) < EXACT
    np.testing.assert_allclose(run.position[:, 0, 0], table[0](run.time) - 0.5, atol=1e-16)
    np.testing.assert_allclose(run.velocity[:, 0, 0], table[1](run.time), atol=1e-15)
    assert balance(run) < BALANCE * run.energy[0]


def test_a_ball_between_a_shell_that_shakes_and_a_disc_in_a_circle():
    seen = 0
    for velocity in ([1.2, -0.4], [-1.5, 0.3], [-2.0, -0.2], [0.1, 0.0]):
        run = jc.simulate(bowl(velocity, 0.05, [0.03, 0.02]), DURATION, instantaneous=True)
        disc, known = reference(velocity, 0.05, [0.03, 0.02])
        assert run.status == jc.Ending.COMPLETED
        seen += len(known.touches)
        np.testing.assert_allclose(run.impacts.time, known.touches[:, 0], rtol=EXACT)
        np.testing.assert_allclose(run.impacts.closing_speed, known.touches[:, 1], atol=EXACT)
        assert np.all(np.asarray(run.impacts.second) - 1 == known.touches[:, 2])
        np.testing.assert_allclose(run.position[-1, 0], known.position, atol=EXACT)
        np.testing.assert_allclose(run.velocity[-1, 0], known.velocity, atol=10 * EXACT)
        np.testing.assert_allclose(run.wall_work, known.work, atol=10 * EXACT)
        assert balance(run) < BALANCE * run.energy[0]
        np.testing.assert_allclose(run.position[-1, 1], disc.place(DURATION), atol=1e-15)
        np.testing.assert_allclose(run.velocity[-1, 1], disc.velocity(DURATION), atol=1e-14)
        # From halfway on all of them continue as before.
        half = jc.simulate(run.scene, DURATION / 2, instantaneous=True)
        rest = jc.simulate(half.final, DURATION / 2, instantaneous=True)
        np.testing.assert_allclose(rest.position[-1], run.position[-1], atol=EXACT)
        np.testing.assert_allclose(half.wall_work + rest.wall_work, run.wall_work, atol=EXACT)
    assert seen == 15


def _end(numbers):
    velocity, radius, amplitude = numbers[:2], numbers[2], numbers[3:]
    scene = bowl(velocity, radius, amplitude)
    run = jc.simulate(scene, 1.0, instantaneous=True, max_impacts=8)
    return jnp.concatenate([run.position[-1, 0], run.velocity[-1, 0], run.wall_work[None]])


@pytest.mark.slow(reason="derivatives of a scene with driven bodies")
def test_derivatives_by_the_motion_of_spheres_and_shells():
    """In both modes, of two runs at once."""
    numbers = np.array([[-1.5, 0.3, 0.05, 0.03, 0.02], [1.2, -0.4, 0.049, 0.03, 0.02]])

    @jax.jit
    @jax.vmap
    def both(numbers):
        end, push = jax.linearize(_end, numbers)
        pull = jax.linear_transpose(push, numbers)
        forward = jax.vmap(push, out_axes=1)(jnp.eye(numbers.size))
        return forward, jax.vmap(pull)(jnp.eye(end.size))[0]

    forward, reverse = both(jnp.asarray(numbers))
    scale = np.max(np.abs(forward))
    np.testing.assert_allclose(reverse, forward, atol=1e-12 * scale)
    step = 1e-7
    for numbers_of_one, found in zip(numbers, forward, strict=True):
        for k in range(5):
            ends = []
            for sign in (1, -1):
                velocity, radius, amplitude = np.split(
                    numbers_of_one + sign * step * np.eye(5)[k], [2, 3]
                )
                known = reference(velocity, radius[0], amplitude, 1.0)[1]
                ends.append(np.concatenate([known.position, known.velocity, [known.work]]))
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(found[:, k], slope, atol=1e-6 * scale)


def test_a_sphere_that_exceeds_its_acceleration_is_flagged():
    """Its bound is that of the vector: each axis alone keeps it."""

    def diagonal(t, args):
        return 1e-3 * jnp.sin(RATE * t) * jnp.ones(2)

    def run(bound):
        motion = jc.Prescribed(diagonal, bound)
        sphere = jc.Sphere(0.1, None, [1.0, 0.0], fixed=True, motion=motion)
        scene = jc.Scene([jc.Sphere(0.1, 1.0, [0.0, 0.0]), sphere], jc.ExactRestitution(e=0.5))
        return jc.simulate(scene, 0.1, instantaneous=True, throw=False)

    along = 1e-3 * RATE**2
    assert run(1.42 * along).status == jc.Ending.COMPLETED
    wrong = run(1.2 * along)
    assert wrong.status == jc.Ending.WALL_TOO_ABRUPT
    assert abs(np.sqrt(2) * np.sin(RATE * wrong.reached) - 1.2) < 2 * RATE * 0.1 / 4096
    assert np.all(np.isnan(wrong.position[-1]))


def test_a_sphere_that_shakes_into_another_at_the_start_is_refused():
    """It starts where its motion has it, not at the place that it moves about."""
    ball = jc.Sphere(0.1, 1.0, [0.0])

    def scene(phase):
        motion = jc.Vibration([-0.1], 1.0, phase)
        return jc.Scene([ball, jc.Sphere(0.1, None, [0.25], fixed=True, motion=motion)], jc.Hertz())

    assert scene(-np.pi / 2).spheres[1].position == 0.25
    with pytest.raises(ValueError, match=r"must not overlap at the start.*by 0\.05 m"):
        scene(np.pi / 2)
