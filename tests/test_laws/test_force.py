"""The force of every law and its first derivatives, against mpmath, in SI units."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_laws.table import VARIANTS

VALUE = 2e-14
"""Relative error of the force: measured 5e-15, where 1 + alpha v/v0 nearly cancels."""

SLOPE = 5e-14
"""Of a derivative: measured 8e-15."""

FITTED = 1e-11
"""For laws whose polynomials of alternating large terms cancel: measured 3e-12, Tsuji at e = 1."""

SMALL = 3e-15
"""Error of a derivative that cancels, by force/argument: measured 1e-15."""

DIGITS = 50


def tolerance(name, usual):
    return FITTED if name.split()[0] in {"tsuji", "thornton"} else usual


# Indentation, its rate, stiffness, mass and closing speed where the force is smooth ...
SMOOTH = [
    (1e-3, 0.8, 1e8, 0.5, 1.0),
    (1e-3, -0.5, 1e8, 0.5, 1.0),
    (2e-5, 3.0, 7e9, 2.0, 4.0),
    (2e-5, -0.9, 7e9, 2.0, 4.0),
    (0.3, 1e-3, 1e4, 1e3, 2e-3),
]
# ... and where it is not: touch, apart, at rest, at the turn, below the threshold of speed.
EDGES = [
    (0.0, 1.0, 1e8, 0.5, 1.0),
    (0.0, -1.0, 1e8, 0.5, 1.0),
    (0.0, 0.0, 1e8, 0.5, 1.0),
    (1e-300, -1.0, 1e8, 0.5, 1.0),
    (-1e-300, 1.0, 1e8, 0.5, 1.0),
    (-1.0, 1.0, 1e8, 0.5, 1.0),
    (-1e-3, -1.0, 1e8, 0.5, 1.0),
    (1e-3, 0.0, 1e8, 0.5, 1.0),
    (1e-3, 1e-10, 1e8, 0.5, 1e-10),
    (1e-3, 0.0, 1e8, 0.5, 0.0),
    (1e-9, -1e3, 1e8, 0.5, 1e-12),
]


def lanes(law):
    """The grid times the parameters of the law, a column for each number."""
    rows = [(*place, *numbers) for numbers in law.parameters for place in SMOOTH + EDGES]
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.fixture(scope="module")
def solved():
    """Force and gradient of each variant on its grid, compiled once."""
    store = {}

    def solve(name):
        if name not in store:
            law = VARIANTS[name]

            def force(d, v, K, m, v0, *numbers):
                contact = jc.Contact(mass=m, stiffness=K, exponent=law.exponent)
                return law.make(*numbers).force(d, v, contact, v0)

            columns = [jnp.asarray(column) for column in lanes(law)]
            both = jax.value_and_grad(force, argnums=tuple(range(len(columns))))
            store[name] = jax.tree.map(np.asarray, jax.jit(jax.vmap(both))(*columns))
        return store[name]

    return solve


@pytest.mark.parametrize("name", VARIANTS)
def test_force(name, solved):
    law = VARIANTS[name]
    found, _ = solved(name)
    with mp.workdps(DIGITS):
        rows = [map(mp.mpf, row) for row in zip(*lanes(law), strict=True)]
        expected = [float(law.force(*row)) for row in rows]
    np.testing.assert_allclose(found, expected, rtol=tolerance(name, VALUE), atol=1e-300)
    apart = -1e-3 if law.cls.ends_apart else 0
    assert np.all(found[lanes(law)[0] < apart] == 0)
    if not law.pulls:
        assert np.all(found >= 0)
    else:
        assert np.any(found < 0)


@pytest.mark.parametrize("name", VARIANTS)
def test_derivatives(name, solved):
    law = VARIANTS[name]
    force, found = solved(name)
    columns = lanes(law)
    assert all(np.all(np.isfinite(column)) for column in found)
    assert np.any(found[1] != 0) == law.make(*law.parameters[0]).damped
    smooth = [i for i in range(len(columns[0])) if i % len(SMOOTH + EDGES) < len(SMOOTH)]
    for argument, slopes in enumerate(found):
        if argument == 4 and law.alpha is None:
            assert np.all(slopes == 0)
            continue
        expected = np.array([slope(law, [c[i] for c in columns], argument) for i in smooth])
        size = np.abs(force / np.where(columns[argument] == 0, 1, columns[argument]))[smooth]
        error = np.abs(slopes[smooth] - expected)
        limit = tolerance(name, SLOPE) * np.abs(expected) + SMALL * size
        assert np.all(error <= limit), (argument, error / limit)


def slope(law, row, argument):
    with mp.workdps(DIGITS):
        row = [mp.mpf(x) for x in row]
        h = mp.mpf("1e-15") * (abs(row[argument]) or 1)

        def at(offset):
            return law.force(*row[:argument], row[argument] + offset, *row[argument + 1 :])

        # e = 1 is the end of the range, and of some formulas.
        if argument == 5 and row[5] == 1:
            return float((3 * at(0) - 4 * at(-h) + at(-2 * h)) / (2 * h))
        # Likewise a loss or a pull-off force of 0.
        if argument == 5 and row[5] == 0 and law.names[0] in ("loss", "pull_off"):
            if law.names[0] == "pull_off":
                # The next power is 3/2.
                h = mp.mpf("1e-30")
            return float((-3 * at(0) + 4 * at(h) - at(2 * h)) / (2 * h))
        # A critical speed of 0 at e = 1.
        if argument == 6 and row[5:] == [1, 0]:
            return float((-3 * at(0) + 4 * at(h) - at(2 * h)) / (2 * h))
        return float((at(h) - at(-h)) / (2 * h))


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("e", [0.9, 0.5, 0.05])
def test_a_derivative_by_no_closing_speed_is_zero(e, kind):
    """Below its floor v0 does not matter; there the damping is so large that slopes overflow."""
    number = functools.partial(jnp.asarray, dtype=kind)
    contact = jc.Contact(number(0.5), number(1e8), 1.5)

    def force(v0):
        return jc.Flores(e=number(e)).force(number(1e-3), number(1.0), contact, v0)

    assert jax.grad(force)(number(0.0)) == jax.jacfwd(force)(number(0.0)) == 0
