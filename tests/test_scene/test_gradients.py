"""Derivatives of a run: exact ones, forward against reverse, and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import both_jacobians

MODES = 1e-9
"""Forward against reverse, relative to the largest entry: measured 1e-15."""

DIFFERENCES = 1e-6
"""Against central differences with Richardson's extrapolation: measured 2e-8."""


def two(start):
    """Positions and velocities of two equal balls before and after an elastic hit, in a line."""
    x, y, v, w = start
    balls = [jc.Sphere(0.1, 1.0, [x], [v]), jc.Sphere(0.1, 1.0, [y], [w])]
    run = jc.simulate(jc.Scene(balls, jc.Hertz()), 2.0, instantaneous=True, max_impacts=4)
    return jnp.concatenate([run.position[-1, :, 0], run.velocity[-1, :, 0]])


def test_two_balls_exactly():
    """They exchange their places and velocities; engines that freeze the time get this wrong."""
    start = jnp.array([0.0, 1.0, 1.0, 0.0])
    exact = [[0, 1, 0, 2], [1, 0, 2, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    forward, reverse = both_modes(two, start)
    np.testing.assert_allclose(forward, exact, atol=1e-14)
    np.testing.assert_allclose(reverse, exact, atol=1e-14)


@pytest.mark.slow(reason="second derivatives of a scene")
def test_second_derivatives():
    """The speed after an oblique hit against second differences of first derivatives."""

    def speed(start):
        balls = [
            jc.Sphere(0.1, 1.0, jnp.stack([start[0], start[1]]), jnp.stack([start[2], start[3]])),
            jc.Sphere(0.1, 2.0, [1.0, 0.0]),
        ]
        scene = jc.Scene(balls, jc.ExactRestitution(e=0.8))
        run = jc.simulate(scene, 2.0, instantaneous=True, max_impacts=2)
        return run.velocity[-1, 0, 1] + run.position[-1, 1, 0]

    start = jnp.array([0.0, 0.05, 1.0, 0.02])

    @jax.jit
    def slopes(start):
        slope, push = jax.linearize(jax.grad(speed), start)
        return slope, jax.vmap(push, out_axes=1)(jnp.eye(4))

    hessian = slopes(start)[1]
    steps = 1e-5 * np.eye(4)
    differences = [(slopes(start + h)[0] - slopes(start - h)[0]) / 2e-5 for h in steps]
    np.testing.assert_allclose(hessian, differences, atol=1e-6 * np.max(np.abs(hessian)))


def both_modes(function, start):
    with jax.default_matmul_precision("float32"):
        return jax.jit(lambda start: both_jacobians(function, start)[1:])(start)


def differences(function, start, step):
    """Central differences with one extrapolation, column by column."""
    columns = []
    for k in range(len(start)):
        h = step * max(1.0, abs(float(start[k])))
        shift = np.zeros(len(start))
        shift[k] = h
        one = (function(start + shift) - function(start - shift)) / (2 * h)
        half = (function(start + shift / 2) - function(start - shift / 2)) / h
        columns.append((4 * half - one) / 3)
    return np.stack(columns, axis=-1)


def plane(numbers):
    """Three balls, a fixed one and a floor under gravity, with two laws: six impacts in a plane."""
    state, rest = numbers[:12].reshape(3, 4), numbers[12:]
    balls = [
        jc.Sphere(rest[0], rest[1 + k], s[:2], s[2:], name="ball") for k, s in enumerate(state)
    ]
    pin = jc.Sphere(rest[4], None, jnp.stack([rest[5], rest[5]]), fixed=True, name="pin")
    floor = jc.Plane(jnp.stack([rest[6], rest[6]]), jnp.stack([rest[7], 1 + rest[7]]))
    laws = {("ball", "ball"): jc.ExactRestitution(e=rest[8]), "default": jc.MarhefkaOrin(a=rest[9])}
    scene = jc.Scene(
        [*balls, pin, floor],
        laws,
        stiffness={"default": 1e6},
        gravity=jnp.stack([rest[10], rest[11]]),
    )
    run = jc.simulate(scene, 1.1, times=[0.3, 1.1], instantaneous=True, max_impacts=16)
    out = jnp.concatenate([run.position.ravel(), run.velocity.ravel(), run.impacts.time[:6]])
    return out, run


# Positions and velocities of the three balls.
STATES = [0.0, 1.0, 1.0, 0.0, 0.8, 1.1, -0.8, 0.1, -0.5, 0.8, 0.4, 0.2]
# Radius, masses, the pin's radius and place, floor, normal, e, a, gravity.
REST = [0.1, 1.0, 1.5, 0.7, 0.2, 0.35, 0.01, 0.02, 0.8, 0.05, 0.1, -9.0]
PLANE = jnp.array([*STATES, *REST])


def agree(scene, fast, numbers, step):
    """Compare the slopes of a scene in both modes, and with differences of its fast program."""
    forward, reverse = both_modes(lambda x: scene(x)[0], numbers)
    scale = np.max(np.abs(forward))
    assert np.max(np.abs(forward - reverse)) < MODES * scale
    columns = differences(lambda x: fast(x)[0], numbers, step)
    assert np.max(np.abs(forward - columns)) < DIFFERENCES * scale


def test_impacts_in_a_plane():
    fast = jax.jit(plane)
    run = fast(PLANE)[1]
    assert int(jnp.sum(run.impacts.valid)) >= 6 and run.status == jc.Ending.COMPLETED
    assert run.margin.time > 1e-3 and run.margin.closing_speed > 0.1
    agree(plane, fast, PLANE, 2e-5)


def line(numbers):
    """Five unequal balls between two walls, thirty impacts."""
    place, speed, mass, e = numbers[:5], numbers[5:10], numbers[10:15], numbers[15]
    balls = [
        jc.Sphere(0.1, m, x[None], v[None]) for x, v, m in zip(place, speed, mass, strict=True)
    ]
    ends = [jc.Plane([-3.0], [1.0]), jc.Plane([3.0], [-1.0])]
    scene = jc.Scene([*balls, *ends], jc.ExactRestitution(e=e))
    run = jc.simulate(scene, 15.0, instantaneous=True, max_impacts=64)
    return jnp.concatenate([run.position[-1].ravel(), run.velocity[-1].ravel()]), run


LINE = jnp.array(
    [-2.0, -1.1, 0.1, 0.9, 2.2, 1.0, -0.4, 0.7, -1.1, 0.3, 1.0, 1.3, 0.8, 1.1, 0.9, 0.97]
)


@pytest.mark.slow(reason="a long run with its derivatives")
def test_thirty_impacts_in_a_line():
    fast = jax.jit(line)
    run = fast(LINE)[1]
    assert 30 <= int(jnp.sum(run.impacts.valid)) < 64
    agree(line, fast, LINE, 1e-6)
    # From Python, without a reserved size, the same values.
    np.testing.assert_allclose(fast(LINE)[0], line(np.asarray(LINE))[0], rtol=1e-10)


def test_a_batch_with_bad_lanes():
    """A lane that is out of range, overlaps or needs more room is flagged; the others are whole."""

    def run_of(radius, start):
        balls = [
            jc.Sphere(radius, 1.0, jnp.stack([start]), [1.0]),
            jc.Sphere(0.1, 1.0, [1.0], [0.0]),
            jc.Sphere(0.1, 1.0, [2.0], [0.0]),
        ]
        scene = jc.Scene([*balls, jc.Plane([4.0], [-1.0])], jc.Hertz())
        run = jc.simulate(scene, 3.0, instantaneous=True, max_impacts=2)
        good = run.status == jc.Ending.COMPLETED
        place = jnp.where(good, run.position[-1, 0, 0], 0)
        return place, (run.position[-1], run.status, run.impacts.valid.sum(), run.velocity[-1])

    def total(radius):
        place, rest = jax.vmap(run_of)(radius, start)
        return jnp.sum(place), rest

    radius = jnp.array([0.1, -0.1, 0.1, 0.1, 0.1])
    start = jnp.array([0.0, 0.0, 0.95, jnp.nan, 0.75])
    slope, (place, status, count, velocity) = jax.jit(jax.grad(total, has_aux=True))(radius)
    wrong, room = jc.Ending.INVALID_INPUT, jc.Ending.TOO_MANY_IMPACTS
    assert status.tolist() == [jc.Ending.COMPLETED, wrong, wrong, wrong, room]
    assert count.tolist() == [2, 0, 0, 0, 2]
    assert np.isfinite(place).all(axis=(1, 2)).tolist() == [True, False, False, False, False]
    np.testing.assert_allclose(velocity[0, :, 0], [0.0, 0.0, 1.0], atol=1e-15)
    # The first ball stops at the contact with the second.
    np.testing.assert_allclose(slope, [-1.0, 0.0, 0.0, 0.0, 0.0], atol=1e-14)


def test_a_grazing_hit_has_no_nan():
    """Two discs that just miss or just touch: the margin says how close it was."""

    def speed(offset):
        balls = [
            jc.Sphere(0.1, 1.0, jnp.stack([0.0, offset]), [1.0, 0.0]),
            jc.Sphere(0.1, 1.0, [1.0, 0.0]),
        ]
        scene = jc.Scene(balls, jc.Hertz())
        run = jc.simulate(scene, 2.0, instantaneous=True, max_impacts=2)
        return run.velocity[-1, 0, 1], run.margin.closing_speed

    slope = jax.jit(jax.jacfwd(speed, has_aux=True))
    missed, closing = slope(0.2)
    assert np.isfinite(missed) and closing == np.inf
    for less in (1e-15, 1e-12, 1e-8):
        touched, closing = slope(0.2 - less)
        assert np.isfinite(touched)
        assert closing == np.inf or closing == pytest.approx(np.sqrt(10 * less), rel=0.5)
