"""Plots of a fit: data, prediction and its bands; residuals; profiles."""

import importlib
import inspect
import pkgutil
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib import pyplot
from scipy import stats

import jaxcontact
import jaxcontact as jc
from jaxcontact._text.units import Shown

X = np.linspace(1, 4, 20)
Y = 2 * X + np.random.default_rng(0).normal(size=20)


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
    # The band of a straight line has a formula.
    noise = np.sqrt(np.sum(fitted.residuals**2) / 18)
    error = noise * np.sqrt(1 / 20 + (X - X.mean()) ** 2 / np.sum((X - X.mean()) ** 2))
    for band, half in zip(ax.collections, (error, np.hypot(error, noise)), strict=True):
        corners = band.get_paths()[0].vertices
        students = stats.t.ppf(0.975, 18)
        for x, wide, middle in zip(X, students * half, np.asarray(fitted.predict()), strict=True):
            edge = corners[np.isclose(corners[:, 0], x)][:, 1]
            ends = middle - wide, middle + wide
            assert (edge.min(), edge.max()) == pytest.approx(ends, rel=1e-6)


def test_speeds_over_decades_are_logarithmic():
    x = np.geomspace(0.01, 10, 20)
    ax = jc.plot.fit(jc.fit(line, 1 + x, [0.0, 0.5], x=x))
    assert ax.get_xscale() == "log" and ax.lines[1].get_xdata().size == 200


class Falling(eqx.Module):
    """ln h over a speed."""

    shown: ClassVar = {"x": Shown("velocity"), "": Shown("height", "rebound", logarithm=True)}

    def __call__(self, p, x):
        return p[0] + p[1] * jnp.log(x)


def test_a_prediction_says_how_it_is_shown():
    heights = np.exp(0.1 + 2 * np.log(X) + 0.05 * (Y - 2 * X))
    weights = np.where(X > 3.9, 0.0, 1.0)
    found = jc.fit(Falling(), np.log(heights), [0.0, 1.0], x=X, weights=weights)
    ax = jc.plot.fit(found)
    dots, drawn = ax.lines
    assert np.allclose(dots.get_ydata(), heights[:-1])
    # It ends at the last data used.
    assert drawn.get_xdata()[-1] == X[-2]
    assert np.allclose(drawn.get_ydata(), np.exp(found.predict(drawn.get_xdata())))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("closing speed / (m/s)", "rebound / m")
    assert ax.get_yscale() == "log"
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["data", "fit", "true curve, 95 %", "new reading, 95 %"]
    assert jc.plot.residuals(found)[0].get_xlabel() == "closing speed / (m/s)"


def test_every_ready_made_prediction_says_how_it_is_shown():
    rooms = "_inverse lab.bounces lab.oblique lab.records paper._velocity_profile".split()
    every = [one.name for one in pkgutil.walk_packages(jaxcontact.__path__, "jaxcontact.")]
    names = [x for x in every if x.startswith(tuple(f"jaxcontact.{room}" for room in rooms))]
    predictions = {
        value
        for module in map(importlib.import_module, names)
        for value in vars(module).values()
        if inspect.isclass(value) and issubclass(value, eqx.Module) and "__call__" in vars(value)
        if value.__module__ == module.__name__ and not issubclass(value, jc.AbstractShape)
    }
    assert len(predictions) >= 8
    assert not [one.__name__ for one in predictions if not hasattr(one, "shown")]


def test_what_fit_velocity_profile_returned():
    u = np.linspace(0, 1, 12)
    found = jc.fit_velocity_profile(1e-3 * u, 2 * np.sqrt(1 - u**2.3))
    ax = jc.plot.fit(found)
    dots, drawn = ax.lines
    assert np.allclose(dots.get_xdata(), u) and np.allclose(dots.get_ydata(), np.sqrt(1 - u**2.3))
    assert np.allclose(drawn.get_ydata(), np.sqrt(1 - drawn.get_xdata() ** 2.3), atol=1e-6)
    assert ax.get_xlabel() == "indentation / largest"
    assert len(jc.plot.residuals(found)) == 3


def both(p, x):
    return {"e": p[0] + p[1] * x, "time": p[0] - p[1] * x}


def test_several_columns_have_axes_of_their_own():
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
    axes = jc.plot.residuals(found)
    assert [text.get_text() for text in axes[2].get_legend().get_texts()] == ["e", "time"]
    # One of the first 20 is not counted.
    assert np.array_equal(axes[1].lines[1].get_xdata(), np.arange(19, 39))


def test_residuals_over_x_in_order_and_against_normal_ones(fitted):
    axes = jc.plot.residuals(fitted)
    z = fitted.residuals / np.sqrt(fitted.noise)
    over_x, in_order, quantiles = (one.lines[0] for one in axes)
    assert np.array_equal(over_x.get_xdata(), X) and np.allclose(over_x.get_ydata(), z)
    assert np.array_equal(in_order.get_xdata(), np.arange(20))
    # Like scipy, which uses other quantiles at the ends.
    theirs = stats.probplot(z, fit=False)
    assert np.array_equal(quantiles.get_ydata(), theirs[1])
    assert np.allclose(quantiles.get_xdata(), theirs[0], atol=0.15)
    # Points without weight, such as padding, are not counted in the order.
    padded = jc.fit(line, Y, [0.0, 1.0], x=X, weights=np.arange(20) % 3 > 0)
    in_order = jc.plot.residuals(padded)[1].lines[0].get_xydata()
    there = in_order[~np.isnan(in_order[:, 1]), 0]
    assert np.array_equal(there, np.arange(np.count_nonzero(np.arange(20) % 3)))
    lone = jc.fit(lambda p: p * np.ones(3), np.arange(3.0), 1.0)
    assert len(jc.plot.residuals(lone)) == 2
    with pytest.raises(ValueError, match="one-dimensional `x`"):
        jc.plot.fit(lone)
    with pytest.raises(ValueError, match="3 axes of matplotlib, one for each picture"):
        jc.plot.residuals(fitted, ax=axes[:2])


def test_profiles_of_a_line_are_parabolas(fitted):
    axes = jc.plot.profile(fitted, level=0.9)
    assert [one.get_xlabel() for one in axes] == list(fitted.names)
    for one, name in zip(axes, fitted.names, strict=True):
        normal, curve, best = one.lines[:3]
        assert np.allclose(normal.get_ydata(), curve.get_ydata(), rtol=1e-6, atol=1e-6)
        assert best.get_xdata()[0] == fitted.params[int(name[1])]
        low, high = fitted.interval(0.9)[name]
        box = one.patches[0].get_extents().transformed(one.transData.inverted())
        assert (box.x0, box.x1) == pytest.approx((low, high))
    alone = jc.plot.profile(fitted, "[0]")
    assert alone.get_xlabel() == "[0]"
