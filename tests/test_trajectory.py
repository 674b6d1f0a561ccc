"""The motion in time: against scipy on the plain equation, against `impact`, and its own books."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc

CONTACT = jc.Contact(mass=0.3, stiffness=2e7)
SPEED = 1.7
SAMPLES = 41

# The path is solved to 1e-9 of the units of the impact; measured 4e-10 at worst, the velocity of
# Kuwabara and Kono's law against scipy.
PATH = 4e-9
# Summed along the path; measured 9e-10.
ENERGY = 4e-9
# The force is evaluated at the sampled state: rounding of two ways to write it, measured 1.2e-15.
ROUNDING = 1e-13
# One difference quotient at h = 1e-5 of a path at rtol 1e-11; measured 1.4e-8.
DIFFERENCE = 2e-7

LAWS = {
    "hu_guo": jc.HuGuo(e=0.5),
    "kuwabara_kono": jc.KuwabaraKono(A=3e-5),
    "thornton": jc.Thornton(e=0.6),
    "jankowski": jc.Jankowski(e=0.6),
}


@pytest.fixture(scope="module")
def paths():
    return {name: jc.trajectory(law, CONTACT, SPEED, samples=SAMPLES) for name, law in LAWS.items()}


def by_scipy(law, times):
    """x and v at the times, from the plain equation of motion."""
    force = jax.jit(lambda x, v: law.force(x, v, CONTACT, SPEED))

    def rate(t, y):
        return (y[1], -float(force(max(y[0], 0.0), y[1])) / float(CONTACT.mass))

    end = float(times[-1])
    # The step is bounded: the force has no second derivative at touch, where an error estimate
    # can be too hopeful.
    solution = solve_ivp(
        rate, (0, end), (0.0, SPEED), "DOP853", np.asarray(times), rtol=1e-11, atol=1e-16,
        max_step=end / 100,
    )  # fmt: skip
    return solution.y


@pytest.mark.parametrize("name", ["hu_guo", "kuwabara_kono"])
def test_against_an_independent_solver(paths, name):
    path = paths[name]
    x, v = by_scipy(LAWS[name], path.time)
    assert np.max(np.abs(path.indentation - x)) <= PATH * np.max(x)
    assert np.max(np.abs(path.velocity - v)) <= PATH * SPEED


@pytest.mark.parametrize("name", LAWS)
def test_from_touch_to_separation_as_impact_has_it(paths, name):
    path, hit = paths[name], jc.impact(LAWS[name], CONTACT, SPEED)
    assert int(path.status) == jc.Status.SEPARATED
    assert path.time[0] == 0
    assert path.indentation[0] == 0
    assert path.velocity[0] == pytest.approx(SPEED, rel=ROUNDING)
    assert path.time[-1] == pytest.approx(float(hit.duration), rel=PATH)
    assert path.velocity[-1] == pytest.approx(-float(hit.rebound_velocity), rel=PATH)
    steps = np.diff(path.time)
    assert np.ptp(steps) <= ROUNDING * float(path.time[-1])
    # Samples stay below the extrema and come near them.
    for found, most in ((path.indentation, hit.max_indentation), (path.force, hit.max_force)):
        assert 0.99 * most < jnp.max(found) <= most * (1 + PATH)


@pytest.mark.parametrize("name", LAWS)
def test_force_and_energy(paths, name):
    path = paths[name]
    force = LAWS[name].force(path.indentation, path.velocity, CONTACT, SPEED)
    assert np.max(np.abs(path.force - force)) <= ROUNDING * np.max(force)
    total = 0.5 * float(CONTACT.mass) * SPEED**2
    assert np.max(np.abs(path.energy.total - total)) <= ENERGY * total
    assert np.all(np.diff(path.energy.dissipated) >= -ENERGY * total)
    assert np.all(path.energy.external == 0)
    kinetic = 0.5 * CONTACT.mass * jnp.square(path.velocity)
    np.testing.assert_allclose(path.energy.kinetic, kinetic, rtol=ROUNDING)
    elastic = 0.4 * CONTACT.stiffness * np.asarray(path.indentation) ** 2.5
    np.testing.assert_allclose(path.energy.elastic, elastic, rtol=1e-12, atol=ROUNDING * total)


def test_derivatives_of_a_sample_in_both_modes():
    law = jc.HuGuo(e=0.5)

    def middle(e, v):
        path = jc.trajectory(jc.HuGuo(e=e), CONTACT, v, samples=7, rtol=1e-11)
        return jnp.stack([path.indentation[3], path.velocity[5], path.force[2], path.time[4]])

    point = (law.e, jnp.asarray(SPEED))
    forward = jax.jit(jax.jacfwd(middle, argnums=(0, 1)))(*point)
    reverse = jax.jit(jax.jacrev(middle, argnums=(0, 1)))(*point)
    value = jax.jit(middle)
    for k, (one, other) in enumerate(zip(forward, reverse, strict=True)):
        np.testing.assert_allclose(one, other, rtol=1e-10)
        h = 1e-5
        up = value(*(p + h * (j == k) for j, p in enumerate(point)))
        down = value(*(p - h * (j == k) for j, p in enumerate(point)))
        np.testing.assert_allclose(one, (up - down) / (2 * h), rtol=DIFFERENCE)


def test_a_batch_with_a_bad_lane():
    speeds = jnp.array([SPEED, -1.0, SPEED])
    path = jc.trajectory(jc.HuGuo(e=jnp.array([[0.5], [0.9]])), CONTACT, speeds, samples=5)
    assert path.time.shape == path.energy.total.shape == (2, 3, 5)
    assert path.status.tolist() == [[0, 3, 0]] * 2
    assert np.all(np.isnan(path.velocity[:, 1]))
    np.testing.assert_array_equal(path.velocity[:, 0], path.velocity[:, 2])


def test_a_ball_that_stays_down():
    """Under its weight a slow ball settles; it is followed to its second turn."""
    weight = 9.81 * CONTACT.mass
    path = jc.trajectory(jc.HuGuo(e=0.5), CONTACT, 1e-2, samples=SAMPLES, external_force=weight)
    assert int(path.status) == jc.Status.SETTLED
    assert path.indentation[-1] > 0
    assert abs(path.velocity[-1]) <= PATH * 1e-2
    np.testing.assert_allclose(path.energy.external, weight * path.indentation, rtol=1e-12)
    total = 0.5 * float(CONTACT.mass) * 1e-4
    assert np.max(np.abs(path.energy.total - total)) <= 10 * ENERGY * total


@pytest.mark.parametrize("samples", [1, 0, 2.5])
def test_too_few_samples(samples):
    with pytest.raises(ValueError, match="`samples` must be a whole number of at least 2, but is"):
        jc.trajectory(jc.HuGuo(e=0.5), CONTACT, SPEED, samples=samples)
