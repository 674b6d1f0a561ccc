"""The regression of Eq. 22, against samples with a known β and against scipy."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

import jaxcontact as jc
from jaxcontact.paper._velocity_profile import _profile, _square

KNOWN = 3e-6  # a β that the samples hold, relative: measured 8e-7 over the range, 1e-8 at 2.4
SCIPY = 1e-6  # both search until rounding stops them: β measured 9e-8
SAME = 1e-7
"""The same sums in another order: measured 0; the search may end elsewhere in its tolerance."""
DIFFERENCE = 5e-11  # central differences with step 1e-5 in ln β, slopes up to 0.2: measured 2e-12
U = np.linspace(0, 1, 41)


def samples(beta, u=U):
    return np.sqrt(1 - u**beta)


@given(
    beta=st.floats(0.7, 20),
    depth=st.floats(1e-9, 1e3),
    speed=st.floats(1e-6, 1e3),
    squared=st.booleans(),
)
def test_a_known_power_is_found(beta, depth, speed, squared):
    fit = jc.fit_velocity_profile(U * depth, samples(beta) * speed, squared=squared)
    assert fit.converged and fit.reason == "no step is left"
    np.testing.assert_allclose(fit.beta, beta, rtol=KNOWN)
    assert fit.residual < KNOWN and 0 < fit.steps < 100


@pytest.mark.parametrize("squared", [False, True])
@pytest.mark.parametrize("shape", [lambda u: 1 - u, lambda u: 1 - u**2 * (3 - 2 * u)])
def test_against_scipy_where_no_power_fits(shape, squared):
    v, power = shape(U), 2 if squared else 1
    fit = jc.fit_velocity_profile(U, v, squared=squared)
    other = least_squares(
        lambda beta: samples(beta) ** power - v**power, 1.0, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    np.testing.assert_allclose(fit.beta, other.x[0], rtol=SCIPY)
    rms = math.sqrt(np.mean(other.fun**2))
    np.testing.assert_allclose(fit.residual, rms, rtol=SCIPY)
    assert rms > 0.05


def test_weights_count_samples():
    v = 1 - U
    weights = np.ones(41)
    weights[5:20] = 0
    kept = weights > 0
    some = jc.fit_velocity_profile(U, v, weights=weights)
    few = jc.fit_velocity_profile(U[kept], v[kept])
    np.testing.assert_allclose([some.beta, some.residual], [few.beta, few.residual], rtol=SAME)
    scaled = jc.fit_velocity_profile(U, v, weights=1e6 * weights)
    np.testing.assert_allclose(scaled.beta, some.beta, rtol=SAME)
    assert abs(some.beta - jc.fit_velocity_profile(U, v).beta) > 1e-2


@functools.partial(jax.jit, static_argnums=0)
def curve_and_slope(curve, log_beta, u):
    """The profile and its derivative by ln β."""
    one = jnp.ones(())
    return jax.jvp(lambda x: curve({"beta": jnp.exp(x)}, u), (log_beta,), (one,))


@pytest.mark.parametrize("curve", [_profile, _square])
def test_slope(curve):
    step = 1e-5
    for beta in (0.3, 2.4, 40.0):
        rows = [curve_and_slope(curve, np.log(beta) + s, U) for s in (-step, 0.0, step)]
        (low, _), (_, slope), (high, _) = np.array(rows)
        assert np.max(np.abs(slope)) > 1e-2
        np.testing.assert_allclose(slope, (high - low) / (2 * step), atol=DIFFERENCE)
    # The ends do not depend on the power.
    value, slope = np.array(curve_and_slope(curve, np.float64(0), U))[:, [0, -1]]
    assert value.tolist() == [1.0, 0.0] and slope.tolist() == [0.0, 0.0]
    # β so small that it vanishes, and so large that no u^β remains: no slope, but no NaN.
    for wild in (-800.0, 700.0):
        value, slope = np.array(curve_and_slope(curve, np.float64(wild), U))
        assert np.all(np.isfinite(value)) and np.all(slope == 0)


@pytest.mark.parametrize("squared", [False, True])
@pytest.mark.parametrize(
    "v",
    [np.where(U < 1, 1.0, 0.0), np.where(U == 0, 1.0, 0.0)],
    ids=["undamped to the turn", "stopped at touch"],
)
def test_what_no_power_describes_is_not_returned_as_good(v, squared):
    fit = jc.fit_velocity_profile(U, v, squared=squared)
    assert not fit.converged
    assert math.isnan(fit.beta) and math.isnan(fit.residual)
    assert "in ln beta is left" in fit.reason or "do not determine" in fit.reason


@pytest.mark.parametrize("start", [0.2, 2.5, 30.0])
def test_a_start_far_away_serves(start):
    fit = jc.fit_velocity_profile(U, samples(0.1), start=start)
    np.testing.assert_allclose(fit.beta, 0.1, rtol=KNOWN)


def test_double_precision_whatever_is_set():
    double = jc.fit_velocity_profile(U, samples(2.4))
    with jax.enable_x64(False):
        single = jc.fit_velocity_profile(U, samples(2.4))
        assert jnp.ones(1).dtype == jnp.float32
    assert single == double


GOOD = {"indentation": [0.0, 0.5, 1.0], "velocity": [1.0, 0.8, 0.0]}

BAD = [
    ({"indentation": [0.0, 1.0]}, r"`indentation` must have the shape .* is of shape \(2,\)"),
    ({"velocity": [1.0, 0.9, 0.8, 0.0]}, "`velocity` .* for each of the 3 points of .* has 4"),
    ({"weights": [1.0, 1.0, 1.0, 1.0]}, "`weights` .* for each of the 3 points of .* has 4"),
    ({"velocity": [1.0, math.nan, 0.0]}, r"`velocity` .*\[0, inf\), but is nan at point 1"),
    ({"velocity": [math.inf, 0.5, 0.0]}, r"`velocity` .*\[0, inf\), but is inf at point 0"),
    ({"velocity": [1.0, -0.1, 0.0]}, r"`velocity` must be in \[0, inf\), but is -0\.1 at point 1"),
    ({"indentation": [0.0, -0.5, 1.0]}, r"`indentation` .* is -0\.5 at point 1"),
    ({"weights": [1.0, -1.0, 1.0]}, "`weights` .* is -1 at point 1"),
    ({"weights": [0.0, 0.0, 0.0]}, "`weights` must not be zero everywhere"),
    ({"indentation": [0.1, 0.5, 1.0]}, r"must rise from 0 .* goes from 0\.1 to 1"),
    ({"indentation": [0.0, 0.0, 0.0]}, "must rise from 0 .* goes from 0 to 0"),
    ({"indentation": [0.0, 1.0, 0.9]}, r"falls from 1 to 0\.9 at point 2"),
    ({"velocity": [1.0, 0.5, 0.1]}, r"`velocity` .* goes from 1 to 0\.1; append"),
    ({"velocity": [0.0, 0.5, 0.0]}, "`velocity` must go from v0 > 0 .* goes from 0 to 0"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_input(change, message):
    arguments = GOOD | change
    with pytest.raises(ValueError, match=f"^Argument {message}" if "`" in message else message):
        jc.fit_velocity_profile(
            arguments.pop("indentation"), arguments.pop("velocity"), **arguments
        )


ROUNDING = 1e-13


@pytest.mark.parametrize("low", [0.0, 0.3])
def test_a_spline_is_scipys(low):
    intervals = 12
    weights = np.random.default_rng(0).normal(size=intervals + 3)
    ours = eqx.tree_at(lambda s: s.weights, jc.Spline(intervals, low), jnp.asarray(weights))
    knots = low + (1 - low) / intervals * np.arange(-3, intervals + 4)
    e = np.linspace(low, 1, 101)
    found = eqx.filter_jit(ours)(e)
    assert np.allclose(found, BSpline(knots, weights, 3)(e), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("shape", [jc.Spline(), jc.Spline(low=0.5)])
def test_it_starts_between_the_limits_of_the_laws(shape):
    # (1-e)/e times 1.25: between 1 as e -> 0 and 1.5 as e -> 1.
    e = np.linspace(0.5, 1, 20)
    assert np.allclose(eqx.filter_jit(shape)(e), 1.25, rtol=0, atol=ROUNDING)
