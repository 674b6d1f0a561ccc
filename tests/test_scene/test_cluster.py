"""Clusters of touching bodies, against Newton's equations, with invariants and derivatives."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._coupled.modes import APART, AT_REST, CHANGED, TIME_IS_UP
from jaxcontact._scene.cluster.problem import ClusterPairs, ClusterProblem
from jaxcontact._scene.cluster.solve import cluster, cluster_at_touch
from tests.oracle.scene_oracle import Ball, Spring, Wall, run
from tests.test_impact.support import both_jacobians
from tests.test_scene.support import fourth

K = 1e4
BODIES, SLOTS, DIM = 5, 8, 3
HIGH = np.sqrt(3) / 2
GRAVITY = [0.0, 0.0, -9.81]
FOR_EVER = 1e3


def row(*places, masses=(1.0,) * 9, speed=1.0):
    """Balls of diameter one in a line, the first one flying at the others."""
    return [
        Ball([x, 0.0, 0.0], [speed if k == 0 else 0.0, 0.0, 0.0], 0.5, masses[k])
        for k, x in enumerate(places)
    ]


def ball(position, velocity=(0.0, 0.0, 0.0), **more):
    return Ball(list(position), list(velocity), **more)


FLOOR = Wall([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])


class Case(NamedTuple):
    """Balls, and what they are followed beside, under and until."""

    balls: list[Ball]
    walls: Sequence[Wall] = ()
    gravity: list[float] | None = None
    until: float = FOR_EVER


CASES = {
    "three in a row": Case(row(0, 1, 2)),
    "five in a row": Case(row(0, 1, 2, 3, 4)),
    "four unequal": Case(row(0, 1, 2, 3, masses=(1, 2, 0.5, 3))),
    "small gaps": Case(row(0, 1, 2.001, 3.002, masses=(1, 2, 0.5, 3))),
    "three at once": Case(
        [ball([0, 0, 0], [1, 0, 0]), ball([HIGH, 0.5, 0], mass=2.0), ball([HIGH, -0.5, 0])]
    ),
    "oblique": Case([ball([0, 0, 0]), ball([2 / 3, 2 / 3, 1 / 3], [-1, -0.2, 0.3])]),
    "a corner": Case(
        [ball([0.5, 0.5, 0.5], [-1, -0.7, 0.1])],
        [Wall([0, 0, 0], [1, 0, 0]), Wall([0, 0, 0], [0, 1, 0])],
    ),
    "a ball dropped onto another": Case(
        [ball([0, 0, 0.5]), ball([0.1, 0, 0.5 + np.sqrt(0.99)], [0, 0, -1])], [FLOOR], GRAVITY, 0.2
    ),
    "a rising floor": Case(
        [ball([0, 0, 0.5], [0.3, 0, -1])], [Wall([0, 0, 0], [0, 0, 1], [0, 0, 0.5])], GRAVITY
    ),
}
LANES = [(name, alpha) for name in CASES for alpha in (0.0, 0.5, 2.0)]


def pairs_of(balls, walls):
    n = len(balls)
    found = [(i, j) for i in range(n) for j in range(i + 1, n)]
    if n > 3:
        # In a row only neighbours meet.
        found = [(i, i + 1) for i in range(n - 1)]
    return found + [(i, n + k) for i in range(n) for k in range(len(walls))]


def numbers(balls, walls, gravity, bodies=BODIES, slots=SLOTS, dim=DIM):
    """The arrays of a cluster, padded."""
    n, found = len(balls), pairs_of(balls, walls)
    position, velocity = np.zeros((2, bodies, dim))
    inverse, acceleration = np.zeros(bodies), np.zeros((bodies, dim))
    for i, b in enumerate(balls):
        position[i], velocity[i], inverse[i] = b.position, b.velocity, 1 / b.mass
        acceleration[i] = 0.0 if gravity is None else gravity
    for k, w in enumerate(walls):
        position[n + k] = w.point
        velocity[n + k] = 0.0 if w.velocity is None else w.velocity
    ends, flat, used = np.zeros((2, slots), int), np.zeros(slots, bool), np.zeros(slots, bool)
    distance, normal, mass = np.ones(slots), np.zeros((slots, dim)), np.ones(slots)
    closed = np.zeros(slots, bool)
    for k, (i, j) in enumerate(found):
        ends[:, k], flat[k], used[k] = (i, j), j >= n, True
        distance[k] = balls[i].radius + (balls[j].radius if j < n else 0.0)
        apart = position[i] - position[j]
        if j >= n:
            normal[k] = walls[j - n].normal
        gap = (apart @ normal[k] if j >= n else np.linalg.norm(apart)) - distance[k]
        closed[k] = abs(gap) < 1e-12
        mass[k] = 1 / (inverse[i] + inverse[j])
    pairs = ClusterPairs(*ends, distance, normal, flat, used)
    return jax.tree.map(
        jnp.asarray, (pairs, inverse, acceleration, position, velocity, closed, mass)
    )


def follow(case, alpha, until, rtol, v0="peak", **options):
    pairs, inverse, acceleration, position, velocity, closed, mass = case
    start = cluster_at_touch(pairs, position, velocity, closed, v0=v0)
    law, contact = jc.Damped(alpha=alpha), jc.Contact(mass, K)
    problem = ClusterProblem(law, contact, pairs, inverse, acceleration, start, until, rtol)
    return cluster(problem, v0=v0, **options)


in_lanes = jax.jit(jax.vmap(follow, in_axes=(0, 0, 0, None)))


def stacked(cases):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *cases)


@functools.cache
def solved(rtol):
    cases = stacked([numbers(*CASES[name][:3]) for name, _ in LANES])
    until = jnp.array([CASES[name].until for name, _ in LANES])
    alpha = jnp.array([alpha for _, alpha in LANES])
    return jax.tree.map(np.asarray, in_lanes(cases, alpha, until, rtol))


@functools.cache
def reference(name, alpha):
    balls, walls, gravity, until = CASES[name]
    return run(balls, Spring(K, alpha=alpha), until, walls, gravity, until_apart=True)


@pytest.mark.slow("1e-06", reason="the run once more at another tolerance")
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_clusters_end_where_newtons_equations_do(rtol):
    end = solved(rtol)
    for lane, (name, alpha) in enumerate(LANES):
        balls, walls, _, until = CASES[name]
        exact, n = reference(name, alpha), len(CASES[name][0])
        speed = max(np.abs(b.velocity).max() for b in balls)
        state = jax.tree.map(lambda leaf, lane=lane: leaf[lane], end.state)
        assert end.status[lane] == (TIME_IS_UP if exact.time == until else APART), name
        error = np.abs(state.velocity[:n] - exact.velocity).max()
        assert error <= rtol * speed, (name, alpha)
        assert abs(state.time - exact.time) <= 10 * rtol * exact.time, (name, alpha)
        assert np.abs(state.position[:n] - exact.position).max() <= 10 * rtol * speed * exact.time
        last = {touch.pair: touch for touch in exact.touches}
        for k, pair in enumerate(pairs_of(balls, walls)):
            if pair in last:
                touch = last[pair]
                assert abs(state.lost[k] - touch.lost) <= 10 * rtol
                assert abs(state.since[k] - touch.begin) <= 10 * rtol * exact.time
                if alpha:
                    assert abs(state.latched[k] - touch.latched) <= 10 * rtol
                # The reference evaluates its forces five times per step.
                assert abs(state.max_force[k] - touch.max_force) <= 2e-3 * touch.max_force
        assert end.error_estimate[lane] <= rtol


def test_a_chain_ends_at_speeds_on_which_two_codes_agree():
    """Two independent ones, for v0 = the largest closing speed. Elastic ones: `test_soft_runs`."""
    damped = solved(1e-9).state.velocity[LANES.index(("three in a row", 0.5)), :3, 0]
    np.testing.assert_allclose(damped, [-0.01488824, 0.25259641, 0.76229183], atol=6e-9)


def test_momentum_and_energy_are_kept():
    end = solved(1e-9)
    for lane, (name, alpha) in enumerate(LANES):
        balls, walls, gravity, _ = CASES[name]
        if walls or gravity:
            continue
        mass = np.array([b.mass for b in balls])
        before = np.array([b.velocity for b in balls])
        after = end.state.velocity[lane, : len(balls)]
        np.testing.assert_allclose(mass @ after, mass @ before, atol=1e-14)
        lost = mass @ np.sum(before**2 - after**2, axis=1) / 2
        # A pair that touched twice keeps only the loss of its last contact.
        touches = [touch.pair for touch in reference(name, alpha).touches]
        if len(set(touches)) == len(touches):
            np.testing.assert_allclose(end.state.lost[lane].sum(), lost, atol=1e-10)
        if alpha == 0:
            assert abs(lost) < 1e-10


def test_no_step_passes_over_a_touch():
    """Beside a ball at rest, which needs no short steps, two others graze each other for 30 ms."""
    offset, speed = 0.99, 10.0
    waits = np.linspace(0.3, 0.4, len(LANES))
    cases = []
    for wait in waits:
        flying = ball([-speed * wait - np.sqrt(1 - offset**2), offset, 20.0], [speed, 0.0, 0.0])
        balls = [ball([9.0, 0.0, 0.5]), flying, ball([0.0, 0.0, 20.0])]
        cases.append(numbers(balls, [FLOOR], GRAVITY))
    alpha, until = jnp.full(len(LANES), 2.0), jnp.full(len(LANES), 0.6)
    end = in_lanes(stacked(cases), alpha, until, 1e-6)
    met = pairs_of(balls, [FLOOR]).index((1, 2))
    np.testing.assert_allclose(end.state.since[:, met], waits, rtol=1e-5)
    assert np.all(end.state.max_force[:, met] > K * 1e-3**1.5)


LINE = [Ball([float(k)], [1.0 if k == 0 else 0.0]) for k in range(3)]
"""Three just touching balls in one dimension, the first one at speed one."""


@jax.jit
def clamped_three(start):
    """Three balls in a row whose law ends its force before they part."""
    pairs, inverse, acceleration, *_, mass = numbers(LINE, [], None, 3, 3, 1)
    law = jc.AntypovElliott(e=0.5, tension=False)
    contact = jc.Contact(mass, K)
    problem = ClusterProblem(law, contact, pairs, inverse, acceleration, start, FOR_EVER, 1e-9)
    return cluster(problem, until_change=True)


def test_a_solve_goes_on_from_where_it_stopped():
    pairs, *_, position, velocity, closed, _ = numbers(LINE, [], None, 3, 3, 1)
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
    case = numbers(LINE, [], None, 3, 3, 1)
    end = jax.jit(jax.vmap(lambda v0: follow(case, 0.5, FOR_EVER, 1e-6, v0)))(floors)
    np.testing.assert_allclose(end.state.velocity[1:, 2, 0], [0.57, 0.63, 0.81], atol=6e-3)
    for floor, speeds in zip(floors[1:], end.state.velocity[1:], strict=True):
        exact = run(LINE, Spring(K, alpha=0.5), v0=float(floor), until_apart=True)
        np.testing.assert_allclose(speeds, exact.velocity, atol=1e-6)


SPEEDS = (0.3, 0.01, 1e-3)


def test_a_damped_ball_comes_to_rest_on_a_floor():
    cases = [numbers([ball([0, 0, 0.5], [0.2, 0, -v])], [FLOOR], GRAVITY) for v in SPEEDS]
    until, alpha = jnp.full(len(LANES), 50.0), jnp.full(len(LANES), 0.5)
    end = in_lanes(stacked(cases * (len(LANES) // len(cases))), alpha, until, 1e-6)
    end = jax.tree.map(lambda x: np.asarray(x)[: len(SPEEDS)], end)
    np.testing.assert_array_equal(end.status, AT_REST)
    static = (9.81 / K) ** (2 / 3)
    np.testing.assert_allclose(end.state.indentation[:, 0], static, rtol=1e-5)
    # Without friction it continues to slide.
    np.testing.assert_allclose(end.state.velocity[:, 0, 0], 0.2, rtol=1e-12)
    np.testing.assert_allclose(end.state.velocity[:, 0, 2], 0, atol=1e-6)
    assert np.all(end.state.closed[:, 0]) and np.all(end.state.time < 5)


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
    pairs, inverse, acceleration, position, velocity, closed, _ = numbers(
        three_at_once(POINT), [], None, 3, 3, 2
    )
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
        numbers(LINE, [], None, 3, 3, 1),
    )
    some = jnp.asarray(0.5, jnp.float32), jnp.asarray(FOR_EVER, jnp.float32)
    end = jax.jit(follow)(case, *some, jnp.asarray(1e-6, jnp.float32))
    assert end.state.velocity.dtype == jnp.float32 and end.status == APART
    exact = reference("three in a row", 0.5).velocity[:, :1]
    np.testing.assert_allclose(end.state.velocity, exact, atol=1e-5)
