"""Derivatives of runs with friction: both modes, beside differences and formulas."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.test_impact.support import both_jacobians
from tests.test_scene.test_gradients import DIFFERENCES, both_modes, differences

FORMULA = 1e-11
"""Derivatives of the moment of rolling beside those of its formula, relative: measured 1e-14."""

SETTLING = 2e-4
"""What the swing of the normal force adds in 0.03 s to derivatives of order 1: measured 3e-5."""

GIVES = 1e-6
"""Places and speeds at rtol 1e-6 beside those at 1e-8, in m and m/s: measured 4e-8. A spring that
did not give way would leave 1e-5 m."""


def rolling(numbers):
    """The last position, velocity and spin of a ball that slides and then rolls."""
    v0, w0, mu, radius, g = numbers
    ball = jc.Sphere(radius, 0.5, jnp.stack([0.0 * v0, radius]), jnp.stack([v0, 0.0 * v0]), spin=w0)
    scene = jc.Scene(
        [ball, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.ExactRestitution(e=0.5),
        gravity=jnp.stack([0.0 * g, -g]), friction=jc.RigidCoulomb(mu),
    )  # fmt: skip
    run = jc.simulate(scene, 1.5, instantaneous=True, max_impacts=4)
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.spin[-1, 0]])


def formula(numbers):
    v0, w0, mu, radius, g = numbers
    slip = v0 + radius * w0
    begins = 2 * slip / (7 * mu * g)
    rolls = v0 - 2 / 7 * slip
    place = v0 * begins - mu * g * begins**2 / 2 + rolls * (1.5 - begins)
    return jnp.stack([place, rolls, -rolls / radius])


def test_the_moment_of_rolling_has_a_derivative():
    numbers = jnp.array([2.0, 3.0, 0.3, 0.1, 9.8])
    exact = jax.jacfwd(formula)(numbers)
    np.testing.assert_allclose(rolling(numbers), formula(numbers), rtol=1e-12)
    for found in both_modes(rolling, numbers):
        np.testing.assert_allclose(found, exact, atol=FORMULA * np.max(np.abs(exact)))


class Formula(jc.RegularizedCoulomb):
    """A law that is not known to act alike in coupled contacts, so that its formula is used."""


def meeting(numbers):
    """Two spheres in space that meet softly: the last velocities and spins."""
    x, v, w, mu, v_d, inertia, e = numbers[0:3], numbers[3:6], numbers[6:9], *numbers[9:13]
    balls = [
        jc.Sphere(0.1, 0.5, x, v, spin=w, inertia=inertia),
        jc.Sphere(0.12, 0.8, [0.5, 0.05, 0.0], [-0.5, 0.0, 0.1], spin=[3.0, 0.0, -8.0]),
    ]
    friction = Formula(mu, v_d)
    scene = jc.Scene(balls, jc.HuGuo(e=e), friction=friction, stiffness=1e7)
    run = jc.simulate(scene, 0.5, max_impacts=2, rtol=1e-9)
    return jnp.concatenate([run.velocity[-1].ravel(), run.spin[-1].ravel() * 0.1])


def test_a_soft_impact_in_space():
    place, velocity, spin = [0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [0.0, 10.0, -5.0]
    numbers = jnp.array([*place, *velocity, *spin, 0.2, 0.5, 0.004, 0.7])
    _, forward, reverse = both_jacobians(meeting, numbers)
    assert np.all(np.isfinite(forward))
    size = np.max(np.abs(forward))
    np.testing.assert_allclose(forward, reverse, atol=1e-12 * size)
    columns = differences(meeting, numbers, 2e-5)
    np.testing.assert_allclose(forward, columns, atol=DIFFERENCES * size)


def rebounding(numbers):
    """A disc that meets a floor under gravity, followed: last velocity and surface speed."""
    v, w, mu, kappa, e = numbers
    disc = jc.Sphere(0.1, 0.5, [0.0, 0.101], jnp.stack([v, -1.0 + 0 * v]), spin=w)
    scene = jc.Scene(
        [disc, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.HuGuo(e=e), stiffness=1e6,
        friction=jc.SpringSlider(mu, ratio=kappa), gravity=[0.0, -9.8],
    )  # fmt: skip
    run = jc.simulate(scene, 0.015, rtol=1e-10)
    return jnp.append(run.velocity[-1, 0], run.spin[-1, 0] * 0.1)


def test_a_followed_impact_has_derivatives():
    """It slips, sticks, and slips again. Runs of Python numbers share their programs."""
    numbers = np.array([0.5, 2.0, 0.3, 0.8, 0.8])
    weights = np.array([1.0, 0.3, -0.7])
    found = jax.grad(lambda numbers: weights @ rebounding(numbers))(jnp.asarray(numbers))
    steps = 2e-4 * np.abs(numbers)
    for k, step in enumerate(steps):
        ends = [np.asarray(rebounding(numbers + s * step * np.eye(5)[k])) for s in (-2, -1, 1, 2)]
        slope = weights @ (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        assert abs(found[k] - slope) < DIFFERENCES * max(1, np.abs(slope)), (k, found[k], slope)


def sliding(v, mu, time, rtol=1e-10):
    """The run of a disc that is put on the floor."""
    disc = jc.Sphere(0.1, 0.5, [0.0, 0.1], jnp.stack([v, 0 * v]))
    scene = jc.Scene(
        [disc, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.HuGuo(e=0.3), stiffness=1e6,
        friction=jc.SpringSlider(mu, ratio=0.8), gravity=[0.0, -9.8],
    )  # fmt: skip
    return jc.simulate(scene, time, rtol=rtol)


def put_down(v, mu, time):
    """Its place, velocity and surface speed at the end, and all losses."""
    run = sliding(v, mu, time)
    lost = jnp.nansum(run.impacts.energy_loss) + run.sliding_loss
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.spin[-1, 0] * 0.1, lost])


WEIGHTS = np.array([0.8, 1.0, -0.5, 0.7])


def check_put_down(v, mu, time):
    """Check the derivatives by v and μ beside differences, and return them."""
    found = jax.grad(lambda v, mu: WEIGHTS @ put_down(v, mu, time), (0, 1))(v, mu)

    def by(place):
        def at(shift):
            return WEIGHTS @ np.asarray(put_down(*place(shift), time))

        return (at(-0.02) - 8 * at(-0.01) + 8 * at(0.01) - at(0.02)) / 0.12

    slopes = by(lambda shift: (v + shift, mu)), by(lambda shift: (v, mu + shift))
    np.testing.assert_allclose(found, slopes, atol=DIFFERENCES)
    return found


def test_a_lasting_slide_has_derivatives():
    """dv'/dv is 1, and the loss has the derivative μ g m t by v."""
    time, mu, g, m = 0.03, 0.1, 9.8, 0.5
    found, _ = check_put_down(3.0, mu, time)
    assert abs(found - (0.8 * time + 1 + 0.7 * mu * g * m * time)) < SETTLING


