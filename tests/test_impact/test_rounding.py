"""Rounding: single precision over its whole range, and what floats cannot resolve.

Events, turns and largest forces that are closer together than that have truths by the stability
map's oracle, in 80 bits.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests import oracle
from tests.oracle import FIELDS
from tests.oracle.stored import stored
from tests.test_impact import units
from tests.test_impact.support import (
    LANES,
    UNIT,
    assert_same,
    column,
    finite,
    given_ratio,
    grid,
    impacts,
    values,
)
from tests.test_laws import table

# The logarithm of m v²/K loses a factor of its size, up to 90, to rounding. Measured: 7e-6 for the
# times; 6e-8 for e by the closed forms, 2.7e-6 by the event solve.
RESTITUTION, DURATION = 1e-5, 1e-4
SLOPE = 1e-5  # measured 9e-7
STRONG = 1e-5  # times by event: measured 1.7e-6, and 8e-5 with a tolerance far above the momentum


def single(*numbers):
    return np.array(numbers, np.float32)


# Every corner of the SI range and the middle, 7 x 7 x 5 x 4 impacts in one call.
STIFFNESS = single(1e-3, 1.0, 1e3, 1e6, 1e9, 1e12, 1e15)
MASS = single(1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6)[:, None]
VELOCITY = single(1e-6, 1e-3, 1e-1, 1e1, 1e3)[:, None, None]
ASKED = single(0.05, 0.5, 0.9, 1.0)[:, None, None, None]

# By the oracle: α, or the damping ratio and the ending, of an e.
LAWS = {
    "hu_guo": (jc.HuGuo, 1.5, lambda e: 3 * (1 - e) / (2 * e), None),
    "exact": (jc.ExactRestitution, 1.5, table.exact_alpha, None),
    "kelvin_voigt": (jc.KelvinVoigt, 1.0, table.zeta_of_half_period, "tension"),
    "thornton": (jc.Thornton, 1.5, lambda e: table.thornton(e) * mp.sqrt(mpf(6) / 5), "clamped"),
}


@stored()
def by_the_oracle(name, e):
    """The outcome in scaled units, and for `hu_guo` dR/de + d ln T/de of its e R and duration T."""
    _, n, damping, ending = LAWS[name]
    with mp.workdps(oracle.DIGITS):
        e = mpf(e)
        solve = oracle.hunt_crossley if ending is None else oracle.oscillator
        hit, slope = solve(damping(e), n, *[ending] * (ending is not None)), 0
        if name == "hu_guo":
            by_alpha = oracle.derivative(oracle.hunt_crossley, (damping(e), n), 0)
            slope = -3 / (2 * e**2) * (by_alpha["e"] + by_alpha["duration"] / hit.duration)
        return np.array([float(x) for x in (*(getattr(hit, f) for f in FIELDS), slope)])


@functools.cache
def corners(name):
    """Impacts at all corners, for `hu_guo` with slopes by one program; and by the oracle."""
    law, n, *_ = LAWS[name]

    def total(e, stiffness, mass, velocity):
        hit = jc.impact(law(e=e), jc.Contact(mass, stiffness, n), velocity)
        unit = jax.lax.stop_gradient(hit.duration)
        return jnp.sum(hit.restitution) + jnp.sum(hit.duration / unit), hit

    def both(*numbers):
        if name != "hu_guo":
            return None, total(*numbers)[1]
        return jax.grad(total, (0, 1, 2, 3), has_aux=True)(*numbers)

    numbers = [x.ravel() for x in np.broadcast_arrays(ASKED, STIFFNESS, MASS, VELOCITY)]
    e, *place = (x.astype(float) for x in numbers)
    known = {x: by_the_oracle(name, x) for x in ASKED.ravel().tolist()}
    wanted = dict(
        zip((*FIELDS, "slope"), np.transpose([known[x] for x in e.tolist()]), strict=True)
    )
    places = dict(zip("Kmv", place, strict=True)) | {"n": np.full(e.size, n)}
    return jax.tree.map(np.asarray, jax.jit(both)(*numbers)), wanted, places


@pytest.mark.parametrize("name", LAWS)
def test_all_corners(name):
    (_, hit), wanted, places = corners(name)
    assert hit.restitution.dtype == hit.duration.dtype == hit.max_force.dtype == jnp.float32
    assert (hit.status == jc.Status.SEPARATED).all() and finite(hit)
    assert np.allclose(hit.restitution, wanted["e"], rtol=0, atol=RESTITUTION)
    assert np.allclose(hit.rebound_velocity, wanted["e"] * places["v"], rtol=DURATION, atol=0)
    for f in ("duration", "compression_time", "max_indentation", "max_force"):
        in_si = np.float64(units.unit(f, places) * wanted[f])
        assert np.allclose(getattr(hit, f), in_si, rtol=DURATION, atol=0), f


def test_derivatives_at_all_corners_are_finite():
    (slopes, _), wanted, places = corners("hu_guo")
    for got, by in zip(slopes, "eKmv", strict=True):
        want = wanted["slope"] if by == "e" else units.log_slope("duration", by, places)
        assert got.dtype == np.float32 and np.isfinite(got).all()
        assert np.allclose(got, want, rtol=SLOPE, atol=0)


@stored()
def along_n(alpha, n):
    """The sum of e and both times, and its slope along n."""
    hit = oracle.hunt_crossley(alpha, n)
    slope = oracle.derivative(oracle.hunt_crossley, (alpha, n), 1)
    names = ("e", "duration", "compression_time")
    return float(sum(getattr(hit, f) for f in names)), float(n * sum(slope[f] for f in names))


def test_a_traced_exponent_in_closed_form():
    # The first nodes of the quadrature are below the smallest single-precision number. Without a
    # guard all lanes except those with n near 1 were flagged, and derivatives were NaN.
    alpha = single(0.0, 1e-6, 0.3, 14.4, 1e6)
    n, alpha = (x.ravel() for x in np.broadcast_arrays(single(1.0, 1.5, 2.2, 3.0)[:, None], alpha))

    def solve(n, alpha):
        hit = jc.impact(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, n), 1.0, method="exact")
        return hit.restitution + hit.duration + hit.compression_time, hit.status

    @jax.jit
    def slopes(n, alpha):
        return jax.jvp(solve, (n, alpha), (n, jnp.zeros_like(alpha)), has_aux=True)

    value, slope, status = slopes(n, alpha)
    want, want_slope = np.transpose(
        [along_n(*x) for x in zip(alpha.tolist(), n.tolist(), strict=True)]
    )
    assert (status == jc.Status.SEPARATED).all()
    assert value.dtype == slope.dtype == jnp.float32
    assert np.allclose(value, want, rtol=SLOPE, atol=0)
    assert np.allclose(slope, want_slope, rtol=SLOPE, atol=SLOPE)


ALPHAS = [0.0, 0.3, 2.0, 14.4]


@pytest.mark.slow("phase", reason="slopes of one more solve; values in a test below")
@pytest.mark.parametrize("method", ["event", "phase"])
def test_the_other_methods(method):
    some = [c for a in ALPHAS for c in grid("hunt_crossley", n=1.5, alpha=a)]
    alpha = jnp.asarray(column(some, "alpha"), "float32")

    @jax.jit
    @functools.partial(jax.grad, has_aux=True)
    def solve(alpha, stiffness, mass, velocity):
        contact = jc.Contact(mass, stiffness)
        outcome = jc.impact(jc.Damped(alpha=alpha), contact, velocity, method=method)
        return jnp.sum(outcome.restitution), outcome

    for p in [(1.0, 1.0, 1.0), (1e15, 1e-12, 1e3), (1e-3, 1e6, 1e-6)]:
        slope, hit = jax.tree.map(np.asarray, solve(alpha, *jnp.asarray(single(*p))))
        duration = units.unit("duration", dict(zip("Kmv", p, strict=True)) | {"n": 1.5})
        want = values(some)
        assert (hit.status == jc.Status.SEPARATED).all() and np.isfinite(slope).all()
        assert hit.duration.dtype == jnp.float32
        assert np.allclose(hit.restitution, want["e"], rtol=0, atol=RESTITUTION)
        assert np.allclose(hit.duration, duration * want["duration"], rtol=DURATION, atol=0)


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
        made, (m, K, speed) = (
            [single(x)[0].astype(kind) for x in row] for row in (numbers, (mass, stiffness, speeds))
        )
        return impacts(law(*made), jc.Contact(m, K, n), speed)

    hit, exact = solve("float32"), solve("float64")
    assert hit.restitution.dtype == jnp.float32
    np.testing.assert_array_equal(hit.ok, [True, False, True])
    np.testing.assert_array_equal(hit.status, exact.status)
    names = ["restitution", "duration", "compression_time", "max_indentation", "max_force"]
    names += ["min_force"] if law in (jc.JKR, jc.Luding) else []
    assert_same(hit, exact, names, at=np.array([0, 2]), rtol=tolerance)


def test_python_numbers_follow_the_arrays():
    def kind_of(e, stiffness, speed):
        law, contact = jc.HuGuo(e=e), jc.Contact(1.0, stiffness)
        # No program is needed to say so.
        return jax.eval_shape(lambda: jc.impact(law, contact, speed)).duration.dtype

    assert kind_of(0.5, 1e8, single(0.1, 1.0)) == "float32"
    assert kind_of(0.5, 1e8, 1.0) == kind_of(single(0.5), jnp.array([1e8]), 1.0) == "float64"


MANY = np.linspace(0, 20, 2001, dtype=np.float32)


def test_no_lane_of_many_is_lost_to_rounding():
    """A root asked for too sharply steps to and fro: that was one lane in a thousand."""
    for law in (jc.Damped(alpha=MANY), jc.KuwabaraKono(A=MANY / 20)):
        hit = jax.tree.map(np.asarray, jc.impact(law, UNIT[1.5], 1.0, method="event"))
        assert hit.duration.dtype == jnp.float32
        assert (hit.status == jc.Status.SEPARATED).all()
        if isinstance(law, jc.Damped):
            exact = jc.restitution(law)
            assert np.allclose(hit.restitution, exact, rtol=0, atol=RESTITUTION)


@stored()
def strongly_damped(alpha):
    hit = oracle.hunt_crossley(alpha, 2)
    return [float(x) for x in (hit.duration, hit.compression_time, hit.max_indentation)]


def test_strong_damping_by_event():
    alpha = np.geomspace(1e2, 1e6, LANES, dtype=np.float32)
    hit = impacts(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, 2.0), method="event")
    assert (hit.status == jc.Status.SEPARATED).all() and hit.duration.dtype == np.float32
    found = np.stack([hit.duration, hit.compression_time, hit.max_indentation], axis=1)
    np.testing.assert_allclose(found, list(map(strongly_damped, alpha.tolist())), rtol=STRONG)


def test_a_way_out_whose_force_is_below_the_smallest_number():
    """From A = 4e4 on the bodies were said to part .6 % too late, without a force to slow them."""
    creeping = np.geomspace(1e3, 1e6, 25, dtype=np.float32)
    hit = impacts(jc.KuwabaraKono(A=creeping), jc.Contact(1.0, 1.0, single(1.5)), method="event")
    # The limit of strong damping, as in test_exact.
    duration = creeping.astype(float) * (5 * np.log(creeping.astype(float)) - 0.359367057)
    good = hit.status == jc.Status.SEPARATED
    assert good[creeping < 5e3].all() and not good[creeping > 6e4].any()
    assert np.allclose(hit.duration[good], duration[good], rtol=STRONG, atol=0)


def test_an_end_that_no_step_shows_is_flagged():
    # e is 6e-58 by the oracle of the stability map. The bodies creep to a distance far below the
    # tolerance, where a step passed the end by chance: e was 3e-26, and the duration half of it.
    law = jc.KuwabaraKono(A=np.float32(3.9692243))
    hit = impacts(law, jc.Contact(1.0, 1.0, single(1.0115324)), method="event")
    assert (hit.status == jc.Status.NOT_CONVERGED).all() and not hit.ok.any()


PUSHED = 1e-6  # of the place and time of the turn: measured 1.9e-7 and 8e-8


@stored()
def turned(alpha, push):
    """When and where bodies on a linear spring turn under a push."""

    def speed(_, state):
        return state[1]

    speed.terminal, speed.direction = True, -1
    path = solve_ivp(
        lambda _, s: (s[1], push - s[0] * (1 + alpha * s[1])),
        (0, 5), (0, 1), "DOP853", events=speed, rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    return path.t_events[0][0], path.y_events[0][0, 0]


@pytest.mark.parametrize("n", [1.0, single(1.0)], ids=["a number", "traced"])
def test_the_turn_under_a_strong_push(n):
    """Before their turn the bodies are up to a thousand times as fast as at touch."""
    alpha, force = 1e-4, np.geomspace(1e3, 5e3, 4, dtype=np.float32)
    hit = impacts(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, n), external_force=force)
    assert (hit.status == jc.Status.SETTLED).all()
    found = np.stack([hit.compression_time, hit.max_indentation], 1)
    want = [turned(alpha, push) for push in force.tolist()]
    np.testing.assert_allclose(found, want, rtol=PUSHED)


# --- Between two roundings ------------------------------------------------------------------------


def pushed(law, n, push):
    """Impacts in scaled units, in the precision of the push."""
    return impacts(law, jc.Contact(1.0, 1.0, n), external_force=push)


def test_the_turn_under_a_strong_pull():
    """A search that stands on its root was sent to the middle of its bracket, and left there."""
    zeta, pull = 0.68257, -1e4
    hit = pushed(given_ratio(np.array([zeta]), "tension"), 1.0, np.array([pull]))
    # x'' = Γ - x - 2ζx': v = e^(-ζt) (cos ωt + (Γ - ζ)/ω sin ωt).
    omega = np.sqrt(1 - zeta**2)
    turn = np.arctan(omega / (zeta - pull)) / omega
    assert hit.compression_time == pytest.approx([turn], rel=1e-9)
    alpha, pull = single(941.589, 6.5678, 7.92151), single(-3225.49, -2937.93, -1232.43)
    times = pushed(jc.Damped(alpha=alpha, tension=True), 2.0, pull).compression_time
    np.testing.assert_allclose(times, [0.0003100303, 0.0003403753, 0.0008114068], rtol=DURATION)


def test_the_largest_force_under_a_strong_pull():
    """Regula falsi from a gentle slope at touch to one 1e7 times as steep took its first step."""
    zeta, pull = single(0.09751, 0.237139, 0.395379), single(-1e4, -2502.14, -3079.96)
    hit = pushed(given_ratio(zeta, "tension"), 3.0, pull)
    np.testing.assert_allclose(hit.max_force[:2], [5.307772e-06, 5.158864e-05], rtol=DURATION)
    np.testing.assert_allclose(hit.compression_time[2], 0.0003246797, rtol=DURATION)


def test_a_push_does_no_work_on_what_rounding_leaves_of_x():
    """At the end x is 0, not 1e-7 of the largest x, times a push that is 1e2 times the energy."""
    alpha, push = single(1.20127e-9, 1e-6), single(69.15487, 69.15487)
    hit = pushed(jc.Damped(alpha=alpha, tension=True), 2.0, push)
    # The last step jumps over the separation and the following turn, back to x > 0. The loss by
    # weak damping is proportional to it.
    lost = (1 - 0.9563783**2) * 1.20127e-9 / 1e-6
    expected = [math.sqrt(1 - lost), 0.9563783]
    assert hit.restitution == pytest.approx(expected, abs=RESTITUTION)


def test_a_pull_holds_nothing():
    """Below x = 0 by rounding its work is positive: the bodies seemed too slow to part."""
    hit = pushed(jc.KuwabaraKono(A=single(200166.0)), 1.0, single(-3.50256e-05))
    assert hit.status.tolist() == [jc.Status.SEPARATED]
    assert hit.restitution == pytest.approx([1.749828e-10], rel=1e-3)
    # Explicit steps made no progress in restitution; a single one of length 1 replaced them.
    hit = pushed(jc.KuwabaraKono(A=single(32176.0067)), 1.0, single(-230.98334))
    assert hit.max_force == pytest.approx([32176.0067], rel=DURATION)


def test_the_place_where_weak_damping_ends_a_strong_push():
    """Its work is a part of e, and it followed from a speed with the rounding of a larger one."""
    zeta, push = single(1.164353e-6, 5.663193e-7), single(340.5041, 764.094)
    hit = pushed(given_ratio(zeta, "clamped"), 3.0, push)
    assert hit.restitution == pytest.approx([1.5865965, 1.8999016], abs=RESTITUTION)


def test_a_force_that_vanishes_and_comes_back_beyond_the_end():
    """For x = w² time runs back beyond x = 0, where the force seemed never to have vanished."""
    hit = pushed(jc.Damped(alpha=single(1.0227), tension=False), 1.5, single(-5340.281))
    assert hit.restitution == pytest.approx([0.9778039], abs=RESTITUTION)


def test_a_force_that_vanishes_and_comes_back_within_a_step():
    """Both ends of the step have a force: a contact without tension went on with a pull between."""
    push = np.linspace(0.014, 0.0149, 64, dtype=np.float32)
    law = jc.KuwabaraKono(A=np.full(64, np.float32(2.5741088)), tension=False)
    # A force that returns before x = 0 belongs to the same contact, which here settles.
    assert (pushed(law, 2.0, push).status == jc.Status.SETTLED).all()
    # A sampled motion does not follow the return. For pushes below 0.01464 it therefore shows
    # whether the end of the force was found.
    one = np.ones_like(push)
    contact = jc.Contact(one, one, 2.0)
    path = jc.trajectory(law, contact, one, samples=2, external_force=push)
    status = np.asarray(path.status)
    assert (status[push < 0.01462] == jc.Status.NOT_CONVERGED).all()
    assert (status[push > 0.01466] == jc.Status.SETTLED).all()


def test_a_turn_that_nothing_tells_from_rest_is_flagged():
    """Near critical damping bodies go 1e-6 beyond rest: rounding moved their turn by 2 %."""
    zeta, push = single(0.9751, 0.9751, 0.9586706757545471), single(1e4, 0.5, 4693.314208945532)
    hit = pushed(given_ratio(zeta, "tension"), 1.0, push)
    # The third goes 2.5e-5 beyond rest, and the time of its turn was off by 1.2e-3.
    flagged = jc.Status.NOT_CONVERGED
    assert hit.status.tolist() == [flagged, jc.Status.SETTLED, flagged]
    assert hit.compression_time[1] == pytest.approx(1.96927515, rel=DURATION)
    # Here they go 7e-9 beyond rest, and the time of the turn was off by 9e-7.
    law = jc.KuwabaraKono(A=np.array([1.9724609008794347]), tension=False)
    hit = pushed(law, 1.0, np.array([9083.721070343718]))
    assert hit.status.tolist() == [jc.Status.NOT_CONVERGED]


def test_the_phase_method_counts_the_error_of_a_short_way_in():
    """Its estimate was that of the whole duration, a hundred times as long."""
    law = jc.Damped(alpha=single(109.12004, 112.98866))
    contact = jc.Contact(1.0, 1.0, single(2.8330388, 2.6941454))
    hit = impacts(law, contact, method="phase")
    exact = impacts(law, contact, method="exact").compression_time
    close = np.abs(hit.compression_time / exact - 1) <= DURATION
    assert (close | (hit.status == jc.Status.NOT_CONVERGED)).all()


@pytest.mark.slow(reason="derivatives by an exponent that is traced")
def test_derivatives_by_a_traced_exponent():
    """Values at n = 1 are smooth for long steps, but not their slopes by n, which hold log(x)."""

    def outcome(n):
        contact = jc.Contact(1.0, 1.0, n)
        how = jc.Event(rtol=1e-11)
        law = given_ratio(jnp.array(0.1), "clamped")
        hit = jc.impact(law, contact, 1.0, method=how, external_force=jnp.array(-1e-4))
        return hit.restitution, hit.duration

    _, (e, duration) = jax.jvp(outcome, (jnp.array(1.0),), (jnp.array(1.0),))
    # Differences of order six of the oracle, with steps of 2e-3 and 1e-4. Measured 4e-13.
    assert e == pytest.approx(-7.608526760e-6, abs=1e-11)
    assert duration == pytest.approx(0.303636830147, rel=1e-9)
