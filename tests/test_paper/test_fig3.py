"""Fig. 3 against the energy integral and forty digits of the two impacts."""

import numpy as np
import pytest

from jaxcontact import paper
from tests import oracle
from tests.test_paper.test_layout import faults

MASS, STIFFNESS = 0.033, 1.07e10
SPEED = np.array([0.8, 0.1])
ALPHA = np.array([2.0e9, 2.0e10]) * SPEED / STIFFNESS

CLOSED = 1e-13
"""The closed form against forty digits: measured 1e-14, in the duration."""

MOTION = 3e-9
"""An event solve with tolerance 1e-9, scaled units: measured 3e-10 in energy and rebound."""

UNIT = 1e-15
"""The scaled speed at touch, after a product and a quotient: measured 2e-16."""


@pytest.fixture(scope="module")
def result():
    return paper.fig3()


@pytest.fixture(scope="module")
def exact():
    return [oracle.hunt_crossley(alpha, "1.5") for alpha in ALPHA]


def test_how_the_impacts_end(result, exact):
    table = result.tables["impact"]
    length = (MASS * SPEED**2 / STIFFNESS) ** 0.4
    units = {
        "restitution": ("e", 1.0),
        "duration_s": ("duration", length / SPEED),
        "compression_time_s": ("compression_time", length / SPEED),
        "max_deformation_m": ("max_indentation", length),
    }
    for column, (field, unit) in units.items():
        expected = np.array([float(getattr(impact, field)) for impact in exact]) * unit
        np.testing.assert_allclose(table[column], expected, rtol=CLOSED)
    np.testing.assert_array_equal(table["case"], [1, 2])
    np.testing.assert_array_equal(table["impact_velocity_m_per_s"], SPEED)
    np.testing.assert_allclose(table["alpha"], ALPHA, rtol=CLOSED)


@pytest.mark.parametrize("case", [1, 2])
def test_the_motion_keeps_the_energy_integral(result, exact, case):
    table = result.tables["motion"]
    mine = table["case"] == case
    v0, alpha = SPEED[case - 1], ALPHA[case - 1]
    v = table["velocity_m_per_s"][mine] / v0
    x = table["deformation_m"][mine] / (MASS * v0**2 / STIFFNESS) ** 0.4
    # x^(n+1)/(n+1) is the integral of u/(1 + αu) from v to 1, in both phases.
    taken = (1 - v) / alpha - np.log((1 + alpha) / (1 + alpha * v)) / alpha**2
    np.testing.assert_allclose(x**2.5 / 2.5, taken, atol=MOTION)
    assert x[0] == 0 and abs(v[0] - 1) < UNIT
    np.testing.assert_allclose(v[-1], -float(exact[case - 1].e), rtol=MOTION)
    assert np.all(np.diff(v) <= 0)


def test_the_picture(result):
    assert len(result.figure.axes) == 4
    assert faults(result.figure) == []
    top, _, bottom, _ = result.figure.axes
    curve, table = top.get_lines()[1], result.tables["motion"]
    mine = table["case"] == 1
    np.testing.assert_allclose(curve.get_xdata(), table["time_s"][mine] * 1e6)
    np.testing.assert_array_equal(curve.get_ydata(), table["velocity_m_per_s"][mine])
    assert top.get_ylabel() == "velocity / (m/s)"
    assert bottom.get_ylabel() == "deformation / µm" and bottom.get_xlabel() == "time / µs"
