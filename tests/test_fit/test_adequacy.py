"""Adequacy of a model: levels, power, and probabilities known in closed form."""

import numpy as np
import pytest
from scipy import stats

import jaxcontact as jc
from tests.test_fit.curves import FLAT, fading, line

DRAWS = 200
ALARMS = (3, 19)
"""Of 200 at a level of 5 %: fewer or more come in .6 % of all cases on either side. The studies of
2000 draws are in benchmarks/fit_adequacy.py."""
SEEN = 0.9
"""A reduced form of the 95 % that benchmarks/fit_adequacy.py counts: 200 draws leave 1.5 %."""
X = np.linspace(-1, 1, 25)
SIGMA = 0.1
NOISES = {}, {"sigma": SIGMA}, {"loss": jc.Huber()}


def both(p, x):
    return {"first": p["a"] + p["b"] * x, "second": p["a"] - p["b"] * x}


def drawn(n, seed):
    return SIGMA * np.random.default_rng(seed).normal(size=(DRAWS, n))


@pytest.mark.parametrize(("how", "n"), [({}, 25), *((how, 8) for how in NOISES)], ids=str)
def test_a_right_model_is_called_wrong_in_five_per_cent(n, how):
    x = np.linspace(-1, 1, n)
    fits = (jc.fit(line, 1 + 2 * x + noise, FLAT, x=x, **how) for noise in drawn(n, n))
    assert ALARMS[0] <= sum(fit.adequate is False for fit in fits) <= ALARMS[1]


def test_what_shifts_a_trial_is_no_misfit():
    """With few trials there are few signs: a shift of each is taken out instead."""
    trial = np.arange(24) % 3
    x = np.linspace(-1, 1, 24)
    random, alarms, blind, seen = np.random.default_rng(2), 0, 0, 0
    for noise in drawn(24, 8):
        # Consecutive trials: a shift of each one looks like a step of the curve.
        y = x + noise + 3 * SIGMA * random.normal(size=3)[np.sort(trial)]
        alarms += jc.fit(line, y, FLAT, x=x, groups=np.sort(trial)).adequate is False
        if blind <= ALARMS[1]:
            blind += jc.fit(line, y, FLAT, x=x).adequate is False
        # Each trial covers all x, so a misfit appears within it.
        y = x + misfit(x, 60) + noise + 3 * SIGMA * random.normal(size=3)[trial]
        seen += jc.fit(line, y, FLAT, x=x, groups=trial).adequate is False
    assert ALARMS[0] <= alarms <= ALARMS[1] < blind and seen > SEEN * DRAWS


def test_a_shift_is_not_told_from_a_misfit_between_trials():
    """Short trials side by side: a misfit would be their shifts, and it must not pass as none."""
    trial = np.repeat(np.arange(6), 4)
    x = np.linspace(-1, 1, 24)
    y = x + misfit(x, 200) + drawn(24, 8)[0]
    found = jc.fit(line, y, FLAT, x=x, groups=trial)
    assert found.adequate is None and "too little overlap of their x" in found.adequacy.reason
    assert jc.fit(line, y, FLAT, x=x).adequate is False


@pytest.mark.slow(reason="a study of 200 fits")
def test_trials_shift_each_column_by_itself():
    trial, alarms = np.arange(24) % 3, 0
    x, random = np.linspace(-1, 1, 24), np.random.default_rng(3)
    for first, second in zip(drawn(24, 13), drawn(24, 14), strict=True):
        shift = random.normal(size=(2, 3))[:, trial]
        y = {"first": x + first + shift[0], "second": -x + second + shift[1]}
        groups = np.tile(trial, 2)
        alarms += jc.fit(both, y, FLAT, x=x, groups=groups).adequate is False
    assert ALARMS[0] <= alarms <= ALARMS[1]


def misfit(x, size):
    """What a line leaves of a parabola, with λ = `size`."""
    left = x**2 - np.mean(x**2)
    return SIGMA * np.sqrt(size) * left / np.linalg.norm(left)


@pytest.mark.parametrize(("n", "size", "how"), [(12, 60, {}), (25, 35, {"sigma": SIGMA})], ids=str)
def test_a_wrong_model_is_seen(n, size, how):
    x = np.linspace(-1, 1, n)
    y = 1 + 2 * x + misfit(x, size)
    # The order of the points is that of x, not of the input.
    order = np.random.default_rng(1).permutation(n)
    fits = (jc.fit(line, (y + z)[order], FLAT, x=x[order], **how) for z in drawn(n, n))
    assert np.mean([fit.adequate is False for fit in fits]) > SEEN


def test_chi_squared_is_scipys():
    y = 1 + 2 * X + drawn(25, 3)[0]
    for sigma in (SIGMA, 0.7 * SIGMA, SIGMA / 30):
        told = jc.fit(line, y, FLAT, x=X, sigma=sigma).adequacy
        best = np.polynomial.Polynomial.fit(X, y, 1)
        square = np.sum(((best(X) - y) / sigma) ** 2)
        assert told.chi2_per_dof == pytest.approx(square / 23, rel=1e-8)
        assert told.chi2_p == pytest.approx(stats.chi2.sf(square, 23), rel=1e-6)
        ends = [told.chi2_p, told.structure_p]
        if told.chi2_p > 0:
            assert told.p == pytest.approx(stats.combine_pvalues(ends).pvalue, rel=1e-8)
    assert told.p == 0 and told.adequate is False


