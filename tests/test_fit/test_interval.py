"""Intervals and bands against closed forms, and against a profile by scipy."""

import numpy as np
import pytest
from scipy import optimize, stats

import jaxcontact as jc
from tests.test_fit.curves import FLAT, decay, line

X = np.linspace(0, 4, 12)
NOISE = np.random.default_rng(0).normal(size=12)
DECAY = 2.5 * np.exp(-1.3 * X) + 0.5 + 0.1 * NOISE
START = {"a": 1.0, "b": 1.0, "c": 0.3}
T9 = stats.t.ppf(0.975, 9)

MET = 2e-3  # of a standard error: an end is searched until its deviation is within a thousandth


def of_line(**how):
    return jc.fit(line, 2 * X - 1 + NOISE, FLAT, x=X, **how)


@pytest.fixture(scope="module")
def curved():
    return jc.fit(decay, DECAY, START, x=X)


def least(value, held, bounds=(-np.inf, np.inf)):
    """Twice the loss of the decay with one parameter held and the others fitted, by scipy."""
    others = [name for name in START if name != held]

    def residual(fitted):
        p = dict(zip(others, fitted, strict=True)) | {held: value}
        return p["a"] * np.exp(-p["b"] * X) + p["c"] - DECAY

    start = [START[name] for name in others]
    tight = {"xtol": 1e-14, "ftol": 1e-14}
    return 2 * optimize.least_squares(residual, start, bounds=bounds, **tight).cost


def ends_by_scipy(held, quantile, high=np.inf):
    """The ends for a parameter of the decay: where the least loss has risen enough."""
    bounds = (-np.inf, [high if name == "b" else np.inf for name in START if name != held])
    best = optimize.least_squares(
        lambda p: p[0] * np.exp(-p[1] * X) + p[2] - DECAY, (1, 1, 0.3), xtol=1e-14, ftol=1e-14
    )
    wanted = 2 * best.cost * (1 + quantile**2 / 9)
    middle = best.x[list(START).index(held)]
    return tuple(
        optimize.brentq(lambda v: least(v, held, bounds) - wanted, middle, middle + far, xtol=1e-10)
        for far in (-0.6, 0.6)
    )


@pytest.mark.parametrize(
    ("how", "level", "far"),
    [
        ({}, 0.95, stats.t.ppf(0.975, 10)),
        ({"sigma": 1.0}, 0.9, stats.norm.ppf(0.95)),
        ({"groups": np.arange(12)}, 0.95, stats.t.ppf(0.975, 11)),
    ],
    ids=["unknown noise", "known noise", "trials"],
)
def test_a_line_has_students_interval(how, level, far):
    found = of_line(**how)
    assert found.by_group == ("groups" in how)
    for name, error in found.standard_errors.items():
        middle = float(found.params[name])
        wanted = middle - far * error, middle + far * error
        assert found.interval(level)[name] == pytest.approx(wanted)


@pytest.mark.parametrize("name", START)
def test_a_curve_has_the_profile_of_scipy(curved, name):
    ours, error = curved.interval()[name], curved.standard_errors[name]
    assert ours == pytest.approx(ends_by_scipy(name, T9), abs=MET * error)
    # Different from the standard error: the likelihood is not a parabola.
    away = np.abs(np.array(ours) - float(curved.params[name])) / error
    assert name == "a" or abs(away[0] - away[1]) > 0.05


def test_no_end_lies_beyond_a_bound(curved):
    top = float(curved.params["b"]) + 0.5 * curved.standard_errors["b"]
    bounds = {"c": jc.Positive(), "b": jc.Between(0.0, top)}
    found = jc.fit(decay, DECAY, START, x=X, transforms=bounds)
    ends, error = found.interval(), found.standard_errors
    assert ends["b"][1] == top
    assert ends["b"][0] == pytest.approx(curved.interval()["b"][0], abs=MET * error["b"])
    # With c at its end, b has reached its own bound.
    assert ends["c"] == pytest.approx(ends_by_scipy("c", T9, high=top), abs=MET * error["c"])


