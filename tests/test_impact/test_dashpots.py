"""Dashpots given by their coefficient, against Newton's equations solved by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.dashpot import MASS, SPEED, STIFFNESS, followed, truth
from tests.test_impact.support import impacts

LENGTH = (MASS * SPEED**2 / STIFFNESS) ** 0.4
CONTACT = jc.Contact(MASS, STIFFNESS)

TRUTH = 2e-9  # an event solve at 1e-9 of restitution: measured 4e-10
DIFFERENCE = 2e-6  # central differences with step 1e-4 of SciPy's answers: measured 1e-7

COMES_BACK = 3e-5
"""The force of STEP that comes back after it vanished, at d = 0.07 X: measured 7e-6."""


# Coefficients relative to m v0/X, and d relative to X; e from 0.93 to 0.3. The force does not
# return.
COEFFICIENTS = np.array([0.05, 0.3, 0.9, 0.3, 0.9]) * MASS * SPEED / LENGTH
DEPTHS = np.array([1e-3, 1e-3, 1.0, 2.0, 4.0]) * LENGTH


# A force that returns: it and x vanish together in the end, where only x has a slope. Solves that
# took the force for the end were off by up to 1e123, and not flagged.
RETURNING = np.array([0.03, 0.2, 0.7, 0.3, 0.5]) * MASS * SPEED / LENGTH
EARLY = np.array([0.01348, 0.05, 0.03, 0.05, 0.03]) * LENGTH
STEPS = np.append(COEFFICIENTS, RETURNING), np.append(DEPTHS, EARLY)


def test_restitution_and_force_are_newtons():
    dashpot = impacts(jc.LinearDashpot(c=COEFFICIENTS[:3]), CONTACT, SPEED)
    expected = np.array([truth(c, None, SPEED) for c in COEFFICIENTS[:3]])
    np.testing.assert_allclose(dashpot.restitution, expected[:, 0], rtol=TRUTH)
    np.testing.assert_allclose(dashpot.max_force, expected[:, 2], rtol=1e-7)  # of 20,001 samples
    # Largest at touch.
    assert dashpot.max_force[2] == pytest.approx(COEFFICIENTS[2] * SPEED, rel=1e-12)
    step = impacts(jc.StepDamping(*STEPS), CONTACT, SPEED)
    expected = np.array([truth(c, d, SPEED) for c, d in zip(*STEPS, strict=True)])
    np.testing.assert_allclose(step.restitution[:5], expected[:5, 0], rtol=TRUTH)
    np.testing.assert_allclose(step.restitution, expected[:, 0], rtol=COMES_BACK)
    np.testing.assert_allclose(step.max_force, expected[:, 2], rtol=1e-7)


def test_a_linear_spring_is_kelvin_and_voigts():
    linear = jc.Contact(MASS, 4e4, 1.0)
    for tension in (False, True):
        zeta = jc.KelvinVoigt(e=0.6, tension=tension).damping_ratio()
        law = jc.LinearDashpot(c=2 * zeta * np.sqrt(4e4 * MASS), tension=tension)
        hit = impacts(law, linear, SPEED)
        assert hit.method == "exact"
        assert hit.restitution == pytest.approx(0.6, rel=1e-14)
    assert jc.LinearDashpot(c=1.0).tension is jc.StepDamping(c_max=1.0, d=1.0).tension is False


def test_beyond_its_step_a_cubic_is_not_evaluated():
    """It would overflow in single precision; values and slopes at its ends are in test_formulas."""

    def force(x, c_max, depth):
        return jc.StepDamping(c_max=c_max, d=depth).force(x, 0.7, jc.Contact(1.0, 1e8, 2.0), 1.0)

    tiny = jax.jit(jax.grad(force, (0, 1, 2)))(*np.float32([1.0, 5.0, 1e-30]))
    assert all(np.isfinite(s) for s in tiny) and tiny[1] == jnp.float32(0.7)


def test_the_kink_of_a_restitution_that_is_bounded():
    """At the kink derivatives are those of the power, above it they are zero."""

    def e(a, power, v):
        return jc.Bridges(a=a, power=power, reference=1.0).restitution_at(v)

    slopes = jax.jit(jax.vmap(jax.grad(e, (0, 1, 2))))
    # The last power does not overflow: v^-p is 1e400 there.
    places = np.transpose([[0.8, 0.25, 1], [1, 0.25, 1], [2, 0.25, 1], [1, 100, 1e-4]])
    falling, kink, *elastic = np.transpose(slopes(*places))
    np.testing.assert_allclose(falling, [1, 0, -0.2], atol=1e-15)
    np.testing.assert_allclose(kink, [1, 0, -0.25], atol=1e-15)
    np.testing.assert_array_equal(elastic, 0)
    # The ice of Bridges, Hatzes and Lin: e = 0.32 (v in cm/s)^-0.234.
    ice = jc.Bridges(a=1.0, power=0.234, reference=7.7e-5)
    assert ice.restitution_at(0.01) == pytest.approx(0.32, abs=5e-3)
    assert jc.restitution(ice, velocity=jnp.array([1e-5, 0.03])) == pytest.approx(
        [1.0, float(ice.restitution_at(0.03))], rel=1e-14
    )


class Impact(jc.AbstractLaw):
    """Adams' force as a user writes it down, without the clamp."""

    c_max: jax.Array
    d: float = 1e-4
    tension = False

    def force(self, indentation, velocity, contact, impact_velocity):
        part = jnp.clip(indentation / self.d, 0, 1)
        damping = self.c_max * part**2 * (3 - 2 * part)
        return contact.stiffness * jc.power(indentation, contact.exponent) + damping * velocity


