"""Derivatives of a coupled solve of some of nine balls in a periodic ring, across its border.

Compared with Newton's equations and their differences, and forward with reverse mode, in one
program.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.scene_oracle import Ball, Spring, run

RING = 6.0
ALPHA, STIFFNESS, DURATION = 0.5, 1e5, 0.3
MASS = np.array([1.0, 2.0, 0.5, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0])

# The first hits the second, which touches the third across the border. Two others meet separately
# before this has ended.
PLACES = np.array([5.749, 5.95, 6.1501, 1.0, 1.21, 2.0, 3.0, 4.0, 5.0])
SPEEDS = np.array([1.0, 0.0, 0.0, 0.6, 0.1, 0.0, 0.0, 0.0, 0.0])
RADII = np.full(9, 0.1)
H = 1e-6
"""A change of all numbers that is far below an indentation."""
WRAPPED = np.where(np.arange(9) == 2, RING, 0.0)
"""The third one is given on the other side of the face."""


@functools.cache
def program():
    def of(places, speeds, radii):
        spheres = [
            jc.Sphere(radii[k], MASS[k], places[k : k + 1] - WRAPPED[k], speeds[k : k + 1])
            for k in range(9)
        ]
        scene = jc.Scene(spheres, jc.Damped(alpha=ALPHA), stiffness=STIFFNESS, periodic=[RING])
        end = jc.simulate(scene, DURATION, rtol=1e-10, max_impacts=8, max_cluster=4)
        state = jnp.concatenate([end.position[-1, :, 0], end.velocity[-1, :, 0]])
        return state, (end.status, end.impacts)

    @jax.jit
    def all_of_it(given, along, weight):
        end, push, rest = jax.linearize(of, *given, has_aux=True)
        pull = jax.linear_transpose(push, *given)
        return end, rest, push(*along), pull(weight)

    return all_of_it


def exact(places, speeds, radii, who):
    balls = [Ball([places[k]], [speeds[k]], radii[k], MASS[k]) for k in who]
    end = run(balls, Spring(STIFFNESS, alpha=ALPHA), DURATION)
    return np.concatenate([end.position[:, 0], end.velocity[:, 0]]), end


def agrees(given, groups, ways, order=2.0):
    """Values and derivatives, both against Newton's equations of the `groups` that meet; `order`:
    with which power of H the error of a central difference goes.
    """
    rng = np.random.default_rng(3)
    weight, along = rng.normal(size=18), tuple(rng.normal(size=9) for _ in given)
    end, (status, impacts), forward, reverse = program()(given, along, weight)
    assert status == jc.Ending.COMPLETED
    # The effect of a change of all numbers on one of them, by both modes.
    one, other = weight @ forward, sum(a @ b for a, b in zip(along, reverse, strict=True))
    assert abs(one - other) <= 1e-9 * np.abs(forward).max() * np.abs(weight).sum()
    hits = impacts.to_dict()
    assert sorted(hits["solved_by"]) == ways
    touched = []
    for who in groups:
        rows = np.array(who + [9 + k for k in who])
        truth, known = exact(*given, who)
        touched += [touch.begin for touch in known.touches]
        turns = np.array([WRAPPED[k] for k in who] + [0.0] * len(who))
        np.testing.assert_allclose(end[rows], truth - turns, rtol=0, atol=1e-9)

        def moved(step, who=who):
            return exact(*[x + step * H * d for x, d in zip(given, along, strict=True)], who)[0]

        one, two = ((moved(k) - moved(-k)) / (2 * k * H) for k in (1, 2))
        slope = one + (one - two) / (2**order - 1)
        atol = 1e-6 * np.abs(slope).max()
        np.testing.assert_allclose(forward[rows], slope, rtol=0, atol=atol)
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(touched), rtol=0, atol=1e-9)
    return touched


@pytest.mark.slow(reason="derivatives of coupled solves")
def test_values_and_derivatives():
    ways = [jc.SolvedBy.CLOSED_FORM, jc.SolvedBy.COUPLED, jc.SolvedBy.COUPLED]
    touched = agrees((PLACES, SPEEDS, RADII), ([0, 1, 2], [3, 4]), ways)
    assert max(touched) < 0.03


@pytest.mark.slow(reason="derivatives of coupled solves")
def test_a_tie():
    """One is hit from both sides at once: the force begins so gently that this has a derivative."""
    places, speeds = PLACES.copy(), 0 * SPEEDS
    places[[3, 4, 5]] = [1.0, 1.25, 1.5]
    speeds[[3, 5]] = [1.0, -1.0]
    # If one starts a time h before the other, the force δ^1.5 adds h^2.5 to the end states.
    agrees((places, speeds, RADII), ([3, 4, 5],), [jc.SolvedBy.COUPLED] * 2, order=1.5)


@pytest.mark.slow(reason="derivatives of coupled solves")
def test_crowds_are_refused():
    """Five in a row, of which four have a place; three that span more than half of the ring."""

    def ended(places, radii):
        given = (places, np.eye(9)[0], radii)
        along = jax.tree.map(jnp.zeros_like, given)
        end, (status, _), _, _ = program()(given, along, jnp.zeros(18))
        assert np.all(np.isnan(end))
        return status

    places = PLACES.copy()
    places[:5] = [5.29, 5.5, 6.1, 5.7, 5.9]
    assert ended(places, RADII) == jc.Ending.CROWDED
    radii = RADII.copy()
    radii[:3] = 0.6
    places[:] = [2.79, 4.0, 5.2 + RING, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8]
    assert ended(places, radii) == jc.Ending.CROWDED
