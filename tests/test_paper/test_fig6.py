"""Fig. 6 against forty digits of each impact, and errors by another quadrature."""

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxcontact import paper
from tests import oracle
from tests.test_paper.test_layout import faults

OUT = 5e-15
"""The closed form against forty digits, α given exactly: measured 2e-16."""

DIAGONAL = 1e-14
"""e through the inverse of the closed form and back: measured 7e-16."""

MEAN = 1e-4
"""Trapezia over 0.005 against an adaptive quadrature, relative: measured 5e-5."""

PEAK = 2e-5
"""The largest error on that grid against the largest there is, relative: measured 1e-6."""

ALPHA = {
    "lankarani_nikravesh": lambda e: 3 * (1 - e**2) / 4,
    "hunt_crossley": lambda e: 3 * (1 - e) / 2,
    "flores": lambda e: 8 * (1 - e) / (5 * e),
    "hu_guo": lambda e: 3 * (1 - e) / (2 * e),
}


@pytest.fixture(scope="module")
def result():
    return paper.fig6()


def outgoing(alpha):
    """e from α(1+e) = ln[(1+α)/(1-αe)], by bisection and secants in z = ln(1-αe)."""
    if alpha == 0:
        return 1.0
    start = np.log1p(alpha)
    z = brentq(lambda z: alpha - start - np.expm1(z) + z, -(1 + alpha), -start / 2, xtol=1e-14)
    return -np.expm1(z) / alpha


@pytest.mark.parametrize("law", ALPHA)
def test_against_forty_digits(result, law):
    table = result.tables["restitution"]
    for tenth in (1, 5, 9):
        exact = mpmath.mpf(tenth) / 10
        expected = float(oracle.hunt_crossley(ALPHA[law](exact), "1.5").e)
        np.testing.assert_allclose(table[law][tenth - 1], expected, rtol=OUT)
    assert table[law][-1] == 1


def test_the_exact_law_is_the_diagonal(result):
    for name in ("curves", "restitution"):
        table = result.tables[name]
        np.testing.assert_allclose(table["exact"], table["e_in"], rtol=DIAGONAL)
    np.testing.assert_array_equal(result.tables["restitution"]["e_in"], np.arange(1, 11) / 10)


@pytest.mark.parametrize("law", ALPHA)
@pytest.mark.parametrize("start", [0.1, 0.01])
def test_errors(result, law, start):
    table = result.tables["errors"]
    row = list(table["law"]).index(law)

    def error(e):
        return abs(outgoing(ALPHA[law](e)) - e)

    mean = quad(error, start, 1, limit=200, epsabs=1e-10)[0] / (1 - start)
    largest = max(error(e) for e in np.linspace(start, 1, 2001))
    np.testing.assert_allclose(table[f"mean_error_from_{start:g}"][row], mean, rtol=MEAN)
    np.testing.assert_allclose(table[f"largest_error_from_{start:g}"][row], largest, rtol=PEAK)


def test_the_new_law_is_the_best_of_the_four_but_not_exact(result):
    table = result.tables["errors"]
    for column in ("mean_error_from_0.1", "largest_error_from_0.1"):
        error = dict(zip(table["law"], table[column], strict=True))
        assert error["exact"] < 1e-14 < error["hu_guo"] < error["flores"]
        assert error["flores"] < error["hunt_crossley"] < error["lankarani_nikravesh"]


def test_it_prints_what_there_is_and_no_numbers(result):
    lines = repr(result).splitlines()
    assert lines[0] == "Reproduction" and len(lines) == 5
    assert lines[2].split()[:4] == ["curves", "199", "rows", "e_in,"]


def test_the_picture(result):
    top, bottom = result.figure.axes
    assert faults(result.figure) == []
    assert len(top.get_lines()) == len(bottom.get_lines()) == 5
    curves = result.tables["curves"]
    for line, below, law in zip(top.get_lines(), bottom.get_lines(), ALPHA, strict=False):
        np.testing.assert_array_equal(line.get_ydata(), curves[law])
        np.testing.assert_array_equal(below.get_ydata(), curves[law] - curves["e_in"])
    assert top.get_xlim() == bottom.get_xlim() == (0, 1)
