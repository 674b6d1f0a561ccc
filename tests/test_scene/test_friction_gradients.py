"""Runs with friction on a floor and on a peg, to rest and rolling, and their derivatives: both
modes, beside differences and formulas.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.rubbing_spheres import integrated
from tests.test_scene.support import apart, check_modes, missing, simulate, spheres
from tests.test_scene.test_friction_coupled import KAPPA, KEPT, MISSED, NUMBERS, compare
from tests.test_scene.test_gradients import DIFFERENCES

FORMULA = 1e-11
"""Derivatives of the moment of rolling beside those of its formula, relative: measured 1e-14."""

SETTLING = 2e-4
"""What the swing of the normal force adds in 0.03 s to derivatives of order 1: measured 3e-5."""

GIVES = 1e-6
"""Places and speeds at rtol 1e-6 beside those at 1e-10, in m and m/s: measured 4e-8. A spring that
did not give way would leave 1e-5 m."""


def rolling(numbers):
    """The last position, velocity and spin of a ball that slides and then rolls."""
    v0, w0, mu, radius, g = numbers
    ball = jc.Sphere(radius, 0.5, jnp.stack([0.0 * v0, radius]), jnp.stack([v0, 0.0 * v0]), spin=w0)
    scene = jc.Scene(
        [ball, jc.Plane([0.0, 0.0], [0.0, 1.0])], jc.ExactRestitution(e=0.5),
        gravity=jnp.stack([0.0 * g, -g]), friction=jc.RigidCoulomb(mu),
    )  # fmt: skip
    run = simulate(scene, 1.5, instantaneous=True, max_impacts=4)
    return jnp.stack([run.position[-1, 0, 0], run.velocity[-1, 0, 0], run.spin[-1, 0]])


@jax.jit
@functools.partial(jax.jacrev, has_aux=True)
def slopes_of_rolling(numbers):
    return (end := rolling(numbers)), end


def formula(numbers):
    v0, w0, mu, radius, g = numbers
    slip = v0 + radius * w0
    begins = 2 * slip / (7 * mu * g)
    rolls = v0 - 2 / 7 * slip
    place = v0 * begins - mu * g * begins**2 / 2 + rolls * (1.5 - begins)
    return jnp.stack([place, rolls, -rolls / radius])


def test_the_moment_of_rolling_has_a_derivative():
    numbers = jnp.array([2.0, 3.0, 0.3, 0.1, 9.8])
    exact = jax.jit(jax.jacfwd(formula))(numbers)
    found, value = slopes_of_rolling(numbers)
    np.testing.assert_allclose(value, formula(numbers), rtol=1e-12)
    np.testing.assert_allclose(found, exact, atol=FORMULA * np.max(np.abs(exact)))


def test_rolling_has_the_derivative_of_a_slip_that_is_stopped():
    """A ball that just rolls has none of the slip by which its derivatives are taken."""
    exact = np.array([[7.5, -0.3], [5.0, -0.2], [-50.0, 2.0]]) / 7
    for v in (0.0, 2.0):
        found = slopes_of_rolling(jnp.array([v, -v / 0.1, 0.3, 0.1, 9.8]))[0]
        np.testing.assert_allclose(found[:, :2], exact, rtol=FORMULA)


def over_a_floor(discs, e, friction, stiffness=1e6, floor=(0.0, 0.0), normal=(0.0, 1.0), shell=1e3):
    """Discs above a floor that could move, in a shell. Far bodies make all programs the same."""
    floor = jc.Plane(floor, normal, motion=jc.Steady([0.0, 0.0]))
    return jc.Scene(
        [*discs, floor, jc.Shell([0.0, 0.0], shell)], jc.HuGuo(e=e), stiffness=stiffness,
        friction=friction, gravity=[0.0, -9.8],
    )  # fmt: skip


def followed(scene, duration, rtol=1e-9, times=None):
    """The run for v0 as at touch, but for slow ones, so that discs come to rest."""
    return simulate(scene, duration, rtol=rtol, times=times, v0=0.05)


SPRING = jc.SpringSlider(0.3, ratio=KAPPA)
FAR = jc.Sphere(0.1, 0.5, [0.0, 100.0])


def test_a_ball_that_spins_along_a_shell_agrees_with_an_integration():
    """The normal turns with the ball, and gravity acts."""
    place = np.array([[0.3, -0.8]])
    place *= (0.9 - 1e-4) / np.linalg.norm(place)
    speed, spin = np.array([[0.5, -1.0]]), np.array([[30.0]])
    discs = jc.Sphere(0.1, 0.5, place[0], speed[0], spin=30.0), jc.Sphere(0.01, 0.5, [0.0, 0.5])
    run = followed(over_a_floor(discs, 0.8, SPRING, floor=[0.0, -50.0], shell=1.0), 0.012)
    start, more = (place, speed, spin), {"shell": 1.0}
    numbers, gravity = (1e6, *NUMBERS[1:]), np.array([0.0, -9.8])
    known = integrated(np.array([0.1]), np.array([0.5]), gravity, start, 0.012, numbers, more)
    compare((run.velocity[-1, :1], run.spin[-1, :1]), known, np.array([0.1]))


LEVER = 3e-4
"""Arms are R - δ on a soft floor: the rolling speed differs by about δ/R from 5/7 of the sliding
speed. Measured 8e-5 at δ/R = 5e-4."""


def test_a_ball_comes_to_rest_rolls_and_meets_another_one():
    """Bounces, sliding at rest, rolling at rest, and a ball at rest that is hit. The floor, which
    could move, does no work.
    """
    balls = [jc.Sphere(0.1, 0.5, [x, y], [v, 0.0]) for x, y, v in ((0, 0.102, 1.0), (1.2, 0.1, 0))]
    scene = over_a_floor(balls, 0.5, jc.SpringSlider(0.2, ratio=KAPPA), 1e8)
    run = followed(scene, 3.0, times=[0.0, 0.9, 1.2, 3.0])
    speed, spin = run.velocity[:, :2, 0], run.spin[:, :2]
    assert abs(speed[1, 0] - 5 / 7) < LEVER and speed[1, 1] == 0
    # At rest they roll, until one meets the other and afterwards, at the height of their centres.
    np.testing.assert_allclose(speed[1:] + run.position[1:, :2, 1] * spin[1:], 0, atol=1e-12)
    assert run.position[3, 1, 0] > run.position[3, 0, 0] + 0.2
    assert 0 < run.velocity[3, 0, 0] < run.velocity[3, 1, 0]
    assert abs(run.wall_work) < KEPT and missing(run) < KEPT * run.energy[0]


def test_a_wall_that_stands_does_no_work_on_a_ball_at_rest():
    """A slope that could move, whose spring holds the ball below the middle of its swing."""
    along, normal = np.array([np.cos(0.2), -np.sin(0.2)]), np.array([np.sin(0.2), np.cos(0.2)])
    discs = jc.Sphere(0.1, 0.5, 0.102 * normal, along - 0.3 * normal), FAR
    run = followed(over_a_floor(discs, 0.5, SPRING, normal=normal), 2.0, times=[0.0, 1.0, 1.5, 2.0])
    assert abs(run.wall_work) < KEPT and missing(run) < KEPT * run.energy[0]


@jax.jit
def along(v, w):
    """A velocity along the floor and one towards it, as one program, and so its slopes."""
    return jnp.stack([v, w])


@jax.jit
def last_of(position, velocity, spin, losses, sliding):
    """The place, velocity and surface speed at the end, and all losses."""
    last = [position[-1, 0, 0], *velocity[-1, 0], spin[-1, 0] * 0.1, jnp.nansum(losses) + sliding]
    return jnp.stack(last)


def outcome(run):
    parts = run.position, run.velocity, run.spin, run.impacts.energy_loss, run.sliding_loss
    return last_of(*parts), None


def test_a_followed_impact_has_derivatives():
    """It slips, sticks, and slips again."""

    def rebounding(numbers):
        v, w, mu, kappa, e = apart(numbers)
        disc = jc.Sphere(0.1, 0.5, [0.0, 0.101], along(v, -1.0), spin=w)
        scene = over_a_floor([disc, FAR], e, jc.SpringSlider(mu, ratio=kappa))
        return outcome(followed(scene, 0.015, 1e-10))

    numbers = np.array([0.5, 2.0, 0.3, 0.8, 0.8])
    check_modes(rebounding, numbers, numbers, 2e-4, DIFFERENCES)


def sliding(v, mu, time, rtol=1e-10):
    """The run of a disc that is put on the floor."""
    disc = jc.Sphere(0.1, 0.5, [0.0, 0.1], along(v, 0.0))
    return followed(over_a_floor([disc, FAR], 0.3, jc.SpringSlider(mu, ratio=0.8)), time, rtol)


# The spring of one that comes to rest swings at that moment, which has no derivative.
@pytest.mark.parametrize(("v", "mu", "time"), [(3.0, 0.1, 0.03), (1.0, 0.3, 0.6)])
def test_a_disc_that_slides_or_comes_to_rest_has_derivatives(v, mu, time):
    def put_down(numbers):
        return outcome(sliding(*apart(numbers), time))

    check_modes(put_down, np.array([v, mu]), np.ones(2), 0.01, DIFFERENCES)
    if time < v / (9.8 * mu):
        slope = jax.jvp(lambda v: put_down(jnp.stack([v, mu]))[0], (v,), (1.0,))[1]
        # The loss has the derivative μ g m t.
        exact = [time, 1, 0, mu * 9.8 * 0.5 * time]
        np.testing.assert_allclose(slope[np.array([0, 1, 3, 4])], exact, rtol=0, atol=SETTLING)


def test_the_moment_of_rest_does_not_matter():
    """At the coarser tolerance the disc counts as at rest while it slides, else after its stop."""
    coarse, fine = sliding(1.0, 0.15, 1.5, 1e-6), sliding(1.0, 0.15, 1.5, 1e-10)
    assert coarse.sliding_loss > 1e-3 and fine.sliding_loss < 1e-12
    for name in ("position", "velocity"):
        one, other = (getattr(run, name)[-1] for run in (coarse, fine))
        np.testing.assert_allclose(one, other, rtol=0, atol=GIVES)


LAST = 2e-6
"""A run that ends within a contact and goes on, beside one in a piece, in m/s: measured 4e-7. The
second half then belongs to the normal of that moment."""

FALLING = 4e-3
"""The angle at which a ball leaves a peg, beside that of a rigid one, in rad: measured 3e-3, as the
ball slips and bounces a little. Without friction it would be 0.06."""

SLOPE = 1e-7  # derivatives beside differences of fourth order, relative: measured 4e-9


def on_a_peg(place, speed, spin, mu, stiffness=1e6, e=0.7):
    """Two balls above a peg in the plane, or one, and one that falls far from them."""
    if len(place) == 1:
        place, speed, spin = [*place, [5.0, 0.0]], [*speed, [0.0, 0.0]], [*spin, 0.0]
    peg = jc.Sphere(0.3, None, [0.0, 0.0], fixed=True)
    return jc.Scene(
        [*spheres(0.1, 0.5, place, speed, spin), peg], jc.HuGuo(e=e),
        stiffness=stiffness, gravity=[0.0, -9.81], friction=jc.RigidCoulomb(mu),
    )  # fmt: skip


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_run_that_ends_within_a_contact_goes_on(share):
    scene = on_a_peg([[0.1, 0.42]], [[0.3, -1.0]], [5.0], 0.05)
    whole = simulate(scene, 0.08)
    within = whole.impacts.time[0] + share * whole.impacts.duration[0]
    begun = simulate(scene, float(within))
    rest = simulate(begun.final, 0.08 - float(within))
    np.testing.assert_allclose(rest.velocity[-1], whole.velocity[-1], atol=LAST)
    np.testing.assert_allclose(0.1 * rest.spin[-1], 0.1 * whole.spin[-1], atol=LAST)
    assert missing(begun) < MISSED and missing(rest) < MISSED
    np.testing.assert_allclose(rest.impacts.slip_after[0], whole.impacts.slip_after[0], atol=LAST)


def test_a_ball_rolls_off_a_peg():
    """A contact that lasts has a spring, and says so. A ball that rolls from rest at the angle a
    leaves where cos is 10/17 cos a.
    """
    angle = 0.4
    place = 0.4 * np.array([[np.sin(angle), np.cos(angle)]])
    scene = on_a_peg(place, [[0.0, 0.0]], [0.0], 5.0, 1e8, e=0.3)
    run = simulate(scene, 1.5)
    assert run.ok and run.impacts.solved_by[0] == jc.SolvedBy.SPRING
    assert "a spring for its law in 1 contacts that lasted or were of several bodies" in str(run)
    left = run.impacts.time[-1] + run.impacts.duration[-1]
    x, y = simulate(scene, float(left)).position[-1, 0]
    assert abs(np.arctan2(x, y) - np.arccos(10 / 17 * np.cos(angle))) < FALLING
    assert missing(run) < MISSED


@jax.jit
def parts(numbers):
    """Places, speeds, spins, μ and K; as one program, and so its slopes."""
    mu, stiffness, rest = numbers[0], numbers[1], numbers[2:]
    return *rest[:8].reshape(2, 2, 2), rest[8:], mu, stiffness


@jax.jit
def ends(position, velocity, spin):
    last = position[-1, :2], velocity[-1, :2], 0.1 * spin[-1, :2]
    return jnp.concatenate([part.ravel() for part in last])


def bounced(numbers):
    """A ball hits one that nearly touches a peg, on which it falls later: the ends, and how
    contacts were solved.
    """
    run = simulate(on_a_peg(*parts(numbers)), 0.25, max_impacts=16)
    return ends(run.position, run.velocity, run.spin), run.impacts.solved_by


def test_derivatives_of_bounces_on_a_peg():
    near = 0.4003 * np.array([np.sin(0.3), np.cos(0.3)])
    state = [0.16, 0.58, *near, 0.2, -2.0, 0.1, -0.2, 5.0, -3.0]
    numbers = np.array([0.3, 1e6, *state])
    sizes = np.maximum(np.abs(numbers), 0.1)
    ways = np.asarray(check_modes(bounced, numbers, sizes, 1e-6, SLOPE))
    assert {jc.SolvedBy.COUPLED, jc.SolvedBy.SPRING} == set(ways[ways >= 0].tolist())