@pytest.mark.parametrize(("low", "high"), [(0.1, 0.4), (0.6, 3.0)])
def test_a_parameter_at_its_bound_has_an_interval_to_one_side(low, high):
    start, bounds = START | {"c": (low + high) / 2}, {"c": jc.Between(low, high)}
    found = jc.fit(decay, DECAY, start, x=X, transforms=bounds)
    assert found.at_bound == ("c",)
    ends = found.interval()["c"]
    bound, side = (high, 0) if high < 0.5 else (low, 1)
    assert ends[1 - side] == bound
    lowest = least(bound, "c")
    rise = (least(ends[side], "c") - lowest) / (lowest / found.dof)
    assert np.sqrt(rise) == pytest.approx(stats.t.ppf(0.975, found.dof), rel=MET)


def test_what_the_data_do_not_limit():
    start, positive = {"a": 1.0, "b": 2.0}, {"a": jc.Positive()}
    found = jc.fit(lambda p, x: p["a"] * p["b"] * x, X, start, x=X, sigma=0.1, transforms=positive)
    assert found.interval() == {"a": (0.0, np.inf), "b": (-np.inf, np.inf)}
    exact = jc.fit(line, X[:2], FLAT, x=X[:2])
    assert exact.interval()["b"] == (-np.inf, np.inf)


def test_bands_of_a_line_are_the_formulas():
    found, at = of_line(), np.array([-1.0, 2.0, 9.0])
    far, noise = stats.t.ppf(0.975, 10), np.sqrt(2 * found.loss / 10)
    away = (at - X.mean()) ** 2 / np.sum((X - X.mean()) ** 2)
    curve = np.asarray(found.predict(at))
    for band, more in ((found.confidence_band(at), 0), (found.prediction_band(at), 1)):
        half = far * noise * np.sqrt(1 / 12 + away + more)
        assert np.allclose(band, [curve - half, curve + half], rtol=1e-9)
    of_own = found.prediction_band(at, sigma=[0.0001, 3.0, 1e9])
    assert np.allclose(of_own[0][0], found.confidence_band(at)[0][0], rtol=1e-5)
    assert of_own[1][2] == pytest.approx(far * 1e9, rel=1e-6)


def both(p, x):
    return {"first": line(p, x), "second": line(p, x**2)}


def test_the_noise_of_each_column_is_that_of_the_restricted_likelihood():
    random = np.random.default_rng(5)
    size = {"first": 0.02, "second": 3.0}
    clean = both({"a": -1.0, "b": 2.0}, X)
    data = {name: y + size[name] * random.normal(size=12) for name, y in clean.items()}
    found = jc.fit(both, data, FLAT, x=X, noise="by column")
    design = np.concatenate([np.stack([np.ones(12), X]), np.stack([np.ones(12), X**2])], axis=1).T
    y = np.concatenate([data["first"], data["second"]])

    def minus_twice(logs):
        weight = np.repeat(np.exp(-2 * logs), 12)
        normal = design.T @ (weight[:, None] * design)
        left = y - design @ np.linalg.solve(normal, design.T @ (weight * y))
        return np.sum(weight * left**2) + 24 * logs.sum() + np.linalg.slogdet(normal)[1]

    theirs = optimize.minimize(minus_twice, np.zeros(2), method="Nelder-Mead", tol=1e-10).x
    ours = np.sqrt(found.noise) / np.asarray(found.problem.factor)[[0, 12]]
    # The search for the sizes stops at a thousandth.
    assert ours == pytest.approx(np.exp(theirs), rel=1e-3)
    assert found.noise == pytest.approx(1, rel=2e-3) and found.dof == 22
    weights = {"first": np.full(12, 1e8), "second": np.full(12, 1e-8)}
    shrunk = jc.fit(both, data, FLAT, x=X, noise="by column", weights=weights)
    assert np.allclose(shrunk.values, found.values, atol=1e-3 * found.errors.min())
