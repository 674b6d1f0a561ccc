"""Correlated errors: generalised least squares against its closed form."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

import jaxcontact as jc

X = np.linspace(0, 4, 20)
SIGMA = 0.2 + X / 8
CORRELATION = toeplitz(0.6 ** np.arange(20))
COVARIANCE = CORRELATION * np.outer(SIGMA, SIGMA)
Y = 2 * X - 1 + np.random.default_rng(2).multivariate_normal(np.zeros(20), COVARIANCE)
START = {"slope": 0.0, "offset": 0.0}
DESIGN = np.stack([np.ones(20), X], axis=1)


def line(p, x):
    return p["slope"] * x + p["offset"]


def closed_form(rows=slice(None)):
    design, y = DESIGN[rows], Y[rows]
    weight = np.linalg.inv(COVARIANCE[rows][:, rows])
    covariance = np.linalg.inv(design.T @ weight @ design)
    return covariance @ design.T @ weight @ y, covariance, weight


def test_known_errors():
    found = jc.fit(line, Y, START, x=X, sigma=SIGMA, correlation=CORRELATION)
    values, covariance, weight = closed_form()
    assert np.allclose(found.values, values, rtol=1e-9)
    assert np.allclose(found.covariance, covariance, rtol=1e-9)
    left = DESIGN @ values - Y
    assert found.loss == pytest.approx(left @ weight @ left / 2)
    assert np.allclose(found.residuals, left) and np.sum(found.z**2) == pytest.approx(
        2 * found.loss
    )
    assert found.adequate is not None


def test_errors_of_unknown_size_and_a_point_without_weight():
    keep = np.arange(20) != 7
    weights = np.where(keep, SIGMA**-2.0, 0)
    found = jc.fit(line, Y, START, x=X, weights=weights, correlation=CORRELATION)
    values, covariance, _ = closed_form(keep)
    assert np.allclose(found.values, values, rtol=1e-9)
    assert np.allclose(found.covariance, found.noise * covariance, rtol=1e-9)
    assert found.noise == pytest.approx(2 * found.loss / 17) and np.isnan(found.residuals[7])


SCATTER = 0.15
"""Of the standard deviation of 200 draws, which is known to 5 per cent."""


def test_draws_of_the_bootstrap_are_correlated():
    found = jc.fit(line, Y, START, x=X, sigma=SIGMA, correlation=CORRELATION)
    again = found.bootstrap(200)
    for name, error in again.standard_errors.items():
        assert error == pytest.approx(found.standard_errors[name], rel=SCATTER)
    independent = jc.fit(line, Y, START, x=X, sigma=SIGMA)
    assert independent.standard_errors["offset"] < 0.8 * found.standard_errors["offset"]


def level(p, x):
    return p["level"] + 0 * x


def test_fits_with_one_correlation_are_compared():
    """AIC differs by what the generalised sums of squares say; what is left out is predicted by the
    fit to the others alone, whose correlation is that of the rest.
    """
    fits = {
        "line": jc.fit(line, Y, START, x=X, sigma=SIGMA, correlation=CORRELATION),
        "level": jc.fit(level, Y, {"level": 0.0}, x=X, sigma=SIGMA, correlation=CORRELATION),
    }
    parts = np.arange(20) % 5
    found = {c.name: c for c in jc.compare_fits(fits, folds=5, groups=parts).candidates}
    values, _, weight = closed_form()
    one = np.ones(20)
    mean = one @ weight @ Y / (one @ weight @ one)
    squares = [r @ weight @ r for r in (DESIGN @ values - Y, mean - Y)]
    terms = [2 * k + 2 * k * (k + 1) / (20 - k - 1) for k in (2, 1)]
    gap = squares[1] + terms[1] - squares[0] - terms[0]
    assert found["level"].aicc - found["line"].aicc == pytest.approx(gap)
    total = 0.0
    for part in range(5):
        out = parts == part
        z = (DESIGN[out] @ closed_form(~out)[0] - Y[out]) / SIGMA[out]
        total += z @ z
    assert found["line"].held_out == pytest.approx(np.sqrt(total / 20))


def test_what_is_no_correlation():
    for bad in (CORRELATION[:3], 2 * CORRELATION, CORRELATION + np.triu(CORRELATION, 1)):
        with pytest.raises(ValueError, match="Argument `correlation` must be a symmetric matrix"):
            jc.fit(line, Y, START, x=X, correlation=bad)
    with pytest.raises(ValueError, match="Argument `correlation` must be positive definite"):
        jc.fit(line, Y, START, x=X, correlation=np.ones((20, 20)))

    def halves(p, x):
        return {"left": line(p, x)[:10], "right": line(p, x)[10:]}

    both = {"left": Y[:10], "right": Y[10:]}
    with pytest.raises(ValueError, match="must be 'common' with a `correlation` between columns"):
        jc.fit(halves, both, START, x=X, correlation=CORRELATION, noise="by column")
    found = jc.fit(line, Y, START, x=X, correlation=CORRELATION)
    alone = jc.fit(line, Y, START, x=X)
    with pytest.raises(ValueError, match="the same `correlation`, but that of 'two' differs"):
        jc.compare_fits({"one": found, "two": alone})
