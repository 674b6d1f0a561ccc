"""Times of impact: the right root, its digits, and existing touches."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact._scene.contact_times.closed_form import (
    curved_time,
    image_horizon,
    sphere_time,
    wall_time,
)

ROOT = 1e-13
"""Relative error of a time of impact: measured 2e-15 (quadratics), 3e-14 (quartics)."""

NOISE = 1e-15


def wall(gap, rate, acceleration):
    return float(wall_time(*map(jnp.asarray, (gap, rate, acceleration, NOISE))))


@pytest.mark.parametrize(
    ("gap", "rate", "acceleration", "time"),
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
    ],
)
def test_walls(gap, rate, acceleration, time):
    np.testing.assert_allclose(wall(gap, rate, acceleration), time, rtol=ROOT, atol=1e-16)


def test_a_slow_fall_keeps_its_digits():
    # 1e-12 - τ - 1e-9 τ²/2: the root by the other formula would have four digits.
    time = wall(1e-12, -1.0, -1e-9)
    np.testing.assert_allclose(time, 1e-12 * (1 - 0.5e-21), rtol=ROOT)


def spheres(apart, rate, distance=1.0):
    time = sphere_time(jnp.asarray(apart), jnp.asarray(rate), jnp.asarray(distance), NOISE)
    return float(time)


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
    found = curved_time(
        *map(jnp.asarray, (apart, rate, bend)), jnp.ones(400), jnp.full(400, NOISE), horizon
    )
    met = 0
    for d, w, a, time in zip(apart, rate, bend / 2, np.asarray(found), strict=True):
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


def test_what_touches_under_acceleration():
    def time(apart, rate, bend):
        given = map(jnp.asarray, (apart, rate, bend, 1.0, NOISE, 10.0))
        return float(curved_time(*given))

    assert time([1.0, 0.0], [0.0, 0.0], [-2.0, 0.0]) == 0.0
    assert np.isinf(time([1.0, 0.0], [0.0, 0.0], [2.0, 0.0]))
    np.testing.assert_allclose(time([1.0, 0.0], [1.0, 0.0], [-2.0, 0.0]), 1.0, rtol=ROOT)


def test_another_image_is_not_met_before_the_horizon():
    horizon = image_horizon(*map(jnp.asarray, (0.3, 2.0, 0.0, 0.2, 1.0)))
    np.testing.assert_allclose(horizon, 0.25, rtol=ROOT)
    bent = float(image_horizon(*map(jnp.asarray, (0.3, 2.0, 4.0, 0.2, 1.0))))
    np.testing.assert_allclose(2 * bent + 2 * bent**2, 0.5, rtol=ROOT)
