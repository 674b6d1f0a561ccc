"""A user-defined form works everywhere: the linear dashpot."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._impact import landing, method_of, problem_of
from tests.oracle import bouncing_ball
from tests.oracle.stored import stored
from tests.test_impact.support import UNIT, both_jacobians, impacts

# Closed forms: rounding. Event solves at rtol 1e-9: measured 3.3e-9. Phase method: its promise.
FORMULA, EVENT, PHASE = 1e-13, 1e-8, 1e-6
# Derivatives of event solves at rtol 1e-11: measured 3e-11. Without compiler optimisation the steps
# round differently: 1.6e-8.
SLOPE = 1e-7


class DashpotForm(jc.AbstractForm):
    """f = x + 2ζ v, for n = 1 and ζ < 1/2: x = e^(-ζt) sin(ωt)/ω, ω² = 1-ζ²."""

    zeta: jax.Array
    tension: bool = eqx.field(static=True)

    def force(self, x, v, n, compressing):
        return x + 2 * self.zeta * v

    def restitution(self):
        return jnp.exp(-jnp.pi * self.zeta / self._omega())

    def solve(self, n):
        zeta, omega = self.zeta, self._omega()
        turn = jnp.arccos(zeta) / omega
        # f' = 0 where tan(ωt) = ω (1-4ζ²)/(ζ (3-4ζ²)); f = e^(-ζt) there.
        peak = jnp.arctan2(omega * (1 - 4 * zeta**2), zeta * (3 - 4 * zeta**2)) / omega
        return jc.ScaledImpact(
            restitution=self.restitution(),
            duration=jnp.pi / omega,
            compression_time=turn,
            max_indentation=jnp.exp(-zeta * turn),
            max_force=jnp.exp(-zeta * peak),
        )

    def _omega(self):
        return jnp.sqrt(1 - self.zeta**2)


class Dashpot(jc.AbstractLaw):
    """F = K δ + c δ'."""

    c: jax.Array = eqx.field(converter=jnp.asarray)
    tension = True
    exponents = (1.0,)

    def force(self, indentation, velocity, contact, impact_velocity):
        return contact.stiffness * indentation + self.c * velocity

    def form(self, contact, scale):
        zeta = self.c / (2 * jnp.sqrt(contact.stiffness * contact.mass))
        return DashpotForm(zeta=zeta, tension=self.tension)


class Plain(Dashpot):
    """The same without a form of its own."""

    def form(self, contact, scale):
        return jc.AbstractLaw.form(self, contact, scale)


MASS, STIFFNESS, SPEED = 0.3, 2e5, 1.7
CONTACT = jc.Contact(MASS, STIFFNESS, 1.0)
DAMPING = np.array([0.0, 3.0, 40.0, 150.0])


NUMBERS = ("restitution", "duration", "compression_time", "max_indentation", "max_force")


def same(c, numpy=np):
    """The law of the package with this damping."""
    zeta = c / (2 * np.sqrt(STIFFNESS * MASS))
    return jc.KelvinVoigt(e=numpy.exp(-np.pi * zeta / numpy.sqrt(1 - zeta**2)))


def known(c):
    hit = impacts(same(c), CONTACT, SPEED)
    return {name: getattr(hit, name) for name in NUMBERS}


@pytest.mark.parametrize(
    ("law", "method", "used", "tolerance"),
    [
        (Dashpot, "auto", "exact", FORMULA),
        (Dashpot, "event", "event", EVENT),
        (Dashpot, "phase", "phase", PHASE),
        (Plain, "auto", "event", EVENT),
    ],
)
def test_impact(law, method, used, tolerance):
    hit = impacts(law(c=DAMPING), CONTACT, SPEED, method=method)
    assert hit.method == used and (hit.status == jc.Status.SEPARATED).all()
    for name, expected in known(DAMPING).items():
        np.testing.assert_allclose(getattr(hit, name), expected, rtol=tolerance, err_msg=name)


@stored()
def by_scipy(c, d, weight):
    """The duration, when the bodies are back at x = 0, and how fast, with the force of Adams."""

    def force(depth, rate, v0):
        s = min(depth / d, 1.0)
        return depth**1.5 + c * s * s * (3 - 2 * s) * rate

    # The first forces return at a thousandth of the depth at which they vanished.
    finest = 1e-4 if d < 0.2 else 0.02
    return bouncing_ball.contact(force, 1.0, weight, 1.0, 3.0, finest=finest)


