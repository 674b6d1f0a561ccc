"""A user's own friction law, that of docs/friction.md, by public names alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

ROUNDING = 1e-12  # relative; exponentials and logarithms of numbers near one
SAMPLED = 5e-3  # relative; friction ends between two of 401 samples where the contact sticks

LAW = jc.HuGuo(e=0.8)
CONTACT = jc.Contact(mass=0.05, stiffness=1e7, exponent=1.5)
VELOCITY = 2.0
MOBILITY = 3.5


class GrowingFriction(jc.AbstractFriction):
    """u' = max(0, (u0 + μ/c) exp(-λ c (1+e)) - μ/c), with c in s/m."""

    mu: jax.Array
    c: jax.Array

    def after(self, problem: jc.Tangential, impulse: jax.Array) -> jax.Array:
        c = self.c * problem.speed
        left = (problem.slip + self.mu / c) * jnp.exp(-problem.mobility * c * impulse)
        return jnp.maximum(left - self.mu / c, 0)

    def rebound(self, problem: jc.Tangential) -> jc.TangentialOutcome:
        slip = self.after(problem, 1 + problem.restitution)
        return jc.TangentialOutcome(slip=slip, slid=slip > 0)

    def along(self, problem, path):
        slip = self.after(problem, 1 - path.velocity)
        strength = self.mu + self.c * problem.speed * slip
        return slip, jnp.where(slip > 0, strength * path.force, 0)


MU, C = 0.05, 0.02
OWN = GrowingFriction(mu=jnp.asarray(MU), c=jnp.asarray(C))
ALONG = np.array([-3.0, 0.4, 0.7, 1.2, 3.0, 5.0])


def needed(before, after):
    """The normal impulse per mass in m/s that takes a slip from one speed to another."""
    return np.log((MU + C * before) / (MU + C * after)) / (MOBILITY * C)


def hits():
    hit = jc.oblique_impact(LAW, CONTACT, VELOCITY, ALONG, friction=OWN)
    return jax.tree.map(np.asarray, hit)


def test_the_slip_needs_the_impulse_of_the_impact():
    hit = hits()
    impulse = VELOCITY * (1 + hit.normal.restitution)
    before, after = np.abs(ALONG), np.abs(hit.slip_velocity)
    slides = needed(before, 0.0) > impulse
    assert list(slides) == [True, False, False, True, True, True]
    assert needed(before, after)[slides] == pytest.approx(impulse[slides], rel=ROUNDING)
    assert not after[~slides].any()
    assert np.array_equal(hit.slip == int(jc.Slip.SLID), slides)
    # Newton's law for the centres: (λ-1)/λ of the slip comes from spin.
    lost = (before - after) / MOBILITY * np.sign(ALONG)
    assert hit.tangential_velocity == pytest.approx(ALONG - lost, rel=ROUNDING)


def test_its_derivative_is_that_of_the_closed_form():
    def slip(mu, c, along):
        friction = GrowingFriction(mu, c)
        return jc.oblique_impact(LAW, CONTACT, VELOCITY, along, friction=friction).slip_velocity

    after = float(slip(OWN.mu, OWN.c, 3.0))
    by_mu, by_along = jax.jit(jax.grad(slip, argnums=(0, 2)))(OWN.mu, OWN.c, 3.0)
    # From the logarithm in `needed`, whose value stays.
    first, last = MU + C * 3.0, MU + C * after
    assert by_along == pytest.approx(last / first, rel=ROUNDING)
    assert by_mu == pytest.approx((last / first - 1) / C, rel=ROUNDING)


def test_the_impulse_over_time_is_that_of_the_outcome():
    path = jc.oblique_trajectory(LAW, CONTACT, VELOCITY, ALONG, friction=OWN, samples=401)
    path, hit = jax.tree.map(np.asarray, path), hits()
    assert path.slip_velocity[:, -1] == pytest.approx(hit.slip_velocity, abs=1e-6)
    impulse = np.trapezoid(path.friction, path.time, axis=-1)
    lost = (ALONG - hit.tangential_velocity) * 0.05
    assert impulse == pytest.approx(lost, rel=SAMPLED)


def test_a_scene_takes_it():
    ball = jc.Sphere(radius=0.1, mass=0.5, position=[0.0, 0.2], velocity=[3.0, -VELOCITY])
    table = jc.Plane(point=[0.0, 0.0], normal=[0.0, 1.0])
    scene = jc.Scene([ball, table], jc.ExactRestitution(e=0.8), gravity=[0.0, 0.0], friction=OWN)
    run = jc.simulate(scene, duration=0.1, instantaneous=True)
    after = float(run.velocity[-1, 0, 0] + 0.1 * run.spin[-1, 0])
    assert needed(3.0, after) == pytest.approx(VELOCITY * 1.8, rel=ROUNDING)
