"""Fits against the certified parameters of NIST's nonlinear regression problems."""

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.nist import MODELS, digits, problems

PROBLEMS = problems()

FOUND = 9.0  # digits: of 11 that are certified, rounding has left at least 9.6 on two machines
CERTAIN = 9.0
"""Digits of standard errors. Those of Lanczos1, whose data have no noise, are rounding."""


def fitted(name, start, **how):
    problem = PROBLEMS[name]
    start = np.array(problem["starts"][start])
    return jc.fit(MODELS[name], problem["y"], start, x=problem["x"], **how), problem


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_certified_values_are_reached_from_both_starts(name):
    for start in (0, 1):
        found, problem = fitted(name, start)
        assert found.converged, found.reason
        assert digits(found.values, problem["certified"]) > FOUND
        deviations = list(found.standard_errors.values())
        assert name == "Lanczos1" or digits(deviations, problem["deviations"]) > CERTAIN
        assert 2 * found.loss == pytest.approx(problem["squares"], rel=1e-9, abs=1e-24)


@pytest.mark.parametrize("most", [86, 90, 94])
def test_a_search_that_is_cut_off_is_not_called_converged(most):
    """Its steps are below a thousandth of a standard error, and it is 4 digits from the end."""
    found, problem = fitted("MGH09", 0, max_steps=most, throw=False)
    assert digits(found.values, problem["certified"]) < 6 and not found.converged
    assert f"{most} steps were not enough" in found.reason


def test_a_linear_model_takes_few_steps():
    x = np.linspace(0, 2, 25)
    y = 1e6 * (3 - x) + np.sin(7 * x)
    found = jc.fit(lambda p, x: p[0] + p[1] * x, y, np.array([1e-3, 1e3]), x=x)
    assert found.converged
    np.testing.assert_allclose(found.values[::-1], np.polyfit(x, y, 1), rtol=1e-12)
    # The start is a billionth of the end: the radius grows tenfold per step.
    assert found.steps <= 8