def test_a_clamped_force_that_returns():
    """Damping that falls faster than the spring: the force vanishes, and returns.

    The contact ends where its force vanishes and stays away until δ = 0.
    """
    c, d = np.array([0.3, 2.0, 1.0, 3.0]), np.array([0.1, 0.1, 0.5, 0.5])
    law, push = jc.StepDamping(c_max=c, d=d), 0.003
    found = landing(problem_of(law, UNIT[1.5], 1.0, push), method_of("event"))
    assert (found.impact.status == jc.Status.SEPARATED).all()
    duration, back, speed = np.transpose([by_scipy(*x, push) for x in zip(c, d, strict=True)])
    e, end = np.asarray(found.impact.restitution), np.asarray(found.end_indentation)
    np.testing.assert_allclose(found.impact.duration, duration, rtol=EVENT)
    np.testing.assert_allclose(np.sqrt(e**2 - 2 * push * end), speed, rtol=EVENT)
    assert np.all(duration == back) and np.all(np.abs(end) < 1e-12)


SOLVED = 1e-8  # the duration of an event solve at its default tolerance beside π √(m/K)


class Pushing(Dashpot):
    """Its form says that it only pushes, and not where that begins."""

    tension = False


def test_a_law_that_gives_energy_is_flagged():
    """A damper of the wrong sign; its neighbours and a law without damping are as they were."""
    c, flagged = np.array([-40.0, 0.0, 40.0]), [jc.Status.GAINED, *[jc.Status.SEPARATED] * 2]
    for law in (Plain(c=c), Dashpot(c=c)):
        hit = impacts(law, CONTACT, SPEED)
        assert hit.status.tolist() == flagged
        assert hit.restitution[0] > 1.2
    # Without damping a force without tension vanishes with the indentation: two events coincide.
    pushes = impacts(Pushing(c=c), CONTACT, SPEED, method="event")
    assert pushes.status.tolist() == flagged
    half = np.pi * np.sqrt(CONTACT.mass / CONTACT.stiffness)
    np.testing.assert_allclose(pushes.duration[1], half, rtol=SOLVED)
    path = jc.trajectory(Plain(c=c), CONTACT, SPEED, samples=5)
    assert path.status.tolist() == flagged
    # A push also supplies energy, but not to a ball that is back at δ = 0.
    landed = landing(problem_of(Plain(c=c), CONTACT, SPEED, 1.0), method_of("event"))
    assert landed.impact.status.tolist() == flagged
    assert (impacts(Plain(c=c), CONTACT, SPEED, external_force=1.0).status == 0).all()


def test_restitution_alone():
    e = known(DAMPING)["restitution"]
    np.testing.assert_allclose(jc.restitution(Dashpot(c=DAMPING), CONTACT), e, rtol=FORMULA)
    np.testing.assert_allclose(jc.restitution(Plain(c=DAMPING), CONTACT, SPEED), e, rtol=EVENT)
    with pytest.raises(ValueError, match="`velocity` is needed for `Plain`"):
        jc.restitution(Plain(c=DAMPING), CONTACT)
    with pytest.raises(ValueError, match="`velocity` is needed for `Dashpot` by method 'event'"):
        jc.restitution(Dashpot(c=DAMPING), CONTACT, method="event")


def test_what_rests_on_it():
    expected = known(40.0)
    for law in (Dashpot, Plain):
        path = jc.trajectory(law(c=40.0), CONTACT, SPEED, samples=20)
        np.testing.assert_allclose(path.time[-1], expected["duration"], rtol=EVENT)
        np.testing.assert_allclose(-path.velocity[-1] / SPEED, expected["restitution"], rtol=EVENT)
        np.testing.assert_allclose(path.energy.total, MASS * SPEED**2 / 2, rtol=EVENT)
    # e is the same at every speed, which `bounce` uses.
    run = jc.bounce(Dashpot(c=40.0), CONTACT, 0.5, bounces=3, rest_velocity=1e-3)
    assert run.remaining_flight is not None
    np.testing.assert_allclose(run.restitution, expected["restitution"], rtol=FORMULA)


def test_derivatives():
    def outcome(law, method="exact"):
        hit = jc.impact(law, CONTACT, SPEED, method=method)
        return jnp.stack([hit.restitution, hit.duration])

    wanted = jax.jit(jax.jacfwd(lambda c: outcome(same(c, jnp))))(40.0)
    for method, tolerance in (("exact", FORMULA), (jc.Event(rtol=1e-11), SLOPE)):
        both = both_jacobians(lambda c, m=method: outcome(Dashpot(c[0]), m), jnp.array([40.0]))
        for slope in both[1:]:
            np.testing.assert_allclose(slope[:, 0], wanted, rtol=tolerance)
