"""The twenty impacts of the bouncing ball against forty digits, and the claims of the text."""

import numpy as np
import pytest

from jaxcontact import paper
from tests import oracle
from tests.paper.test_layout import faults

OUTCOME = 1e-12  # the closed form against forty digits, relative: measured 2e-14
ENERGY = 1e-13  # ½ m v0² (1-e²) from the table's own e, relative to ½ m v0²: measured 2e-16
PEAK = 1e-3  # the largest of 200 samples against the largest there is: measured 2.1e-4
MASS, STIFFNESS, SPEED = 1.0, 1.4e8, 4.2
LAWS = ("lankarani_nikravesh", "hunt_crossley", "flores", "hu_guo")


@pytest.fixture(scope="module")
def table():
    return {
        name: values.reshape(4, 5) if values.dtype.kind != "U" else values
        for name, values in paper.ball_table().items()
    }


def test_the_order_of_the_rows(table):
    assert tuple(table["law"][::5]) == LAWS
    assert np.all(table["e_in"] == [1.0, 0.8, 0.6, 0.4, 0.2])


def test_against_forty_digits(table):
    length = (MASS * SPEED**2 / STIFFNESS) ** 0.4
    units = {
        "max_deformation_m": (length, "max_indentation"),
        "duration_s": (length / SPEED, "duration"),
        "max_force_N": (MASS * SPEED**2 / length, "max_force"),
        "rebound_velocity_m_per_s": (SPEED, "e"),
    }
    for index in np.ndindex(4, 5):
        scaled = oracle.hunt_crossley(float(table["alpha"][index]), "1.5")
        for name, (unit, field) in units.items():
            expected = unit * float(getattr(scaled, field))
            assert table[name][index] == pytest.approx(expected, rel=OUTCOME)


def test_the_energy_is_that_of_the_rebound(table):
    before = MASS * SPEED**2 / 2
    lost = before - MASS * table["rebound_velocity_m_per_s"] ** 2 / 2
    np.testing.assert_allclose(table["energy_loss_J"], lost, rtol=0, atol=ENERGY * before)


@pytest.mark.parametrize(
    ("name", "across", "up"),
    [
        ("fig8", "time / ms", "deformation / mm"),
        ("fig9", "time / ms", "velocity / (m/s)"),
        ("fig10", "deformation / mm", "force / kN"),
    ],
)
def test_figures(table, name, across, up):
    figure, tables = getattr(paper, name)()
    assert faults(figure) == []
    assert {ax.get_xlabel() for ax in figure.axes[2:]} == {across}
    assert {ax.get_ylabel() for ax in figure.axes[::2]} == {up}
    scale = {"deformation / mm": 1e3, "force / kN": 1e-3, "velocity / (m/s)": 1.0}[up]
    field = {"fig8": "max_deformation_m", "fig10": "max_force_N"}.get(name)
    for i, ax in enumerate(figure.axes):
        lines = ax.get_lines()
        assert len(lines) == 5
        for j, line in enumerate(lines):
            y = line.get_ydata() / scale
            if field is None:
                assert y[0] == pytest.approx(SPEED, rel=1e-12)
                assert -y[-1] == pytest.approx(
                    table["rebound_velocity_m_per_s"][i, j], rel=1e-7, abs=1e-7
                )
            else:
                assert y.max() == pytest.approx(table[field][i, j], rel=PEAK)
    assert len(tables["curves"]["time_s"]) == 4 * 5 * 200


STATIC = 1e-14  # the static indentation by hand, relative: measured 2e-16


@pytest.fixture(scope="module")
def result():
    return paper.bouncing()


def test_the_picture(result):
    assert faults(result.figure) == []
    top, bottom = result.figure.axes
    assert len(top.get_lines()) == 4 and len(bottom.get_lines()) == 8
    for line in top.get_lines():
        assert line.get_ydata()[0] == pytest.approx(0.9, rel=1e-14)
        assert line.get_ydata()[-1] == 0


def test_rest(result):
    rest = result.tables["rest"]
    felt, elastic = rest["gravity_in_contact"], rest["e_in"] == 1
    assert np.all(np.isnan(rest["rest_time_s"]) == elastic)
    # Gravity in contact takes energy from late bounces: fewer, and sooner at rest.
    assert np.all(rest["bounces"][felt & ~elastic] < rest["bounces"][~felt & ~elastic])
    assert np.all(rest["rest_time_s"][felt & ~elastic] < rest["rest_time_s"][~felt & ~elastic])
    np.testing.assert_allclose(rest["rest_indentation_m"], (9.8 / 1.4e8) ** (2 / 3), rtol=STATIC)


def test_late_bounces_are_longer_contacts(result):
    touches = result.tables["touches"]
    chosen = (~touches["gravity_in_contact"]) & (touches["e_in"] == 0.8) & (touches["status"] == 0)
    duration, speed = touches["duration_s"][chosen], touches["velocity_m_per_s"][chosen]
    np.testing.assert_allclose(duration / duration[0], (speed / speed[0]) ** -0.2, rtol=1e-12)
