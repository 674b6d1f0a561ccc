"""One isolated soft impact, against Newton's equations and its limits."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._impact import Status
from jaxcontact._scene.pair_impact.oblique import oblique
from jaxcontact._scene.result import SolvedBy
from tests.oracle.scene_oracle import Ball, Spring, run

MASSES = np.array([1.0, 2.0])
MASS = MASSES.prod() / MASSES.sum()
CASES = np.array(
    [
        (alpha, turned, across)
        for turned in (1e-5, 4e-3, 0.1)
        for alpha in (0.0, 0.5, 1.5, 8.0)
        for across in (0.3, 3.0)
    ]
)
"""Damping, about v_t T/d, and the tangential speed; the normal speed and d are 1."""


ROUNDING = 2e-12  # of the radial solve at its finest, and of differences of turns of some 1e-7 rad


def stiffness(turned, across):
    return MASS / (turned / across / 3.2) ** 2.5


def solved(rows, rtol):
    """Any number of lanes, by one compiled program for 24."""
    hit = _solved(jnp.resize(rows, (len(CASES), 7)), jnp.asarray(rtol, rows.dtype))
    return jax.tree.map(lambda out: np.asarray(out)[: len(rows)], hit)


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, None))
def _solved(numbers, rtol):
    alpha, k, mass, normal, across, distance, pull = numbers
    law, contact = jc.Damped(alpha=alpha), jc.Contact(mass, k)
    return oblique(law, contact, normal, across, distance, pull, rtol=rtol)


def lanes(dtype=float):
    alpha, turned, across = CASES.T
    one = np.ones_like(alpha)
    columns = (alpha, stiffness(turned, across), MASS * one, one, across, one, 0 * one)
    return jnp.asarray(np.stack(columns, axis=1), dtype)


def by_force(spring, normal, across, distance=1.0, masses=MASSES):
    balls = [
        Ball([0.0, 0.0], [0.0, 0.0], distance / 2, masses[0]),
        Ball([distance, 0.0], [-normal, across], distance / 2, masses[1]),
    ]
    return run(balls, spring, until_apart=True)


@functools.cache
def reference():
    springs = [Spring(stiffness(turned, v), alpha=a) for a, turned, v in CASES]
    return [by_force(spring, 1.0, v) for spring, v in zip(springs, CASES[:, 2], strict=True)]


def velocities(e, turn, normal, across, masses=MASSES):
    """Of both bodies, from what an impact returns: the second one flies at the resting first."""
    n = np.array([np.cos(turn), np.sin(turn)])
    t = np.array([-np.sin(turn), np.cos(turn)])
    relative = e * normal * n + across * t
    centre = masses[1] * np.array([-normal, across]) / masses.sum()
    shares = masses[::-1] / masses.sum()
    return centre + np.outer(shares * [-1, 1], relative)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_velocities_duration_and_loss_are_those_of_newtons_equations(rtol):
    hit = solved(lanes(), rtol)
    assert set(np.asarray(hit.status)) == {int(Status.SEPARATED)}
    for k, (_, _, across) in enumerate(CASES):
        exact, speed = reference()[k], max(1.0, across)
        found = velocities(float(hit.restitution[k]), float(hit.turn[k]), 1.0, across)
        error = np.abs(found - exact.velocity).max()
        assert error <= rtol * speed
        assert abs(hit.elapsed[k] / exact.time - 1) <= 10 * rtol
        lost = exact.touches[0].lost
        assert abs(hit.energy_loss[k] - lost) <= rtol
        # The reference evaluates its forces five times per step.
        assert 0 <= hit.max_force[k] / exact.touches[0].max_force - 1 + rtol < 1e-3
        # The estimate refers to the velocities, in units of the normal speed.
        assert error <= 3 * float(hit.error_estimate[k]) + 1e-12 < rtol


def test_the_closed_form_is_nearer_than_it_says():
    """Over damping, sliding, ratios of indentation to distance of both signs, pushes and pulls."""
    random = np.random.default_rng(0)
    count = 40 * len(CASES)

    def spread(low, high, zeros, signed):
        size = 10 ** random.uniform(low, high, count) * (random.random(count) > zeros)
        return size * np.where(signed & (random.random(count) < 0.4), -1, 1)

    alpha = 5 * random.uniform(0, 1, count) ** 2 * (random.random(count) > 0.1)
    across, ratio = spread(-1, 1, 0.1, False), spread(-4, -1, 0.2, True)
    pull = spread(-4, -0.5, 0.5, True)
    distance = 1 / np.where(ratio == 0, np.finfo(float).tiny, ratio)
    one = np.ones(count)
    rows = np.stack([alpha, one, one, one, across, distance, pull], axis=1)
    chunks = jnp.asarray(rows).reshape(-1, len(CASES), 7)
    near, exact = (
        jax.tree.map(lambda *x: np.concatenate(x), *(solved(chunk, rtol) for chunk in chunks))
        for rtol in (0.1, 1e-13)
    )
    kept = (near.solved_by == SolvedBy.CLOSED_FORM) & (exact.solved_by == SolvedBy.RADIAL)
    assert np.sum(kept) > 0.2 * count and np.all(exact.status[kept] == int(Status.SEPARATED))

    def off(name):
        return np.abs(getattr(near, name)[kept] - getattr(exact, name)[kept])

    e, T, v = exact.restitution[kept], exact.elapsed[kept], across[kept]
    errors = [off("restitution"), off("turn") * np.hypot(e, v)]
    errors += [off("elapsed") * (1 + e) / T, off("energy_loss") / (1 + e)]
    errors += [off(name) / getattr(exact, name)[kept] for name in ("max_force", "max_indentation")]
    bound = near.error_estimate[kept] + ROUNDING
    assert np.max(bound) > 5e-3 and np.max(errors / bound) < 0.4


def test_single_precision_keeps_its_digits():
    single, double = solved(lanes(jnp.float32), 1e-6), solved(lanes(), 1e-9)
    for name, tolerance in {"restitution": 2e-5, "turn": 1e-5, "max_force": 1e-5}.items():
        left, right = np.asarray(getattr(single, name)), np.asarray(getattr(double, name))
        assert left.dtype == np.float32
        np.testing.assert_allclose(left, right, rtol=tolerance, atol=tolerance)
    assert not np.any(single.status)


def test_head_on_and_slightly_oblique_impacts_are_the_closed_form():
    row = lanes()[2]
    some = jnp.stack([row.at[4].set(v) for v in (0.0, 1e-5, 1e-2)])
    hit = solved(some, 1e-9)
    assert list(np.asarray(hit.solved_by)) == [
        SolvedBy.CLOSED_FORM,
        SolvedBy.CLOSED_FORM,
        SolvedBy.RADIAL,
    ]
    free = jc.impact(jc.Damped(alpha=row[0]), jc.Contact(row[2], row[1]), 1.0)
    for name in ("restitution", "duration", "max_force", "max_indentation", "energy_loss"):
        np.testing.assert_allclose(getattr(hit, name)[0], getattr(free, name), rtol=1e-14)
    assert hit.turn[0] == 0 and np.all(hit.elapsed[:2] == hit.duration[:2])
    # The rotation is the remaining first-order effect: tangential speed times duration over
    # distance.
    np.testing.assert_allclose(hit.turn[1], 1e-5 * hit.duration[1], rtol=1e-2)


def test_a_pull_against_a_plane_is_that_of_an_impact():
    """And a push away from it."""
    speeds = np.array([3.0, 1.0, 0.3, 0.01, 0.001, 1.0, 1.0])
    rows = [[0.5, 1e4, 1.0, v, 0.0, jnp.inf, 9.81] for v in speeds[:5]]
    rows += [[0.0, 1e4, 1.0, 1.0, 5.0, jnp.inf, 9.81], [0.5, 1e4, 1.0, 1.0, 0.0, jnp.inf, -5.0]]
    rows = jnp.array(rows)
    hit = solved(rows, 1e-9)
    law = jc.Damped(alpha=rows[:, 0])
    how = jc.Event(rtol=1e-11)
    same = jc.impact(law, jc.Contact(1.0, 1e4), speeds, external_force=rows[:, 6], method=how)
    np.testing.assert_array_equal(hit.status, same.status)
    assert int(Status.SETTLED) in hit.status and not np.any(hit.turn)
    for name in ("restitution", "duration", "max_force", "max_indentation"):
        np.testing.assert_allclose(getattr(hit, name), getattr(same, name), rtol=1e-8)


def test_a_clamped_law_lasts_longer_than_its_force():
    """By the radial solve and, head-on, by formula: the bodies coast until they are apart."""
    k, law = 1e4, jc.AntypovElliott(e=0.6, tension=False)
    c = 2 * float(law.damping_ratio()) * np.sqrt(2.5 / 2) * np.sqrt(k * MASS)

    def solve(across, free=False):
        v = jnp.ones_like(across)
        return oblique(law, jc.Contact(MASS, k), v, across, v, 0 * v, rtol=1e-9, free=free)

    both = jax.jit(jax.vmap(solve))(jnp.array([1.0, 0.0]))
    head_on = jax.tree.map(lambda x: x[None], jax.jit(lambda v: solve(v, free=True))(jnp.zeros(())))
    hit = jax.tree.map(lambda *x: np.concatenate(x), both, head_on)
    ways = [SolvedBy.RADIAL, SolvedBy.CLOSED_FORM, SolvedBy.CLOSED_FORM]
    np.testing.assert_array_equal(hit.solved_by, ways)
    for lane, across in enumerate([1.0, 0.0, 0.0]):
        exact = by_force(Spring(k, c=c), 1.0, across)
        found = velocities(float(hit.restitution[lane]), float(hit.turn[lane]), 1.0, across)
        np.testing.assert_allclose(found, exact.velocity, atol=1e-9)
        np.testing.assert_allclose(hit.elapsed[lane], exact.time, rtol=1e-9)
    assert np.all(hit.duration < 0.95 * hit.elapsed)


def test_bad_lanes_are_flagged_and_leave_their_neighbours_alone():
    row = lanes()[9]
    bad = [row.at[place].set(x) for place, x in [(0, -1.0), (3, 0.0), (4, jnp.nan), (5, 0.0)]]
    hit = solved(jnp.stack([row, *bad, row]), 1e-9)
    expected = [0, *[int(Status.INVALID_INPUT)] * 4, 0]
    np.testing.assert_array_equal(hit.status, expected)
    good = np.array(expected) == 0
    for value in (hit.restitution, hit.turn, hit.elapsed, hit.max_force):
        np.testing.assert_array_equal(np.isfinite(value), good)


def test_the_derivative_across_is_that_of_a_free_impact_where_nothing_turns():
    """Where it turns: `test_gradients`."""

    def outcome(numbers):
        alpha, k, mass, *rest = numbers
        hit = oblique(jc.Damped(alpha=alpha), jc.Contact(mass, k), *rest, rtol=1e-11)
        return jnp.stack([hit.restitution, hit.turn, hit.elapsed, hit.energy_loss])

    point = lanes()[2].at[4].set(0.0)
    reverse = jax.jit(jax.jacrev(outcome))(point)
    assert np.all(np.isfinite(reverse))
    duration = solved(point[None], 1e-9).elapsed[0]
    np.testing.assert_allclose(reverse[1, 4], duration, rtol=1e-2)
    assert reverse[0, 4] == 0
