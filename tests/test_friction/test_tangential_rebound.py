"""The curve of Maw, Barber and Fawcett: stored digits, another solver, derivatives, and limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact import tangential_rebound
from jaxcontact._forms import exact_damping_factor, restitution_of
from jaxcontact._friction.maw_barber_fawcett import (
    ALPHA,
    CHI_DAMPED,
    MIDDLE,
    TURNING,
    full_sliding,
    mbf_curve,
    onset,
)

from .springs import rebound

TABLE = 1e-8
"""Without damping; at 1800 random places the largest error was 5.3e-9."""

SLOPE = 2e-7
"""Of the derivative at ψ1 = 0 without damping: 1.7e-7 for ν = 0, below 2e-8 elsewhere."""

JUMP = 2e-3
"""Of the derivative where springs begin to slip when they touch: 1.4e-3 for α = 0.9."""

SPRINGS = 2e-4
"""Between the table and the extrapolated rows of springs. These leave 1.1e-4 at most, a tenth of it
with twice the springs, and the table 4e-7."""

ROUNDING_32 = 2e-5
"""In float32 the coefficients of a piece cancel partly."""

LIKE = 49 / 34
"""χ of solid spheres of like materials with ν = 0.3."""

DIGITS = np.array(
    [
        (0.1, 0.020590706), (0.25, 0.041611319), (0.5, 0.047831079), (1, -0.059696704),
        (1.5, -0.428016532), (2, -0.837210007), (2.5, -1.162290249), (3, -1.379683292),
        (3.5, -1.477326779), (4, -1.436512225), (4.5, -1.217617298),
    ]
)  # fmt: skip
"""ψ1 and ψ2 for χ = `LIKE`."""

ELASTIC = np.array(
    [
        (0.8, 0.3, -0.2306656239), (0.8, 1.02, -0.8639491029), (0.8, 1.7, -1.2276226344),
        (1.0, 0.3, -0.1425887876), (1.0, 1.02, -0.6498150946), (1.0, 2.2, -1.3269251392),
        (1.25, 0.3, -0.0272039809), (1.25, 1.02, -0.3260382859), (1.25, 1.7, -0.8928911521),
        (1.49, 0.3, 0.0608212672), (1.49, 1.02, -0.0043047216), (1.49, 2.2, -0.9076848920),
        (1.51, 0.3, 0.0664436909), (1.51, 1.02, 0.0213206004), (1.51, 1.7, -0.4829465948),
        (1.62, 0.3, 0.0917217000), (1.62, 1.02, 0.1546674977), (1.62, 1.7, -0.2915190619),
        (1.75, 0.3, 0.1097833304), (1.75, 1.02, 0.2865487657), (1.75, 2.2, -0.4719229751),
        (1.8, 0.3, 0.1136832822), (1.8, 1.7, 0.0310507213), (1.8, 2.2, -0.3803528467),
    ]
)  # fmt: skip
"""χ, ψ1 and ψ2 by `elastic_rebound.py`, with steps of 0.001 and alike with 0.0025."""


def test_known_digits():
    np.testing.assert_allclose(tangential_rebound(DIGITS[:, 0], LIKE), DIGITS[:, 1], atol=TABLE)


def test_without_damping():
    chi, psi1, psi2 = ELASTIC.T
    np.testing.assert_allclose(tangential_rebound(psi1, chi), psi2, rtol=0, atol=TABLE)


def test_continuous_where_forward_slip_begins():
    psi1 = np.linspace(0, 5, 101)[:, None]
    chi = TURNING + np.array([-1e-9, 1e-9])
    before, after = np.asarray(tangential_rebound(psi1, chi)).T
    np.testing.assert_allclose(before, after, rtol=0, atol=TABLE)


@pytest.mark.parametrize(
    ("nu", "slope"),
    [(0, 0.38698456647), (0.23, 0.29620264411), (0.3, 0.23166969105), (0.33, 0.19676990045),
     (0.5, -0.10396736026)],
)  # fmt: skip
def test_slope_at_small_angles(nu, slope):
    chi = 7 * (1 - nu) / (2 * (2 - nu))
    assert float(jax.grad(tangential_rebound)(0.0, chi)) == pytest.approx(slope, abs=SLOPE)


@pytest.mark.parametrize(
    ("chi", "alpha"), [(1.1, 0.0), (1.6, 0.0), (1.2, 0.1), (1.7, 0.5), (1.05, 0.6), (1.4, 1.4)]
)
def test_another_solver(chi, alpha):
    full = float(full_sliding(jnp.asarray(chi), jnp.asarray(alpha)))
    psi1 = np.random.default_rng(0).uniform(0, 1.02 * full, 8)
    fine, coarse = (rebound(psi1, chi, alpha, springs) for springs in (600, 300))
    np.testing.assert_allclose(
        tangential_rebound(psi1, chi, alpha), 2 * fine - coarse, atol=SPRINGS
    )


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.4])
def test_full_sliding_is_the_formula(alpha):
    chi, e = 1.3, restitution_of(jnp.asarray(alpha))
    full = full_sliding(jnp.asarray(chi), jnp.asarray(alpha))
    psi1 = full + jnp.array([0.0, 1e-9, 1.0, 100.0])
    expected = psi1 - 2 * chi * (1 + e)
    np.testing.assert_allclose(tangential_rebound(psi1, chi, alpha), expected, rtol=1e-14)
    below = jax.grad(tangential_rebound)(full - 1e-7, chi, alpha)
    assert float(below) == pytest.approx(1, abs=1e-4)
    if alpha == 0:
        assert float(full) == pytest.approx(4 * chi - 1, rel=1e-14)


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.9])
def test_derivatives(alpha):
    chi, far = 1.3, 1e-4
    full = float(full_sliding(jnp.asarray(chi), jnp.asarray(alpha)))
    psi1 = np.array([0.05, 0.3, 0.8 * (1 + alpha), 1.2 * (1 + alpha), 0.8 * full, 1.1 * full])

    def curve(change, place):
        """ψ2 as one of the arguments changes; α only grows from 0."""
        numbers = [psi1, np.full(6, chi), np.full(6, alpha)]
        numbers[place] = numbers[place] + change
        return np.asarray(tangential_rebound(*numbers))

    slopes = jax.vmap(jax.grad(tangential_rebound, (0, 1, 2)), (0, None, None))(psi1, chi, alpha)
    for place, slope in enumerate(slopes):
        if place == 2 and alpha == 0:
            one, two = curve(far, place), curve(2 * far, place)
            expected = (4 * one - two - 3 * curve(0.0, place)) / (2 * far)
        else:
            expected = (curve(far, place) - curve(-far, place)) / (2 * far)
        np.testing.assert_allclose(slope, expected, atol=2e-6 if place else 1e-6, rtol=1e-5)


def test_derivative_at_zero():
    slope = jax.grad(tangential_rebound)(0.0, 1.3, 0.1)
    beside = tangential_rebound(np.array([1e-6, -1e-6]), 1.3, 0.1) / np.array([1e-6, -1e-6])
    np.testing.assert_allclose(beside, slope, atol=1e-5)


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.9])
def test_continuous_at_the_transitions(alpha):
    chi = 1.3
    touch, full = 1 + alpha, full_sliding(jnp.asarray(chi), jnp.asarray(alpha))
    places = jnp.array([touch, touch + MIDDLE * (full - touch), full])
    value = jax.vmap(jax.value_and_grad(tangential_rebound), (0, None, None))
    (before, slope), (after, later) = (value(places + x, chi, alpha) for x in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-6)
    np.testing.assert_allclose(slope, later, atol=JUMP)


def test_continuous_where_strong_damping_begins():
    psi1 = np.linspace(0, 5, 101)
    weak, strong = (tangential_rebound(psi1, 1.3, onset(1.3) + x) for x in (-1e-9, 1e-9))
    np.testing.assert_allclose(weak, strong, atol=1e-5)


def test_odd_and_no_energy_from_nothing():
    psi1 = jnp.linspace(0, 8, 400)[:, None]
    rng = np.random.default_rng(1)
    chi, alpha = rng.uniform(*CHI_DAMPED, 30), rng.uniform(0, ALPHA, 30)
    psi2 = tangential_rebound(psi1, chi[None], alpha[None])
    np.testing.assert_array_equal(tangential_rebound(-psi1, chi[None], alpha[None]), -psi2)
    assert bool((abs(psi2) <= psi1).all())


def test_float32():
    psi1 = np.linspace(0, 6, 50)
    exact = tangential_rebound(psi1, 1.3, 0.3)
    single = tangential_rebound(psi1.astype(np.float32), np.float32(1.3), np.float32(0.3))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, exact, atol=ROUNDING_32)
    # A process may use both settings, as a calibration does.
    with jax.enable_x64(False):
        single = tangential_rebound(jnp.asarray(psi1), 1.3, 0.3)
    np.testing.assert_allclose(single, exact, atol=ROUNDING_32)


def test_lanes_out_of_range_are_nan():
    chi = np.array([0.7, 1.2, 1.9, np.nan, 0.9, 0.9])
    psi2 = tangential_rebound(1.0, chi, np.array([0.0, 0.1, 0.0, 0.1, 0.1, 0.0]))
    np.testing.assert_array_equal(jnp.isnan(psi2), [True, False, True, True, True, False])
    assert bool(jnp.isnan(tangential_rebound(jnp.array(jnp.nan), 1.2)))
    with pytest.raises(ValueError, match=r"Argument `chi` must be in \[0.8, 1.8\], but is 3"):
        tangential_rebound(1.0, 3.0)
    with pytest.raises(ValueError, match=r"Argument `alpha` must be in \[0, 1.433\], but is -1"):
        tangential_rebound(1.0, 1.2, -1.0)
    assert float(exact_damping_factor(0.5)) < ALPHA


def test_no_jump_where_damping_begins():
    psi1 = np.linspace(0, 7, 200)[:, None]
    chi = np.array([1.05, 1.4, 1.6, 1.74])
    none, little = (np.asarray(tangential_rebound(psi1, chi, a)) for a in (0.0, 1e-10))
    np.testing.assert_allclose(none, little, rtol=0, atol=1e-9)


def test_shapes_and_many_lanes():
    psi1, chi, alpha = (
        np.linspace(0, 5, 2000),
        np.linspace(1, 1.75, 2000),
        np.linspace(0, 1.4, 2000),
    )
    many = tangential_rebound(psi1, chi, alpha)
    few = tangential_rebound(psi1[::400], chi[::400], alpha[::400])
    np.testing.assert_allclose(many[::400], few, rtol=1e-12, atol=1e-12)
    assert tangential_rebound(psi1[:6].reshape(2, 3), chi[:3]).shape == (2, 3)
    assert tangential_rebound(psi1[:4], np.array([[1.2]])).shape == (1, 4)
    inside = jax.vmap(lambda x: mbf_curve(x, jnp.asarray(1.2), jnp.asarray(0.1)))(psi1)
    np.testing.assert_allclose(inside, tangential_rebound(psi1, 1.2, 0.1), atol=1e-14)
