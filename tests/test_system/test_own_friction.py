"""A friction law of one's own with a state: bristles (LuGre) in a mechanism, beside SciPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import check_modes
from tests.test_system.references import DIFFERENCES, plane, restarted

MU, STIFF, DAMPED = 0.3, 2e3, 2.0
"""μ, and the bristles' stiffness in 1/m and damping in s/m, each over the normal force."""

K, RADIUS = 1e6, 0.02
CLOSE = 1e-8  # relative, at rtol 1e-10


class Bristles(jc.AbstractFriction):
    """f = -F (σ0 z + σ1 z') with z' = u - σ0 |u| z/μ, after Canudas de Wit et al. (1995)."""

    kind = "state"
    mu: jax.Array
    stiffness: float = STIFF

    @property
    def unit(self):
        return self.mu / self.stiffness

    def force_and_rate(self, normal, slip, state):
        bends = slip - self.stiffness * jnp.abs(slip) * state / self.mu
        normal = normal.reshape(normal.shape + (1,) * (slip.ndim - 1))
        return -normal * (self.stiffness * state + DAMPED * bends), bends

    def rebound(self, problem):
        raise NotImplementedError


def system(mu, axes=1):
    """A ball with the spin of a solid sphere that falls on a plane; q = (x, height, Rθ)."""

    def slip(t, q, v, args):
        u = v[0] + v[2]
        return u[None] if axes == 1 else jnp.stack([u, 0 * u])[None]

    return jc.System(
        lambda t, q, args: jnp.diag(jnp.array([1.0, 1.0, 0.4])),
        lambda t, q, v, args: jnp.array([0.0, -9.8, 0.0]),
        plane,
        law=jc.HuGuo(e=0.7),
        stiffness=K,
        friction=Bristles(mu),
        slip=slip,
    )


def run(mu, speed, axes=1, rtol=1e-10):
    start = {"position": [0.0, 1e-3, 0.0], "velocity": jnp.stack([speed, -1.0, 0.0])}
    return jc.simulate(system(mu, axes), 0.25, **start, rtol=rtol, max_impacts=8, v0="touch")


def reference(mu, speed):
    """Return velocities at 0.25 s by DOP853."""

    def bristles(normal, u, z):
        bends = u - STIFF * abs(u) * z / mu
        return -normal * (STIFF * z + DAMPED * bends), bends

    alpha = float(jc.HuGuo(e=0.7).damping_factor(jc.Contact(1.0, K), 1.0))
    start = np.array([0.0, 1e-3, 0.0]), np.array([speed, -1.0, 0.0])
    _, _, end = restarted(
        lambda t, q: np.diag([1.0, 1.0, 0.4]), lambda t, q, v: np.array([0.0, -9.8, 0.0]),
        lambda t, q: q[1:2], start, 0.25, K, alpha,
        slip=lambda t, q, v: v[0] + v[2], bristles=bristles,
    )  # fmt: skip
    return end[3:6]


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_bristles_are_those_of_scipy(speed):
    found = run(MU, jnp.asarray(speed))
    assert len(found.contacts) == 2
    np.testing.assert_allclose(found.final.velocity, reference(MU, speed), rtol=CLOSE)


def test_both_modes_are_differences():
    # The slope of |u| jumps where the slip turns, which is no event: shorter steps.
    def outcome(vector):
        return run(vector[0], vector[1], rtol=1e-12).final.velocity, None

    check_modes(jax.jit(outcome), np.array([MU, 3.0]), np.array([MU, 3.0]), 2e-5, DIFFERENCES)


def test_two_axes_of_slip_hold_what_one_holds():
    one, two = (run(MU, jnp.asarray(3.0), axes).final.velocity for axes in (1, 2))
    np.testing.assert_allclose(two, one, rtol=CLOSE)
