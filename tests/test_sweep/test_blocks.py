"""Blocks: every lane once, for any size, order and padding."""

import functools
import math
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxcontact as jc
from jaxcontact._sweep.planning.blocks import divide, places_of

SAME = 2e-15  # blocks of another length are vectorised otherwise: measured 4e-16

RNG = np.random.default_rng(4)
LANES = 1003
SAMPLES = {"e": RNG.uniform(0.05, 1.1, LANES), "v": RNG.uniform(-0.5, 10, LANES)}


GRID = {"e": [0.3, 0.7, 1.2], "v": [0.5, 2.0, -1.0, 4.0, 8.0], "K": [1e6, 1e7, -1e8, 1e9]}


def summary(e, v, K=1e8):
    return jc.impact(jc.HuGuo(e=e), jc.Contact(1.0, K), v)


def close(a, b, fields=("restitution", "duration", "max_force", "energy_loss")):
    np.testing.assert_array_equal(a.status, b.status)
    for name in fields:
        np.testing.assert_allclose(a[name], b[name], rtol=SAME, err_msg=name)


@pytest.fixture(scope="module")
def at_once():
    return jc.sweep(summary, samples=SAMPLES)


@given(shape=st.lists(st.integers(1, 30), min_size=0, max_size=4), most=st.integers(1, 300))
def test_every_lane_is_in_one_block(shape, most):
    block = divide(shape, most)
    assert math.prod(block) <= most
    count = np.zeros(shape, int)
    for place in places_of(shape, block):
        count[place] += 1
        assert all(s.stop - s.start <= n for s, n in zip(place, block, strict=True))
    assert np.all(count == 1)


def test_long_axes_have_blocks_of_one_shape():
    assert divide((10**7,), 65536) == divide((10**7 + 1,), 65536) == (65536,)
    # A small number of blocks is made nearly equal, with little padding.
    assert divide((101,), 100) == (51,)
    assert divide((41, 1000), 40_000) == (21, 1000)


@pytest.fixture(scope="module")
def grid():
    return jc.sweep(summary, **GRID)


COSTS = None, lambda K: K, lambda e, v: e * v, lambda v, e: e


@pytest.mark.parametrize(
    ("axes", "most", "cost"),
    [({"samples": SAMPLES}, most, cost) for most in (1000, 64) for cost in (None, lambda e: 1 / e)]
    + [(GRID, most, None) for most in (1, 5, 12)]
    + [(GRID, 7, cost) for cost in COSTS],
)
def test_lanes_in_blocks(at_once, grid, axes, most, cost):
    table, expected = jc.sweep(summary, **axes, batch_size=most, cost=cost), grid
    if axes is not GRID:
        assert table.shape == (LANES,) and table.dims == ("sample",)
        expected = at_once
    close(table, expected)


def test_samples_are_lanes(at_once):
    lane = summary(jnp.asarray(SAMPLES["e"]), jnp.asarray(SAMPLES["v"]))
    np.testing.assert_array_equal(at_once.status, lane.status)
    np.testing.assert_allclose(at_once.duration, lane.duration, rtol=SAME)


def test_an_axis_for_every_sample(at_once):
    table = jc.sweep(summary, samples=SAMPLES, K=[1e8, 1e6], batch_size=100)
    assert table.shape == (LANES, 2) and table.dims == ("sample", "K")
    close(table.select(K=1e8), at_once)


def test_a_fold_sees_every_lane_once_and_in_order(at_once):
    def fold(blocks, block):
        return [*blocks, np.stack([*block.axes.values(), block.max_force])]

    table = jc.sweep(summary, samples=SAMPLES, batch_size=100, reduce=([], fold))
    assert table.complete and len(table.value) > 9
    *axes, force = np.concatenate(table.value, axis=1)
    np.testing.assert_array_equal(axes, list(SAMPLES.values()))
    np.testing.assert_allclose(force, at_once.max_force, rtol=SAME)


def test_a_fold_over_a_grid_knows_the_status():
    def fold(counts, block):
        assert block.shape == block.status.shape
        return counts + Counter(block.status.ravel().tolist())

    def alone(e, v):
        return jc.restitution(jc.HuGuo(e=e), jc.Contact(1.0, 1e8), v)

    axes = {"e": [0.3, 0.7, 1.2], "v": [0.5, 2.0, -1.0, 4.0]}
    counts = jc.sweep(alone, **axes, batch_size=4, reduce=(Counter(), fold)).value
    assert counts == jc.sweep(alone, **axes).status_counts() == {0: 6, 3: 6}


def test_one_lane_and_none():
    table = jc.sweep(summary, e=0.5, v=1.0)
    assert table.shape == () and table.restitution.shape == ()
    np.testing.assert_allclose(table.restitution, summary(0.5, 1.0).restitution, rtol=SAME)
    assert jc.sweep(lambda: jnp.arange(3)).value.shape == (3,)


def test_own_shapes():
    def courses(e, v, K):
        return {"line": e * jnp.arange(3.0), "plane": jnp.where(K > 0, v, jnp.nan) * jnp.eye(2)}

    table = jc.sweep(courses, e=[0.3, 0.6], v=[1.0, 2.0, 3.0], K=[1.0, -1.0], batch_size=2)
    assert table.line.shape == (2, 3, 2, 3) and table.plane.shape == (2, 3, 2, 2, 2)
    np.testing.assert_array_equal(table.line[1, 1, 0], 0.6 * np.arange(3.0))
    np.testing.assert_array_equal(table.plane[1, 2, 0], 3 * np.eye(2))
    assert np.all(np.isnan(table.plane[..., 1, :, :]))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"u": [1.0]}, r"Argument `u` must be an argument of `fn`.*e, v, K"),
        ({"e": [0.5]}, r"Argument `v` of `fn` must be given.*only: e"),
        ({"samples": {"e": [1.0], "v": [1.0, 2.0]}}, "one length, but has e: 1, v: 2"),
        ({"samples": {"e": [1.0]}, "e": [0.5], "v": 1.0}, "`e` must be given once"),
        ({"e": [0.5], "v": 1.0, "store": "a", "reduce": (0, max)}, "`store` must be None"),
        ({"e": [0.5], "v": 1.0, "cost": lambda e: (e, e)}, "`cost` must return one number"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        jc.sweep(summary, **arguments)


def test_loops_of_unknown_length_get_smaller_blocks():
    def searched(e):
        """Whose loop stands inside of a branch."""
        grow = functools.partial(jax.lax.while_loop, lambda x: x < 1, lambda x: 2 * x)
        return jax.lax.cond(e > 0, grow, jnp.sin, e)

    def halved(e):
        return jax.lax.fori_loop(0, 3, lambda _, x: x / 2, e)

    def largest_block(fn):
        done = [0]
        jc.sweep(fn, samples={"e": np.linspace(0.1, 1, 1100)}, progress=lambda d, _: done.append(d))
        return max(np.diff(done))

    # Blocks are made nearly equal: three of 367 lanes.
    assert largest_block(searched) == 367 and largest_block(halved) == 1100
