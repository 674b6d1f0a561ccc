"""The ball followed to rest, and the effect of gravity in contact."""

import numpy as np
import pytest

from jaxcontact import paper
from tests.test_paper.layout import faults

STATIC = 1e-14
"""The static indentation by hand, relative: measured 2e-16."""


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
