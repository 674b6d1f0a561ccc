"""Legibility of a figure: nothing cut off, no overlapping text."""

import itertools

import pytest
from matplotlib.text import Text

from jaxcontact.paper._drawing import sheet

PIXEL = 1.0  # what two neighbouring boxes may share by rounding


def faults(figure):
    """Everything that is cut off by the edge of the figure, and every pair of texts that touch."""
    figure.canvas.draw()
    page = figure.bbox
    texts = [
        (text.get_text(), text.get_window_extent())
        for text in figure.findobj(lambda artist: isinstance(artist, Text))
        if text.get_visible() and text.get_text().strip() and text.get_figure() is figure
    ]
    # Tick labels beyond the limits of their axis are made but not drawn.
    texts = [(name, box) for name, box in texts if _is_drawn(figure, name, box)]
    found = [
        f"{name!r} is cut off"
        for name, box in texts
        if min(box.x0 - page.x0, box.y0 - page.y0, page.x1 - box.x1, page.y1 - box.y1) < -PIXEL
    ]
    for (first, a), (second, b) in itertools.combinations(texts, 2):
        width = min(a.x1, b.x1) - max(a.x0, b.x0)
        height = min(a.y1, b.y1) - max(a.y0, b.y0)
        if width > PIXEL and height > PIXEL:
            found.append(f"{first!r} lies on {second!r}")
    for legend in figure.legends:
        box = legend.get_window_extent()
        if box.x0 < page.x0 - PIXEL or box.x1 > page.x1 + PIXEL:
            found.append("the legend is cut off")
        for ax in figure.axes:
            data = ax.get_window_extent()
            if min(box.x1, data.x1) > max(box.x0, data.x0) + PIXEL and box.y0 < data.y1 - PIXEL:
                found.append("the legend covers data")
    return found


def _is_drawn(figure, name, box):
    ticks = [
        (axis, label)
        for ax in figure.axes
        for axis in (ax.xaxis, ax.yaxis)
        for label in axis.get_ticklabels(which="both")
        if label.get_text() == name and label.get_window_extent().bounds == box.bounds
    ]
    if not ticks:
        return True
    for axis, label in ticks:
        low, high = sorted(axis.get_view_interval())
        place = label.get_position()[0 if axis.axis_name == "x" else 1]
        if low <= place <= high:
            return True
    return False


@pytest.mark.parametrize(
    ("plant", "fault"),
    [
        (lambda f, ax: [ax.text(0.5, 0.5, x) for x in ("one", "two")], "'one' lies on 'two'"),
        (lambda f, ax: f.text(0.99, 0.5, "long"), "'long' is cut off"),
        (lambda f, ax: f.legend(loc="center"), "the legend covers data"),
    ],
)
def test_a_fault_is_seen(plant, fault):
    figure, (ax,) = sheet()
    ax.plot([0, 1], [0, 1], label="a line")
    ax.set_xlabel("a quantity / unit")
    plant(figure, ax)
    assert faults(figure) == [fault]
