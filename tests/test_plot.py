"""Pictures: on the axes they are given, with units, and matplotlib only for those who plot."""

import subprocess
import sys

import jax
import numpy as np
import pytest
from matplotlib import pyplot

import jaxcontact as jc

CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8)


@pytest.fixture(autouse=True)
def close():
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def path():
    return jc.trajectory(jc.HuGuo(e=0.7), CONTACT, 4.2, samples=30)


def test_on_given_axes(path):
    _, ax = pyplot.subplots()
    assert jc.plot.trajectory(path, x="indentation", y="force", ax=ax, label="Hu-Guo") is ax
    (line,) = ax.get_lines()
    np.testing.assert_array_equal(line.get_xdata(), path.indentation)
    np.testing.assert_array_equal(line.get_ydata(), path.force)
    assert line.get_label() == "Hu-Guo"
    assert ax.get_xlabel() == "indentation / m" and ax.get_ylabel() == "force / N"
    jc.plot.trajectory(path, x="indentation", y="force", ax=ax)
    assert len(ax.get_lines()) == 2


def test_on_new_axes(path):
    ax = jc.plot.trajectory(path)
    assert ax.get_xlabel() == "time / s" and ax.get_ylabel() == "force / N"
    other = jc.plot.trajectory(path, y="velocity")
    assert other is not ax and other.get_ylabel() == "velocity / (m/s)"
    ax.figure.canvas.draw()


def test_bad_arguments(path):
    with pytest.raises(ValueError, match=r"`y` must be one of .*'force'.*, but is 'speed'"):
        jc.plot.trajectory(path, y="speed")
    with pytest.raises(ValueError, match=r"`x` must be one of .*, but is 'energy'"):
        jc.plot.trajectory(path, x="energy")
    batch = jax.tree.map(lambda leaf: leaf[None], path)
    with pytest.raises(ValueError, match=r"`path` must be a single trajectory.*\(1, 30\)"):
        jc.plot.trajectory(batch)
    assert not pyplot.get_fignums()


def test_unknown_attributes_are_errors():
    with pytest.raises(AttributeError, match="'jaxcontact' has no attribute 'nonsense'"):
        _ = jc.nonsense


SCRIPT = """
import sys
import jaxcontact as jc
for name in ("matplotlib", "optax", "xarray", "tqdm", "pandas"):
    assert name not in sys.modules, name
assert callable(jc.plot.trajectory)
assert jc.plot is sys.modules["jaxcontact.plot"]
import jax
assert not jax.config.jax_enable_x64
"""


def test_importing_loads_no_matplotlib(request):
    subprocess.run([sys.executable, "-c", SCRIPT], check=True, cwd=request.config.rootpath)
