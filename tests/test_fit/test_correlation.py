"""Correlated errors: generalised least squares against its closed form."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

import jaxcontact as jc
from tests.test_fit.curves import FLAT, line

X = np.linspace(0, 4, 20)
SIGMA = 0.2 + X / 8
CORRELATION = toeplitz(0.6 ** np.arange(20))
COVARIANCE = CORRELATION * np.outer(SIGMA, SIGMA)
Y = 2 * X - 1 + np.random.default_rng(2).multivariate_normal(np.zeros(20), COVARIANCE)
DESIGN = np.stack([np.ones(20), X], axis=1)


@pytest.fixture(scope="module")
def known():
    return jc.fit(line, Y, FLAT, x=X, sigma=SIGMA, correlation=CORRELATION)


def closed_form(rows=slice(None)):
    design, y = DESIGN[rows], Y[rows]
    weight = np.linalg.inv(COVARIANCE[rows][:, rows])
    covariance = np.linalg.inv(design.T @ weight @ design)
    return covariance @ design.T @ weight @ y, covariance, weight


def test_known_errors(known):
    values, covariance, weight = closed_form()
    assert np.allclose(known.values, values, rtol=1e-9)
    assert np.allclose(known.covariance, covariance, rtol=1e-9)
    left = DESIGN @ values - Y
    assert known.loss == pytest.approx(left @ weight @ left / 2)
    assert np.allclose(known.residuals, left)
    assert np.sum(known.z**2) == pytest.approx(2 * known.loss) and known.adequate is not None


def test_errors_of_unknown_size_and_a_point_without_weight():
    keep = np.arange(20) != 7
    weights = np.where(keep, SIGMA**-2.0, 0)
    found = jc.fit(line, Y, FLAT, x=X, weights=weights, correlation=CORRELATION)
    values, covariance, _ = closed_form(keep)
    assert np.allclose(found.values, values, rtol=1e-9)
    assert np.allclose(found.covariance, found.noise * covariance, rtol=1e-9)
    assert found.noise == pytest.approx(2 * found.loss / 17) and np.isnan(found.residuals[7])


SCATTER = 0.15
"""Of the standard deviation of 200 draws, which is known to 5 per cent."""


def test_draws_of_the_bootstrap_are_correlated(known):
    for name, error in known.bootstrap(200).standard_errors.items():
        assert error == pytest.approx(known.standard_errors[name], rel=SCATTER)
    independent = jc.fit(line, Y, FLAT, x=X, sigma=SIGMA)
    assert independent.standard_errors["a"] < 0.8 * known.standard_errors["a"]


def test_fits_with_one_correlation_are_compared(known):
    """AIC differs by what the generalised sums of squares say; what is left out is predicted by the
    fit to the others alone, whose correlation is that of the rest.
    """
    how = {"x": X, "sigma": SIGMA, "correlation": CORRELATION}
    level = jc.fit(lambda p, x: p["level"] + 0 * x, Y, {"level": 0.0}, **how)
    parts = np.arange(20) % 5
    compared = jc.compare_fits({"line": known, "level": level}, folds=5, groups=parts)
    found = {c.name: c for c in compared.candidates}
    values, _, weight = closed_form()
    one = np.ones(20)
    mean = one @ weight @ Y / (one @ weight @ one)
    squares = [r @ weight @ r for r in (DESIGN @ values - Y, mean - Y)]
    terms = [2 * k + 2 * k * (k + 1) / (20 - k - 1) for k in (2, 1)]
    gap = squares[1] + terms[1] - squares[0] - terms[0]
    assert found["level"].aicc - found["line"].aicc == pytest.approx(gap)
    left = [(DESIGN @ closed_form(parts != k)[0] - Y)[parts == k] for k in range(5)]
    z = np.concatenate(left) / np.concatenate([SIGMA[parts == k] for k in range(5)])
    assert found["line"].held_out == pytest.approx(np.sqrt(np.mean(z**2)))


def test_what_is_no_correlation(known):
    """What is no correlation matrix is refused in `test_general`."""

    def halves(p, x):
        return {"left": line(p, x)[:10], "right": line(p, x)[10:]}

    both = {"left": Y[:10], "right": Y[10:]}
    with pytest.raises(ValueError, match="must be 'common' with a `correlation` between columns"):
        jc.fit(halves, both, FLAT, x=X, correlation=CORRELATION, noise="by column")
    alone = jc.fit(line, Y, FLAT, x=X)
    with pytest.raises(ValueError, match="the same `correlation`, but that of 'two' differs"):
        jc.compare_fits({"one": known, "two": alone})
