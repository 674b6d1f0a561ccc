"""Single precision over its whole range."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.test_impact.support import assert_same, column, finite, grid

# The logarithm of m v²/K loses a factor of its size, up to 90, to rounding. Measured: 7e-6 for the
# times; 6e-8 for e by the closed forms, 2.7e-6 by the event solve.
RESTITUTION, DURATION = 1e-5, 1e-4
# Measured 9e-7.
SLOPE = 1e-5
# Times by event: measured 1.7e-6, and 8e-5 with a tolerance far above the momentum.
STRONG = 1e-5


def single(*numbers):
    return jnp.asarray(np.array(numbers, np.float32))


# Every corner of the SI range and the middle, 7 x 7 x 5 x 4 impacts in one call.
STIFFNESS = single(1e-3, 1.0, 1e3, 1e6, 1e9, 1e12, 1e15)
MASS = single(1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6)[:, None]
VELOCITY = single(1e-6, 1e-3, 1e-1, 1e1, 1e3)[:, None, None]
ASKED = single(0.05, 0.5, 0.9, 1.0)[:, None, None, None]

LAWS = {
    "hu_guo": (jc.HuGuo, 1.5),
    "exact": (jc.ExactRestitution, 1.5),
    "kelvin_voigt": (jc.KelvinVoigt, 1.0),
    "thornton": (jc.Thornton, 1.5),
}


def flat(dtype):
    shape = np.broadcast_shapes(STIFFNESS.shape, MASS.shape, VELOCITY.shape, ASKED.shape)
    every = (ASKED, STIFFNESS, MASS, VELOCITY)
    return [jnp.broadcast_to(x, shape).astype(dtype).ravel() for x in every]


@pytest.mark.parametrize("name", LAWS)
def test_all_corners(name):
    law, n = LAWS[name]

    def solve(e, stiffness, mass, velocity):
        return jc.impact(law(e=e), jc.Contact(mass, stiffness, n), velocity)

    hit, reference = solve(*flat(jnp.float32)), solve(*flat(jnp.float64))
    assert hit.restitution.dtype == hit.duration.dtype == hit.max_force.dtype == jnp.float32
    assert (hit.status == jc.Status.SEPARATED).all() and finite(hit)
    assert np.allclose(hit.restitution, reference.restitution, rtol=0, atol=RESTITUTION)
    for f in ("duration", "compression_time", "max_indentation", "max_force", "rebound_velocity"):
        assert np.allclose(getattr(hit, f), getattr(reference, f), rtol=DURATION, atol=0), f


def test_derivatives_at_all_corners_are_finite():
    def total(e, stiffness, mass, velocity):
        hit = jc.impact(jc.HuGuo(e=e), jc.Contact(mass, stiffness), velocity)
        return jnp.sum(hit.restitution) + jnp.sum(
            hit.duration / jax.lax.stop_gradient(hit.duration)
        )

    single_, double = (jax.grad(total, (0, 1, 2, 3))(*flat(t)) for t in (jnp.float32, jnp.float64))
    for got, want in zip(single_, double, strict=True):
        assert got.dtype == jnp.float32 and jnp.isfinite(got).all()
        assert np.allclose(got, want, rtol=SLOPE, atol=0)


def test_a_traced_exponent_in_closed_form():
    # The first nodes of the quadrature are below the smallest single-precision number. Without a
    # guard all lanes except those with n near 1 were flagged, and derivatives were NaN.
    alpha = single(0.0, 1e-6, 0.3, 14.4, 1e6)
    n = single(1.0, 1.5, 2.2, 3.0)[:, None]

    def solve(n, alpha):
        hit = jc.impact(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, n), 1.0, method="exact")
        return hit.restitution + hit.duration + hit.compression_time, hit.status

    def slopes(dtype):
        at = [x.ravel().astype(dtype) for x in jnp.broadcast_arrays(n, alpha)]
        (value, status), (slope, _) = jax.jvp(solve, tuple(at), (at[0], jnp.zeros_like(at[1])))
        assert (status == jc.Status.SEPARATED).all()
        return value, slope

    (value, slope), (want, want_slope) = slopes(jnp.float32), slopes(jnp.float64)
    assert value.dtype == slope.dtype == jnp.float32
    assert np.allclose(value, want, rtol=SLOPE, atol=0)
    assert np.allclose(slope, want_slope, rtol=SLOPE, atol=SLOPE)


ALPHAS = [0.0, 0.3, 2.0, 14.4]


@pytest.mark.parametrize("method", ["event", "phase"])
def test_the_other_methods(method):
    some = [c for a in ALPHAS for c in grid("hunt_crossley", n=1.5, alpha=a)]
    alpha = column(some, "alpha").astype(jnp.float32)

    def solve(alpha, stiffness, mass, velocity):
        def hit(alpha):
            contact = jc.Contact(mass, stiffness)
            return jc.impact(jc.Damped(alpha=alpha), contact, velocity, method=method)

        def total(alpha):
            outcome = hit(alpha)
            return jnp.sum(outcome.restitution), outcome

        return jax.grad(total, has_aux=True)(alpha)

    for p in [(1.0, 1.0, 1.0), (1e15, 1e-12, 1e3), (1e-3, 1e6, 1e-6)]:
        slope, hit = solve(alpha, *single(*p))
        reference = jc.impact(jc.Damped(alpha=alpha.astype(float)), jc.Contact(p[1], p[0]), p[2])
        assert (hit.status == jc.Status.SEPARATED).all() and jnp.isfinite(slope).all()
        assert hit.duration.dtype == jnp.float32
        assert np.allclose(hit.restitution, reference.restitution, rtol=0, atol=RESTITUTION)
        assert np.allclose(hit.duration, reference.duration, rtol=DURATION, atol=0)


# Numbers of each law, one lane of them bad, with the contact and the speeds. Measured: 2e-6 (JKR),
# 1e-6 (wet), 5e-7 (the others).
KEEPING = {
    "jkr": (jc.JKR, [[5e-6, -1.0, 5e-6]], (1e-11, 4e6, 1.5), [0.16, 0.16, 0.01], 1e-5),
    "luding": (jc.Luding, [[1.5, 0.5, 3.0], 0.0, 0.3], (0.3, 2e6, 1.0), [0.7, 0.7, 7.0], 3e-6),
    "plastic": (jc.ThorntonPlastic, [[0.1, -1, 0.1]], (0.3, 2e8, 1.5), [0.05, 2.0, 40.0], 3e-6),
    "wet": (jc.WetRestitution, [0.9, [0.1, -1.0, 0.1]], (1e-4, 1e9, 1.5), [0.3, 0.3, 0.05], 1e-5),
}


@pytest.mark.parametrize("name", KEEPING)
def test_laws_that_stick_or_remember(name):
    law, numbers, (mass, stiffness, n), speeds, tolerance = KEEPING[name]

    def solve(kind):
        made, speed = ([jnp.asarray(single(x)[0], kind) for x in y] for y in (numbers, [speeds]))
        contact = jc.Contact(*(jnp.asarray(single(x)[0], kind) for x in (mass, stiffness)), n)
        return jc.impact(law(*made), contact, speed[0])

    hit, exact = solve("float32"), solve("float64")
    assert hit.restitution.dtype == jnp.float32
    np.testing.assert_array_equal(hit.ok, [True, False, True])
    np.testing.assert_array_equal(hit.status, exact.status)
    names = ["restitution", "duration", "compression_time", "max_indentation", "max_force"]
    names += ["min_force"] if law in (jc.JKR, jc.Luding) else []
    assert_same(hit, exact, names, at=np.array([0, 2]), rtol=tolerance)


def test_python_numbers_follow_the_arrays():
    law = jc.HuGuo(e=0.5)
    hit = jc.impact(law, jc.Contact(1.0, 1e8), single(0.1, 1.0))
    assert hit.duration.dtype == jnp.float32
    assert jc.impact(law, jc.Contact(1.0, 1e8), 1.0).duration.dtype == jnp.float64
    mixed = jc.impact(jc.HuGuo(e=single(0.5)), jc.Contact(1.0, jnp.array([1e8])), 1.0)
    assert mixed.duration.dtype == jnp.float64


MANY = np.linspace(0, 20, 4001, dtype=np.float32)
CREEPING = np.geomspace(1e3, 1e6, 25, dtype=np.float32)


@functools.cache
def viscous():
    """Many impacts and those that creep, by one program."""
    a = np.append(MANY / 20, CREEPING)
    return jc.impact(jc.KuwabaraKono(A=a), jc.Contact(1.0, 1.0), 1.0, method="event")


def test_no_lane_of_many_is_lost_to_rounding():
    """A root asked for too sharply steps to and fro: that was one lane in a thousand."""
    hit = jc.impact(jc.Damped(alpha=MANY), jc.Contact(1.0, 1.0), 1.0, method="event")
    assert hit.duration.dtype == viscous().duration.dtype == jnp.float32
    assert (hit.status == jc.Status.SEPARATED).all()
    assert (viscous().status[: MANY.size] == jc.Status.SEPARATED).all()
    exact = jc.restitution(jc.Damped(alpha=MANY))
    assert np.allclose(hit.restitution, exact, rtol=0, atol=RESTITUTION)


def test_strong_damping_by_event():
    alpha = np.geomspace(1e2, 1e6, 64, dtype=np.float32)
    hit = jc.impact(
        jc.Damped(alpha=alpha), jc.Contact(*single(1, 1), 2.0), *single(1), method="event"
    )
    want = jc.impact(jc.Damped(alpha=alpha.astype(float)), jc.Contact(1.0, 1.0, 2.0), 1.0)
    assert (hit.status == jc.Status.SEPARATED).all() and hit.duration.dtype == jnp.float32
    for f in ("duration", "compression_time", "max_indentation"):
        assert np.allclose(getattr(hit, f), getattr(want, f), rtol=STRONG, atol=0), f


def test_a_way_out_whose_force_is_below_the_smallest_number():
    """From A = 4e4 on the bodies were said to part .6 % too late, without a force to slow them."""
    hit = jax.tree.map(lambda x: x[MANY.size :], viscous())
    want = jc.impact(jc.KuwabaraKono(A=CREEPING.astype(float)), jc.Contact(1.0, 1.0), 1.0)
    good = np.asarray(hit.status == jc.Status.SEPARATED)
    assert good[CREEPING < 5e3].all() and not good[CREEPING > 6e4].any()
    assert np.allclose(hit.duration[good], want.duration[good], rtol=STRONG, atol=0)


# Of the place and time of the turn: measured 1.9e-7 and 8e-8.
PUSHED = 1e-6


def test_an_end_that_no_step_shows_is_flagged():
    # e is 6e-58 by the oracle of the stability map. The bodies creep to a distance far below the
    # tolerance, where a step passed the end by chance: e was 3e-26, and the duration half of it.
    n = jnp.full(8, 1.0115324, jnp.float32)
    contact = jc.Contact(jnp.float32(1), jnp.float32(1), n)
    law = jc.KuwabaraKono(A=jnp.float32(3.9692243))
    hit = jc.impact(law, contact, jnp.float32(1), method="event")
    assert (hit.status == jc.Status.NOT_CONVERGED).all() and not hit.ok.any()


@pytest.mark.parametrize("n", [1.0, jnp.float32(1.0)], ids=["a number", "traced"])
def test_the_turn_under_a_strong_push(n):
    """Before their turn the bodies are up to a thousand times as fast as at touch."""
    alpha, force = 1e-4, jnp.geomspace(1e3, 5e3, 4, dtype=jnp.float32)
    contact = jc.Contact(jnp.float32(1), jnp.float32(1), n)
    hit = jc.impact(
        jc.Damped(alpha=jnp.float32(alpha)), contact, np.float32(1), external_force=force
    )
    assert (hit.status == jc.Status.SETTLED).all()

    def turned(_, state):
        return state[1]

    turned.terminal, turned.direction = True, -1
    for push, deepest, turn in zip(
        *map(np.asarray, (force, hit.max_indentation, hit.compression_time)), strict=True
    ):
        path = solve_ivp(
            lambda _, s, push=float(push): (s[1], push - s[0] * (1 + alpha * s[1])),
            (0, 5), (0, 1), "DOP853", events=turned, rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        assert turn == pytest.approx(path.t_events[0][0], rel=PUSHED)
        assert deepest == pytest.approx(path.y_events[0][0, 0], rel=PUSHED)
