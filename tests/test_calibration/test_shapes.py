"""The shapes of a learned damping factor, against scipy's B-splines."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

import jaxcontact as jc

ROUNDING = 1e-13


@pytest.mark.parametrize("low", [0.0, 0.3])
def test_a_spline_is_scipys(low):
    intervals = 12
    weights = np.random.default_rng(0).normal(size=intervals + 3)
    ours = eqx.tree_at(lambda s: s.weights, jc.Spline(intervals, low), jnp.asarray(weights))
    knots = low + (1 - low) / intervals * np.arange(-3, intervals + 4)
    e = np.linspace(low, 1, 101)
    assert np.allclose(ours(jnp.asarray(e)), BSpline(knots, weights, 3)(e), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("shape", [jc.Spline(), jc.Spline(low=0.5)])
def test_it_starts_between_the_limits_of_the_laws(shape):
    # (1-e)/e times 1.25: between 1 as e -> 0 and 1.5 as e -> 1.
    assert np.allclose(shape(jnp.linspace(0.5, 1, 20)), 1.25, rtol=0, atol=ROUNDING)
