"""Fig. 5 against the formulas of the paper's Table 1 and their limits. Fig. 6 against forty digits
of each impact, and errors by another quadrature.
"""

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import jaxcontact as jc
from jaxcontact import paper
from tests import oracle
from tests.paper.test_layout import faults

FORMULA = 1e-14  # the same arithmetic in another order: measured 5e-16
OUT = 5e-15  # the closed form against forty digits, α given exactly: measured 2e-16
DIAGONAL = 1e-14  # e through the inverse of the closed form and back: measured 7e-16
MEAN = 1e-4  # trapezia over 0.005 against an adaptive quadrature, relative: measured 5e-5
PEAK = 2e-5  # the largest error on that grid against the largest there is, relative: measured 1e-6

ALPHA = {
    "lankarani_nikravesh": lambda e: 3 * (1 - e**2) / 4,
    "hunt_crossley": lambda e: 3 * (1 - e) / 2,
    "flores": lambda e: 8 * (1 - e) / (5 * e),
    "hu_guo": lambda e: 3 * (1 - e) / (2 * e),
}


@pytest.fixture(scope="module")
def fig5():
    return paper.fig5()


@pytest.fixture(scope="module")
def fig6():
    return paper.fig6()


def test_the_formulas(fig5):
    table = fig5.tables["damping_factor"]
    assert list(table) == ["e_in", *ALPHA, "exact"]
    for name, alpha in (*ALPHA.items(), ("exact", jc.exact_damping_factor)):
        expected = alpha(table["e_in"])
        np.testing.assert_allclose(table[name], expected, rtol=FORMULA, atol=FORMULA)


def test_the_limits(fig5):
    table = fig5.tables["limits"]
    order = [list(table["law"]).index(law) for law in ALPHA]
    alpha, e_alpha = table["alpha_towards_0"][order], table["e_alpha_towards_0"][order]
    np.testing.assert_allclose(alpha[:2], [3 / 4, 3 / 2], rtol=1e-11)
    np.testing.assert_allclose(e_alpha[2:], [8 / 5, 3 / 2], rtol=1e-11)
    assert np.all(alpha[2:] > 1e11) and np.all(e_alpha[:2] < 1e-11)
    np.testing.assert_array_equal(table["alpha_at_1"], 0)
    np.testing.assert_allclose(table["slope_at_1"][order], [-3 / 2, -3 / 2, -8 / 5, -3 / 2])


def test_the_picture_of_factors(fig5):
    (ax,) = fig5.figure.axes
    assert faults(fig5.figure) == []
    labels = [line.get_label() for line in ax.get_lines()]
    assert labels == ["Lankarani-Nikravesh", "Hunt-Crossley", "Flores et al.", "Hu-Guo", "exact"]
    for line, name in zip(ax.get_lines(), [*ALPHA, "exact"], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), fig5.tables["damping_factor"][name])


def outgoing(alpha):
    """e from α(1+e) = ln[(1+α)/(1-αe)], by bisection and secants in z = ln(1-αe)."""
    if alpha == 0:
        return 1.0
    start = np.log1p(alpha)
    z = brentq(lambda z: alpha - start - np.expm1(z) + z, -(1 + alpha), -start / 2, xtol=1e-14)
    return -np.expm1(z) / alpha


@pytest.mark.parametrize("law", ALPHA)
def test_against_forty_digits(fig6, law):
    table = fig6.tables["restitution"]
    for tenth in (1, 5, 9):
        exact = mpmath.mpf(tenth) / 10
        expected = float(oracle.hunt_crossley(ALPHA[law](exact), "1.5").e)
        np.testing.assert_allclose(table[law][tenth - 1], expected, rtol=OUT)
    assert table[law][-1] == 1


def test_the_exact_law_is_the_diagonal(fig6):
    for name in ("curves", "restitution"):
        table = fig6.tables[name]
        np.testing.assert_allclose(table["exact"], table["e_in"], rtol=DIAGONAL)
    np.testing.assert_array_equal(fig6.tables["restitution"]["e_in"], np.arange(1, 11) / 10)


@pytest.mark.parametrize("law", ALPHA)
@pytest.mark.parametrize("start", [0.1, 0.01])
def test_errors(fig6, law, start):
    table = fig6.tables["errors"]
    row = list(table["law"]).index(law)

    def error(e):
        return abs(outgoing(ALPHA[law](e)) - e)

    mean = quad(error, start, 1, limit=200, epsabs=1e-10)[0] / (1 - start)
    largest = max(error(e) for e in np.linspace(start, 1, 2001))
    np.testing.assert_allclose(table[f"mean_error_from_{start:g}"][row], mean, rtol=MEAN)
    np.testing.assert_allclose(table[f"largest_error_from_{start:g}"][row], largest, rtol=PEAK)


def test_it_prints_what_there_is_and_no_numbers(fig6):
    lines = repr(fig6).splitlines()
    assert lines[0] == "Reproduction" and len(lines) == 5
    assert lines[2].split()[:4] == ["curves", "199", "rows", "e_in,"]


def test_the_picture_of_restitutions(fig6):
    top, bottom = fig6.figure.axes
    assert faults(fig6.figure) == []
    assert len(top.get_lines()) == len(bottom.get_lines()) == 5
    curves = fig6.tables["curves"]
    for line, below, law in zip(top.get_lines(), bottom.get_lines(), ALPHA, strict=False):
        np.testing.assert_array_equal(line.get_ydata(), curves[law])
        np.testing.assert_array_equal(below.get_ydata(), curves[law] - curves["e_in"])
    assert top.get_xlim() == bottom.get_xlim() == (0, 1)
