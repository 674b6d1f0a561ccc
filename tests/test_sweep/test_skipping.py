"""Independent arrays are not computed again, and the numbers do not change."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxcontact as jc

SAME = 2e-15
"""XLA fuses and vectorises another batch otherwise: measured 0 in most fields, 9e-16 in a slope."""

EVENT = 1e-9  # the tolerance of the event solves, whose steps follow the roundings: measured 6e-11

GOOD = {"e": [0.3, 0.7, 0.9, 1.0], "K": [1e8, 1e6, 3e7], "m": [2.0, 0.5], "v": [1.0, 3.0, 0.2]}
BAD = {"e": [0.3, 1.5, 0.9, np.nan], "K": [1e8, -1.0, 1e6], "m": [2.0, 0.0], "v": [1.0, 3.0, -1.0]}


def impact_of(law, method="exact"):
    return lambda e, K, m, v: jc.impact(law(e), jc.Contact(m, K), v, method=method)


summary = impact_of(lambda e: jc.HuGuo(e=e))


def alone(e, K, m, v):
    return jc.restitution(jc.HuGuo(e=e), jc.Contact(m, K), v)


def slope(e, K, m, v):
    return jax.grad(lambda e: jc.restitution(jc.HuGuo(e=e), jc.Contact(m, K), v))(e)


def branches(e, K, m, v):
    """A choice between two values is no check."""
    return {
        "chosen": jnp.where(v > 2, alone(e, K, m, v), K),
        "cond": jax.lax.cond(v > 2, lambda: e, lambda: m * e),
        "loop": jax.lax.fori_loop(0, 3, lambda _, x: x * e, v),
        "constant": jnp.ones(2),
    }


def hertzian(e, K, m, v):
    """The check of a stiffness that is computed from two inputs concerns both."""
    return alone(e, K - 1e5 * m, m, v)


FUNCTIONS = {
    "summary": summary,
    "stepped": impact_of(lambda e: jc.HuGuo(e=e), "event"),
    "phased": impact_of(lambda e: jc.Flores(e=e), "phase"),
    "damped": impact_of(lambda e: jc.ConstantDamping(c=1e7 * e)),
    **{f.__name__: f for f in (alone, slope, branches, hertzian)},
}


@functools.cache
def every_lane(function, names):
    return jax.jit(jax.vmap(lambda *a: function(**dict(zip(names, a, strict=True)))))


def plainly(function, axes):
    """Every lane in full: one vmap over all lanes."""
    grids = np.meshgrid(*(np.asarray(axis, float) for axis in axes.values()), indexing="ij")
    shape = grids[0].shape
    out = every_lane(function, tuple(axes))(*(jnp.asarray(grid.reshape(-1)) for grid in grids))
    return jax.tree.map(lambda leaf: np.asarray(leaf).reshape(shape + leaf.shape[1:]), out)


def fields(output):
    if not isinstance(output, dict | jc.Impact):
        return {"value": output}
    named = output if isinstance(output, dict) else vars(output)
    return {k: a for k, a in named.items() if a is not None and not isinstance(a, str)}


@functools.cache
def swept(function, bad=False):
    """The table over good or bad axes, which several tests look at."""
    return jc.sweep(function, **(BAD if bad else GOOD))


@pytest.mark.slow("stepped", reason="event solves in two sweeps and in full, 13 s of CPU")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_as_the_full_computation(name):
    function, tolerance = FUNCTIONS[name], EVENT if name == "stepped" else SAME
    for bad in (False, True):
        table = swept(function, bad)
        for field, expected in fields(plainly(function, BAD if bad else GOOD)).items():
            # 1 - e² has no digits left for e near 1, and one step more or less is not an error.
            largest = np.nanmax(expected) if field == "energy_loss" else 0.0
            atol = 1 if field == "steps" else tolerance * largest
            how = {"rtol": tolerance, "atol": atol, "err_msg": field}
            np.testing.assert_allclose(table[field], expected, **how)
            assert table[field].dtype == expected.dtype


AXES = {
    "restitution": "e", "rebound_velocity": "ev", "energy_loss": "emv", "duration": "eKmv",
    "max_force": "eKmv", "status": "e",
}  # fmt: skip


@pytest.mark.parametrize("method", ["summary", "stepped", "phased"])
def test_stored_over_what_they_depend_on(method):
    table = swept(FUNCTIONS[method])
    for name, expected in AXES.items():
        assert "".join(table.dims[d] for d in table.columns()[name].dims) == expected, name
        # A view: nothing is stored along the other axes.
        array = table[name]
        assert array.shape == table.shape
        for dim, stride in zip(table.dims, array.strides, strict=True):
            assert (stride == 0) == (dim not in expected)


def test_64_to_the_fourth_takes_64_solves():
    axes = {
        "e": np.linspace(0.05, 1, 64),
        "K": np.geomspace(1e5, 1e9, 64),
        "m": np.geomspace(0.01, 10, 64),
        "v": np.geomspace(0.01, 10, 64),
    }
    work = []
    table = jc.sweep(alone, progress=lambda done, total: work.append((done, total)), **axes)
    # 64 solves; and the checks, 64 of each axis side by side.
    assert work == [(64, 128), (128, 128)]
    assert table.value.shape == (64,) * 4
    assert table.value.strides[1:] == (0, 0, 0)
    assert table.columns()["value"].values.size == 64
    assert table.status_counts() == {int(jc.Status.SEPARATED): 64**4}
    ends = [axis if name == "e" else axis[[0, -1]] for name, axis in axes.items()]
    expected = np.asarray(alone(*np.ix_(*map(jnp.asarray, ends))))
    np.testing.assert_allclose(table.value[:, ::63, ::63, ::63], expected, rtol=SAME)


def test_a_bad_number_shows_in_its_lanes_only():
    table = swept(alone, bad=True)
    good = np.zeros(table.shape, bool)
    good[np.ix_([0, 2], [0, 2], [0], [0, 1])] = True
    expected = np.where(good, int(jc.Status.SEPARATED), int(jc.Status.INVALID_INPUT))
    np.testing.assert_array_equal(table.status, expected)
    np.testing.assert_array_equal(np.isfinite(table.value), good)


def test_what_has_effects_is_run_for_every_lane():
    seen = []

    def watched(e, K):
        jax.debug.callback(lambda e, K: seen.append((float(e), float(K))), e, K)
        return 2 * e

    table = jc.sweep(watched, e=[0.1, 0.2], K=[1.0, 2.0, 3.0])
    jax.effects_barrier()
    assert sorted(seen) == sorted(itertools.product([0.1, 0.2], [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(table.value, [[0.2] * 3, [0.4] * 3])


def test_random_numbers_inside():
    key = jax.random.key(7)

    def noisy(e, v):
        return jnp.where(v > 0, e + jax.random.normal(key, (2,)), jnp.nan)

    table = jc.sweep(noisy, e=[0.1, 0.2], v=[1.0, -1.0])
    assert table.value.shape == (2, 2, 2)
    expected = np.array([[0.1], [0.2]]) + np.asarray(jax.random.normal(key, (2,)))
    np.testing.assert_allclose(table.value[:, 0], expected, rtol=SAME)
    assert np.all(np.isnan(table.value[:, 1]))


numbers = st.one_of(st.floats(0.05, 3.0), st.sampled_from([0.0, -1.0, np.nan, np.inf, 1.0, 2.0]))

# One length in each place, a part of the last axis, several of it, all: each is compiled.
SHAPES = [((3, 2, 4), most) for most in (1, 3, 7, 40)]
SHAPES += [((1, 2, 3), 40), ((2, 1, 3), 4), ((2, 3, 1), 2), ((1, 1, 1), 1)]


def mixture(a, b, c, xp=jnp):
    """Checks and choices of many kinds, over three inputs, in JAX or NumPy."""
    good = (a > 0) & (b >= 0) & ~(c > 2.5)
    inner = xp.where(good, a * xp.where(b > 1, b, 1.0), xp.nan)
    return {
        "masked": xp.where((a > 0) & (c < 2), a + 1, xp.nan), "inner": inner,
        "again": xp.where(xp.isnan(inner), 7.0, inner),
        "number": xp.where((b > 0) | (c > 0), a, -3.0),
        "whole": xp.where(good & xp.isfinite(a), 1, 2),
        "nested": xp.where(b > 0, xp.where(c > 0, a, xp.nan), xp.nan) * 2 + 1, "flag": good,
        "not": xp.where(~(b < 1), a, 5.0), "power": xp.where(b > 0, a, xp.nan) ** 0,
    }  # fmt: skip


def mixed(a, b, c):
    return mixture(a, b, c)


@settings(max_examples=24)
@given(data=st.data(), shape=st.sampled_from(SHAPES))
def test_against_a_loop_in_python(data, shape):
    lengths, most = shape
    a, b, c = (data.draw(st.lists(numbers, min_size=n, max_size=n)) for n in lengths)
    table = jc.sweep(mixed, a=a, b=b, c=c, batch_size=most)
    with np.errstate(all="ignore"):
        for place in itertools.product(*map(range, table.shape)):
            lane = [np.float64(x[i]) for x, i in zip((a, b, c), place, strict=True)]
            for name, expected in mixture(*lane, xp=np).items():
                np.testing.assert_array_equal(table[name][place], expected, err_msg=name)


def test_zeros_of_both_signs():
    """They are different numbers of an axis where the function tells them apart."""

    def function(x, y):
        return {
            "inverse": 1 / x,
            "chosen": jnp.where(y > 0, 0.0, -0.0),
            "inverse of chosen": 1 / jnp.where(y > 0, 0.0, -0.0),
            "array": 1 / jnp.where(y > 0, jnp.array([0.0, -0.0]), 0.0),
        }

    axes, inf = {"x": [0.0, -0.0, 1.0], "y": [-1.0, 0.0, 2.0]}, np.inf
    table = identical(function, axes)
    np.testing.assert_array_equal(table["inverse"][:, 0], [inf, -inf, 1.0])
    np.testing.assert_array_equal(table["inverse of chosen"][0], [-inf, -inf, inf])
    assert table.select(x=0.0)["inverse"][0] == inf
    assert table.select(x=-0.0)["inverse"][0] == -inf


def test_arrays_without_elements():
    """A sum of nothing is no NaN, whatever the lane is."""

    def function(x, y):
        empty = jnp.where(x > 0, y, jnp.nan) * jnp.zeros((0,))
        return {"sum": jnp.sum(empty), "max": jnp.max(empty, initial=x), "empty": empty}

    table = identical(function, {"x": [1.0, -1.0], "y": [1.0, 2.0, 3.0]})
    assert table["empty"].shape == (2, 3, 0)
    np.testing.assert_array_equal(table["sum"], 0)


def identical(function, axes):
    """The table, which is that of all lanes in full bit for bit, but for the bits of NaN."""
    table = jc.sweep(function, **axes)
    for name, expected in fields(plainly(function, axes)).items():
        found = np.asarray(table[name])
        assert found.dtype == expected.dtype and found.shape == expected.shape, name
        np.testing.assert_array_equal(found, expected, err_msg=name)
        if found.dtype.kind == "f":
            same = np.signbit(found) == np.signbit(expected)
            assert np.all(same | np.isnan(found)), name
    return table


UNARY = {
    **{"neg": jnp.negative, "abs": jnp.abs, "sqrt": jnp.sqrt, "floor": jnp.floor},
    **{"sign": jnp.sign, "isnan": lambda x: jnp.isnan(x).astype(float), "half": lambda x: x / 2},
    **{"square": jnp.square, "whole": lambda x: jnp.nan_to_num(x).astype(int).astype(float)},
    **{"power": lambda x: x**0, "sum": lambda x: jnp.sum(x * jnp.ones(3))},
    **{"none": lambda x: jnp.sum(x * jnp.ones(0)), "barrier": jax.lax.optimization_barrier},
}
BINARY = {
    **{"add": jnp.add, "mul": jnp.multiply, "div": jnp.divide, "max": jnp.maximum},
    **{"min": jnp.minimum, "less": lambda x, y: (x < y).astype(float), "copysign": jnp.copysign},
    **{"rem": jnp.fmod, "cond": lambda x, y: jax.lax.cond(x > y, lambda: x, lambda: y * 2)},
    "loop": lambda x, y: jax.lax.fori_loop(0, 2, lambda _, z: jnp.maximum(z, x) + 1, y),
}
CHOICES = {
    "where": lambda x, y, z: jnp.where(x > 0, y, z),
    "check": lambda x, y, z: jnp.where((x > 0) & jnp.isfinite(y), z, jnp.nan),
    "either": lambda x, y, z: jnp.where((x >= 1) | ~(y < 2), z, -3.0),
    "select": lambda x, y, z: jnp.select([x > 1, y > 1], [z, x], 0.0),
}
OPERATIONS = [*UNARY.items(), *BINARY.items(), *CHOICES.items()]
CONSTANTS = [0.0, -0.0, 1.0, np.nan, np.inf, 2.0]


@st.composite
def programs(draw):
    """A function of three numbers: each step takes what came before it, or a constant."""
    steps = []
    for number in range(draw(st.integers(1, 12))):
        name, operation = draw(st.sampled_from(OPERATIONS))
        count = 1 if name in UNARY else 2 if name in BINARY else 3
        place = st.integers(0, 2 + len(CONSTANTS) + number)
        steps.append((operation, [draw(place) for _ in range(count)]))
    kept = draw(st.lists(st.integers(0, len(steps) - 1), min_size=1, max_size=3, unique=True))

    def function(a, b, c):
        values = [a, b, c, *map(jnp.asarray, CONSTANTS)]
        for operation, places in steps:
            values.append(operation(*(values[k] for k in places)))
        return {str(k): values[3 + len(CONSTANTS) + k] for k in kept}

    return function


signed = st.one_of(numbers, st.sampled_from([-0.0, -np.inf, 5e-324]))
axes_of_two = st.lists(signed, min_size=1, max_size=3)


@pytest.mark.slow(reason="twenty random programs, each compiled twice")
@settings(max_examples=20)
@given(function=programs(), a=axes_of_two, b=axes_of_two, c=axes_of_two)
def test_any_program(function, a, b, c):
    identical(function, {"a": a, "b": b, "c": c})
