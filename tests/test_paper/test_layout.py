"""The check of layouts detects planted faults."""

import pytest

from jaxcontact.paper._figures.style import legend_above, sheet
from tests.test_paper.layout import faults


@pytest.fixture
def drawn():
    figure, (ax,) = sheet()
    ax.plot([0, 1], [0, 1], label="a line")
    ax.set_xlabel("a quantity / unit")
    return figure, ax


def test_a_tidy_figure_passes(drawn):
    figure, ax = drawn
    legend_above(figure, ax)
    assert faults(figure) == []


def test_text_on_text_is_seen(drawn):
    figure, ax = drawn
    ax.text(0.5, 0.5, "one")
    ax.text(0.5, 0.5, "two")
    assert faults(figure) == ["'one' lies on 'two'"]


def test_text_over_the_edge_is_seen(drawn):
    figure, _ = drawn
    figure.text(0.99, 0.5, "long")
    assert faults(figure) == ["'long' is cut off"]


def test_a_legend_on_data_is_seen(drawn):
    figure, _ = drawn
    figure.legend(loc="center")
    assert faults(figure) == ["the legend covers data"]
