"""Plots of sweeps: lines, maps and dots, with units, and scales that suit the axes."""

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm

import jaxcontact as jc

E, V = np.linspace(0.1, 1, 9), np.geomspace(0.01, 10, 12)


def summary(e, v, m=1.0):
    return jc.impact(jc.HuGuo(e=e), jc.Contact(m, 1.4e8), v)


@pytest.fixture(scope="module")
def table():
    return jc.sweep(summary, e=E, v=V)


def test_a_line(table):
    _, ax = pyplot.subplots()
    assert jc.plot.sweep(table.select(v=V[3]), ax=ax) is ax
    (line,) = ax.get_lines()
    np.testing.assert_array_equal(line.get_xdata(), E)
    np.testing.assert_array_equal(line.get_ydata(), table.restitution[:, 3])
    assert ax.get_xlabel() == "restitution asked for" and ax.get_ylabel() == "restitution"
    assert ax.get_xscale() == "linear"


def test_a_handful_of_lines(table):
    ax = jc.plot.sweep(table, field="duration", x="v")
    lines = ax.get_lines()
    assert len(lines) == 6
    np.testing.assert_array_equal(lines[0].get_ydata(), table.duration[0])
    np.testing.assert_array_equal(lines[-1].get_ydata(), table.duration[-1])
    assert ax.get_legend().get_title().get_text() == "restitution asked for"
    assert ax.get_xlabel() == "closing speed / (m/s)"
    assert ax.get_ylabel() == "duration of contact / ms"
    assert ax.get_xscale() == "log"


def test_a_map(table):
    ax = jc.plot.sweep(table, field="max_force")
    (mesh,) = (item for item in ax.collections if isinstance(item, QuadMesh))
    np.testing.assert_array_equal(mesh.get_array(), table.max_force)
    assert ax.get_xscale() == "log" and ax.get_yscale() == "linear"
    assert ax.get_ylabel() == "restitution asked for"
    x, y = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    # The numbers lie in the middle of their cells, on the scale that is drawn.
    np.testing.assert_allclose(np.sqrt(x[1:] * x[:-1]), V)
    np.testing.assert_allclose((y[1:] + y[:-1]) / 2, E)
    assert ax.figure.axes[-1].get_ylabel() == "largest force / N"
    ax.figure.canvas.draw()


def test_axes_in_any_order_and_bad_lanes():
    table = jc.sweep(summary, e=[0.9, 1.5, 0.3], v=[2.0, 1.0])
    ax = jc.plot.sweep(table, field="duration")
    (mesh,) = (item for item in ax.collections if isinstance(item, QuadMesh))
    shown = mesh.get_array()
    np.testing.assert_array_equal(shown[1], table.duration[0, ::-1])
    assert np.all(shown.mask[2])
    one = jc.plot.sweep(jc.sweep(summary, e=[0.5], v=[1.0, 2.0]), field="duration")
    one.figure.canvas.draw()


def test_dots():
    samples = {"e": [0.3, 0.9, 0.5], "v": [1.0, 2.0, 3.0]}
    table = jc.sweep(summary, samples=samples)
    (line,) = jc.plot.sweep(table, x="v", field="duration").get_lines()
    np.testing.assert_array_equal(line.get_xdata(), samples["v"])
    np.testing.assert_array_equal(line.get_ydata(), table.duration)
    assert line.get_linestyle() == "None"


def test_tables_that_have_no_picture(table):
    with pytest.raises(ValueError, match=r"`table` must have one or two axes.*\('e', 'v', 'm'\)"):
        jc.plot.sweep(jc.sweep(summary, e=E, v=V, m=[1.0, 2.0]))
    with pytest.raises(ValueError, match=r"`table` must have one or two axes.*\(\)"):
        jc.plot.sweep(table.select(e=E[0], v=V[0]))
    nameless = jc.sweep(lambda e: e * np.ones(3), e=E)
    with pytest.raises(ValueError, match="`table` must have a field of one number"):
        jc.plot.sweep(nameless)
    assert not pyplot.get_fignums()


def test_colours_are_logarithmic_over_decades():
    def powers(a, b):
        return {"product": a * b}

    wide = jc.sweep(powers, a=np.geomspace(1, 1000, 4), b=np.linspace(1, 2, 3))
    norm = jc.plot.sweep(wide).collections[0].norm
    assert isinstance(norm, LogNorm) and (norm.vmin, norm.vmax) == (1, 2000)
    for few in (np.linspace(1, 2, 4), np.linspace(-1000, 1000, 4)):
        narrow = jc.sweep(powers, a=few, b=np.linspace(1, 2, 3))
        assert not isinstance(jc.plot.sweep(narrow).collections[0].norm, LogNorm)
