"""A fit is invariant under units of parameters, data and x, and under a distant start."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

import jaxcontact as jc
from tests.test_fit.curves import fading, line

X = np.linspace(0, 1, 20)
Y = 2 + 3 * X + 0.1 * np.random.default_rng(0).normal(size=20)
CURVED = 2 * np.exp(-3 * X) + 0.02 * np.random.default_rng(1).normal(size=20)

SAME = 1e-8  # of a value, or 1e-5 of its error
ERRORS = 1e-6
"""Standard errors follow from a Jacobian, whose singular values are accurate to rounding."""

units = st.integers(-12, 12).map(lambda k: 10.0**k)


def in_units(curve):
    def predict(p, x):
        return curve({name: p[name] / p["unit"] for name in "ab"}, x / p["across"]) * p["out"]

    return predict


straight, decay = in_units(line), in_units(fading)
HELD = {name: jc.Fixed() for name in ("unit", "out", "across")}


def fitted(predict, y, start, unit=1.0, out=1.0, across=1.0, **how):
    """Parameters and standard errors without their unit."""
    a, b = (unit * s for s in start)
    begin = {"a": a, "b": b, "unit": unit, "out": out, "across": across}
    found = jc.fit(predict, y * out, begin, x=X * across, transforms=HELD, **how)
    assert found.converged, found.reason
    assert found.loss / out**2 == pytest.approx(LOSSES[predict], rel=1e-6)
    return found.values / unit, found.errors / unit


def by_scipy(curve, y):
    """Parameters, their standard errors and the loss."""
    best, spread = curve_fit(curve, X, y, (2, 3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return best, np.sqrt(np.diag(spread)), np.sum((curve(X, *best) - y) ** 2) / 2


BEST, ERROR, LOSS = by_scipy(lambda x, a, b: a + b * x, Y)
BENT, BENT_ERROR, BENT_LOSS = by_scipy(lambda x, a, b: a * np.exp(-b * x), CURVED)
LOSSES = {straight: LOSS, decay: BENT_LOSS}


def assert_same(got, best, error):
    values, errors = got
    assert (np.abs(values - best) <= np.maximum(SAME * np.abs(best), 1e-5 * error)).all()
    np.testing.assert_allclose(errors, error, rtol=ERRORS)


@settings(max_examples=30)
@given(units, units, units)
def test_a_line_in_any_units(unit, out, across):
    # From zero, with a scale that only the data determine.
    assert_same(fitted(straight, Y, (0.0, 0.0), unit, out, across), BEST, ERROR)


@settings(max_examples=30)
@given(units, units, st.sampled_from([1e-6, 1.0, 1e6, -1e6]))
def test_a_line_from_far_away(unit, out, far):
    assert_same(fitted(straight, Y, (2 * far, 3 * far), unit, out), BEST, ERROR)


@settings(max_examples=30)
@given(units, units, units)
def test_a_curve_in_any_units(unit, out, across):
    assert_same(fitted(decay, CURVED, (1.0, 1.0), unit, out, across), BENT, BENT_ERROR)


def test_other_starts_have_no_unit_either():
    units = (1.0, 1.0), (1e-9, 1e6)
    ends = [fitted(decay, CURVED, (1.0, 1.0), *one, starts=4)[0] for one in units]
    np.testing.assert_allclose(*ends, rtol=1e-7)


def above_an_offset(p, x):
    return p * x + 5e6


@pytest.mark.parametrize("start", [0.0, 1.0, 1e7, 3e13, -1e14])
def test_a_large_offset_in_the_data(start):
    found = jc.fit(above_an_offset, 3e7 * X + 5e6, start, x=X)
    assert found.converged and found.params == pytest.approx(3e7, rel=SAME)


@pytest.mark.parametrize("start", [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (1e-9, 1e9)])
@pytest.mark.parametrize("level", [0.0, 2.0])
def test_a_parameter_whose_true_value_is_zero(start, level):
    found = jc.fit(line, np.full(20, level), dict(zip("ab", start, strict=True)), x=X)
    assert found.converged, found.reason
    np.testing.assert_allclose(found.values, [level, 0], atol=SAME * (level or max(start)))
