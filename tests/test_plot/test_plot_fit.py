"""Plots of a fit: data, prediction and its bands; residuals; profiles; corners, also of draws."""

import dataclasses
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


NAMES = "K", "e", "law.beta"
VALUES = np.array([1.4e8, 0.7, 3.0])
ERRORS = np.array([3e6, 1e-5, 0.1])


@pytest.fixture(scope="module")
def of_three():
    """A fit of three numbers of other sizes, whose covariance is set."""
    line = jc.fit(lambda p: p, np.array([1.0, 2.0]), np.ones(2), sigma=1.0)
    correlation = np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]])
    covariance = correlation * np.outer(ERRORS, ERRORS)
    return dataclasses.replace(line, names=NAMES, values=VALUES, covariance=covariance)


@pytest.fixture(scope="module")
def drawn(of_three):
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(3), of_three.correlation, (4, 5000)
    )
    samples = {name: VALUES[i] + ERRORS[i] * draws[..., i] for i, name in enumerate(NAMES)}
    return jc.Posterior(samples, {}, {}, 0, 0, True, "", of_three)


def inside(path, points):
    """The share of points (n, 2) inside a closed line."""
    return path.contains_points(points).mean()


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_ellipses_and_contours_hold_the_level(of_three, drawn, level):
    grid = jc.plot.corner(drawn, level=level)
    again = jc.plot.corner(of_three, level=level, ax=grid)
    assert again.shape == (3, 3) and all(a is b for a, b in zip(again.flat, grid.flat, strict=True))
    for row, column in ((1, 0), (2, 0), (2, 1)):
        pair = grid[row, column]
        points = np.stack([drawn.samples[NAMES[i]].ravel() for i in (column, row)], axis=1)
        (contour,) = pair.collections
        ellipse = pair.lines[1].get_path()
        # 20,000 draws: three times √(level (1 - level)/n).
        assert inside(ellipse, points) == pytest.approx(level, abs=0.011)
        # A contour of smoothed counts is a little wide.
        assert inside(contour.get_paths()[0], points) == pytest.approx(level, abs=0.03)
    for i in range(3):
        curve, *ends = grid[i, i].lines[2:]
        wanted = stats.norm(VALUES[i], ERRORS[i])
        assert np.allclose(curve.get_ydata(), wanted.pdf(curve.get_xdata()))
        assert [end.get_xdata()[0] for end in ends] == pytest.approx(wanted.interval(level))
        drawn_ends = [line.get_xdata()[0] for line in grid[i, i].lines[:2]]
        assert drawn_ends == pytest.approx(drawn.interval(NAMES[i], level))
    assert not grid[0, 1].get_visible() and grid[1, 0].get_visible()


def test_labels_have_units_and_ticks_do_not_collide(of_three):
    grid = jc.plot.corner(of_three)
    figure = grid[0, 0].figure
    figure.canvas.draw()
    assert grid[2, 0].get_xlabel() == "K\n/ (10⁸ N/m^n)"
    assert grid[2, 0].get_ylabel() == "law.beta" and grid[2, 1].get_ylabel() == ""
    # e is known to 1e-5, so its ticks are counted from a number in the middle.
    assert grid[2, 1].get_xlabel() == "(e - 0.7)\n/ 10⁻⁵"
    assert grid[0, 0].get_window_extent().height > 100
    for axes in (grid[2, 0], grid[2, 1], grid[2, 2], grid[1, 0]):
        for axis in (axes.xaxis, axes.yaxis):
            labels = [label for label in axis.get_ticklabels() if label.get_text()]
            assert all(len(label.get_text()) <= 6 for label in labels)
            # Rotated by 45°, or one above the other: lines of text need √2 of their height.
            place = axes.transData.transform([label.get_position() for label in labels])
            place = np.sort(place[:, 0 if axis is axes.xaxis else 1]) if labels else np.zeros(0)
            height = labels[0].get_fontsize() * figure.dpi / 72 if labels else 0
            assert (np.diff(place) > 1.42 * height).all()
    assert 2 <= len([x for x in grid[2, 1].get_xticklabels() if x.get_text()]) <= 4
    for i in range(3):
        lows = {tuple(grid[row, i].get_xlim()) for row in range(i, 3)}
        assert lows | {tuple(grid[i, column].get_ylim()) for column in range(i)} == lows
        assert len(lows) == 1


def test_some_names_and_one_that_has_no_error(of_three, drawn):
    grid = jc.plot.corner(drawn, names=["law.beta", "K"])
    assert grid.shape == (2, 2) and grid[1, 0].get_xlabel() == "law.beta"
    covariance = of_three.covariance.copy()
    covariance[1] = covariance[:, 1] = np.nan
    open_ = dataclasses.replace(of_three, covariance=covariance)
    assert jc.plot.corner(open_).shape == (2, 2)
    none, stopped = {"covariance": covariance * np.nan}, {"converged": False}
    for change, names, words in (
        ({}, ["e"], "with a standard error, but names e, which has none"),
        (none, None, "no parameter has one"),
        (stopped, None, r"must be a fit that converged, but it did not: no step"),
    ):
        for draw in (jc.plot.corner, jc.plot.profile):
            with pytest.raises(ValueError, match=words):
                draw(dataclasses.replace(open_, **change), names=names)
    with pytest.raises(ValueError, match="`ax` must be 3 x 3 axes of matplotlib"):
        jc.plot.corner(of_three, ax=pyplot.figure().subplots(2, 2))


def test_draws_that_did_not_converge_say_so(drawn):
    stuck = {name: np.full((2, 4), x) for name, x in zip(NAMES, VALUES, strict=True)}
    grid = jc.plot.corner(dataclasses.replace(drawn, converged=False, samples=stuck))
    assert grid[0, 0].get_title(loc="left") == "not converged"
    assert not grid[1, 0].collections
