"""The figure of a calibration: its contents, their places, and its axes."""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.plots import calibration


@pytest.fixture(scope="module")
def blue():
    """Two laws, four times each to fill the legend; the last one is not identifiable."""
    found = jc.calibrate(jc.read_recording(), laws="kuwabara_kono")
    *laws, last = 4 * found.choice.laws
    laws = (*laws, dataclasses.replace(last, identifiable=False))
    return dataclasses.replace(found, choice=dataclasses.replace(found.choice, laws=laws))


@pytest.fixture(scope="module")
def ax(blue):
    return calibration(blue)


def test_it_draws_into_the_axes_it_is_given(blue):
    _, ax = plt.subplots()
    assert calibration(blue, ax=ax) is ax


def test_every_pair_is_drawn_once_and_inside(blue, ax):
    points = [line for line in ax.lines if line.get_linestyle() == "None"]
    assert sum(len(line.get_xdata()) for line in points) == len(blue.pairs)
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for line in points:
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert np.all((x > left) & (x < right) & (y > low) & (y < high))
    kept = next(line for line in points if line.get_label() == "kept")
    assert len(kept.get_xdata()) == blue.choice.count


def test_curves_bands_and_words(blue, ax):
    labels = ax.get_legend_handles_labels()[1]
    assert [law.kind for law in blue.choice.laws] == labels[2:]
    assert "left out (23)" in labels[1]
    assert len(ax.collections) == sum(law.identifiable for law in blue.choice.laws) == 7
    assert ax.get_xlabel().endswith("(m/s)")
    assert "drag left in" in ax.get_ylabel()
    # The legend covers no data.
    ax.figure.canvas.draw()
    legend = ax.get_legend().get_window_extent()
    assert legend.y0 >= ax.get_window_extent().y1 - 1
