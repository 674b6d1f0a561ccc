"""`posterior` against closed forms and integrals over grids, and its diagnostics."""

import dataclasses
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

import jaxcontact as jc
from jaxcontact._fit.posterior.posterior import r_hat_and_effective

OFF = 4.0
"""Monte Carlo standard errors: 48 numbers are compared, one of them is beyond 4 by chance once in
300 seeds; the seed is fixed."""
RNG = np.random.default_rng(7)
X = np.linspace(0, 2, 7)
Y = 1e8 * (1 + 0.7 * X) + 1e7 * RNG.normal(size=7)
START = {"offset": 1e8, "slope": 1e8}


def line(p, x):
    return p["offset"] + p["slope"] * x


def decay(p, x):
    return p["e"] * jnp.exp(-p["c"] * x)


def product(p, x):
    return p["K"] * p["m"] * x


BOUNDS = {"c": jc.Positive(), "e": jc.Between(0.0, 1.0)}
SPEEDS = np.array([0.3, 1.0, 2.0])
DECAYED = np.array([0.80, 0.55, 0.50])


def decay_fit(data=DECAYED, **how):
    return jc.fit(decay, data, {"c": 0.5, "e": 0.8}, x=SPEEDS, transforms=BOUNDS, **how)


def within(result, name, value, mean):
    """Whether the mean of a function's draws is right within its own Monte Carlo error."""
    error = value.std() / np.sqrt(result.effective_samples[name])
    return abs(value.mean() - mean) < OFF * error


@pytest.fixture(scope="module")
def known():
    return jc.fit(line, Y, START, x=X, sigma=1e7)


@pytest.fixture(scope="module")
def unknown():
    return jc.fit(line, Y, START, x=X)


@pytest.fixture(scope="module")
def normal(known):
    return jc.posterior(known)


def test_a_line_with_known_noise_has_a_normal_posterior(known, normal):
    assert normal.converged and normal.names == known.names == ("offset", "slope")
    off = {
        name: normal.samples[name] - x for name, x in zip(known.names, known.values, strict=True)
    }
    for i, one in enumerate(known.names):
        assert within(normal, one, off[one], 0)
        for j, other in enumerate(known.names):
            assert within(normal, one, off[one] * off[other], known.covariance[i, j])
        # The whole distribution, by draws far enough apart to be independent.
        thinned = (off[one] / known.errors[i])[:, ::10].ravel()
        assert stats.kstest(thinned, "norm").pvalue > 1e-3
        low, high = normal.interval(one)
        assert (high - low) / known.errors[i] == pytest.approx(2 * 1.96, rel=0.05)


def test_unknown_noise_gives_students_t(unknown):
    result = jc.posterior(unknown)
    assert result.converged and unknown.dof == 5
    assert result.names == ("offset", "slope", "noise")
    for i, name in enumerate(unknown.names):
        t = (result.samples[name] - unknown.values[i]) / unknown.errors[i]
        assert stats.kstest(t[:, ::20].ravel(), stats.t(5).cdf).pvalue > 1e-3
        inside = np.abs(t) < stats.t(5).ppf(0.975)
        assert within(result, name, inside, 0.95)
        # The test distinguishes it from a normal distribution.
        assert not within(result, name, np.abs(t) < stats.norm.ppf(0.975), 0.95)
    # Σz²/σ² is χ² with as many degrees of freedom.
    chi2 = np.sum(unknown.residuals**2) / result.samples["noise"] ** 2
    assert within(result, "noise", chi2, 5)
    assert stats.kstest(chi2[:, ::20].ravel(), stats.chi2(5).cdf).pvalue > 1e-3


def on_a_grid(weight, sigma):
    """Means of c, e and their squares and product by integration over (ln c, logit e)."""
    u, v = np.meshgrid(np.linspace(-8, 3, 401), np.linspace(-6, 14, 401), indexing="ij")
    c, e = np.exp(u), 1 / (1 + np.exp(-v))
    z = (e[..., None] * np.exp(-c[..., None] * SPEEDS) - DECAYED) / sigma
    density = np.exp(-np.sum(z**2, axis=-1) / 2) * weight(c, e) * e * (1 - e)
    total = integrate.simpson(integrate.simpson(density))
    return {
        key: integrate.simpson(integrate.simpson(density * moment)) / total
        for key, moment in moments(c, e).items()
    }


