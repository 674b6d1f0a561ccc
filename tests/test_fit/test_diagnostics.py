"""R-hat and effective numbers of draws against blackjax, stored values and the theory of AR(1)."""

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact._fit.posterior.posterior import r_hat_and_effective

SAME = 1e-9
"""Two programs of one definition: 1e-13 was seen."""


def autoregressive(rng, rho, chains, count):
    x = rng.normal(size=(chains, count))
    for i in range(1, count):
        x[:, i] = rho * x[:, i - 1] + np.sqrt(1 - rho**2) * x[:, i]
    return x


def some():
    """Chains, and what ArviZ 0.23.4 says of them: rhat, and the lower of ess bulk and tail."""
    rng = np.random.default_rng(0)
    levels, slow = np.arange(4)[:, None], np.cumsum(rng.normal(size=(4, 400)), axis=1)
    return {
        "independent": rng.normal(size=(4, 500)),
        "slow": slow,
        "alternating": autoregressive(rng, -0.5, 4, 500),
        "odd": autoregressive(rng, 0.9, 4, 1001),
        "apart": rng.normal(size=(4, 300)) + levels,
        "of other widths": rng.normal(size=(3, 301)) * (1 + levels[:3]),
        "heavy tails": rng.standard_cauchy(size=(4, 200)),
        "ties": np.round(rng.normal(size=(2, 100)), 1),
        "five": rng.normal(size=(4, 5)),
    }


ARVIZ = {
    "independent": (0.999840608379, 1969.00141944),
    "slow": (2.18670278653, 5.23848886635),
    "alternating": (1.000559944, 1949.04550658),
    "odd": (1.01234068136, 181.073515134),
    "apart": (1.56228949073, 7.07604830958),
    "of other widths": (1.13392721766, 190.243188935),
    "heavy tails": (1.0004450047, 729.53663306),
    "ties": (0.998822245998, 180.122675985),
    "five": (1.39153756815, 19.2659197225),
}


@pytest.mark.parametrize("name", some())
def test_as_arviz(name):
    assert r_hat_and_effective(some()[name]) == pytest.approx(ARVIZ[name], rel=SAME)


def test_as_blackjax():
    """Its conventions for chains of odd length, ties and chains that do not mix are others."""
    x = some()["independent"]
    with (
        jax.enable_x64(True),
        jax.numpy_dtype_promotion("standard"),
        jax.numpy_rank_promotion("allow"),
    ):
        draws = jnp.asarray(x)
        ratio = float(blackjax.diagnostics.rhat(draws))
        counts = blackjax.diagnostics.ess_bulk(draws), blackjax.diagnostics.ess_tail(draws)
    assert r_hat_and_effective(x) == pytest.approx((ratio, float(min(counts))), rel=SAME)


def test_chains_with_memory_are_worth_what_theory_says():
    """n (1-ρ)/(1+ρ) in the bulk; the tails remember less, so the bulk decides."""
    x = autoregressive(np.random.default_rng(1), 0.8, 4, 20_000)
    # A tenth: the standard error of the estimate is about 3 %.
    ratio, count = r_hat_and_effective(x)
    assert count == pytest.approx(x.size * 0.2 / 1.8, rel=0.1)
    assert ratio < 1.01 < r_hat_and_effective(x + 0.5 * np.arange(4)[:, None])[0]


def test_too_few_or_constant_draws_have_none():
    for x in (np.ones((4, 100)), np.zeros((4, 3)), np.full((4, 9), np.nan)):
        assert np.isnan(r_hat_and_effective(x)).all()


def test_chains_that_do_not_move_differ():
    ratio, count = r_hat_and_effective(np.ones((4, 100)) * np.arange(4)[:, None])
    assert ratio > 1e9 and count < 5
