"""Plots of impacts, laws and sweeps: on given axes, with units, and scales that suit the axes."""

import jax
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm

import jaxcontact as jc

CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8)


@pytest.fixture(scope="module")
def path():
    return jc.trajectory(jc.HuGuo(e=0.7), CONTACT, 4.2, samples=30)


def test_on_given_axes_and_on_new_ones(path):
    _, ax = pyplot.subplots()
    assert jc.plot.trajectory(path, x="indentation", y="force", ax=ax, label="Hu-Guo") is ax
    (line,) = ax.get_lines()
    np.testing.assert_array_equal(line.get_xdata(), path.indentation)
    np.testing.assert_array_equal(line.get_ydata(), path.force)
    assert line.get_label() == "Hu-Guo"
    assert ax.get_xlabel() == "indentation / mm" and ax.get_ylabel() == "force / kN"
    jc.plot.trajectory(path, ax=ax)
    assert len(ax.get_lines()) == 2 and ax.get_xlabel() == "time / ms"
    other = jc.plot.trajectory(path, y="velocity")
    assert other is not ax and other.get_ylabel() == "velocity / (m/s)"
    other.figure.canvas.draw()


def test_a_batch_is_refused(path, hit):
    batch, hits = jax.tree.map(lambda leaf: leaf[None], (path, hit))
    with pytest.raises(ValueError, match=r"`path` must be a single trajectory.*\(1, 30\)"):
        jc.plot.trajectory(batch)
    with pytest.raises(ValueError, match=r"`hit` must be a single impact.*\(1,\)"):
        jc.plot.impact(path, hits)
    assert not pyplot.get_fignums()


@pytest.fixture(scope="module")
def hit():
    return jc.impact(jc.HuGuo(e=0.7), CONTACT, 4.2)


def test_one_impact(path, hit):
    axes = jc.plot.impact(path, hit, label="Hu-Guo")
    loop, force, speed = axes
    # The area of the loop is the energy lost, up to the trapezoids of 30 samples.
    x, y = loop.patches[0].get_xy().T
    assert np.trapezoid(y, x) == pytest.approx(float(hit.energy_loss), rel=0.01)
    assert "$e$ = 0.697, 4.53 J lost" in speed.get_title(loc="left")
    ends = {float(line.get_xdata()[0]) for line in force.lines if line.get_linestyle() == ":"}
    assert {float(hit.compression_time), float(hit.duration)} < ends
    across = [line.get_ydata()[0] for line in speed.lines if line.get_linestyle() == ":"]
    assert -float(hit.rebound_velocity) in across
    again = jc.plot.impact(path, ax=axes)
    assert list(again) == list(axes)
    assert [text.get_text() for text in loop.get_legend().get_texts()] == ["Hu-Guo"]
    with pytest.raises(ValueError, match="is an `Impact`, which has no time history: give"):
        jc.plot.impact(hit)
    with pytest.raises(ValueError, match="`ax` must be 3 axes of matplotlib, one for each picture"):
        jc.plot.impact(path, ax=axes[:2])


def test_a_law_without_a_contact():
    axes = jc.plot.law(jc.HuntCrossley(e=0.5))
    loop, delivered, damping = axes
    assert loop.get_xlabel() == "indentation / largest"
    # Hunt and Crossley's α = 3/2 (1 - e), drawn over the requested e.
    line, dot = damping.lines
    np.testing.assert_allclose(line.get_ydata(), 1.5 * (1 - line.get_xdata()), rtol=1e-12)
    assert dot.get_ydata()[0] == pytest.approx(0.75)
    (e,) = delivered.lines[-1].get_ydata()
    # α (1 + e) = ln((1 + α)/(1 - α e)) holds for the delivered e.
    assert 0.75 * (1 + e) == pytest.approx(np.log(1.75 / (1 - 0.75 * e)), rel=1e-9)
    jc.plot.law(jc.HuGuo(e=0.5), ax=axes, label="other")
    first, second = loop.lines
    assert first.get_color() != second.get_color()
    assert first.get_linestyle() != second.get_linestyle()
    for one in axes:
        assert {line.get_color() for line in one.lines} >= {first.get_color(), second.get_color()}
    labels = [text.get_text() for text in loop.get_legend().get_texts()]
    assert labels == ["HuntCrossley(e=0.5)", "other"]


def test_a_law_of_the_speed():
    law, contact = jc.ConstantDamping(c=2e5), jc.Contact(mass=0.05, stiffness=1e6)
    loop, delivered, damping = jc.plot.law(law, contact, 2.0)
    e = delivered.lines[-1].get_ydata()[0]
    x, y = loop.lines[0].get_xdata(), loop.lines[0].get_ydata()
    # The loss ½ m v² (1 - e²) is the area of the loop.
    assert np.trapezoid(y, x) == pytest.approx(0.5 * 0.05 * 4 * (1 - e**2), rel=1e-4)
    speeds = damping.lines[0].get_xdata()
    np.testing.assert_allclose(damping.lines[0].get_ydata(), 0.2 * speeds, rtol=1e-12)
    assert speeds[[0, -1]] == pytest.approx([2 / 30, 60])
    assert damping.get_xlabel() == "closing speed / (m/s)" and loop.get_ylabel() == "force / N"
    with pytest.raises(ValueError, match="Argument `contact` is needed for `ConstantDamping`"):
        jc.plot.law(law)


def test_a_law_without_a_damping_factor():
    axes = jc.plot.law(jc.KelvinVoigt(e=0.5))
    assert not axes[2].has_data() and "no damping factor" in axes[2].texts[0].get_text()
    with pytest.raises(ValueError, match="must hold scalars"):
        jc.plot.law(jc.HuGuo(e=np.array([0.3, 0.5])))


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
