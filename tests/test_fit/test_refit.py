"""The one loop of fits whose errors follow from their own residuals."""

import pytest

from jaxcontact._fit import AbstractErrors, refit


class Halving(AbstractErrors[float, float]):
    """A fit of 16 is halved until it is at most `enough`."""

    rounds = 5

    def __init__(self, enough):
        self.enough = enough

    def estimate(self, found):
        return None if found <= self.enough else found / 2

    def finish(self, found):
        return -found


@pytest.mark.parametrize(("enough", "end"), [(16.0, -16.0), (3.0, -2.0), (0.0, -0.5)])
def test_it_ends_when_the_errors_settle_or_after_its_rounds(enough, end):
    assert refit(Halving(enough), 16.0, lambda last, errors: min(last, errors)) == end
