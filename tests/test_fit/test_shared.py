"""Errors shared by readings and excluded from the weights, against draws of a quantised line."""

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._fit import SharedErrors, with_shared
from jaxcontact.lab.records.instrument_errors import rounding_of_white_noise
from tests.test_fit.curves import line

X = np.linspace(-1, 1, 60)
TRUTH = {"a": 3.2, "b": 0.4}
"""A slope of so few steps that neighbours share their rounding errors."""
SIGMA, DRAWS = 0.15, 400
ERRORS = rounding_of_white_noise(np.full(60, SIGMA), TRUTH["a"] + TRUTH["b"] * X, 1.0)
ALARMS = 44
"""Of 400 at a level of 5 %. Rounding is not normal, as the draws of the test are: measured 21, 25
and 32 with three seeds. Points taken as independent are called wrong in 212 to 224."""


def read(random):
    """Readings in steps of 1 with a zero that is as probable anywhere."""
    zero = random.uniform(0, 1)
    return np.round(line(TRUTH, X) + SIGMA * random.normal(size=60) - zero) + zero


def fitted(y):
    plain = jc.fit(line, y, {"a": 3.0, "b": 0.5}, x=X)
    return with_shared(plain, ERRORS)


@pytest.mark.slow(reason="a study of hundreds of fits")
def test_standard_errors_are_the_scatter():
    random, values, alarms = np.random.default_rng(0), [], 0
    for _ in range(DRAWS):
        found = fitted(read(random))
        values.append(found.values)
        alarms += found.adequate is False
    # A standard deviation of 400 draws is accurate to 3.5 %.
    np.testing.assert_allclose(np.std(values, axis=0) / found.errors, 1, atol=0.12)
    assert (found._wider > 1.5).any() and alarms < ALARMS


def test_intervals_widen_with_them():
    found = fitted(read(np.random.default_rng(1)))
    t = 2.0017175  # Student's t of 58 degrees of freedom at 97.5 %, by tables
    for name, (low, high) in found.interval().items():
        error = found.standard_errors[name]
        assert (high - low) / (2 * t * error) == pytest.approx(1, rel=2e-3)
        assert found.profile(name).interval() == pytest.approx((low, high), rel=2e-3)


def test_a_bootstrap_draws_them():
    found = fitted(read(np.random.default_rng(2)))
    drawn = found.bootstrap(DRAWS).standard_errors
    for name, error in found.standard_errors.items():
        assert drawn[name] == pytest.approx(error, rel=0.15)


def test_a_posterior_refuses_them():
    with pytest.raises(ValueError, match="its readings share errors of rounding"):
        jc.posterior(fitted(read(np.random.default_rng(3))))


def test_nothing_changes_where_nothing_is_shared():
    plain = jc.fit(line, read(np.random.default_rng(4)), {"a": 3.0, "b": 0.5}, x=X)
    same = with_shared(plain, SharedErrors(np.full(60, plain.noise), np.zeros((60, 0))))
    np.testing.assert_allclose(same.errors, plain.errors, rtol=1e-9)
    np.testing.assert_allclose(same._wider, 1, rtol=1e-9)
