"""The style of plots: colours distinguishable with any vision and in grey, reproducible files."""

import inspect
import itertools

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot

import jaxcontact as jc
from docs import plots
from jaxcontact.lab.plots import _LEFT_OUT
from jaxcontact.plot._drawing.labels import put_label
from jaxcontact.plot._drawing.style import BODIES, CURVES, DATA, use_curves

DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
"""What linear RGB becomes without green cones: Machado et al. (2009), doi 10.1109/TVCG.2009.113."""

XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])

GREY = 10.0  # in L*, where white is 100 and a difference of 1 can just be seen side by side
COLOUR = 17.0  # what all pairs reach, in ΔE*ab, where 2.3 can just be seen


def lab(colour, seen=None):
    """CIE L*a*b* of a colour, as it is `seen`."""
    coded = np.array(mpl.colors.to_rgb(colour))
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    linear = linear if seen is None else np.clip(seen @ linear, 0, 1)
    t = XYZ @ linear / (XYZ @ np.ones(3))
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_the_measure_of_colours_is_right():
    # sRGB red has L*a*b* = 53.24, 80.09, 67.20 (Lindbloom). Red and the green of the same luminance
    # are alike without green cones, and different with them.
    assert lab("#FF0000") == pytest.approx([53.24, 80.09, 67.20], abs=0.05)
    red, green = "#A05000", "#627000"
    assert np.linalg.norm(lab(red) - lab(green)) > 40
    assert np.linalg.norm(lab(red, DEUTERANOPIA) - lab(green, DEUTERANOPIA)) < 18


def test_curves_are_told_apart():
    colours, lines = zip(*CURVES, strict=True)
    assert len(set(lines)) == len(lines)
    for one, other in itertools.combinations(colours[:4], 2):
        assert abs(lab(one)[0] - lab(other)[0]) > GREY
    for palette in (colours, BODIES, (DATA, _LEFT_OUT)):
        for one, other in itertools.combinations(palette, 2):
            for seen in (None, DEUTERANOPIA):
                assert np.linalg.norm(lab(one, seen) - lab(other, seen)) > COLOUR, (one, other)
    # On white paper.
    assert max(lab(colour)[0] for colour in colours) < 75


def test_lines_follow_the_curves_unless_the_user_has_chosen():
    ax = use_curves(pyplot.figure().add_subplot())
    for k in range(4):
        ax.plot([0, 1], [k, k])
    assert [(line.get_color(), line.get_linestyle()) for line in ax.lines] == list(CURVES[:4])
    with mpl.rc_context({"axes.prop_cycle": mpl.cycler(color=["red"])}):
        ax = use_curves(pyplot.figure().add_subplot())
        assert ax.plot([0, 1])[0].get_color() == "red"


@pytest.mark.parametrize(
    ("largest", "name", "label", "tick"),
    [
        (3e-5, "time", "time / µs", "20"),
        (0.02, "indentation", "indentation / mm", "10.0"),
        (0.5, "time", "time / s", "0.2"),
        (4e4, "force", "force / kN", "20"),
        (4e4, "time", "time / s", "20000"),
        (3e-3, "v", "closing speed / (mm/s)", "2.0"),
        (3e-3, "mass", "effective mass / kg", "0.0020"),
        (3e-4, "restitution", "restitution", "0.00020"),
    ],
)
def test_numbers_at_ticks_are_short(largest, name, label, tick):
    ax = pyplot.figure().add_subplot()
    ax.plot([0, largest], [0, 1])
    put_label(ax.xaxis, name)
    ax.figure.canvas.draw()
    assert ax.get_xlabel() == label
    assert tick in [text.get_text() for text in ax.get_xticklabels()]
    # Data and limits stay in SI units.
    assert ax.get_xlim()[1] == pytest.approx(1.05 * largest)


def test_a_file_is_the_same_each_time(tmp_path):
    def written(name):
        ax = pyplot.figure().add_subplot()
        ax.plot([0, 1], [0, 1], label="line")
        ax.fill_between([0, 1], 0, 1, alpha=0.2)
        ax.set_xlabel("v / (m/s)")
        jc.plot.save(np.array([ax]), tmp_path / name)
        return (tmp_path / name).read_bytes()

    for ending in ("svg", "pdf", "png"):
        first = written(f"a.{ending}")
        assert first == written(f"b.{ending}")
        for date in (b"dc:date", b"CreationDate"):
            assert date not in first
    assert b"<image" not in written("a.svg")
    pdf = written("a.pdf")
    assert b"/Type3" not in pdf and b"/CIDFontType2" in pdf and b"/Subtype /Image" not in pdf


def test_the_page_shows_every_plot():
    functions = inspect.getmembers(jc.plot, inspect.isfunction)
    names = [name for name, _ in functions if not name.startswith("_")]
    assert {"law", "impact", "fit", "save"} <= set(names)
    page = (plots.HERE / "plots.md").read_text(encoding="utf-8")
    assert page == plots.page(), "run python docs/plots.py"
    for name in names:
        assert f"jc.plot.{name}(" in page, name
    for section in plots.SECTIONS:
        assert 1000 < section.file.stat().st_size < 60_000, section.name
        # With the data that a new user lacks: a sound, a track, a record.
        assert len(section.code.strip().splitlines()) <= 12
