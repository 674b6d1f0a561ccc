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


@pytest.mark.parametrize(
    ("plant", "fault"),
    [
        (lambda f, ax: [ax.text(0.5, 0.5, x) for x in ("one", "two")], "'one' lies on 'two'"),
        (lambda f, ax: f.text(0.99, 0.5, "long"), "'long' is cut off"),
        (lambda f, ax: f.legend(loc="center"), "the legend covers data"),
    ],
)
def test_a_fault_is_seen(drawn, plant, fault):
    plant(*drawn)
    assert faults(drawn[0]) == [fault]
