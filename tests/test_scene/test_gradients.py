"""Derivatives of a run: exact ones, both modes, and finite differences, also where a run begins
inside contacts. The growth of a change of the start.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.derivative import differentiable_run
from tests.test_scene.support import (
    apart,
    central,
    check_modes,
    ended,
    go,
    in_a_line,
    missing,
    simulate,
    spheres,
)

DIFFERENCES = 1e-6  # against differences of order four: measured 2e-8


def test_two_balls_exactly(monkeypatch):
    """They exchange their places and velocities; engines that freeze the time get this wrong. The
    growth of a run shares the program of a gradient.
    """
    used, program = [], differentiable_run.matrices
    count = lambda *of, **how: used.append(1) or program(*of, **how)  # noqa: E731
    monkeypatch.setattr(differentiable_run, "matrices", count)

    def two(start):
        return go(jc.Scene(in_a_line(0.1, 1.0, start[:2], start[2:]), jc.Hertz()), 2.0)

    start = jnp.array([0.0, 1.0, 1.0, 0.0])
    assert two(start).margin.growth > 1
    exact = [[0, 1, 0, 2], [1, 0, 2, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    _, push = jax.linearize(lambda start: ended(two(start)), start)
    pull = jax.linear_transpose(push, start)
    columns, rows = ([np.asarray(way(x)).ravel() for x in np.eye(4)] for way in (push, pull))
    np.testing.assert_allclose(np.transpose(columns), exact, atol=1e-14)
    np.testing.assert_allclose(rows, exact, atol=1e-14)
    assert used == [1]


@pytest.mark.slow(reason="second derivatives of a scene")
def test_second_derivatives():
    """The speed after an oblique hit against second differences of first derivatives."""

    def speed(start):
        balls = [jc.Sphere(0.1, 1.0, start[:2], start[2:]), jc.Sphere(0.1, 2.0, [1.0, 0.0])]
        run = go(jc.Scene(balls, jc.ExactRestitution(e=0.8)), 2.0, max_impacts=2)
        return run.velocity[-1, 0, 1] + run.position[-1, 1, 0]

    start = jnp.array([0.0, 0.05, 1.0, 0.02])

    @jax.jit
    def slopes(start):
        slope, push = jax.linearize(jax.grad(speed), start)
        return slope, jax.vmap(push, out_axes=1)(jnp.eye(4))

    hessian = slopes(start)[1]
    found = [central(lambda h, k=k: slopes(start + h * np.eye(4)[k])[0], 1e-5) for k in range(4)]
    np.testing.assert_allclose(hessian, found, atol=1e-6 * np.max(np.abs(hessian)))


def plane(numbers):
    """Three balls, a fixed one and a floor under gravity, with two laws: six impacts in a plane."""
    state, rest = numbers[:12].reshape(3, 4), numbers[12:]
    balls = spheres([rest[0]] * 3, rest[1:4], state[:, :2], state[:, 2:], names=["ball"] * 3)
    pin = jc.Sphere(rest[4], None, jnp.stack([rest[5], rest[5]]), fixed=True, name="pin")
    floor = jc.Plane(jnp.stack([rest[6], rest[6]]), jnp.stack([rest[7], 1 + rest[7]]))
    laws = {("ball", "ball"): jc.ExactRestitution(e=rest[8]), "default": jc.MarhefkaOrin(a=rest[9])}
    bodies, stiffness = [*balls, pin, floor], {"default": 1e6}
    scene = jc.Scene(bodies, laws, stiffness=stiffness, gravity=rest[10:])
    run = go(scene, 1.1, times=[0.3, 1.1], max_impacts=16)
    out = jnp.concatenate([run.position.ravel(), run.velocity.ravel(), run.impacts.time[:6]])
    return out, run


# Positions and velocities of the three balls.
STATES = [0.0, 1.0, 1.0, 0.0, 0.8, 1.1, -0.8, 0.1, -0.5, 0.8, 0.4, 0.2]
# Radius, masses, the pin's radius and place, floor, normal, e, a, gravity.
REST = [0.1, 1.0, 1.5, 0.7, 0.2, 0.35, 0.01, 0.02, 0.8, 0.05, 0.1, -9.0]
PLANE = np.array([*STATES, *REST])


def test_impacts_in_a_plane():
    run = check_modes(jax.jit(plane), PLANE, np.maximum(np.abs(PLANE), 0.1), 1e-5, DIFFERENCES)
    assert int(np.sum(run.impacts.valid)) >= 6 and run.status == jc.Ending.COMPLETED
    assert run.margin.time > 1e-3 and run.margin.closing_speed > 0.1


def test_a_batch_with_bad_lanes():
    """A lane that is out of range, overlaps or needs more room is flagged; the others are whole."""

    def run_of(radius, start):
        balls = in_a_line([radius, 0.1, 0.1], 1.0, [start, 1.0, 2.0], [1.0, 0.0, 0.0])
        run = go(jc.Scene([*balls, jc.Plane([4.0], [-1.0])], jc.Hertz()), 3.0, max_impacts=2)
        good = run.status == jc.Ending.COMPLETED
        place = jnp.where(good, run.position[-1, 0, 0], 0)
        return place, (run.position[-1], run.status, run.impacts.valid.sum(), run.velocity[-1])

    def total(radius):
        place, rest = jax.vmap(run_of)(radius, start)
        return jnp.sum(place), rest

    radius = jnp.array([0.1, -0.1, 0.1, 0.1, 0.1])
    start = jnp.array([0.0, 0.0, 0.95, jnp.nan, 0.75])
    slope, (place, status, count, velocity) = jax.jit(jax.grad(total, has_aux=True))(radius)
    wrong, room = jc.Ending.INVALID_INPUT, jc.Ending.TOO_MANY_IMPACTS
    assert status.tolist() == [jc.Ending.COMPLETED, wrong, wrong, wrong, room]
    assert count.tolist() == [2, 0, 0, 0, 2]
    assert np.isfinite(place).all(axis=(1, 2)).tolist() == [True, False, False, False, False]
    np.testing.assert_allclose(velocity[0, :, 0], [0.0, 0.0, 1.0], atol=1e-15)
    # The first ball stops at the contact with the second.
    np.testing.assert_allclose(slope, [-1.0, 0.0, 0.0, 0.0, 0.0], atol=1e-14)


def test_a_grazing_hit_has_no_nan():
    """Two discs that just miss or just touch: the margin says how close it was."""

    def speed(offset):
        balls = spheres(0.1, 1.0, [jnp.stack([0.0, offset]), [1.0, 0.0]], [[1.0, 0.0], None])
        run = go(jc.Scene(balls, jc.Hertz()), 2.0, max_impacts=2)
        return run.velocity[-1, 0, 1], run.margin.closing_speed

    slope = jax.jit(jax.jacfwd(speed, has_aux=True))
    missed, closing = slope(0.2)
    assert np.isfinite(missed) and closing == np.inf
    for less in (1e-15, 1e-12, 1e-8):
        touched, closing = slope(0.2 - less)
        assert np.isfinite(touched)
        assert closing == np.inf or closing == pytest.approx(np.sqrt(10 * less), rel=0.5)


def oblique(alpha, stiffness, radius, mass, x, y, u, v, *at):
    """Two discs that pass each other."""
    place, speed = [jnp.stack([x, y]), jnp.stack(at)], [jnp.stack([u, v]), [-0.5, 0.0]]
    balls = spheres([radius, 0.1], [mass, 1.0], place, speed)
    return jc.Scene(balls, jc.Damped(alpha=alpha), stiffness=stiffness), 0.8


def stack(alpha, stiffness, radius, mass, place, speed, high, gravity):
    """One ball on a floor and one that follows it: a coupled solve under gravity."""
    balls = in_a_line([radius, 0.1], [mass, 1.0], [place, high], [speed, -0.3])
    bodies, pull = [*balls, jc.Plane([0.0], [1.0])], jnp.stack([-gravity])
    return jc.Scene(bodies, jc.Damped(alpha=alpha), stiffness=stiffness, gravity=pull), 0.15


# With the sizes of changes: a length changes by far less than an indentation.
SOFT = {
    oblique: (
        [1.0, 1e6, 0.1, 2.0, 0.0, 0.0, 1.0, 0.1, 0.5, 0.12],
        [1.0, 1e6, 0.01, 2.0, 0.01, 0.01, 1.0, 0.1, 0.01, 0.01],
    ),
    stack: (
        [0.5, 1e5, 0.1, 2.0, 0.15, -0.3, 0.3503, 9.81],
        [0.5, 1e5, 0.01, 2.0, 0.01, -0.3, 0.01, 9.81],
    ),
}


@pytest.mark.slow(reason="derivatives of soft scenes by all numbers")
@pytest.mark.parametrize("scene_of", SOFT, ids=lambda f: f.__name__)
def test_derivatives_of_soft_runs(scene_of):
    """Values: `test_soft_runs`."""

    def outcome(numbers):
        scene, duration = scene_of(*apart(numbers))
        return ended(simulate(scene, duration, rtol=1e-10, max_impacts=8)), None

    numbers, sizes = map(np.array, SOFT[scene_of])
    check_modes(outcome, numbers, sizes, 1e-3, DIFFERENCES)


LIFT = jnp.array([0.9, 0.3, 1.0])
"""Speeds of a ball along a lift and of the lift, and the stiffness over 1e5 N/m."""

OF_A_RUN = 1e-7
"""Against differences of the run itself, of order two with steps of 1e-5: relative to the largest
of a row."""


def _on_a_lift(numbers):
    """A ball that leaves a periodic space at its side, between two bounces on a lift."""
    along, lift, stiffness = numbers
    ball = jc.Sphere(0.1, 1.0, [0.5, 0.2], jnp.stack([along, -1.0 + 0 * lift]))
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady(jnp.stack([0 * lift, lift])))
    scene = jc.Scene(
        [ball, floor], jc.HuGuo(e=jnp.asarray(0.8)), stiffness=stiffness * 1e5,
        gravity=[0.0, -9.81], periodic=[1.0, None],
    )  # fmt: skip
    return simulate(scene, 0.6, rtol=1e-10, max_impacts=8)


def _of_the_lift(numbers):
    run = _on_a_lift(numbers)
    later, end = run.at(0.4), run.final.spheres[0]
    parts = [run.position[-1, 0], run.energy[-1:], run.wall_work[None], later.velocity[0, 0]]
    return jnp.concatenate([*parts, later.position[0, 0], end.position, jnp.asarray(end.velocity)])


@pytest.mark.slow(reason="derivatives of a soft run, of its states and of its final scene")
def test_all_that_a_run_gives_has_its_derivatives_by_both_modes():
    """Over a moving wall and a periodic side, out of a trace: states, `at`, `final`."""
    check_modes(lambda numbers: (_of_the_lift(numbers), None), LIFT, np.ones(3), 1e-5, OF_A_RUN)
    assert len(_on_a_lift(LIFT).impacts) == 2


STEP = 1e-4  # of central differences, whose error is 1e-8, relative
AT_REST = 1e-8  # of places, speeds and work, beside statics
SLOPES_AT_REST = 1e-7
"""Of their derivatives: measured 2e-8. A solve whose end in time has a derivative of its own is
1e-4 off."""

GOES_ON = 1e-10  # of a run in two parts, relative
BRIEFLY, BY_DURATION = 1e-6, 1e-6  # in s, and of differences over it, relative: measured 1.4e-7
SPEED, UNTIL = 0.2, 0.016


def _ends(scale, duration=UNTIL, **more):
    """A ball on a lift, amid its contact, and two high above it amid theirs, which is isolated;
    stiffness and speeds vary together.
    """
    balls = [
        jc.Sphere(0.1, 1.0, [0.11], [-0.5]),
        jc.Sphere(0.1, 1.0, [5.0], [20.0 + scale]),
        jc.Sphere(0.1, 2.0, [5.21], [20.0]),
    ]
    lift = jc.Plane([0.0], [1.0], motion=jc.Steady([SPEED * scale]))
    scene = jc.Scene([*balls, lift], jc.HuGuo(e=0.5), stiffness=1e6 * scale, gravity=[-9.81])
    return simulate(scene, duration, rtol=1e-11, **more)


def _numbers(run, first=None):
    """What a run gives, less what the `first` part of it did, and with its energies."""
    lost = jnp.sum(jnp.where(run.impacts.valid, run.impacts.energy_loss, 0))
    work, time = run.wall_work, run.impacts.time[:2]
    if first is not None:
        lost = lost - jnp.sum(first.impacts.energy_loss)
        work, time = work - first.wall_work, time - UNTIL
    numbers = [run.position[-1, 0], run.velocity[-1, 0], work[None], run.position[-1, 1:]]
    numbers += [run.velocity[-1, 1:], run.energy[-1:], lost[None], time]
    return jnp.concatenate([jnp.ravel(x) for x in numbers])


@pytest.mark.slow(reason="derivatives of a soft run in two pieces")
def test_a_run_goes_on_from_contacts_with_their_derivatives():
    """All that a run goes on from varies, the indentation and v0 as well; to flight and to rest."""
    parts = [eqx.partition(_ends(1 + h).final, eqx.is_inexact_array) for h in (STEP, -STEP, 0)]
    rest = parts[2][1]
    moves = jax.tree.map(lambda a, b: (a - b) / (2 * STEP), parts[0][0], parts[1][0])
    assert np.any(moves._start.contacts.state.indentation != 0)
    assert eqx.combine(*parts[2])._start.underway.partner.tolist() == [-1, 2, 1]

    @jax.jit
    def both(numbers, along, duration):
        def end(x):
            return simulate(eqx.combine(x, rest), duration, rtol=1e-11, max_impacts=8)

        return jax.jvp(lambda x: _numbers(end(x)), (numbers,), (along,))

    value, found = both(parts[2][0], moves, 0.03)
    first = _ends(1.0)
    expected = _numbers(_ends(1.0, UNTIL + 0.03), first)
    np.testing.assert_allclose(value, expected, rtol=GOES_ON)
    # Both contacts are in both parts, each with its loss there.
    assert np.all(expected[-2:] < 0)
    assert missing(first) < GOES_ON * first.energy[0]
    # It is up again.
    assert float(value[1]) > SPEED + 0.05
    after = [both(numbers, moves, 0.03)[0] for numbers, _ in parts[:2]]
    np.testing.assert_allclose(found, (after[0] - after[1]) / (2 * STEP), rtol=DIFFERENCES)
    # It is carried: only its lift and its indentation vary then.
    duration = 1.5
    value, found = both(parts[2][0], moves, duration)
    np.testing.assert_allclose(value[1], SPEED, atol=AT_REST)
    sinks = 2 / 3 * (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(found[0], SPEED * (UNTIL + duration) + sinks, rtol=SLOPES_AT_REST)
    np.testing.assert_allclose(found[1], SPEED, rtol=SLOPES_AT_REST)
    slope = central(lambda h: float(_ends(1 + h).velocity[-1, 0, 0]), STEP)
    # Speed times the transferred momentum and the weight, and their variations.
    gives = SPEED * (SPEED - float(first.velocity[-1, 0, 0]) + 9.81 * duration)
    np.testing.assert_allclose(value[2], gives, rtol=AT_REST)
    np.testing.assert_allclose(found[2], gives + SPEED * (SPEED - slope), rtol=SLOPES_AT_REST)


def test_a_derivative_by_the_duration_includes_the_contact_forces():
    """At the end of a run inside contacts, coupled and isolated; beside differences."""

    def end(duration):
        run = _ends(1.0, duration, max_impacts=8)
        return jnp.concatenate([ended(run), run.energy[-1:]])

    # The differences are those of the same program.
    both = jax.jit(lambda duration: jax.jvp(end, (duration,), (1.0,)))
    along, slope = both(UNTIL)[1], central(lambda h: both(UNTIL + h)[0], BRIEFLY)
    assert np.abs(along[3]) > 10 * 9.81
    np.testing.assert_allclose(along, slope, rtol=BY_DURATION)


EXACT = 1e-6  # against the largest singular value by other means: measured 1e-9
OF_GROWTH = 1e-5  # against differences of the run itself: measured 3e-8
FLIGHT, RADII = 3.0, 1.0


def largest(matrix, unit):
    """The largest singular value of a matrix for positions and velocities, in these units."""
    unit = np.diag(unit)
    return np.linalg.svd(unit @ matrix @ np.linalg.inv(unit))[1][0]


def between_pins(offset, duration, room=16):
    """A ball that goes to and fro between two fixed ones."""
    far = RADII + FLIGHT / 2
    pins = [jc.Sphere(0.9, None, [x, 0.0], fixed=True) for x in (-far, far)]
    ball = jc.Sphere(0.1, 1.0, [offset, 0.0], [1.0, 0.0])
    return go(jc.Scene([ball, *pins], jc.Hertz()), duration, max_impacts=room, throw=False)


def of_a_billiard(hits, duration):
    """By the matrices of what is perpendicular to the path: flights, and hits of curved walls."""
    path = flight(duration)
    if hits:
        hit = np.array([[1, 0], [2 / RADII, 1]])
        last = duration - FLIGHT / 2 - FLIGHT * (hits - 1)
        between = np.linalg.matrix_power(hit @ flight(FLIGHT), hits - 1)
        path = flight(last) @ between @ hit @ flight(FLIGHT / 2)
    return largest(path, [1, duration])


def flight(length):
    return np.array([[1, length], [0, 1]])


def test_a_billiard():
    """Every hit multiplies by the eigenvalue 1 + l/r + √((l/r)² + 2 l/r)."""
    durations = FLIGHT * np.array([0.1, 1, 2, 3, 4, 5])
    runs = eqx.filter_jit(jax.vmap(functools.partial(between_pins, 0.0)))(jnp.asarray(durations))
    growth = runs.margin.growth
    exact = [of_a_billiard(hits, duration) for hits, duration in enumerate(durations)]
    np.testing.assert_allclose(growth, exact, rtol=EXACT)
    assert exact[0] == pytest.approx((1 + np.sqrt(5)) / 2)
    ratio = FLIGHT / RADII
    each = 1 + ratio + np.sqrt(ratio * (ratio + 2))
    # The duration itself is the unit of the effect of velocities.
    np.testing.assert_allclose(growth[5] / growth[4] * 4 / 5, each, rtol=0.03)
    # A single run from Python gives the same; one without values has no growth here.
    one = between_pins(0.0, float(durations[3]))
    np.testing.assert_allclose(one.margin.growth, exact[3], rtol=EXACT)
    short = between_pins(0.0, float(durations[3]), room=1)
    assert short.status == jc.Ending.TOO_MANY_IMPACTS and np.isnan(short.margin.growth)


def three(start):
    """Three balls, a fixed one and a floor under gravity."""
    balls = spheres(0.1, [1.0, 1.5, 0.7], *start)
    pin = jc.Sphere(0.2, None, [0.35, 0.35], fixed=True)
    floor = jc.Plane([0.0, -0.3], [0.02, 1.0])
    return go(jc.Scene([*balls, pin, floor], jc.ExactRestitution(e=0.8), gravity=[0.1, -9.0]), 0.9)


def test_growth_against_differences_of_the_run():
    start = np.array([[[0.0, 1.0], [0.8, 1.1], [-0.5, 0.8]], [[1.0, 0.0], [-0.8, 0.1], [0.4, 0.2]]])
    run = three(start)
    assert len(run.impacts) == 4 and np.min(run.margin.time) > 0.01

    def end(h, way):
        found = three(start + h * way)
        return np.stack([found.position[-1, :3], found.velocity[-1, :3]]).ravel()

    ways = np.eye(start.size).reshape(-1, *start.shape)
    columns = [central(functools.partial(end, way=way), 1e-6) for way in ways]
    found = largest(np.array(columns).T, np.repeat([1.0, 0.9], 6))
    np.testing.assert_allclose(run.margin.growth, found, rtol=OF_GROWTH)


@pytest.mark.slow(reason="the growth through a soft scene")
def test_a_soft_impact():
    """Two equal balls head-on exchange velocities u apart: x1 = y - 2 R + w T + u D/2 at the end,
    and x2 = x + 2 R + v T - u D/2, with a duration D ~ u^(-1/5) of the impact.
    """
    end = 2.0
    scene = jc.Scene(in_a_line(0.1, 1.0, [0.0, 1.0], [1.0, 0.0]), jc.Hertz(), stiffness=1e4)
    run = simulate(scene, end)
    part = 0.4 * float(run.impacts.duration[0])
    assert part > 0.01
    slope = [[0, 1, part, end - part], [1, 0, end - part, part], [0, 0, 0, 1], [0, 0, 1, 0]]
    found = largest(np.array(slope), [1, 1, end, end])
    np.testing.assert_allclose(run.margin.growth, found, rtol=EXACT)
