"""The figure of a calibration: its contents, their places, and its axes."""

import dataclasses
import itertools

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text

import jaxcontact as jc
from jaxcontact.lab.calibration.verdict import headlines
from jaxcontact.lab.plots import calibration


@pytest.fixture(scope="module")
def blue():
    """Two laws, four times each under other names: one is chosen, three are not ruled out."""
    found = jc.calibrate(jc.read_recording(), laws="kuwabara_kono")
    laws = [
        dataclasses.replace(law, kind=f"{law.kind} {k}") if k else law
        for k in range(4)
        for law in found.choice.laws
    ]
    fits = {law.kind: found.choice.fits[law.kind[:-2]] for law in laws[2:]}
    rivals = tuple(law.kind for law in laws[2:5])
    named = {"laws": tuple(laws), "rivals": rivals, "fits": found.choice.fits | fits}
    return dataclasses.replace(found, choice=dataclasses.replace(found.choice, **named))


@pytest.fixture(scope="module")
def ax(blue):
    return calibration(blue)


def texts_of(ax):
    return [text.get_text() for text in ax.texts]


def test_every_pair_is_drawn_once_and_inside(blue, ax):
    points = [line for line in ax.lines if line.get_linestyle() == "None"]
    kept, left_out = points
    assert len(kept.get_xdata()) + len(left_out.get_xdata()) == len(blue.pairs)
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for line in points:
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert np.all((x > left) & (x < right) & (y > low) & (y < high))
    assert len(kept.get_xdata()) == blue.choice.count
    # Pairs left out look alike, and the legend says how many the frame does not hold.
    e = np.array([pair.restitution for pair in blue.pairs if pair.marked])
    beyond = np.sum((e < low) | (e > high))
    assert left_out.get_label() == f"left out (23; {beyond} beyond the frame)" and beyond > 0


def test_the_chosen_law_and_those_not_ruled_out(blue, ax):
    best = blue.chosen.kind  # asked for, and not the one of lowest AICc
    labels = ax.get_legend_handles_labels()[1]
    assert labels[0] == "measured (271 pairs, scatter 2.2 %)"
    assert labels[2:] == [f"{best} ± 2 standard errors"] and len(ax.collections) == 1
    lines = [line for line in ax.lines if line.get_linestyle() != "None"]
    thick = max(lines, key=lambda line: line.get_linewidth())
    curve, error = blue.choice.curve(best, thick.get_xdata())
    np.testing.assert_array_equal(thick.get_ydata(), curve)
    band = ax.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(np.max(curve + 2 * error), rel=1e-12)
    assert set(texts_of(ax)) == {best, blue.choice.best, *blue.choice.rivals} and len(lines) == 5
    assert ax.get_title(loc="left").replace("\n", " ") == headlines(blue)[0]
    assert ax.get_xlabel() == "closing speed / (m/s)" and "drag left in" in ax.get_ylabel()


@pytest.mark.parametrize("size", [(7.0, 4.6), (4.4, 3.9)])
def test_names_at_the_lines_do_not_overlap_and_the_legend_covers_no_data(blue, size):
    given = plt.figure(figsize=size, layout="constrained").subplots()
    ax = calibration(blue, show="all", ax=given)
    assert ax is given
    assert sorted(texts_of(ax)) == sorted(law.kind for law in blue.choice.laws)
    ax.figure.canvas.draw()
    frame, figure = ax.get_window_extent(), ax.figure.bbox
    places = sorted((Text.get_window_extent(text) for text in ax.texts), key=lambda box: box.y0)
    assert all(lower.y1 <= upper.y0 for lower, upper in itertools.pairwise(places))
    assert all(figure.x1 >= box.x1 and box.y0 > figure.y0 for box in places)
    legend, title = ax.get_legend().get_window_extent(), ax._left_title.get_window_extent()
    assert legend.y0 >= frame.y1 - 1 and title.y0 >= legend.y1 - 1 and title.y1 <= figure.y1


@pytest.mark.parametrize(("e", "top"), [([0.93, 0.99], 1.0), ([0.93, 1.01], 1.0376)])
def test_the_frame_ends_at_one_unless_data_are_above(e, top):
    two = jc.calibrate(jc.read_recording(velocity=[1.0, 2.0], restitution=e))
    assert calibration(two).get_ylim()[1] == pytest.approx(top, abs=1e-3)


def test_one_pair_has_an_error_bar_and_a_curve():
    one = jc.read_recording({"velocity (m/s)": [2.0], "restitution": [0.85], "sigma": [0.01]})
    ax = calibration(jc.calibrate(one))
    bar, band = sorted(ax.collections, key=lambda one: type(one).__name__, reverse=True)
    (ends,) = bar.get_segments()
    np.testing.assert_allclose(ends, [[2.0, 0.83], [2.0, 0.87]], atol=1e-12)
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(0.87, abs=1e-3)
    (curve,) = (line for line in ax.lines if len(line.get_xdata()) > 1)
    assert curve.get_xdata()[[0, -1]] == pytest.approx([1.0, 3.0])
    assert curve.get_ydata() == pytest.approx(0.85) and ax.get_ylim()[0] < 0.83
    assert ax.get_title(loc="left") == "e = 0.850 ± 0.020 (95 %) at 2 m/s, from one pair"
