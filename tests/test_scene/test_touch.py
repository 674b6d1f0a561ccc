"""Times of impact: the right root, its digits, and existing touches."""

import jax
import numpy as np
import pytest

from jaxcontact._coupled.interpolation import highest
from jaxcontact._scene.contact_times.touch import (
    curved_time,
    image_horizon,
    sphere_time,
    wall_time,
)

ROOT = 1e-13  # relative error of a time of impact: measured 2e-15 (quadratics), 3e-14 (quartics)
NOISE = 1e-15


def time_of(function, *numbers):
    return np.asarray(jax.jit(function)(*map(np.asarray, numbers)))


def test_walls():
    gap, rate, acceleration, time = np.transpose(
        [
            (1.0, -2.0, 0.0, 0.5),
            (1.0, 2.0, 0.0, np.inf),
            (1.0, 0.0, -2.0, 1.0),
            (0.0, 3.0, -2.0, 3.0),  # it has just left, and falls back
            (0.0, -3.0, -2.0, 0.0),  # touching and approaching: now
            (0.0, 3.0, 0.0, np.inf),  # touching and receding: never
            (-1e-17, -3.0, 0.0, 0.0),  # an overlap by rounding
            (-1e-17, 3.0, -2.0, 3.0),  # the same, leaving: not found twice
            (0.0, 1e-17, -2.0, 0.0),  # resting
            (0.0, -1e-17, 0.0, np.inf),  # sliding along
            (1.0, -1.0, 1.0, np.inf),  # pulled away before it is there
            (1.0, -3.0, 4.0, 0.5),
            # 1e-12 - τ - 1e-9 τ²/2: the root by the other formula would have four digits.
            (1e-12, -1.0, -1e-9, 1e-12 * (1 - 0.5e-21)),
        ]
    )
    found = time_of(wall_time, gap, rate, acceleration, NOISE)
    np.testing.assert_allclose(found, time, rtol=ROOT, atol=0)


def spheres(apart, rate):
    return float(time_of(sphere_time, apart, rate, 1.0, NOISE))


@pytest.mark.parametrize(
    ("apart", "rate", "time"),
    [
        ([3.0, 0.0], [-1.0, 0.0], 2.0),
        ([3.0, 0.0], [1.0, 0.0], np.inf),
        ([3.0, 1.0], [-1.0, 0.0], np.inf),  # they graze: no touch
        ([3.0, 0.6], [-2.0, 0.0], 1.1),
        ([1.0, 0.0], [-1.0, 5.0], 0.0),
        ([1.0, 0.0], [1.0, 5.0], np.inf),
        ([1.0 - 1e-16, 0.0], [-1.0, 0.0], 0.0),
        ([1.0 - 1e-16, 0.0], [0.0, 1.0], np.inf),
        ([1e6, 0.6], [-1.0, 0.0], 1e6 - 0.8),
    ],
)
def test_spheres(apart, rate, time):
    np.testing.assert_allclose(spheres(apart, rate), time, rtol=ROOT)


def test_far_away_keeps_the_digits_of_the_normal():
    # b² - a c would lose twelve of the sixteen digits of the discriminant.
    time = spheres([1e6, 0.999999], [-1.0, 0.0])
    assert abs(time - (1e6 - np.sqrt((1 - 0.999999) * 1.999999))) <= 2e-10


def test_under_relative_acceleration_the_first_root_of_many():
    """Against roots by numpy of the quartic, in four hundred random cases with up to four roots."""
    rng = np.random.default_rng(3)
    apart, rate, bend = rng.normal(size=(3, 400, 2))
    apart *= (1.0 + rng.uniform(0.0, 2.0, (400, 1))) / np.linalg.norm(apart, axis=1, keepdims=True)
    horizon = 5.0
    found = time_of(curved_time, apart, rate, bend, np.ones(400), np.full(400, NOISE), horizon)
    met = 0
    for d, w, a, time in zip(apart, rate, bend / 2, found, strict=True):
        quartic = [a @ a, 2 * w @ a, w @ w + 2 * d @ a, 2 * d @ w, d @ d - 1]
        roots = np.roots(quartic)
        real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        real = real[(real > 0) & (real <= horizon)]
        if real.size == 0:
            assert np.isinf(time)
            continue
        met += 1
        np.testing.assert_allclose(time, real[0], rtol=1e-8)
        assert abs(np.linalg.norm(d + w * time + a * time**2) - 1) < ROOT * 30
    assert met > 80


@pytest.mark.parametrize(("rate", "bend", "time"), [(0, -2, 0.0), (0, 2, np.inf), (1, -2, 1.0)])
def test_what_touches_under_acceleration(rate, bend, time):
    found = time_of(
        curved_time, [1.0, 0.0], [float(rate), 0.0], [float(bend), 0.0], 1.0, NOISE, 10.0
    )
    np.testing.assert_allclose(found, time, rtol=ROOT)


def test_another_image_is_not_met_before_the_horizon():
    np.testing.assert_allclose(time_of(image_horizon, 0.3, 2.0, 0.0, 0.2, 1.0), 0.25, rtol=ROOT)
    bent = time_of(image_horizon, 0.3, 2.0, 4.0, 0.2, 1.0)
    np.testing.assert_allclose(2 * bent + 2 * bent**2, 0.5, rtol=ROOT)


CUBIC = 1e-15  # of the largest of value and slopes: measured 4e-16


@pytest.mark.parametrize("rises", [0.0, 1e-300, 1e-16, 1e-15, 1e-8, 0.3])
def test_the_height_of_a_cubic_is_found_from_any_slope(rises):
    """A hump hides behind a slope of rounding size at the start of a step."""
    one, right, falls = np.ones(3), np.array([0.5, -0.2, 0.0]), np.array([-1.0, -1.0, -1e-9])
    top, inside, *_ = jax.jit(highest)(1.0, 0 * one, rises * one, right, falls)
    top, inside = np.asarray(top), np.asarray(inside)
    for lane in range(3):
        a, b, d = rises, float(falls[lane]), float(right[lane])
        cubic = np.polynomial.Polynomial([0, a, 3 * d - 2 * a - b, a + b - 2 * d])
        roots = cubic.deriv().roots()
        roots = roots[np.isreal(roots)].real
        exact = max(0, d, *cubic(roots[(roots > 0) & (roots < 1)]), 0)
        assert abs(top[lane] - exact) < CUBIC
        assert inside[lane] == (exact > max(0, d))
