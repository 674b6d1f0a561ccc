"""Fig. 4 against the compression curve in closed form, and the limit of infinitely many samples.

Independent of the library: the energy integral gives δ as a function of δ', and Gauss's rule the
limits of the sums of squares.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxcontact import paper
from tests.test_paper.test_layout import faults

SPEED = np.array([0.8, 0.1])
ALPHA = np.array([2.0e9, 2.0e10]) * SPEED / 1.07e10

CURVE = 3e-8
"""Cubics through 400 moments of an event solve, in units of v0: measured 6e-9, next to touch."""

LIMIT = 2e-6
"""1000 intervals against infinitely many: β measured 4e-7."""

FEW = 7e-4
"""20 intervals against infinitely many, uniform in deformation: β measured 5.2e-4 and 6.3e-4."""

ROOT = 1e-15
"""The root of a square, at touch: measured 2e-16."""

PUBLISHED = np.array([2.408, 2.395])


def taken(v, alpha):
    """The share of the compression's elastic work that is done when δ' has fallen to v v0."""

    def integral(v):
        return v / alpha - np.log1p(alpha * v) / alpha**2

    return (integral(1.0) - integral(v)) / integral(1.0)


def solved(u, alpha):
    """The v at which δ/δ_m is u."""
    return brentq(lambda v: taken(v, alpha) - u**2.5, 0, 1, xtol=1e-15)


def limit(alpha, uniform_in, squared):
    """The β of infinitely many samples: the root of the derivative of an integral of squares."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    s = (nodes + 1) / 2
    # Near touch 1 - v scales as u^2.5; in s nothing is singular there.
    v, dv = 1 - s**2.5, 2.5 * s**1.5
    u = taken(v, alpha) ** 0.4
    du = v / (1 + alpha * v) / (1 / alpha - np.log1p(alpha) / alpha**2) / (2.5 * u**1.5)
    density = {"indentation": du, "time": du / v, "velocity squared": 2 * v}[uniform_in]

    def slope(beta):
        profile = np.sqrt(1 - u**beta)
        change = -(u**beta) * np.log(u)
        if squared:
            error, change = profile**2 - v**2, change
        else:
            error, change = profile - v, change / (2 * profile)
        return np.sum(weights * dv * density * error * change)

    return brentq(slope, 1.5, 3.5, xtol=1e-12)


@pytest.fixture(scope="module")
def result():
    return paper.fig4()


@pytest.fixture(scope="module")
def regression(result):
    table = result.tables["regression"]
    names = list(table)
    return [dict(zip(names, row, strict=True)) for row in zip(*table.values(), strict=True)]


def test_the_numerical_curve(result):
    table = result.tables["curves"]
    for case in (1, 2):
        mine = table["case"] == case
        u = table["deformation_m"][mine] / table["deformation_m"][mine][-1]
        exact = [solved(x, ALPHA[case - 1]) for x in u]
        v = table["numerical_m_per_s"][mine] / SPEED[case - 1]
        np.testing.assert_allclose(v, exact, atol=CURVE)


def test_every_regression_against_infinitely_many_samples(regression):
    assert len(regression) == 12
    for row in regression:
        squared = {"velocity": False, "velocity squared": True}[row["residual_in"]]
        expected = limit(ALPHA[row["case"] - 1], row["uniform_in"], squared)
        np.testing.assert_allclose(row["beta"], expected, atol=LIMIT)
        np.testing.assert_allclose(row["difference"], row["beta"] - row["published_beta"])
        assert row["published_beta"] == PUBLISHED[row["case"] - 1]
        assert 0 < row["rms_residual"] < 4e-3


def test_the_published_powers_lie_between_the_choices(result):
    band = result.tables["band"]
    expected = [[limit(a, *how) for a in ALPHA] for how in EXTREMES]
    np.testing.assert_allclose(band["lowest_beta"], expected[0], atol=LIMIT)
    np.testing.assert_allclose(band["highest_beta"], expected[1], atol=LIMIT)
    np.testing.assert_allclose(band["beta"], [2.410, 2.391], atol=5e-4)
    np.testing.assert_array_equal(band["published_beta"], PUBLISHED)
    assert band["published_inside"].tolist() == [True, True]


EXTREMES = [("time", False), ("indentation", True)]
"""The choices with the lowest and the highest β."""


def test_how_many_samples_hardly_matters(result):
    table = result.tables["samples"]
    for case in (1, 2):
        beta = table["beta"][table["case"] == case]
        off = np.abs(beta - limit(ALPHA[case - 1], "indentation", False))
        assert np.all(np.diff(off) < 0)
        assert off[-1] < LIMIT and 1e-4 < off[0] < FEW


def test_five_halves_is_nearer_than_two(result):
    table = result.tables["profiles"]
    for case in (1, 2):
        mine = table["case"] == case
        rms = dict(zip(table["form"][mine], table["rms_difference"][mine], strict=True))
        assert rms["fitted β"] < rms["β = 5/2"] < rms["β = 2"] / 3 < rms["linear"] < rms["step"]
    # By hand from the table of curves, for one form.
    curves = result.tables["curves"]
    first = curves["case"] == 1
    off = (curves["beta_2_m_per_s"] - curves["numerical_m_per_s"])[first] / 0.8
    np.testing.assert_allclose(table["rms_difference"][1], np.sqrt(np.mean(off**2)))


def test_the_forms_meet_the_ends(result):
    table = result.tables["curves"]
    for name, values in table.items():
        if name.endswith("m_per_s"):
            for case in (1, 2):
                column = values[table["case"] == case]
                assert abs(column[0] / SPEED[case - 1] - 1) < ROOT and column[-1] == 0


def test_the_picture(result):
    assert faults(result.figure) == []
    first, second, third = result.figure.axes
    assert [len(ax.get_lines()) for ax in (first, second, third)] == [6, 6, 6]
    assert first.get_ylabel() == "velocity / (m/s)"
    assert first.get_xlabel() == second.get_xlabel() == "deformation / µm"
