"""The curve of Maw, Barber and Fawcett: stored digits, another solver, derivatives, and limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
from tests.oracle.stored import stored

TABLE = 1e-8  # without damping; at 1800 random places the largest error was 5.3e-9

SLOPE = 2e-7  # of the derivative at ψ1 = 0 without damping: 1.7e-7 for ν = 0, below 2e-8 elsewhere
JUMP = 2e-3  # of the derivative where springs begin to slip when they touch: 1.4e-3 for α = 0.9

SPRINGS = 2e-4
"""Between the table and the extrapolated rows of springs. These leave 1.1e-4 at most, a tenth of it
with twice the springs, and the table 4e-7."""

ROUNDING_32 = 2e-5  # in float32 the coefficients of a piece cancel partly
LIKE = 49 / 34  # χ of solid spheres of like materials with ν = 0.3

DIGITS = np.array(
    [
        (0.1, 0.020590706), (0.25, 0.041611319), (0.5, 0.047831079), (1, -0.059696704),
        (1.5, -0.428016532), (2, -0.837210007), (2.5, -1.162290249), (3, -1.379683292),
        (3.5, -1.477326779), (4, -1.436512225), (4.5, -1.217617298)
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
        (1.8, 0.3, 0.1136832822), (1.8, 1.7, 0.0310507213), (1.8, 2.2, -0.3803528467)
    ]
)  # fmt: skip
"""χ, ψ1 and ψ2 by `elastic_rebound.py`, with steps of 0.001 and alike with 0.0025."""


LANES = 256  # of every call of `curve`, which has one program

lanes = jax.jit(jax.vmap(jax.value_and_grad(tangential_rebound, (0, 1, 2))))


def curve(*numbers):
    """ψ2 and its slopes by ψ1, χ and α, of the shape of them together; without α for α = 0."""
    numbers = np.broadcast_arrays(*numbers, *[0.0] * (3 - len(numbers)))
    shape, size = numbers[0].shape, numbers[0].size
    rows = np.full((3, -(-size // LANES) * LANES), 1.2)
    rows[:, :size] = [x.ravel() for x in numbers]
    found = [lanes(*part) for part in np.split(rows, rows.shape[1] // LANES, axis=1)]
    value = np.concatenate([value for value, _ in found])[:size].reshape(shape)
    slopes = zip(*(slopes for _, slopes in found), strict=True)
    return value, [np.concatenate(slope)[:size].reshape(shape) for slope in slopes]


full_of, restitution = jax.jit(full_sliding), jax.jit(restitution_of)


# Rows of springs by another scheme than that of the table: midpoints in q, Heun's steps in time.


def end_of_contact(_, y):
    return y[0]


end_of_contact.terminal = True
end_of_contact.direction = -1


@stored()
def rebound(psi1, chi, alpha, springs):
    """ψ2 of several ψ1 at one χ and α.

    Of first order, since a spring that touches within a step moves by the whole step.
    """

    def slope(_, y):
        return [y[1], -(max(y[0], 0) ** 1.5) * (1 + alpha * y[1])]

    motion = solve_ivp(
        slope, (0, 20), [0, 1.0], "DOP853", rtol=1e-12, atol=1e-13, dense_output=True,
        events=end_of_contact,
    )  # fmt: skip
    # Steps are shorter where springs touch and part fast.
    time = motion.t_events[0][0] * np.sin(np.linspace(0, np.pi / 2, 2 * springs + 1)) ** 2
    x, v = motion.sol(time)
    x = np.maximum(x, 0)
    width = np.sqrt(x.max()) / springs
    q2 = (width * (np.arange(springs) + 0.5)) ** 2
    psi, t, total = np.array(psi1, float), np.zeros((len(psi1), springs)), 0.0
    for k in range(2 * springs):
        step = time[k + 1] - time[k]
        most = np.maximum(x[k + 1] - q2, 0) * (1 + alpha * v[k + 1])
        later = psi - 3 * chi * total * step
        # The forces at the end of the step, with the movement of a trapezoid, twice.
        for _ in range(2):
            moved = np.clip(t + (step * (psi + later) / 2)[:, None], -most, most)
            new = width * moved.sum(axis=1)
            later = psi - 1.5 * chi * step * (total + new)
        psi, t, total = later, moved, new
    return psi


def test_without_damping():
    np.testing.assert_allclose(curve(DIGITS[:, 0], LIKE)[0], DIGITS[:, 1], atol=TABLE)
    chi, psi1, psi2 = ELASTIC.T
    np.testing.assert_allclose(curve(psi1, chi)[0], psi2, rtol=0, atol=TABLE)


def test_slope_at_small_angles():
    nu = np.array([0, 0.23, 0.3, 0.33, 0.5])
    slope = [0.38698456647, 0.29620264411, 0.23166969105, 0.19676990045, -0.10396736026]
    _, (found, *_) = curve(0.0, 7 * (1 - nu) / (2 * (2 - nu)))
    np.testing.assert_allclose(found, slope, rtol=0, atol=SLOPE)
    beside = np.array([1e-6, -1e-6])
    _, (slope, *_) = curve(0.0, 1.3, 0.1)
    np.testing.assert_allclose(curve(beside, 1.3, 0.1)[0] / beside, slope, atol=1e-5)


@pytest.mark.parametrize(
    ("chi", "alpha"), [(1.1, 0.0), (1.6, 0.0), (1.2, 0.1), (1.7, 0.5), (1.05, 0.6), (1.4, 1.4)]
)
def test_another_solver(chi, alpha):
    psi1 = np.random.default_rng(0).uniform(0, 1.02 * float(full_of(chi, alpha)), 8)
    fine, coarse = (rebound(psi1, chi, alpha, springs) for springs in (600, 300))
    np.testing.assert_allclose(curve(psi1, chi, alpha)[0], 2 * fine - coarse, atol=SPRINGS)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.4])
def test_full_sliding_is_the_formula(alpha):
    chi, e, full = 1.3, float(restitution(alpha)), float(full_of(1.3, alpha))
    psi1 = full + np.array([0.0, 1e-9, 1.0, 100.0])
    expected = psi1 - 2 * chi * (1 + e)
    np.testing.assert_allclose(curve(psi1, chi, alpha)[0], expected, rtol=1e-14)
    _, (below, *_) = curve(full - 1e-7, chi, alpha)
    assert float(below) == pytest.approx(1, abs=1e-4)
    if alpha == 0:
        assert full == pytest.approx(4 * chi - 1, rel=1e-14)


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.9])
def test_derivatives(alpha):
    chi, far, full = 1.3, 1e-4, float(full_of(1.3, alpha))
    psi1 = np.array([0.05, 0.3, 0.8 * (1 + alpha), 1.2 * (1 + alpha), 0.8 * full, 1.1 * full])
    _, slopes = curve(psi1, chi, alpha)
    for place, slope in enumerate(slopes):
        # α only grows from 0.
        steps = np.array([-1, 1] if place < 2 or alpha else [0, 1, 2])[:, None]
        numbers = [x + far * steps * (k == place) for k, x in enumerate((psi1, chi, alpha))]
        ends = curve(*numbers)[0]
        weights = [-1, 1] if len(ends) == 2 else [-3, 4, -1]
        expected = weights @ ends / (2 * far)
        np.testing.assert_allclose(slope, expected, atol=2e-6 if place else 1e-6, rtol=1e-5)


@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.9])
def test_continuous_at_the_transitions(alpha):
    touch, full = 1 + alpha, float(full_of(1.3, alpha))
    places = np.array([touch, touch + MIDDLE * (full - touch), full])
    (before, (slope, *_)), (after, (later, *_)) = (
        curve(places + x, 1.3, alpha) for x in (-1e-9, 1e-9)
    )
    np.testing.assert_allclose(before, after, atol=1e-6)
    np.testing.assert_allclose(slope, later, atol=JUMP)


@pytest.mark.parametrize(
    ("chi", "alpha", "within"),
    [
        (TURNING + np.array([-1e-9, 1e-9]), 0.0, TABLE),
        (1.3, onset(1.3) + np.array([-1e-9, 1e-9]), 1e-5),
        *((chi, np.array([0.0, 1e-10]), 1e-9) for chi in (1.05, 1.4, 1.6, 1.74)),
    ],
    ids=[
        "forward slip",
        "strong damping",
        *(f"damping at {chi}" for chi in (1.05, 1.4, 1.6, 1.74)),
    ],
)
def test_continuous_where_something_begins(chi, alpha, within):
    before, after = curve(np.linspace(0, 7, 128)[:, None], chi, alpha)[0].T
    np.testing.assert_allclose(before, after, rtol=0, atol=within)


def test_odd_and_no_energy_from_nothing():
    psi1 = np.linspace(0, 8, 400)[:, None]
    rng = np.random.default_rng(1)
    chi, alpha = rng.uniform(*CHI_DAMPED, 30), rng.uniform(0, ALPHA, 30)
    psi2, back = (np.asarray(tangential_rebound(s * psi1, chi[None], alpha[None])) for s in (1, -1))
    np.testing.assert_array_equal(back, -psi2)
    assert (abs(psi2) <= psi1).all()


def test_float32():
    psi1 = np.linspace(0, 6, 50)
    exact = curve(psi1, 1.3, 0.3)[0]
    single = tangential_rebound(psi1.astype(np.float32), np.float32(1.3), np.float32(0.3))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, exact, atol=ROUNDING_32)
    # A process may use both settings, as a calibration does.
    with jax.enable_x64(False):
        single = tangential_rebound(jnp.asarray(psi1), 1.3, 0.3)
    np.testing.assert_allclose(single, exact, atol=ROUNDING_32)


def test_lanes_out_of_range_are_nan():
    chi, alpha = [0.7, 1.2, 1.9, np.nan, 0.9, 0.9], [0.0, 0.1, 0.0, 0.1, 0.1, 0.0]
    psi2 = curve(1.0, chi, alpha)[0]
    np.testing.assert_array_equal(np.isnan(psi2), [True, False, True, True, True, False])
    assert np.isnan(curve(np.nan, 1.2)[0])
    with pytest.raises(ValueError, match=r"Argument `chi` must be in \[0.8, 1.8\], but is 3"):
        tangential_rebound(1.0, 3.0)
    with pytest.raises(ValueError, match=r"Argument `alpha` must be in \[0, 1.433\], but is -1"):
        tangential_rebound(1.0, 1.2, -1.0)
    assert float(jax.jit(exact_damping_factor)(0.5)) < ALPHA


def test_shapes_and_many_lanes():
    psi1, chi, alpha = (np.linspace(*ends, 2000) for ends in ((0, 5), (1, 1.75), (0, 1.4)))
    many = tangential_rebound(psi1, chi, alpha)
    few = curve(psi1[::400], chi[::400], alpha[::400])[0]
    np.testing.assert_allclose(many[::400], few, rtol=1e-12, atol=1e-12)
    assert tangential_rebound(psi1[:6].reshape(2, 3), chi[:3]).shape == (2, 3)
    assert tangential_rebound(psi1[:4], np.array([[1.2]])).shape == (1, 4)
    inside = jax.jit(jax.vmap(lambda x: mbf_curve(x, jnp.asarray(1.2), jnp.asarray(0.1))))(psi1)
    np.testing.assert_allclose(inside, curve(psi1, 1.2, 0.1)[0], atol=1e-14)