def test_a_ball_that_comes_to_rest_has_derivatives():
    """Its spring swings at the moment that counts as rest, which has no derivative."""
    check_put_down(1.0, 0.3, 0.6)


def test_the_moment_of_rest_does_not_matter():
    """At the coarser tolerance the disc counts as at rest while it slides, else after its stop."""
    coarse, fine = sliding(1.0, 0.15, 1.5, 1e-6), sliding(1.0, 0.15, 1.5, 1e-8)
    assert coarse.sliding_loss > 1e-3 and fine.sliding_loss < 1e-12
    for name in ("position", "velocity"):
        one, other = (getattr(run, name)[-1] for run in (coarse, fine))
        np.testing.assert_allclose(one, other, rtol=0, atol=GIVES)


def test_rolling_has_the_derivative_of_a_slip_that_is_stopped():
    """A ball that just rolls has none of the slip by which its derivatives are taken."""

    def rolled(v, w):
        ball = jc.Sphere(0.1, 0.5, jnp.stack([0 * v, 0 * v + 0.1]), jnp.stack([v, 0 * v]), spin=w)
        scene = jc.Scene(
            [ball, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.ExactRestitution(e=0.5),
            gravity=[0.0, -9.8], friction=jc.RigidCoulomb(0.3),
        )  # fmt: skip
        run = jc.simulate(scene, 1.5, instantaneous=True, max_impacts=4)
        return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.spin[-1, 0]])

    exact = np.array([[7.5, -0.3], [5.0, -0.2], [-50.0, 2.0]]) / 7
    for v in (0.0, 2.0):
        found = jax.jacfwd(rolled, (0, 1))(v, -v / 0.1)
        np.testing.assert_allclose(np.stack(found, axis=1), exact, rtol=FORMULA)
