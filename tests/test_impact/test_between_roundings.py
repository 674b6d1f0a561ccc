"""Events, turns and largest forces that are closer together than floats can resolve.

Truths are those of the stability map's oracle, in 80 bits.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import given_ratio

# Bounds of README for float32; measured 1e-6 and 3e-5 here.
RESTITUTION, DURATION = 1e-5, 1e-4


def single(*numbers):
    return jnp.asarray(np.array(numbers, np.float32))


LANES = 3  # at least, in every call, so that those of one law and exponent share a program


def pushed(law, n, push):
    """Impacts in scaled units, in the precision of the push."""
    asked, lanes = push.size, max(push.size, LANES)
    law, push = jax.tree.map(lambda x: jnp.resize(x, lanes), (law, push))
    one = jnp.ones_like(push)
    hit = jc.impact(law, jc.Contact(one, one, n), one, external_force=push)
    return jax.tree.map(lambda x: x[:asked], hit)


def test_the_turn_under_a_strong_pull():
    """A search that stands on its root was sent to the middle of its bracket, and left there."""
    zeta, pull = 0.68257, -1e4
    hit = pushed(given_ratio(jnp.array([zeta]), "tension"), 1.0, jnp.array([pull]))
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
    push = jnp.asarray(np.linspace(0.014, 0.0149, 64, dtype=np.float32))
    law = jc.KuwabaraKono(A=jnp.full(64, np.float32(2.5741088)), tension=False)
    # A force that returns before x = 0 belongs to the same contact, which here settles.
    assert (pushed(law, 2.0, push).status == jc.Status.SETTLED).all()
    # A sampled motion does not follow the return. For pushes below 0.01464 it therefore shows
    # whether the end of the force was found.
    one = jnp.ones_like(push)
    contact = jc.Contact(one, one, 2.0)
    status = jc.trajectory(law, contact, one, samples=2, external_force=push).status
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
    law = jc.KuwabaraKono(A=jnp.array([1.9724609008794347]), tension=False)
    hit = pushed(law, 1.0, jnp.array([9083.721070343718]))
    assert hit.status.tolist() == [jc.Status.NOT_CONVERGED]


def test_the_phase_method_counts_the_error_of_a_short_way_in():
    """Its estimate was that of the whole duration, a hundred times as long."""
    law = jc.Damped(alpha=single(109.12004, 112.98866))
    contact = jc.Contact(1.0, 1.0, single(2.8330388, 2.6941454))
    hit = jc.impact(law, contact, 1.0, method="phase")
    exact = jc.impact(law, contact, 1.0, method="exact").compression_time
    close = np.abs(np.asarray(hit.compression_time / exact) - 1) <= DURATION
    assert (close | np.asarray(hit.status == jc.Status.NOT_CONVERGED)).all()


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


def test_a_force_that_was_not_followed_to_its_largest_is_flagged():
    """A creep to rest was known from its speed, and the push returned for the largest force."""
    law, contact = given_ratio(jnp.array(500.0), "clamped"), jc.Contact(1.0, 1.0, 3.0)
    force = {"external_force": jnp.array(1e4)}
    hit = jc.impact(law, contact, 1.0, method=jc.Event(max_steps=40), throw=False, **force)
    assert hit.status == jc.Status.NOT_CONVERGED
    hit = jc.impact(law, contact, 1.0, method="event", **force)
    assert hit.status == jc.Status.SETTLED
    assert hit.max_force == pytest.approx(13994.75, rel=1e-5)
