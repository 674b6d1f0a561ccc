"""Growth of a change of the start in a run: `Run.margin.growth`."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.derivative import differentiable_run
from tests.test_scene.support import central, go, in_a_line, spheres

EXACT = 1e-6
"""Against the largest singular value by other means: measured 1e-9."""

DIFFERENCES = 1e-5
"""Against differences of the run itself: measured 3e-8."""

GOLDEN = (1 + np.sqrt(5)) / 2

FLIGHT, RADII = 3.0, 1.0


def largest(matrix, unit):
    """The largest singular value of a matrix for positions and velocities, in these units."""
    unit = np.diag(unit)
    return np.linalg.svd(unit @ matrix @ np.linalg.inv(unit))[1][0]


def between_pins(offset, duration, room=16):
    """A ball that goes to and fro between two fixed ones."""
    far = RADII + FLIGHT / 2
    pins = [jc.Sphere(0.9, None, [x, 0.0], fixed=True) for x in (-far, far)]
    ball = jc.Sphere(0.1, 1.0, [offset, 0.0], [1.0, 0.0])
    return go(jc.Scene([ball, *pins], jc.Hertz()), duration, max_impacts=room, throw=False)


def of_a_billiard(hits, duration):
    """By the matrices of what is perpendicular to the path: flights, and hits of curved walls."""
    path = flight(duration)
    if hits:
        hit = np.array([[1, 0], [2 / RADII, 1]])
        last = duration - FLIGHT / 2 - FLIGHT * (hits - 1)
        between = np.linalg.matrix_power(hit @ flight(FLIGHT), hits - 1)
        path = flight(last) @ between @ hit @ flight(FLIGHT / 2)
    return largest(path, [1, duration])


def flight(length):
    return np.array([[1, length], [0, 1]])


def test_a_billiard():
    """Every hit multiplies by the eigenvalue 1 + l/r + √((l/r)² + 2 l/r)."""
    durations = FLIGHT * np.array([0.1, 1, 2, 3, 4, 5])
    runs = jax.vmap(functools.partial(between_pins, 0.0))(jnp.asarray(durations))
    growth = runs.margin.growth
    exact = [of_a_billiard(hits, duration) for hits, duration in enumerate(durations)]
    np.testing.assert_allclose(growth, exact, rtol=EXACT)
    assert exact[0] == pytest.approx(GOLDEN)
    ratio = FLIGHT / RADII
    each = 1 + ratio + np.sqrt(ratio * (ratio + 2))
    # The duration itself is the unit of the effect of velocities.
    np.testing.assert_allclose(growth[5] / growth[4] * 4 / 5, each, rtol=0.03)
    # A single run from Python gives the same; one without values has no growth here.
    one = between_pins(0.0, float(durations[3]))
    np.testing.assert_allclose(one.margin.growth, exact[3], rtol=EXACT)
    short = between_pins(0.0, float(durations[3]), room=1)
    assert short.status == jc.Ending.TOO_MANY_IMPACTS and np.isnan(short.margin.growth)


def three(start):
    """Three balls, a fixed one and a floor under gravity."""
    balls = spheres(0.1, [1.0, 1.5, 0.7], *start)
    pin = jc.Sphere(0.2, None, [0.35, 0.35], fixed=True)
    floor = jc.Plane([0.0, -0.3], [0.02, 1.0])
    return go(jc.Scene([*balls, pin, floor], jc.ExactRestitution(e=0.8), gravity=[0.1, -9.0]), 0.9)


def test_growth_against_differences_of_the_run():
    start = np.array([[[0.0, 1.0], [0.8, 1.1], [-0.5, 0.8]], [[1.0, 0.0], [-0.8, 0.1], [0.4, 0.2]]])
    run = three(start)
    assert len(run.impacts) == 4 and np.min(run.margin.time) > 0.01

    def end(h, way):
        found = three(start + h * way)
        return np.stack([found.position[-1, :3], found.velocity[-1, :3]]).ravel()

    ways = np.eye(start.size).reshape(-1, *start.shape)
    columns = [central(functools.partial(end, way=way), 1e-6) for way in ways]
    found = largest(np.array(columns).T, np.repeat([1.0, 0.9], 6))
    np.testing.assert_allclose(run.margin.growth, found, rtol=DIFFERENCES)


def test_the_growth_shares_its_program_with_a_gradient(monkeypatch):
    used, program = [], differentiable_run.matrices
    count = lambda *of, **how: used.append(1) or program(*of, **how)  # noqa: E731
    monkeypatch.setattr(differentiable_run, "matrices", count)

    def end(speed):
        balls = in_a_line(0.1, [1.0, 2.0], [0.0, 1.0], [speed, 0.0])
        return go(jc.Scene(balls, jc.ExactRestitution(e=0.9)), 2.0)

    assert end(jnp.asarray(1.0)).margin.growth > 1
    assert jax.grad(lambda speed: end(speed).position[-1, 1, 0])(1.0) > 0 and used == [1]


@pytest.mark.slow(reason="the growth through a soft scene")
def test_a_soft_impact():
    """Two equal balls head-on exchange velocities u apart: x1 = y - 2 R + w T + u D/2 at the end,
    and x2 = x + 2 R + v T - u D/2, with a duration D ~ u^(-1/5) of the impact.
    """
    end = 2.0
    scene = jc.Scene(in_a_line(0.1, 1.0, [0.0, 1.0], [1.0, 0.0]), jc.Hertz(), stiffness=1e4)
    run = jc.simulate(scene, end)
    part = 0.4 * float(run.impacts.duration[0])
    assert part > 0.01
    slope = [[0, 1, part, end - part], [1, 0, end - part, part], [0, 0, 0, 1], [0, 0, 1, 0]]
    found = largest(np.array(slope), [1, 1, end, end])
    np.testing.assert_allclose(run.margin.growth, found, rtol=EXACT)
