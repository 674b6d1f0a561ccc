"""The published numbers: computed ones agree to the printed digits, or the table states why not."""

import math
from pathlib import Path

import pytest

from jaxcontact import paper

DIFFERENT = {
    "mass of the steel example",
    "c of case 2 by Eq. 37 at e = 0.9",
    "β of case 1",
    "β of case 2",
}
"""What is known to differ: no more and no less."""


@pytest.fixture(scope="module")
def numbers():
    return paper.numbers()


def test_each_number_agrees_or_says_why_not(numbers):
    assert {number.published.name for number in numbers if not number.agrees} == DIFFERENT
    for number in numbers:
        assert math.isfinite(number.ours)
        assert bool(number.published.differs) != number.agrees


def test_stiffness_and_mass_by_hand(numbers):
    """K = 4/(3·2h) √(R/2) with h = (1-ν²)/E; half the mass of one sphere."""
    ours = {number.published.name: number.ours for number in numbers}
    h = (1 - 0.3**2) / 2.07e11
    assert ours["stiffness of two steel spheres"] == pytest.approx(
        2 / (3 * h) * math.sqrt(0.005), rel=1e-14
    )
    one = 4 / 3 * math.pi * 0.01**3 * 7850
    assert ours["mass of the steel example"] == pytest.approx(one / 2, rel=1e-14)
    assert abs(one - 0.033) < 5e-4


def test_printed_and_value_are_the_same():
    for published in paper.PUBLISHED:
        top, _, bottom = published.printed.partition("/")
        assert published.value == float(top) / float(bottom or 1)


def test_a_wrong_number_does_not_agree(numbers):
    number = numbers[0]
    assert number.agrees
    assert not number._replace(ours=number.ours + 2 * number.published.half).agrees
    exact = next(number for number in numbers if number.published.half == 0)
    assert exact.agrees and not exact._replace(ours=exact.ours * (1 + 1e-9)).agrees


def test_markdown_has_a_row_for_each(numbers):
    lines = paper.markdown(numbers).splitlines()
    assert len(lines) == 2 + len(numbers)
    for number, line in zip(numbers, lines[2:], strict=True):
        assert number.published.name in line and number.published.where in line
        assert ("agrees" in line) == number.agrees


def test_the_page_shows_these_numbers(numbers):
    page = Path(__file__).parents[2] / "docs" / "hu_guo_2015.md"
    shown = {line.rsplit("|", 3)[0] for line in page.read_text().splitlines()}
    for line in paper.markdown(numbers).splitlines()[2:]:
        assert line.rsplit("|", 3)[0] in shown
