"""Fits that could claim too much: saddles, ends of wide intervals, zero weights, small units."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._fit import AbstractErrors, refit

X = np.linspace(0, 1, 80)
NOISE = np.random.default_rng(4).standard_t(2, size=80)
START = {"a": 0.0, "b": 0.0}

SAME = 1e-6
"""Two searches of one minimum, each stopped within a small part of 1e-3 standard errors."""

LARGE_SAMPLE = 0.03
"""Measured: 0.2 % to 1.1 % for six seeds; forgetting the curvature of Huber's loss gives 14 %."""


def line(p, x):
    return p["a"] + p["b"] * x


def square(p, x):
    return p["a"] ** 2 * x


def cosine(p, x):
    return jnp.cos(p["a"]) * x


def proportional(p, x):
    return p * x


def decay(p, x):
    return p["scale"] * (p["a"] * jnp.exp(-p["b"] * x) + p["c"])


def cubic(p, x):
    return p @ jnp.stack([x, x**2, x**3])


@pytest.mark.parametrize(("predict", "slope"), [(square, 3.0), (cosine, -1.0)])
def test_a_maximum_is_no_fit(predict, slope):
    result = jc.fit(predict, slope * X, {"a": 0.0}, x=X, throw=False)
    assert not result.converged
    assert "saddle or a maximum" in result.reason


def test_a_number_the_data_tell_well_is_not_at_the_end_of_a_wide_interval():
    y = 100 * X + 0.1 * np.random.default_rng(4).normal(size=80)
    bounded = jc.fit(proportional, y, 1e4, x=X, transforms=jc.Between(0, 1e9))
    free = jc.fit(proportional, y, 1e4, x=X)
    assert bounded.converged and not bounded.at_bound
    np.testing.assert_allclose(bounded.values, free.values, rtol=SAME)
    np.testing.assert_allclose(bounded.covariance, free.covariance, rtol=SAME)


def test_huber_counts_the_points_that_have_weight():
    y = 1 + 2 * X + 0.1 * NOISE
    weights = np.arange(80) % 2.0
    some = jc.fit(line, y, START, x=X, weights=weights, loss=jc.Huber())
    few = jc.fit(line, y[1::2], START, x=X[1::2], loss=jc.Huber())
    np.testing.assert_allclose(some.covariance, few.covariance, rtol=SAME)


def test_the_profile_of_huber_agrees_with_its_standard_error():
    x = np.linspace(0, 1, 2000)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(0).standard_t(2, size=2000)
    result = jc.fit(line, y, START, x=x, loss=jc.Huber())
    low, high = result.profile("b").interval(0.6827)
    half = (high - low) / 2
    assert half == pytest.approx(result.standard_errors["b"], rel=LARGE_SAMPLE)


@pytest.mark.parametrize("scale", [1e-12, 1e6])
def test_the_unit_of_the_data_does_not_matter(scale):
    y = 2.5 * np.exp(-1.3 * X) + 0.5 + 0.01 * np.random.default_rng(0).normal(size=80)
    fixed = {"scale": jc.Fixed()}
    start = {"a": 1.0, "b": 1.0, "c": 0.0}
    plain = jc.fit(decay, y, start | {"scale": 1.0}, x=X, transforms=fixed)
    scaled = jc.fit(decay, y * scale, start | {"scale": scale}, x=X, transforms=fixed)
    assert plain.converged and scaled.converged
    np.testing.assert_allclose(scaled.values, plain.values, rtol=SAME)


def test_complex_data_are_refused():
    with pytest.raises(ValueError, match="Argument `data` must hold real numbers"):
        jc.fit(proportional, X + 1j, 1.0, x=X)


def test_more_named_numbers_than_points_are_refused():
    x, start = X[:3], {"scale": 1.0, "a": 1.0, "b": 1.0, "c": 0.0}
    with pytest.raises(ValueError, match=r"has numbers to fit \(4: a, b, c, scale\), but holds 3"):
        jc.fit(decay, 2 * x, start, x=x)
    # A point without weight does not count, and a fixed parameter is not fitted.
    kept = {"scale": jc.Fixed(), "b": jc.Fixed()}
    with pytest.raises(ValueError, match=r"\(2: a, c\), but holds 1"):
        jc.fit(decay, 2 * x, start, x=x, weights=[1.0, 0.0, 0.0], transforms=kept)
    assert jc.fit(decay, 2 * x, start, x=x, weights=[1.0, 1.0, 0.0], transforms=kept).dof == 0


def test_an_array_may_have_more_numbers_than_points():
    found = jc.fit(cubic, X[1:3], np.ones(3), x=X[1:3])
    assert found.unidentified


class Halving(AbstractErrors[float, float]):
    """A fit of 16 is halved until it is at most `enough`."""

    rounds = 5

    def __init__(self, enough):
        self.enough = enough

    def estimate(self, found):
        return None if found <= self.enough else found / 2

    def finish(self, found):
        return -found


@pytest.mark.parametrize(("enough", "end"), [(16.0, -16.0), (3.0, -2.0), (0.0, -0.5)])
def test_it_ends_when_the_errors_settle_or_after_its_rounds(enough, end):
    assert refit(Halving(enough), 16.0, lambda last, errors: min(last, errors)) == end
