"""Clusters of touching bodies, against Newton's equations. Whole runs: `test_soft_runs`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._coupled.modes import APART, CHANGED
from jaxcontact._scene.cluster.problem import ClusterPairs, ClusterProblem
from jaxcontact._scene.cluster.solve import cluster, cluster_at_touch
from tests.oracle.scene_oracle import Ball, Spring, Wall, run
from tests.test_impact.support import both_jacobians
from tests.test_scene.support import fourth

K = 1e4
HIGH = np.sqrt(3) / 2
FOR_EVER = 1e3


def pairs_of(balls, walls):
    n = len(balls)
    found = [(i, j) for i in range(n) for j in range(i + 1, n)]
    return found + [(i, n + k) for i in range(n) for k in range(len(walls))]


def numbers(balls, walls=(), gravity=0.0):
    """The arrays of a cluster."""
    n, found = len(balls), pairs_of(balls, walls)
    fixed = np.zeros((len(walls), len(balls[0].position)))
    position = np.array([b.position for b in balls] + [w.point for w in walls])
    velocity = np.concatenate([[b.velocity for b in balls], fixed])
    inverse = np.array([1 / b.mass for b in balls] + [0.0] * len(walls))
    acceleration = np.concatenate([np.zeros((n, fixed.shape[1])) + gravity, fixed])
    ends, flat = np.transpose(found), np.array([j >= n for _, j in found])
    distance, gap = np.zeros((2, len(found)))
    normal = np.zeros((len(found), fixed.shape[1]))
    for k, (i, j) in enumerate(found):
        distance[k] = balls[i].radius + (balls[j].radius if j < n else 0.0)
        apart = position[i] - position[j]
        if j >= n:
            normal[k] = walls[j - n].normal
        gap[k] = (apart @ normal[k] if j >= n else np.linalg.norm(apart)) - distance[k]
    pairs = ClusterPairs(*ends, distance, normal, flat, np.ones(len(found), bool))
    closed, mass = abs(gap) < 1e-12, 1 / (inverse[ends[0]] + inverse[ends[1]])
    return jax.tree.map(
        jnp.asarray, (pairs, inverse, acceleration, position, velocity, closed, mass)
    )


def follow(case, alpha, until, rtol, v0="peak"):
    pairs, inverse, acceleration, position, velocity, closed, mass = case
    start = cluster_at_touch(pairs, position, velocity, closed, v0=v0)
    law, contact = jc.Damped(alpha=alpha), jc.Contact(mass, K)
    problem = ClusterProblem(law, contact, pairs, inverse, acceleration, start, until, rtol)
    return cluster(problem, v0=v0)


def test_no_step_passes_over_a_touch():
    """Beside a ball at rest, which needs no short steps, two others graze each other for 30 ms."""
    offset, speed, waits = 0.99, 10.0, np.linspace(0.3, 0.4, 9)
    floor, still, cases = Wall([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), [0.0, 0.0, 0.0], []
    for wait in waits:
        start = [-speed * wait - np.sqrt(1 - offset**2), offset, 20.0]
        flying = Ball(start, [speed, 0.0, 0.0])
        balls = [Ball([9.0, 0.0, 0.5], still), flying, Ball([0.0, 0.0, 20.0], still)]
        cases.append(numbers(balls, [floor], [0.0, 0.0, -9.81]))
    cases = jax.tree.map(lambda *leaves: np.stack(leaves), *cases)
    end = jax.jit(jax.vmap(lambda case: follow(case, 2.0, 0.6, 1e-6)))(cases)
    met = pairs_of(balls, [floor]).index((1, 2))
    np.testing.assert_allclose(end.state.since[:, met], waits, rtol=1e-5)
    assert np.all(end.state.max_force[:, met] > K * 1e-3**1.5)


LINE = [Ball([float(k)], [1.0 if k == 0 else 0.0]) for k in range(3)]
"""Three just touching balls in one dimension, the first one at speed one."""


@jax.jit
def clamped_three(start):
    """Three balls in a row whose law ends its force before they part."""
    pairs, inverse, acceleration, *_, mass = numbers(LINE)
    law = jc.AntypovElliott(e=0.5, tension=False)
    contact = jc.Contact(mass, K)
    problem = ClusterProblem(law, contact, pairs, inverse, acceleration, start, FOR_EVER, 1e-9)
    return cluster(problem, until_change=True)


def test_a_solve_goes_on_from_where_it_stopped():
    pairs, *_, position, velocity, closed, _ = numbers(LINE)
    # The last pair is initially open.
    start = cluster_at_touch(pairs, position.at[2].add(1e-3), velocity, closed.at[2].set(False))
    states, statuses = [start], []
    while not statuses or statuses[-1] == CHANGED:
        end = clamped_three(states[-1])
        states.append(end.state)
        statuses.append(int(end.status))
    assert statuses[-1] == APART and len(statuses) >= 3
    assert not states[0].closed[2] and states[1].closed[2]
    np.testing.assert_array_equal(states[1].since[2], states[1].time)
    zeta = float(jc.AntypovElliott(e=0.5, tension=False).damping_ratio())
    spring = Spring(K, c=2 * zeta * np.sqrt(2.5 / 2) * np.sqrt(K * 0.5))
    exact = run([*LINE[:2], Ball([2.001], [0.0])], spring, until_apart=True)
    np.testing.assert_allclose(states[-1].velocity, exact.velocity, atol=1e-8)
    np.testing.assert_allclose(states[-1].time, exact.time, rtol=1e-8)
    assert states[-1].force_until[2] < states[-1].time


@pytest.mark.slow(reason="several soft scenes, each a program")
def test_the_least_speed_at_touch_decides_the_answer():
    """As in SCENES: the last of three just touching balls, for floors of the latched speed."""
    floors = jnp.array([1e-9, 0.01, 0.1, 1.0])
    case = numbers(LINE)
    end = jax.jit(jax.vmap(lambda v0: follow(case, 0.5, FOR_EVER, 1e-6, v0)))(floors)
    np.testing.assert_allclose(end.state.velocity[1:, 2, 0], [0.57, 0.63, 0.81], atol=6e-3)
    for floor, speeds in zip(floors[1:], end.state.velocity[1:], strict=True):
        exact = run(LINE, Spring(K, alpha=0.5), v0=float(floor), until_apart=True)
        np.testing.assert_allclose(speeds, exact.velocity, atol=1e-6)


def three_at_once(numbers_):
    return [
        Ball([0.0, 0.0], [numbers_[3], numbers_[4]], 0.5, numbers_[2]),
        Ball([HIGH, 0.5], [0.0, 0.0]),
        # A little farther away, so that it is touched later.
        Ball([1.001 * HIGH, -0.5005], [0.0, 0.0], 0.5, 2.0),
    ]


POINT = np.array([0.5, 1e4, 1.2, 1.0, 0.2])


def outcome(numbers_):
    """Of alpha, K, the mass and the velocity of the first ball."""
    alpha, stiffness, mass = numbers_[:3]
    pairs, inverse, acceleration, position, velocity, closed, _ = numbers(three_at_once(POINT))
    inverse, velocity = inverse.at[0].set(1 / mass), velocity.at[0].set(numbers_[3:])
    reduced = 1 / (inverse[pairs.first] + inverse[pairs.second])
    start = cluster_at_touch(pairs, position, velocity, closed)
    law, contact = jc.Damped(alpha=alpha), jc.Contact(reduced, stiffness)
    problem = ClusterProblem(law, contact, pairs, inverse, acceleration, start, FOR_EVER, 1e-10)
    end = cluster(problem)
    state = end.state
    return jnp.concatenate([state.velocity.ravel(), state.position.ravel(), state.time[None]])


def exact_outcome(point):
    exact = run(three_at_once(point), Spring(point[1], alpha=point[0]), until_apart=True)
    return np.concatenate([exact.velocity.ravel(), exact.position.ravel(), [exact.time]])


def test_derivatives_are_those_of_the_reference_in_both_modes():
    both = jax.jit(lambda x: both_jacobians(outcome, x)[1:])
    forward, reverse = (np.asarray(slopes) for slopes in both(jnp.asarray(POINT)))
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-12)
    for place, value in enumerate(POINT):

        def at(h, place=place):
            return exact_outcome(POINT + h * np.eye(5)[place])

        slope = fourth(at, 2e-3 * value)
        np.testing.assert_allclose(forward[:, place] * value, slope * value, atol=1e-6)


def test_single_precision_keeps_its_digits():
    case = jax.tree.map(
        lambda leaf: leaf.astype(jnp.float32) if leaf.dtype == float else leaf,
        numbers(LINE),
    )
    some = jnp.asarray(0.5, jnp.float32), jnp.asarray(FOR_EVER, jnp.float32)
    end = jax.jit(follow)(case, *some, jnp.asarray(1e-6, jnp.float32))
    assert end.state.velocity.dtype == jnp.float32 and end.status == APART
    exact = run(LINE, Spring(K, alpha=0.5), until_apart=True).velocity
    np.testing.assert_allclose(end.state.velocity, exact, atol=1e-5)