def test_repeated_points_tell_the_noise():
    x = np.repeat(np.linspace(-1, 1, 6), 4)
    y = 1 + 2 * x + drawn(24, 5)[0]
    told = jc.fit(line, y, FLAT, x=x).adequacy
    level = np.repeat(y.reshape(6, 4).mean(axis=1), 4)
    best = np.polynomial.Polynomial.fit(x, y, 1)(x)
    ratio = (np.sum((level - best) ** 2) / 4) / (np.sum((y - level) ** 2) / 18)
    assert told.chi2_per_dof == pytest.approx(ratio, rel=1e-8)
    assert told.chi2_p == pytest.approx(stats.f.sf(ratio, 4, 18), rel=1e-8)
    # Identical residuals carry no information.
    same = jc.fit(line, np.repeat(np.linspace(-1, 1, 6) ** 2, 4), FLAT, x=x).adequacy
    assert same.chi2_per_dof is None and same.adequate is False


def test_the_verdict_has_no_unit():
    y = 1 + 2 * X + misfit(X, 20) + drawn(25, 9)[0]
    plain = jc.fit(line, y, FLAT, x=X)
    scaled = jc.fit(line, 1e9 * y, FLAT, x=1e-9 * X)
    assert scaled.adequacy.structure_p == plain.adequacy.structure_p
    reverse = jc.fit(line, y[::-1], FLAT, x=-X[::-1])
    assert reverse.adequate == plain.adequate


@pytest.mark.slow(reason="a study of 400 fits")
def test_each_column_has_an_order_and_a_noise_of_its_own():
    alarms, seen = 0, 0
    for first, second in zip(drawn(25, 11), drawn(25, 12), strict=True):
        # The noise of the second column moves the fit, which affects the first.
        y = {"first": 1 + 2 * X + first, "second": 1 - 2 * X + 50 * second}
        alarms += jc.fit(both, y, FLAT, x=X).adequate is False
        y = {"first": 1 + 2 * X + first + misfit(X, 60), "second": 1 - 2 * X + second}
        seen += jc.fit(both, y, FLAT, x=X).adequate is False
    assert alarms <= ALARMS[1] and seen > SEEN * DRAWS


def test_what_cannot_be_told_is_said():
    def told(n, **how):
        y = np.arange(float(n)) + drawn(n, 1)[0]
        found = jc.fit(line, y, FLAT, x=np.arange(float(n)), **how)
        assert found.adequate is None
        return str(found)

    assert "no degree of freedom" in told(2)
    assert "could not be tested: one degree of freedom" in told(3)
    assert "too few trials" in told(6, groups=[0, 1, 2, 0, 1, 2])
    trials = [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert "too few trials" in told(10, groups=trials, loss=jc.Huber())
    stopped = jc.fit(fading, 1 + X, {"a": 1.0, "b": 9.0}, x=X, max_steps=1, throw=False)
    assert stopped.adequate is None and not stopped.converged


def test_data_without_noise_are_met():
    exact = jc.fit(fading, 3 * np.exp(-X), {"a": 1.0, "b": 0.5}, x=X)
    assert exact.adequate and "one part in a million" in str(exact.adequacy)
    # The scatter of these is rounding, as are their residuals.
    same = jc.fit(fading, np.full(25, 0.8), {"a": 1.0, "b": 0.5}, x=X)
    assert same.loss < 1e-25 and same.adequate and "one part in a million" in str(same.adequacy)


def test_a_warning_comes_first():
    y = 1 + 2 * X + 5 * X**2 + drawn(25, 2)[0]
    text = str(jc.fit(line, y, FLAT, x=X, sigma=1e-3)).splitlines()
    assert text[0].startswith("The model does not describe the data: χ²/dof = ")
    assert "p < 1e-300; residuals follow x, p < 1e-03" in text[0]
    assert text[-1].endswith(", were the model right")
    good = str(jc.fit(line, 1 + 2 * X + drawn(25, 3)[0], FLAT, x=X, sigma=SIGMA)).splitlines()
    assert good[0].startswith("Fit: converged") and "describes the data: χ²/dof" in good[2]


def test_the_best_of_wrong_fits_is_called_so():
    y = np.sin(3 * X) + 0.01 * drawn(25, 4)[0]
    curved = jc.fit(fading, y, {"a": 1.0, "b": 0.5}, x=X)
    found = jc.compare_fits({"line": jc.fit(line, y, FLAT, x=X), "decay": curved})
    assert found.verdict.startswith("The best is line. But it does not describe the data (p < ")
    assert "no other fit does" in found.verdict and str(found).count("*") == 3
