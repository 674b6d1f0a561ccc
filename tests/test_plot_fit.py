"""Pictures of a fit: data, prediction, and the band of its standard errors."""

import numpy as np
import pytest
from matplotlib import pyplot

import jaxcontact as jc

X = np.linspace(1, 4, 20)
Y = 2 * X + np.random.default_rng(0).normal(size=20)


@pytest.fixture(autouse=True)
def close():
    yield
    pyplot.close("all")


def line(p, x):
    return p[0] + p[1] * x


@pytest.fixture(scope="module")
def fitted():
    return jc.fit(line, Y, [0.0, 1.0], x=X)


def test_data_line_and_band(fitted):
    _, ax = pyplot.subplots()
    assert jc.plot.fit(fitted, x=X, ax=ax, color="k") is ax
    dots, drawn = ax.lines
    assert np.array_equal(dots.get_ydata(), Y) and drawn.get_color() == "k"
    assert np.allclose(drawn.get_ydata(), fitted.predict())
    # The band of a straight line is a formula.
    noise = np.sqrt(np.sum(fitted.residuals**2) / 18)
    error = noise * np.sqrt(1 / 20 + (X - X.mean()) ** 2 / np.sum((X - X.mean()) ** 2))
    for band, half in zip(ax.collections, (error, np.hypot(error, noise)), strict=True):
        corners = band.get_paths()[0].vertices
        for x, wide, middle in zip(X, 2 * half, np.asarray(fitted.predict()), strict=True):
            edge = corners[np.isclose(corners[:, 0], x)][:, 1]
            ends = middle - wide, middle + wide
            assert (edge.min(), edge.max()) == pytest.approx(ends, rel=1e-6)


def test_speeds_over_decades_are_logarithmic():
    x = np.geomspace(0.01, 10, 20)
    ax = jc.plot.fit(jc.fit(line, 1 + x, [0.0, 0.5], x=x))
    assert ax.get_xscale() == "log" and ax.lines[1].get_xdata().size == 200


def test_what_has_no_line():
    lone = jc.fit(lambda p: p * np.ones(3), np.arange(3.0), 1.0)
    with pytest.raises(ValueError, match="one-dimensional `x`"):
        jc.plot.fit(lone)


def test_several_columns_have_axes_of_their_own():
    def both(p, x):
        return {"e": p[0] + p[1] * x, "time": p[0] - p[1] * x}

    data = {"e": Y.copy(), "time": -Y}
    data["e"][3] = np.nan
    weights = {"e": np.where(np.isnan(data["e"]), 0.0, 1.0), "time": np.ones(20)}
    found = jc.fit(both, data, [0.0, 1.0], x=X, weights=weights)
    first, second = jc.plot.fit(found, x=X)
    assert (first.get_ylabel(), second.get_ylabel()) == ("e", "time")
    assert np.array_equal(second.lines[0].get_ydata(), data["time"])
    for axes, name in ((first, "e"), (second, "time")):
        assert np.allclose(axes.lines[1].get_ydata(), found.predict()[name])
    with pytest.raises(ValueError, match="Argument `ax` must be 2 axes of matplotlib"):
        jc.plot.fit(found, ax=[first])