def moments(c, e):
    return {"c": c, "e": e, "cc": c * c, "ee": e * e, "ce": c * e}


def gauss(x, middle, width):
    return np.exp(-(((x - middle) / width) ** 2) / 2)


PRIORS = {
    # With a prior flat in ln c the data must exclude c = 0.
    "one": ({"e": (0.9, 0.1)}, lambda c, e: gauss(e, 0.9, 0.1), 0.03),
    "both": (
        {"e": (0.9, 0.1), "c": (0.0, 0.3)},
        lambda c, e: gauss(e, 0.9, 0.1) * gauss(c, 0.0, 0.3) * c,
        0.08,
    ),
    "function": (lambda p: -p["c"], lambda c, e: np.exp(-c) * c, 0.1),
}


@pytest.mark.parametrize("name", PRIORS)
def test_bounded_parameters_as_on_a_grid(name):
    prior, weight, sigma = PRIORS[name]
    result = jc.posterior(decay_fit(sigma=sigma), prior=prior)
    assert result.converged, result.reason
    c, e = result.samples["c"], result.samples["e"]
    assert (c > 0).all() and (e > 0).all() and (e < 1).all()
    wanted = on_a_grid(weight, sigma)
    for key, moment in moments(c, e).items():
        assert within(result, key[0], moment, wanted[key]), key


def test_a_prior_pins_what_the_data_leave_open():
    """ln K + ln m is known to σ/|x| K m, and m from its prior alone."""
    positive = {"K": jc.Positive(), "m": jc.Positive()}
    data = 6 * X[1:]
    found = jc.fit(product, data, {"K": 1.0, "m": 3.0}, x=X[1:], transforms=positive, sigma=0.01)
    with pytest.raises(
        ValueError, match=r"must determine a change of ln K - ln m, since the data do not"
    ):
        jc.posterior(found)
    result = jc.posterior(found, prior={"m": (20.0, 0.5)})
    assert result.converged, result.reason
    m, both = result.samples["m"], result.samples["m"] * result.samples["K"]
    error = 0.01 / np.linalg.norm(X[1:])
    # The prior of ln K is flat: p(m, Km) is the product of both, except for 1e-3 of a width.
    for value, mean, width in ((m, 20.0, 0.5), (both, 6.0, error)):
        assert within(result, "m", value, mean)
        assert within(result, "m", (value - mean) ** 2, width**2)
    assert np.abs(np.corrcoef(m.ravel(), both.ravel())[0, 1]) < 0.05


def test_hubers_noise_is_a_distribution():
    """A location with an outlier, beside the integral over its value and the scale."""
    data = np.array([0.3, -1.2, 0.8, 0.1, -0.4, 9.0, 1.0, -0.2])
    found = jc.fit(lambda p: p * jnp.ones(8), data, 0.5, loss=jc.Huber())
    result = jc.posterior(found)
    assert result.converged, result.reason
    scale = 1 / float(found.problem.factor[0])
    p, s = np.meshgrid(np.linspace(-6, 8, 401), np.geomspace(0.05, 50, 401), indexing="ij")
    u = np.abs(data - p[..., None]) / (s * scale)[..., None]
    loss = np.where(u < 1.345, u**2 / 2, 1.345 * u - 1.345**2 / 2).sum(axis=-1)
    density = np.exp(-loss - 8 * np.log(s))
    for name, grid in (("parameter", p), ("noise", s)):
        value = result.samples[name]
        for power in (1, 2):
            wanted = np.sum(density * grid**power) / density.sum()
            assert within(result, name, value**power, wanted)


def test_what_has_no_posterior_is_refused(known, unknown):
    pairs = np.array([0, 0, 1, 1, 2, 2, 3])
    both = dataclasses.replace(known, at_bound=("offset", "slope"))
    given = r"`sigma` of `fit` must be given for a posterior of an exact fit"
    for fit, change, prior, match in (
        (known, {"converged": False}, None, "did not converge has no posterior"),
        (known, {"groups": pairs}, None, "`groups` of correlated"),
        (unknown, {"dof": 0}, None, "`sigma` of `fit` must be .* degrees of freedom"),
        (unknown, {"residuals": 0 * unknown.residuals}, None, given),
        (known, {"at_bound": ("slope",)}, None, "must determine slope .at its bound."),
        # A prior determines one of two parameters.
        (both, {}, {"slope": (1e8, 1e7)}, r"must determine offset \(at its bound\)"),
        (known, {}, {"c": (1.0, 1.0)}, r"must name fitted numbers, offset, slope, but .* 'c'"),
        (known, {}, {"slope": 1.0}, r"\(mean, standard deviation\) for slope, but holds 1.0"),
        (known, {}, {"slope": (1.0, 0)}, r"`prior` must be a number in \(0, inf\), but is 0"),
        (known, {}, lambda p: jnp.ones(2), r"must return one real number"),
    ):
        with pytest.raises(ValueError, match=match):
            jc.posterior(dataclasses.replace(fit, **change), prior=prior)


