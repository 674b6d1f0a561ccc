"""Elementary functions and scalar roots: values and derivatives against mpmath."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxcontact as jc
from jaxcontact._forms import restitution_of
from jaxcontact._functions import (
    arc_over_sine,
    bracketed_root,
    half_gamma_ratio,
    kappa,
    log1p_over,
    log_remainder,
    log_remainder_over,
    power,
    psi,
    sinc_root,
)
from tests.oracle.stored import stored

# Functions that cancel at their removable points, for arguments down to 1e-300, and differences of
# them. 600 digits are lost, twice 60 by the step, and many remain.
REFERENCE_DIGITS = 900
STEP = "1e-60"
FEWER = 300  # for a function that does not cancel

VALUE = 5e-15
"""Relative error of a value: measured 2e-15 (sinh of 100 in sinc_root), 5e-16 elsewhere."""

FIRST = 3e-14  # of a slope: measured 9e-15, log_remainder just outside its series
SECOND = 2e-13  # of a curvature: measured 6e-14, the same place
ROOT = 2e-14  # roots and their derivatives: measured 2e-15 in the root, 4e-15 in the curvature

ABSOLUTE = 3e-16
"""The damping factor near e = 1 has an absolute error of rounding: measured 8e-17 at 1 - 1e-6."""


def derivatives(function, points):
    """Value, slope, curvature and the slope in reverse of a function of one number, elementwise."""

    def slope(x):
        value, change = jax.jvp(function, (x,), (jnp.ones_like(x),))
        return change, value

    @jax.jit
    def everything(x):
        change, bend, value = jax.jvp(slope, (x,), (jnp.ones_like(x),), has_aux=True)
        _, back = jax.vjp(function, x)
        return value, change, bend, back(jnp.ones_like(x))[0]

    return [np.asarray(part) for part in everything(jnp.asarray(points))]


def reference(function, points, digits=REFERENCE_DIGITS):
    """The same three in mpmath by central differences; `function` knows its removable points."""
    rows = []
    with mp.workdps(digits):
        for x in map(mp.mpf, points):
            h = mp.mpf(STEP) * max(1, x)
            low, mid, high = function(x - h), function(x), function(x + h)
            rows.append([mid, (high - low) / (2 * h), (high - 2 * mid + low) / h**2])
        return np.array(rows, float).T


def removable(function, at, value):
    return lambda x: mp.mpf(value) if x == at else function(x)


def mp_arc(c):
    return mp.acos(c) / mp.sqrt(1 - c * c) if c < 1 else mp.acosh(c) / mp.sqrt(c * c - 1)


def mp_sinc_root(x):
    return mp.sin(mp.sqrt(x)) / mp.sqrt(x) if x > 0 else mp.sinh(mp.sqrt(-x)) / mp.sqrt(-x)


def around(*switches):
    """Points next to the places where one formula takes over from another."""
    return [s + d for s in switches for d in (-1e-3, -1e-12, 0.0, 1e-12, 1e-3)]


TINY = [0.0, 1e-300, -1e-300, 1e-17, -1e-17, 1e-9, -1e-9, 1e-5, -1e-5, 0.01, -0.01, 0.3, -0.3]

FUNCTIONS = {
    "psi": (
        psi,
        removable(lambda z: (mp.expm1(z) - z) / z**2, 0, 0.5),
        [*TINY, *around(-1, 1), 3.0, -3.0, 30.0, -30.0, 600.0, -600.0, -1e8],
    ),
    "kappa": (
        kappa,
        removable(lambda z: mp.expm1(z) / z, 0, 1),
        [*TINY, *around(-1, 1), 3.0, -3.0, 30.0, -30.0, 600.0, -600.0, -1e8],
    ),
    "log1p_over": (
        log1p_over,
        removable(lambda u: mp.log1p(u) / u, 0, 1),
        [*TINY, *around(-0.5, 0.5), -0.9, -0.999, 3.0, 1e3, 1e8, 1e15],
    ),
    "log_remainder": (
        log_remainder,
        removable(lambda u: (u - mp.log1p(u)) / u**2, 0, 0.5),
        [*TINY, *around(-0.5, 0.5), -0.9, -0.999, 3.0, 1e3, 1e8, 1e15],
    ),
    "log_remainder_over": (
        log_remainder_over,
        lambda u: (u * u / 2 - u + mp.log1p(u)) / u**3 if u else mp.mpf(1) / 3,
        [*(u for u in TINY if abs(u) != 1e-300), 0.5, -0.5],
    ),
    "half_gamma_ratio": (
        half_gamma_ratio,
        lambda x: mp.exp(mp.loggamma(x + mp.mpf(0.5)) - mp.loggamma(x)),
        [1e-9, 0.01, 0.5, 1.0, 1.5, 4.0, 30.0, 1e3, 2.5e8, 1e15],
    ),
    "arc_over_sine": (
        arc_over_sine,
        removable(mp_arc, 1, 1),
        [0.0, 1e-300, 1e-9, -0.3, -0.9, -0.999, *around(0.7, 1.0, 1.3), 3.0, 1e3, 1e8],
    ),
    "sinc_root": (
        sinc_root,
        removable(mp_sinc_root, 0, 1),
        [*TINY, *around(-1, 1), 3.0, -3.0, 9.0, 30.0, -30.0, 1e4, -1e4],
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_slopes_and_curvatures(name):
    function, exact, points = FUNCTIONS[name]
    *found, back = derivatives(function, points)
    digits = FEWER if name == "half_gamma_ratio" else REFERENCE_DIGITS
    expected = reference(exact, points, digits)
    for order, tolerance in enumerate((VALUE, FIRST, SECOND)):
        np.testing.assert_allclose(found[order], expected[order], rtol=tolerance, err_msg=order)
    np.testing.assert_allclose(back, expected[1], rtol=FIRST)


# --- Scalar roots ---------------------------------------------------------------------------------

damping_factor = jax.jit(jc.exact_damping_factor)
restitution = jax.jit(restitution_of)


def mp_restitution(alpha):
    """e of the damping factor from e^z - z = 1 + alpha - ln(1 + alpha), z = ln(1 - alpha e)."""
    if alpha == 0:
        return mp.mpf(1)
    level = 1 + alpha - mp.log1p(alpha)
    z = -alpha if abs(alpha) < 1 else -level
    for _ in range(200):
        step = (mp.exp(z) - z - level) / mp.expm1(z)
        z -= step
        if abs(step) <= abs(z) * mp.mpf("1e-200"):
            return -mp.expm1(z) / alpha
    raise ArithmeticError("no convergence")


DAMPING_FACTORS = [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 20.0, 1e3, 1e6]


def test_restitution_of_and_its_derivatives():
    expected = reference(mp_restitution, DAMPING_FACTORS).T
    np.testing.assert_allclose(expected[0], [1, -2 / 3, 8 / 9], rtol=ROOT)
    *found, back = derivatives(restitution_of, DAMPING_FACTORS)
    np.testing.assert_allclose(np.stack(found, axis=1), expected, rtol=ROOT)
    np.testing.assert_allclose(back, found[1], rtol=ROOT)


RESTITUTIONS = [1.0, 1e-6, 1e-4, 0.01, 0.1, 0.3, 0.399, 0.4, 0.401, 0.6, 0.9, 0.999, 1 - 1e-6]


@stored()
@mp.workdps(REFERENCE_DIGITS)
def damping_reference(e):
    """The inverse function by the secant method, its derivatives from those of the function."""
    e, alpha = mp.mpf(e), mp.mpf(0)
    if e != 1:
        guess = 3 * (1 - e) * (11 - e) / (2 * (1 + 9 * e)) if e > 0.2 else 1 / e
        start, close = (guess, guess * 0.999), mp.mpf("1e-120")
        alpha = mp.findroot(lambda a: mp_restitution(a) - e, start, tol=close)
    ((_, slope, curvature),) = reference(mp_restitution, [alpha]).T
    return np.array([float(alpha), 1 / slope, -curvature / slope**3])


def test_exact_damping_factor_and_its_derivatives():
    expected = np.array([damping_reference(e) for e in RESTITUTIONS])
    np.testing.assert_allclose(expected[0, 1], -1.5, rtol=ROOT)
    *found, back = derivatives(jc.exact_damping_factor, RESTITUTIONS)
    np.testing.assert_allclose(np.stack(found, axis=1), expected, rtol=ROOT, atol=ABSOLUTE)
    np.testing.assert_allclose(back, found[1], rtol=ROOT)


def test_damping_factors_out_of_range():
    found = damping_factor(jnp.array([0.5, 0.0, -0.1, 1.0, 1.1, jnp.nan, jnp.inf]))
    np.testing.assert_array_equal(np.isnan(found), [False, True, True, False, True, True, True])
    slope = jax.jit(jax.grad(lambda e: jnp.nansum(damping_factor(e))))(jnp.array([0.5, 1.1, -1.0]))
    assert np.all(np.isfinite(slope))


ROUND_TRIP = 1e-14  # there and back, by the size of the number or 1: measured 2e-15


@settings(max_examples=20)
@given(
    st.lists(st.floats(1e-6, 1.0), min_size=16, max_size=16),
    st.lists(st.floats(0.0, 1e6), min_size=16, max_size=16),
)
def test_round_trips(es, alphas):
    es, alphas = jnp.asarray(es), jnp.asarray(alphas)
    delivered = restitution(damping_factor(es))
    np.testing.assert_allclose(delivered, es, rtol=ROUND_TRIP)
    back = damping_factor(restitution(alphas))
    np.testing.assert_allclose(back, alphas, rtol=ROUND_TRIP, atol=ROUND_TRIP)
    through_the_door = jc.restitution(jc.ExactRestitution(e=es))
    np.testing.assert_allclose(through_the_door, es, rtol=ROUND_TRIP)


BRACKETED = 2e-15  # measured 1e-15, for the cube


@pytest.mark.parametrize(("power", "most"), [(1, 1), (3, 14), (7, 20)])
def test_a_bracketed_root_takes_few_steps(power, most):
    """To rounding, also where one end of the bracket would be kept: c - x^p for c near 0 and 1."""
    c = np.geomspace(1e-3, 0.999, 60)

    @jax.jit
    @jax.vmap
    def root(c):
        return bracketed_root(lambda x: c - x**power, c, c - 1, most)

    assert np.allclose(root(c), c ** (1 / power), rtol=0, atol=BRACKETED)


by_traced_power = jax.jit(jax.vmap(jax.value_and_grad(power), (0, None)))


@pytest.mark.parametrize("p", [0.0, 1.0, 1.5, 2.0])
def test_a_traced_exponent_is_the_concrete_one(p):
    """At the edge, too: x^0 is 1 at zero, and x^1 has the slope 1."""
    x = np.array([-1.0, 0.0, 0.5, 2.0])
    concrete = jax.jit(jax.vmap(jax.value_and_grad(lambda x: power(x, p))))(x)
    for one, other in zip(concrete, by_traced_power(x, np.array(p)), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-15)
