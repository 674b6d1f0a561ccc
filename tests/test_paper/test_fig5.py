"""Fig. 5 against the formulas of the paper's Table 1, written independently, and their limits."""

import numpy as np
import pytest

from jaxcontact import paper
from tests.test_paper.test_layout import faults

FORMULA = 1e-14
"""The same arithmetic in another order: measured 5e-16."""

RELATION = 1e-14
"""The relation between e and α, its two sides relative to each other: measured 9e-16."""


@pytest.fixture(scope="module")
def result():
    return paper.fig5()


def test_the_four_formulas(result):
    table = result.tables["damping_factor"]
    e = table["e_in"]
    expected = {
        "lankarani_nikravesh": 3 * (1 - e**2) / 4,
        "hunt_crossley": 3 * (1 - e) / 2,
        "flores": 8 * (1 - e) / (5 * e),
        "hu_guo": 3 * (1 - e) / (2 * e),
    }
    assert list(table) == ["e_in", *expected, "exact"]
    for name, alpha in expected.items():
        np.testing.assert_allclose(table[name], alpha, rtol=FORMULA, atol=FORMULA)


def test_the_exact_law_keeps_its_relation(result):
    table = result.tables["damping_factor"]
    damped = table["e_in"] < 0.9
    e, alpha = table["e_in"][damped], table["exact"][damped]
    # For small e, α e is below 1 by less than its rounding; there the relation is inverted.
    below_one = (1 + alpha) * np.exp(-alpha * (1 + e))
    np.testing.assert_allclose(1 - below_one, alpha * e, rtol=RELATION)
    assert table["e_in"][-1] == 1 and table["exact"][-1] == 0


def test_the_limits(result):
    table = result.tables["limits"]
    by_law = {law: i for i, law in enumerate(table["law"])}
    order = [by_law[law] for law in ("lankarani_nikravesh", "hunt_crossley", "flores", "hu_guo")]
    alpha, e_alpha = table["alpha_towards_0"][order], table["e_alpha_towards_0"][order]
    np.testing.assert_allclose(alpha[:2], [3 / 4, 3 / 2], rtol=1e-11)
    np.testing.assert_allclose(e_alpha[2:], [8 / 5, 3 / 2], rtol=1e-11)
    assert np.all(alpha[2:] > 1e11) and np.all(e_alpha[:2] < 1e-11)
    np.testing.assert_array_equal(table["alpha_at_1"], 0)
    np.testing.assert_allclose(table["slope_at_1"][order], [-3 / 2, -3 / 2, -8 / 5, -3 / 2])


def test_the_picture(result):
    (ax,) = result.figure.axes
    assert faults(result.figure) == []
    labels = [line.get_label() for line in ax.get_lines()]
    assert labels == ["Lankarani-Nikravesh", "Hunt-Crossley", "Flores et al.", "Hu-Guo", "exact"]
    for line, name in zip(ax.get_lines(), list(result.tables["damping_factor"])[1:], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), result.tables["damping_factor"][name])