@pytest.mark.parametrize("module", ["blackjax", "arviz_stats"])
def test_without_the_extra_it_says_what_to_install(known, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=r"pip install 'jaxcontact\[posterior\]'"):
        jc.posterior(known)


def test_a_posterior_that_is_none_is_told():
    """Data that do not exclude c = 0 leave the flat prior of ln c improper."""
    found = decay_fit(np.array([0.71, 0.70, 0.70]), sigma=0.08)
    assert found.converged and not found.at_bound
    result = jc.posterior(found, prior={"e": (0.7, 0.1)})
    told = "the data do not exclude the bound of ln c: give a `prior`"
    assert not result.converged and result.reason.startswith(told)
    assert repr(result).startswith(f"Posterior: NOT CONVERGED, {told}")
    # Chains seldom reach a bound that is e^6 below the mode, but it is reported.
    seldom = jc.posterior(decay_fit(sigma=0.06), prior={"e": (0.9, 0.1)})
    assert seldom.reason == told


def test_modes_between_which_chains_seldom_go_are_told(known):
    """p² has two signs, with a barrier of 5 between them."""
    found = jc.fit(lambda p: p**2 * jnp.ones(1), [1.0], 1.5, sigma=1 / np.sqrt(10))
    result = jc.posterior(found, draws=500)
    assert not result.converged and "chains differ in parameter" in result.reason


def test_one_compilation_for_all_data(unknown, known, normal, compiled):
    other = jc.fit(line, Y[::-1] + 1e6, START, x=X + 1, sigma=2e7)
    compiled.clear()
    again = jc.posterior(other, draws=700, warmup=333, seed=4)
    assert again.converged and not compiled
    repeated, others = (jc.posterior(known, draws=200, seed=seed).samples for seed in (0, 1))
    for name in known.names:
        assert np.array_equal(normal.samples[name][:, :200], repeated[name])
    assert not np.array_equal(repeated["slope"], others["slope"])


def test_the_result_in_words_and_trees(known, normal):
    assert normal.params["slope"].shape == (4, 2000)
    assert np.array_equal(normal.params["slope"], normal.samples["slope"])
    taken = normal.to_dict()
    taken["slope"][:] = 0
    assert normal.samples["slope"].all() and taken.keys() == normal.samples.keys()
    first, cost, _, offset, slope = repr(normal).splitlines()
    assert first.startswith("Posterior: converged, R-hat up to 1.00")
    assert "8000 draws of 4 chains, 0 divergences" in cost and normal.evaluations > 8000
    assert offset.split()[0] == "offset" and slope.split()[2:4] == ["±", f"{known.errors[1]:.2g}"]
    bad = dataclasses.replace(normal, fit=jc.fit(line, 1e9 * X**3, START, x=X, sigma=1e7))
    assert repr(bad).startswith("The model does not describe the data: χ²/dof")


def test_diagnostics_are_those_of_arviz():
    """By its release 0.23.4: rhat, and the lower of ess bulk and tail."""
    rng = np.random.default_rng(0)
    slow, independent = np.cumsum(rng.normal(size=(4, 400)), axis=1), rng.normal(size=(4, 500))
    for draws, known in (
        (slow, (2.18670278653, 5.23848886635)),
        (independent, (0.999840608379, 1969.00141944)),
    ):
        assert r_hat_and_effective(draws) == pytest.approx(known, rel=1e-9)


def test_too_few_or_constant_draws_have_none():
    for x in (np.ones((4, 100)), np.zeros((4, 3)), np.full((4, 9), np.nan)):
        assert np.isnan(r_hat_and_effective(x)).all()


def test_chains_that_do_not_move_differ():
    ratio, count = r_hat_and_effective(np.ones((4, 100)) * np.arange(4)[:, None])
    assert ratio > 1e9 and count < 5
