"""The path of an impact, against its law, scipy, and the energy balance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.test_impact.support import UNIT, both_jacobians, finite

# At the default rtol of 1e-9, in units of the largest value: measured 8e-10 for the energy, 4e-10
# against scipy.
BALANCE, SAMPLE = 1e-8, 1e-8
CONTACT = jc.Contact(0.7, 3e8)
MASS, STIFFNESS, SPEED = 0.7, 3e8, 1.3
HU_GUO = jc.HuGuo(e=0.5)
LAWS = {
    "hu_guo": (HU_GUO, lambda x, v: x**1.5 * (1 + 1.5 * v / SPEED)),
    "kuwabara_kono": (jc.KuwabaraKono(A=4e-6), lambda x, v: x**1.5 + 6e-6 * np.sqrt(x) * v),
}
"""Laws, and their forces over K by hand."""


@pytest.fixture(scope="module")
def paths():
    return {name: jc.trajectory(law, CONTACT, SPEED) for name, (law, _) in LAWS.items()}


@pytest.mark.parametrize("name", LAWS)
def test_the_path_of_an_impact(paths, name):
    path, by_hand = paths[name], LAWS[name][1]
    t, x, v = map(np.asarray, (path.time, path.indentation, path.velocity))
    assert path.status == jc.Status.SEPARATED and finite(path)
    assert t.shape == x.shape == v.shape == path.force.shape == (200,)
    # It spans the contact uniformly.
    assert t[0] == 0 and x[0] == 0 and v[0] == SPEED
    step = t[1] - t[0]
    assert np.ptp(np.diff(t)) <= 1e-12 * t[-1]
    assert (x >= 0).all() and (x[1:-1] > 0).all() and x[-1] <= SAMPLE * x.max()
    # Energy is kept.
    energy, initial = path.energy, 0.5 * MASS * SPEED**2
    assert np.abs(energy.total / initial - 1).max() <= BALANCE
    assert (energy.external == 0).all() and (energy.elastic >= 0).all()
    assert (np.diff(energy.dissipated) >= -BALANCE * initial).all()
    # The force is the law's, and the velocity the rate of the indentation. Fourth order, reduced
    # by δ^(3/2) next to touch and separation: measured 1e-7.
    force = STIFFNESS * by_hand(x, v)
    assert np.allclose(path.force, force, rtol=1e-12, atol=1e-12 * np.abs(force).max())
    rate = (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * step)
    assert np.abs(rate - v[2:-2])[5:-5].max() / SPEED <= 1e-6

    def motion(_, y):
        return [y[1], -STIFFNESS / MASS * by_hand(max(y[0], 0.0), y[1])]

    how = {"method": "DOP853", "t_eval": t, "rtol": 1e-12, "atol": 1e-16}
    by_scipy = solve_ivp(motion, (0, t[-1]), [0.0, SPEED], **how).y
    assert np.abs(x - by_scipy[0]).max() / x.max() <= SAMPLE
    assert np.abs(v - by_scipy[1]).max() / SPEED <= SAMPLE


# At rtol 1e-11 and a step of 1e-5: measured 2.2e-6, the noise of 1e-11 over the step.
DIFFERENCE, STEP = 1e-5, 1e-5


@pytest.mark.slow(reason="derivatives of all samples by every method")
@pytest.mark.parametrize("name", ["kuwabara_kono", "hu_guo"])
def test_derivatives_of_samples(name):
    """Of time, indentation, velocity and force, by the law's parameter and the speed."""

    def samples(p):
        law = jc.HuGuo(e=p[0]) if name == "hu_guo" else jc.KuwabaraKono(A=p[0] * 4e-6)
        path = jc.trajectory(law, CONTACT, p[1], samples=8, method=jc.Event(rtol=1e-11))
        units = (1e-3, 1e-3, 1.0, 1e4)
        parts = (path.time, path.indentation, path.velocity, path.force)
        return jnp.stack([part / unit for part, unit in zip(parts, units, strict=True)])

    at = jnp.array([0.5 if name == "hu_guo" else 1.0, SPEED])
    points = [
        at,
        *(at + step for step in STEP * jnp.eye(2)),
        *(at - step for step in STEP * jnp.eye(2)),
    ]
    values, forward, reverse = jax.vmap(lambda p: both_jacobians(samples, p))(jnp.stack(points))
    assert finite((values, forward, reverse))
    assert np.allclose(forward[0], reverse[0], rtol=1e-10, atol=1e-10)
    difference = np.moveaxis(np.asarray(values[1:3] - values[3:5]) / (2 * STEP), 0, -1)
    # Like √δ at separation: the quotient of Kuwabara and Kono's last force consists of rounding
    # errors.
    difference[3, -1], forward = 0, forward.at[:, 3, -1].set(0)
    error = np.abs(forward[0] - difference).max()
    assert error <= DIFFERENCE * np.abs(difference).max()


def test_batches_and_bad_lanes(paths):
    law = jc.HuGuo(e=jnp.array([[0.5], [1.0], [-1.0]]))
    path = jc.trajectory(law, CONTACT, jnp.array([1.0, SPEED, np.nan, 2.0]))
    assert path.indentation.shape == path.energy.elastic.shape == (3, 4, 200)
    want = np.zeros((3, 4), int)
    want[2], want[:, 2] = jc.Status.INVALID_INPUT, jc.Status.INVALID_INPUT
    assert (path.status == want).all()
    assert np.isnan(path.time[want > 0]).all() and np.isfinite(path.time[want == 0]).all()
    assert (np.asarray(path.energy.dissipated)[1, want[1] == 0] == 0).all()
    alone = paths["hu_guo"]
    # In a batch the adaptive solve rounds, and therefore steps, differently.
    scale = float(alone.indentation.max())
    assert np.abs(path.indentation[0, 1] - alone.indentation).max() <= SAMPLE * scale


def test_a_bad_lane_spoils_no_derivative():
    def total(mass):
        path = jc.trajectory(HU_GUO, jc.Contact(mass, 3e8), jnp.array([1.0, -1.0]), samples=5)
        return jnp.sum(path.indentation[0])

    slope = jax.grad(total)(0.7)
    assert jnp.isfinite(slope) and slope != 0


def test_gravity_and_settling():
    force = jnp.array([0.05, 0.5])
    law = jc.Damped(alpha=2.0)
    path = jc.trajectory(law, UNIT[1.5], 1.0, samples=60, external_force=force)
    assert (path.status == jnp.array([jc.Status.SEPARATED, jc.Status.SETTLED])).all()
    assert np.abs(path.energy.total - 0.5).max() <= BALANCE
    assert np.allclose(path.energy.external, force[:, None] * path.indentation, rtol=1e-14)
    # The settling one is followed to its second turn, still in contact.
    assert path.indentation[1, -1] > 0.1
    assert abs(path.velocity[1, -1]) <= SAMPLE
    assert finite((path.time, path.force))


def test_a_contact_without_tension_never_pulls():
    law = jc.KuwabaraKono(A=4e-5, tension=False)
    path = jc.trajectory(law, CONTACT, SPEED)
    assert (path.force >= 0).all() and path.force[-1] <= SAMPLE * path.force.max()
    assert path.indentation[-1] > 0
    pulling = jc.trajectory(jc.KuwabaraKono(A=4e-5), CONTACT, SPEED)
    assert pulling.force.min() < 0
