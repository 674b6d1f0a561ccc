"""The stored tables of weak pushes equal the computed ones."""

import numpy as np
import pytest

from jaxcontact._forms.weak_push.correction import computed, name_of, table_of
from tests.weak_push_tables import STORED

INTEGRATION = 1e-9
"""Of the largest coefficient of a term: the integration leaves 1e-10, twelve digits are stored."""


@pytest.mark.parametrize(("n", "order"), STORED, ids=lambda key: f"{key:g}")
def test_the_stored_table_is_the_computed_one(n, order):
    stored, made = table_of(n, order), computed(n, order)
    np.testing.assert_array_equal(stored.output, made.output)
    np.testing.assert_array_equal(stored.powers, made.powers)
    error = np.abs(stored.coefficients - made.coefficients).max(axis=0)
    assert np.max(error / np.abs(made.coefficients).max(axis=0)) < INTEGRATION


def test_another_exponent_is_computed():
    assert name_of(2.0, 1) not in map(name_of, *zip(*STORED, strict=True))
    assert table_of(2.0, 1).coefficients.shape == table_of(1.5, 2).coefficients.shape