SPEEDS = np.array([1.0, 2.0, 3.0, 5.0])


def test_a_clamp_decides_how_much_a_coefficient_takes():
    """The force of IMPACT with c_max = 798: a law that pulls needs a smaller one."""
    e = [truth(798.0, 1e-4, v)[0] for v in SPEEDS]

    def restitution(law, c_max, **how):
        return impacts(law(c_max, 1e-4, **how), CONTACT, SPEEDS).restitution

    # A relative error of c_max changes e by a third of it.
    for law in (jc.StepDamping, Impact):
        np.testing.assert_allclose(restitution(law, 798.0), e, rtol=COMES_BACK / 3)
    # With a pull less damping takes as much: at 0.9 of it e has fallen too far.
    assert np.all(restitution(Impact, 0.9 * 798.0, tension=True) < e)


class Clamped(Impact):
    """The same with its clamp, which opens at the depth `gap` on the way out."""

    gap: jax.Array | float = 0.0

    def force(self, indentation, velocity, contact, impact_velocity):
        force = super().force(indentation, velocity, contact, impact_velocity)
        open_ = (velocity < 0) & (indentation < self.gap)
        return jnp.where(open_, 0, jnp.maximum(force, 0))


SHARP = 1e-8  # an event solve at 1e-9 that ends where a clamp begins: measured 3e-10
SHARP_32 = 1e-5  # that of an event solve in single precision: measured 4e-6


def clamped_lanes(n, kind=float):
    """Durations, speeds at δ = 0, and their derivatives along ln c; the last lane's force jumps."""
    length = (MASS * SPEED**2 / STIFFNESS) ** (1 / (n + 1))
    # Numbers of single precision, so that both precisions ask the oracle the same.
    # The first one, which does not return, is what the oracle computes again.
    share = np.array([0.9, 0.05, 0.3, 2.0, 2.0, 0.3])
    c_max = np.float32(share * MASS * SPEED / length).astype(float)
    # On a linear spring a force with a smaller d comes back for a time that the oracle may miss.
    least = 0.1 if n == 1 else 1e-3
    d = np.array([1.0, least, least, 0.15, 0.1, least]) * length
    gap = jnp.asarray([0, 0, 0, 0, 0, 0.5 * length], kind)
    contact, speed = jax.tree.map(
        lambda x: jnp.asarray(x, kind), (jc.Contact(MASS, STIFFNESS), SPEED)
    )
    contact = jc.Contact(contact.mass, contact.stiffness, n)

    def outcome(c):
        hit = jc.impact(Clamped(c, jnp.asarray(d, kind), gap=gap), contact, speed, method="event")
        return jnp.stack([hit.duration, hit.rebound_velocity]), hit.status

    c = jnp.asarray(c_max, kind)
    found, slopes, status = jax.jvp(outcome, (c,), (c,), has_aux=True)
    # A force that jumps to zero has no tangent there, which the derivative of the end requires.
    assert status.tolist() == [jc.Status.SEPARATED] * 5 + [jc.Status.NOT_CONVERGED]
    assert np.isnan(found[:, 5]).all()
    return c_max[:5], d[:5], np.asarray(found)[:, :5], np.asarray(slopes)[:, :5]


@pytest.mark.slow("single", reason="as in double precision; derivatives of an event solve")
@pytest.mark.parametrize(
    ("n", "kind", "tolerance"),
    [(1.5, float, SHARP), (1.0, float, SHARP), (1.5, "float32", SHARP_32)],
    ids=["a law's own", "linear", "single"],
)
def test_a_law_may_clamp_its_own_force(n, kind, tolerance):
    """max(0, F) ends where F does: what lies beyond has no slope, and is no contact.

    Also on a linear spring, whose equation is solved without w, and in single precision.
    """
    c, d, found, slopes = clamped_lanes(n, kind)
    h = 1e-4
    for k in range(5):
        np.testing.assert_allclose(found[:, k], followed(c[k], d[k], n), rtol=tolerance)
        ends = [followed(c[k] * s, d[k], n) for s in (1 + h, 1 - h)]
        rtol = max(DIFFERENCE, 100 * tolerance)
        # If c hardly matters, the rounding of the outcome remains: measured half of it.
        rounding = 20 * tolerance * np.abs(found[:, k]) if kind == "float32" else np.zeros(2)
        off = np.abs(slopes[:, k] - (ends[0] - ends[1]) / (2 * h))
        assert np.all(off <= rtol * np.abs(slopes[:, k]) + rounding)
