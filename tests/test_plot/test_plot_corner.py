"""The corner plot of fits and of posteriors."""

import dataclasses

import numpy as np
import pytest
from matplotlib import pyplot
from scipy import stats

import jaxcontact as jc

NAMES = "K", "e", "law.beta"
VALUES = np.array([1.4e8, 0.7, 3.0])
ERRORS = np.array([3e6, 1e-5, 0.1])


@pytest.fixture(scope="module")
def fitted():
    """A fit of three numbers of other sizes, whose covariance is set."""
    line = jc.fit(lambda p: p, np.array([1.0, 2.0]), np.ones(2), sigma=1.0)
    correlation = np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]])
    covariance = correlation * np.outer(ERRORS, ERRORS)
    return dataclasses.replace(line, names=NAMES, values=VALUES, covariance=covariance)


@pytest.fixture(scope="module")
def drawn(fitted):
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(3), fitted.correlation, (4, 5000))
    samples = {name: VALUES[i] + ERRORS[i] * draws[..., i] for i, name in enumerate(NAMES)}
    return jc.Posterior(samples, {}, {}, 0, 0, True, "", fitted)


def inside(path, points):
    """The share of points (n, 2) inside a closed line."""
    return path.contains_points(points).mean()


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_ellipses_and_contours_hold_the_level(fitted, drawn, level):
    grid = jc.plot.corner(drawn, level=level)
    again = jc.plot.corner(fitted, level=level, ax=grid)
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


def test_labels_have_units_and_ticks_do_not_collide(fitted):
    grid = jc.plot.corner(fitted)
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


def test_some_names_and_one_that_has_no_error(fitted, drawn):
    grid = jc.plot.corner(drawn, names=["law.beta", "K"])
    assert grid.shape == (2, 2) and grid[1, 0].get_xlabel() == "law.beta"
    covariance = fitted.covariance.copy()
    covariance[1] = covariance[:, 1] = np.nan
    open_ = dataclasses.replace(fitted, covariance=covariance)
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
        jc.plot.corner(fitted, ax=pyplot.figure().subplots(2, 2))


def test_draws_that_did_not_converge_say_so(drawn):
    stuck = {name: np.full((2, 4), x) for name, x in zip(NAMES, VALUES, strict=True)}
    grid = jc.plot.corner(dataclasses.replace(drawn, converged=False, samples=stuck))
    assert grid[0, 0].get_title(loc="left") == "not converged"
    assert not grid[1, 0].collections
