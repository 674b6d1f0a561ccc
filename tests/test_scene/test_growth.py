"""Growth of a change of the start in a run: `Run.margin.growth`."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.derivative import differentiable_run

EXACT = 1e-6
"""Against the largest singular value by other means: measured 1e-9."""

DIFFERENCES = 1e-5
"""Against differences of the run itself: measured 3e-8."""

GOLDEN = (1 + np.sqrt(5)) / 2

FLIGHT, RADII = 3.0, 1.0


def between_pins(offset, duration, room=16):
    """A ball that goes to and fro between two fixed ones."""
    far = RADII + FLIGHT / 2
    pins = [jc.Sphere(0.9, None, [x, 0.0], fixed=True) for x in (-far, far)]
    ball = jc.Sphere(0.1, 1.0, [offset, 0.0], [1.0, 0.0])
    how = {"instantaneous": True, "max_impacts": room, "throw": False}
    return jc.simulate(jc.Scene([ball, *pins], jc.Hertz()), duration, **how)


def of_a_billiard(hits, duration):
    """By the matrices of what is perpendicular to the path: flights, and hits of curved walls."""
    if hits == 0:
        path = flight(duration)
    else:
        hit = np.array([[1, 0], [2 / RADII, 1]])
        last = duration - FLIGHT / 2 - FLIGHT * (hits - 1)
        between = np.linalg.matrix_power(hit @ flight(FLIGHT), hits - 1)
        path = flight(last) @ between @ hit @ flight(FLIGHT / 2)
    scale = np.diag([1, duration])
    return np.linalg.svd(scale @ path @ np.linalg.inv(scale))[1][0]


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
    balls = [jc.Sphere(0.1, m, start[0, k], start[1, k]) for k, m in enumerate((1.0, 1.5, 0.7))]
    pin = jc.Sphere(0.2, None, [0.35, 0.35], fixed=True)
    floor = jc.Plane([0.0, -0.3], [0.02, 1.0])
    scene = jc.Scene([*balls, pin, floor], jc.ExactRestitution(e=0.8), gravity=[0.1, -9.0])
    return jc.simulate(scene, 0.9, instantaneous=True)


def test_growth_against_differences_of_the_run():
    start = np.array([[[0.0, 1.0], [0.8, 1.1], [-0.5, 0.8]], [[1.0, 0.0], [-0.8, 0.1], [0.4, 0.2]]])
    run = three(start)
    assert len(run.impacts) == 4 and np.min(run.margin.time) > 0.01
    unit = np.array([1.0, 0.9]).reshape(2, 1, 1)

    def end(changed):
        found = three(changed / unit)
        return (np.stack([found.position[-1, :3], found.velocity[-1, :3]]) * unit).ravel()

    h = 1e-6
    steps = h * np.eye(start.size).reshape(-1, *start.shape)
    columns = [(end(start * unit + s) - end(start * unit - s)) / (2 * h) for s in steps]
    largest = np.linalg.svd(np.array(columns))[1][0]
    np.testing.assert_allclose(run.margin.growth, largest, rtol=DIFFERENCES)


def test_the_growth_shares_its_program_with_a_gradient(monkeypatch):
    used, program = [], differentiable_run.matrices
    count = lambda *of, **how: used.append(1) or program(*of, **how)  # noqa: E731
    monkeypatch.setattr(differentiable_run, "matrices", count)

    def end(speed):
        balls = [jc.Sphere(0.1, 1.0, [0.0], speed[None]), jc.Sphere(0.1, 2.0, [1.0])]
        return jc.simulate(jc.Scene(balls, jc.ExactRestitution(e=0.9)), 2.0, instantaneous=True)

    assert end(jnp.asarray(1.0)).margin.growth > 1
    assert jax.grad(lambda speed: end(speed).position[-1, 1, 0])(1.0) > 0 and used == [1]


@pytest.mark.slow(reason="the growth through a soft scene")
def test_a_soft_impact():
    """Two equal balls head-on exchange velocities u apart: x1 = y - 2 R + w T + u D/2 at the end,
    and x2 = x + 2 R + v T - u D/2, with a duration D ~ u^(-1/5) of the impact.
    """
    end = 2.0
    balls = [jc.Sphere(0.1, 1.0, [0.0], [1.0]), jc.Sphere(0.1, 1.0, [1.0], [0.0])]
    run = jc.simulate(jc.Scene(balls, jc.Hertz(), stiffness=1e4), end)
    part = 0.4 * float(run.impacts.duration[0])
    assert part > 0.01
    slope = np.array(
        [[0, 1, part, end - part], [1, 0, end - part, part], [0, 0, 0, 1], [0, 0, 1, 0]]
    )
    unit = np.diag([1, 1, end, end])
    largest = np.linalg.svd(unit @ slope @ np.linalg.inv(unit))[1][0]
    np.testing.assert_allclose(run.margin.growth, largest, rtol=EXACT)
