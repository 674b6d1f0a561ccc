"""Derivatives of runs with soft impacts, against differences of Newton's equations, both modes."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.scene_oracle import Ball, Spring, Wall, run

MODES = 1e-9
"""Forward against reverse, relative to the largest entry."""

DIFFERENCES = 1e-6
"""Against differences, relative to the largest derivative by the same number."""


class Case(NamedTuple):
    """A scene as a function of its numbers, which begin with alpha and K; and how long it runs."""

    point: list[float]
    balls: Callable[..., list[tuple]]
    """Of the numbers after those two: position, velocity, radius and mass of each ball."""
    lengths: tuple[int, ...]
    """Which numbers are lengths; an indentation is a small part of them."""
    floor: bool
    duration: float
    results: int
    """Numbers of the state at the end."""


CASES = {
    "oblique": Case(
        [1.0, 1e6, 0.1, 2.0, 0.0, 0.0, 1.0, 0.1, 0.5, 0.12],
        lambda r, m, *s: [
            ([s[0], s[1]], [s[2], s[3]], r, m),
            ([s[4], s[5]], [-0.5, 0.0], 0.1, 1.0),
        ],
        (2, 4, 5, 8, 9),
        False,
        0.8,
        8,
    ),
    # One ball on a floor and one that follows it: a coupled solve under gravity.
    "stack": Case(
        [0.5, 1e5, 0.1, 2.0, 0.15, -0.3, 0.3503, 9.81],
        lambda r, m, *s: [([s[0]], [s[1]], r, m), ([s[2]], [-0.3], 0.1, 1.0)],
        (2, 4, 6),
        True,
        0.15,
        4,
    ),
}


def _vector(numbers):
    return jnp.stack([jnp.asarray(x) for x in numbers])


def simulated(case: Case, numbers):
    alpha, stiffness, *rest = numbers
    bodies: list = [
        jc.Sphere(radius, mass, _vector(position), _vector(velocity))
        for position, velocity, radius, mass in case.balls(*rest)
    ]
    gravity = None
    if case.floor:
        bodies.append(jc.Plane([0.0], [1.0]))
        gravity = jnp.stack([-rest[-1]])
    scene = jc.Scene(bodies, jc.Damped(alpha=alpha), stiffness=stiffness, gravity=gravity)
    end = jc.simulate(scene, case.duration, rtol=1e-10, max_impacts=8)
    return jnp.concatenate([end.position[-1].ravel(), end.velocity[-1].ravel()])


def exact(case: Case, numbers):
    alpha, stiffness, *rest = numbers
    balls = [Ball(*ball) for ball in case.balls(*rest)]
    walls, gravity = ([Wall([0.0], [1.0])], [-rest[-1]]) if case.floor else ([], None)
    end = run(balls, Spring(stiffness, alpha=alpha), case.duration, walls, gravity)
    return np.concatenate([end.position.ravel(), end.velocity.ravel()])


def differences(case: Case, place: int):
    """Of order four, by one number: a relative change, or one far below an indentation."""
    point = np.array(case.point)
    h = 1e-5 if place in case.lengths else 1e-3 * point[place]

    def at(steps):
        return exact(case, point + steps * h * np.eye(len(point))[place])

    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)


@pytest.mark.slow(reason="derivatives of soft scenes by all numbers")
@pytest.mark.parametrize("name", CASES)
def test_derivatives_of_soft_runs(name):
    case = CASES[name]
    point = jnp.array(case.point)

    def outcome(numbers):
        return simulated(case, numbers)

    @jax.jit
    def both(numbers, along, weight):
        # One column and one row at a time: a program for all at once takes far longer to compile.
        end, push = jax.linearize(outcome, numbers)
        (row,) = jax.linear_transpose(push, numbers)(weight)
        return end, push(along), row

    numbers, results = np.eye(len(point)), np.eye(case.results)
    found = [
        both(point, numbers[k % len(numbers)], results[k % len(results)])
        for k in range(max(len(numbers), len(results)))
    ]
    value = np.asarray(found[0][0])
    forward = np.stack([column for _, column, _ in found[: len(numbers)]], axis=-1)
    reverse = np.stack([row for *_, row in found[: len(results)]])
    np.testing.assert_allclose(value, exact(case, case.point), atol=1e-9)
    assert np.abs(forward - reverse).max() <= MODES * np.abs(forward).max()
    for place in range(len(point)):
        found = differences(case, place)
        size = np.abs(found).max()
        np.testing.assert_allclose(forward[:, place], found, rtol=0, atol=DIFFERENCES * size)


LIFT = jnp.array([0.9, 0.3, 1.0])
"""Speeds of a ball along a lift and of the lift, and the stiffness over 1e5 N/m."""

OF_A_RUN = 1e-7
"""Against differences of the run itself, of order two with steps of 1e-5: relative to the largest
of a row."""


def _on_a_lift(numbers):
    """A ball that leaves a periodic space at its side, between two bounces on a lift."""
    along, lift, stiffness = numbers
    ball = jc.Sphere(0.1, 1.0, [0.5, 0.2], jnp.stack([along, -1.0 + 0 * lift]))
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady(jnp.stack([0 * lift, lift])))
    return jc.simulate(
        jc.Scene(
            [ball, floor],
            jc.HuGuo(e=jnp.asarray(0.8)),
            stiffness=stiffness * 1e5,
            gravity=[0.0, -9.81],
            periodic=[1.0, None],
        ),
        0.6,
        rtol=1e-10,
        max_impacts=8,
    )


def _of_the_lift(numbers):
    run = _on_a_lift(numbers)
    later, end = run.at(0.4), run.final.spheres[0]
    parts = [run.position[-1, 0], run.energy[-1:], run.wall_work[None], later.velocity[0, 0]]
    return jnp.concatenate([*parts, later.position[0, 0], end.position, jnp.asarray(end.velocity)])


@pytest.mark.slow(reason="derivatives of a soft run, of its states and of its final scene")
def test_all_that_a_run_gives_has_its_derivatives_by_both_modes():
    """Over a moving wall and a periodic side, out of a trace: states, `at`, `final`."""
    forward = np.asarray(jax.jacfwd(_of_the_lift)(LIFT))
    np.testing.assert_allclose(
        jax.jacrev(_of_the_lift)(LIFT), forward, rtol=0, atol=MODES * np.abs(forward).max()
    )
    step = 1e-5
    ends = [
        [np.asarray(_of_the_lift(LIFT + sign * step * way)) for sign in (1, -1)]
        for way in np.eye(3)
    ]
    found = np.stack([(ahead - behind) / (2 * step) for ahead, behind in ends], axis=-1)
    size = np.abs(found).max(axis=1, keepdims=True)
    assert len(_on_a_lift(LIFT).impacts) == 2
    assert np.all(np.abs(forward - found) <= OF_A_RUN * size)
