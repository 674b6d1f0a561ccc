"""Plastic and adhesive impacts beside plain diffrax: the committed result and its table."""

import json

import numpy as np
import pytest

from benchmarks import plastic_speed

FORCES = 1e-12
"""Of the forces that diffrax and SciPy integrate: measured 2e-13."""


def rows():
    return json.loads(plastic_speed.RESULT.read_text())["rows"]


def test_the_page_is_that_of_the_result():
    page = (plastic_speed.ROOT / "docs" / "plastic.md").read_text()
    assert plastic_speed.table(rows()) in page
    assert {row["law"] for row in rows()} == set(plastic_speed.CASES)


@pytest.mark.parametrize("name", plastic_speed.CASES)
def test_all_integrate_the_same_force(name):
    case = plastic_speed.CASES[name]()
    for depth, rate, most in ((0.3, 0.2, 0.0), (1.1, 0.4, 0.0), (1.1, -0.4, 1.2), (1.2, 0.0, 1.2)):
        most = most if case.law.remembers else 0.0
        found = float(case.force(np.float64(depth), np.float64(rate), np.float64(most)))
        assert found == pytest.approx(case.known(depth, rate, most), rel=FORCES)
