"""Fig. 3 against the energy integral and forty digits of the two impacts. Fig. 4 against the
compression curve in closed form, and the limit of infinitely many samples.

Independent of the library: the energy integral gives δ as a function of δ', and Gauss's rule the
limits of the sums of squares.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxcontact import paper
from tests import oracle
from tests.paper.test_layout import faults

MASS, STIFFNESS = 0.033, 1.07e10
SPEED = np.array([0.8, 0.1])
ALPHA = np.array([2.0e9, 2.0e10]) * SPEED / STIFFNESS
LENGTH = (MASS * SPEED**2 / STIFFNESS) ** 0.4
CASES = 1, 2

CLOSED = 1e-13  # the closed form against forty digits: measured 1e-14, in the duration
MOTION = 3e-9
"""An event solve with tolerance 1e-9, scaled units: measured 3e-10 in energy and rebound."""

UNIT = 1e-15  # the scaled speed at touch, after a product and a quotient or a root: measured 2e-16
CURVE = 3e-8
"""Cubics through 400 moments of an event solve, in units of v0: measured 6e-9, next to touch."""

LIMIT = 2e-6  # 1000 intervals against infinitely many: β measured 4e-7
FEW = 7e-4
"""20 intervals against infinitely many, uniform in deformation: β measured 5.2e-4 and 6.3e-4."""

PUBLISHED = np.array([2.408, 2.395])


@pytest.fixture(scope="module")
def fig3():
    return paper.fig3()


@pytest.fixture(scope="module")
def fig4():
    return paper.fig4()


@pytest.fixture(scope="module")
def exact():
    return [oracle.hunt_crossley(alpha, "1.5") for alpha in ALPHA]


def test_how_the_impacts_end(fig3, exact):
    table = fig3.tables["impact"]
    units = {
        "restitution": ("e", 1.0),
        "duration_s": ("duration", LENGTH / SPEED),
        "compression_time_s": ("compression_time", LENGTH / SPEED),
        "max_deformation_m": ("max_indentation", LENGTH),
    }
    for column, (field, unit) in units.items():
        expected = np.array([float(getattr(impact, field)) for impact in exact]) * unit
        np.testing.assert_allclose(table[column], expected, rtol=CLOSED)
    np.testing.assert_array_equal(table["case"], CASES)
    np.testing.assert_array_equal(table["impact_velocity_m_per_s"], SPEED)
    np.testing.assert_allclose(table["alpha"], ALPHA, rtol=CLOSED)


@pytest.mark.parametrize("case", CASES)
def test_the_motion_keeps_the_energy_integral(fig3, exact, case):
    table = fig3.tables["motion"]
    mine = table["case"] == case
    v0, alpha = SPEED[case - 1], ALPHA[case - 1]
    v = table["velocity_m_per_s"][mine] / v0
    x = table["deformation_m"][mine] / LENGTH[case - 1]
    # x^(n+1)/(n+1) is the integral of u/(1 + αu) from v to 1, in both phases.
    taken = (1 - v) / alpha - np.log((1 + alpha) / (1 + alpha * v)) / alpha**2
    np.testing.assert_allclose(x**2.5 / 2.5, taken, atol=MOTION)
    assert x[0] == 0 and abs(v[0] - 1) < UNIT
    np.testing.assert_allclose(v[-1], -float(exact[case - 1].e), rtol=MOTION)
    assert np.all(np.diff(v) <= 0)


def test_the_picture_of_the_motion(fig3):
    assert faults(fig3.figure) == []
    top, _, bottom, _ = fig3.figure.axes
    curve, table = top.get_lines()[1], fig3.tables["motion"]
    mine = table["case"] == 1
    np.testing.assert_allclose(curve.get_xdata(), table["time_s"][mine] * 1e6)
    np.testing.assert_array_equal(curve.get_ydata(), table["velocity_m_per_s"][mine])
    assert top.get_ylabel() == "velocity / (m/s)"
    assert bottom.get_ylabel() == "deformation / µm" and bottom.get_xlabel() == "time / µs"


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


def test_the_numerical_curve(fig4):
    table = fig4.tables["curves"]
    for case in CASES:
        mine = table["case"] == case
        u = table["deformation_m"][mine] / table["deformation_m"][mine][-1]
        exact = [solved(x, ALPHA[case - 1]) for x in u]
        v = table["numerical_m_per_s"][mine] / SPEED[case - 1]
        np.testing.assert_allclose(v, exact, atol=CURVE)


def test_every_regression_against_infinitely_many_samples(fig4):
    table = fig4.tables["regression"]
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    assert len(rows) == 12
    for row in rows:
        squared = {"velocity": False, "velocity squared": True}[row["residual_in"]]
        expected = limit(ALPHA[row["case"] - 1], row["uniform_in"], squared)
        np.testing.assert_allclose(row["beta"], expected, atol=LIMIT)
        np.testing.assert_allclose(row["difference"], row["beta"] - row["published_beta"])
        assert row["published_beta"] == PUBLISHED[row["case"] - 1]
        assert 0 < row["rms_residual"] < 4e-3


def test_the_published_powers_lie_between_the_choices(fig4):
    """Those with the lowest and the highest β."""
    band = fig4.tables["band"]
    for column, how in (("lowest_beta", ("time", False)), ("highest_beta", ("indentation", True))):
        np.testing.assert_allclose(band[column], [limit(a, *how) for a in ALPHA], atol=LIMIT)
    np.testing.assert_allclose(band["beta"], [2.410, 2.391], atol=5e-4)
    np.testing.assert_array_equal(band["published_beta"], PUBLISHED)
    assert band["published_inside"].tolist() == [True, True]


def test_how_many_samples_hardly_matters(fig4):
    table = fig4.tables["samples"]
    for case in CASES:
        beta = table["beta"][table["case"] == case]
        off = np.abs(beta - limit(ALPHA[case - 1], "indentation", False))
        assert np.all(np.diff(off) < 0)
        assert off[-1] < LIMIT and 1e-4 < off[0] < FEW


def test_five_halves_is_nearer_than_two(fig4):
    table, curves = fig4.tables["profiles"], fig4.tables["curves"]
    for case in CASES:
        mine = table["case"] == case
        rms = dict(zip(table["form"][mine], table["rms_difference"][mine], strict=True))
        assert rms["fitted β"] < rms["β = 5/2"] < rms["β = 2"] / 3 < rms["linear"] < rms["step"]
    # By hand from the table of curves, for one form.
    first = curves["case"] == 1
    off = (curves["beta_2_m_per_s"] - curves["numerical_m_per_s"])[first] / 0.8
    np.testing.assert_allclose(table["rms_difference"][1], np.sqrt(np.mean(off**2)))


def test_the_forms_meet_the_ends(fig4):
    table = fig4.tables["curves"]
    for name in table:
        for case in CASES if name.endswith("m_per_s") else ():
            column = table[name][table["case"] == case]
            assert abs(column[0] / SPEED[case - 1] - 1) < UNIT and column[-1] == 0


def test_the_picture_of_the_profiles(fig4):
    assert faults(fig4.figure) == []
    first, second, third = fig4.figure.axes
    assert [len(ax.get_lines()) for ax in (first, second, third)] == [6, 6, 6]
    assert first.get_ylabel() == "velocity / (m/s)"
    assert first.get_xlabel() == second.get_xlabel() == "deformation / µm"
