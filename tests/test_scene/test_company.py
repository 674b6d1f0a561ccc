"""Coupled solves of some of many discs, against Newton's equations of those in touch: from Python,
and with their derivatives in a periodic ring, across its border.

Runs of the oracle share their programs: ten discs, two walls, places for five.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.engine import pieces
from tests.oracle.scene_oracle import Ball, Spring, Wall, run
from tests.test_scene.support import bodies_of, central, check_modes, ended, in_a_line, spheres

RTOL = 1e-6
ALPHA = 0.5
LAW = jc.Damped(alpha=ALPHA)
WALLS = [Wall([0.0, 0.0], [1.0, 0.0]), Wall([0.0, 0.0], [0.0, 1.0])]


def agrees(balls, near, stiffness, times, speed, walls=(), **options):
    """The first `near` of the balls meet each other and walls, the others nobody."""
    scene = jc.Scene(bodies_of(balls, walls), LAW, stiffness=stiffness)
    found = jc.simulate(scene, times[-1], times=times, rtol=RTOL, **options)
    assert found.status == jc.Ending.COMPLETED
    for k, time in enumerate(times):
        exact = run(balls[:near], Spring(stiffness, alpha=ALPHA), time, list(walls))
        v = np.array([*exact.velocity, *[b.velocity for b in balls[near:]]])
        far = [np.add(b.position, np.multiply(b.velocity, time)) for b in balls[near:]]
        x = np.array([*exact.position, *far])
        assert np.abs(found.velocity[k] - v).max() <= 10 * RTOL * speed
        assert np.abs(found.position[k] - x).max() <= 10 * RTOL * speed * time
    hits = found.impacts.to_dict()
    touched = [touch.begin for touch in exact.touches]
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(touched), atol=10 * RTOL * times[-1])
    # The estimate exists and is close.
    coupled = hits["error_estimate"][hits["solved_by"] == jc.SolvedBy.COUPLED]
    assert len(coupled) and np.all((coupled > 0) & (coupled < 10 * RTOL))
    return found


def test_a_disc_falls_on_others_at_rest():
    """It turns when the solve of three that gather begins; that has one slot more, and is long."""
    places = [(0.021, 0.021), (0.062, 0.021), (0.04, 0.07)]
    speeds = [(0.0, -1.0), (0.0, -1.3), (0.0, -1.0)]
    places += [(0.04, 2.0), *((1 + 0.1 * k, 50.0) for k in range(4))]
    discs = spheres(0.02, 0.02, places, [*speeds, (0.0, 1.5), *[(0.0, 0.0)] * 4])
    fixed = jc.Sphere(0.02, None, [0.104, 0.02], fixed=True)
    planes = jc.Plane([0.0, 0.0], [0.0, 1.0]), jc.Plane([0.0, 0.0], [1.0, 0.0])
    scene = jc.Scene([*discs, fixed, *planes], jc.HuGuo(e=0.3), stiffness=1e5, gravity=[0, -9.81])
    found = jc.simulate(scene, 0.9, times=[0.5, 0.9], max_cluster=5)
    hits = found.impacts.to_dict()
    struck = (hits["first"] == 3) | (hits["second"] == 3)
    (lower, upper), time = found.position[0, 2:4], hits["time"][struck].min()
    fallen = 2.0 + 1.5 * time - 9.81 / 2 * time**2
    assert abs(np.hypot(upper[0] - lower[0], fallen - lower[1]) - 0.04) <= 1e-9


def crowd():
    """Thirteen discs on the way to their middle, of which three touch on the way."""
    rng, ring = np.random.default_rng(5), np.exp(1j * np.arange(6) * np.pi / 3)
    rings = np.concatenate([[0], *(r * ring * np.exp(1j * r) for r in (0.25, 0.5))])
    places = np.stack([rings.real, rings.imag], 1) + rng.uniform(-0.01, 0.01, (13, 2))
    speeds = -2 * places + rng.uniform(-0.1, 0.1, (13, 2))
    columns = (np.round(x, 6).tolist() for x in (places, speeds, rng.uniform(0.5, 2, 13)))
    return [Ball(x, v, 0.1, m) for x, v, m in zip(*columns, strict=True)]


@pytest.mark.parametrize("direct", [16, 0])
def test_a_crowd(direct, monkeypatch):
    """Thirteen discs with slots for all, or for eight at first: of 78 pairs 39 are followed."""
    monkeypatch.setattr(pieces, "_DIRECT", direct)
    found = agrees(crowd(), 13, 1e5, [0.12, 0.25], 1.0)
    # The first time is inside several contacts.
    moving = np.array([ball.mass for ball in crowd()]) @ np.sum(found.velocity[0] ** 2, axis=1) / 2
    assert found.energy[0] > moving + 1e-3


@pytest.mark.slow(reason="the derivative of a crowd, compiled in one program")
def test_slopes_of_a_crowd():
    """By the speeds of one disc of the outer ring in both modes, beside differences."""

    def outcome(change):
        speeds = jnp.array([ball.velocity for ball in crowd()]).at[7].add(change)
        columns = zip(*((0.1, ball.mass, ball.position) for ball in crowd()), strict=True)
        discs = spheres(*map(list, columns), list(speeds))
        scene = jc.Scene(discs, LAW, stiffness=1e5)
        return ended(jc.simulate(scene, 0.12, max_cluster=13)), None

    check_modes(outcome, np.zeros(2), np.ones(2), 1e-4, 1e-6)


def test_slopes_where_one_leaves():
    """Two collide while another one leaves a wall, of which they know nothing."""

    def ended(changes):
        places = [(0.0, 0.1), (0.25, 0.3), (0.56, 0.3), (5.0, 5.0)]
        speeds = [(0.0, changes[0] - 1.0), (1.0 + changes[1], 0.0), (-1.0, 0.0), (0.0, 0.0)]
        bodies = [*spheres(0.1, 1.0, places, speeds), jc.Plane([0.0, 0.0], [0.0, 1.0])]
        run = jc.simulate(jc.Scene(bodies, LAW, stiffness=1e4), 0.2, max_cluster=3)
        return run.position[-1], run.impacts.time[1], run.impacts.duration[1]

    (_, time, lasts), slopes = jax.jvp(ended, ((0.0, 0.0),), ((1.0, 0.0),))
    assert np.abs(slopes[0][1:]).max() <= 1e-9
    beside = central(lambda h: float(ended((h, 0.0))[0][0, 1]), 1e-4)
    assert slopes[0][0, 1] == pytest.approx(beside, rel=1e-6)
    # Both begin and last by the closing speed v = 2, as 1/v and v^(-1/5).
    slopes = jax.jvp(ended, ((0.0, 0.0),), ((0.0, 1.0),))[1]
    np.testing.assert_allclose(np.array(slopes[1:]), np.array([-time / 2, -lasts / 10]), rtol=1e-8)


def test_one_of_many_lies_on_the_floor():
    places = [(0.1 + 0.2 * (k % 4), 0.3 * (1 + k // 4) if k else 0.05) for k in range(12)]
    bodies = [*spheres(0.05, 1.0, places), jc.Box([0.0, 0.0], [0.8, 3.0])]
    scene = jc.Scene(bodies, LAW, stiffness=1e6, gravity=[0, -9.81])
    assert jc.simulate(scene, 0.05).status == jc.Ending.COMPLETED


def test_two_touch_in_a_corner():
    places = [(1.0, 0.3), (1.4, 0.5), (1.2, 1.0), (0.6, 1.2)]
    places += [(1.7, 1.3), (0.3, 1.7), (1.0, 1.6), (1.6, 1.9)]
    balls = [Ball([0.35, 0.36], [-1.0, -0.9], 0.1, 1.0), Ball([0.11, 0.3], [0.0, 0.0], 0.1, 2.0)]
    balls += [
        Ball(list(place), [0.3 * (-1) ** k, 0.2 * (-1) ** (k // 2)], 0.1, 1 + 0.1 * k)
        for k, place in enumerate(places)
    ]
    agrees(balls, 2, 1e6, [0.07, 0.6], 1.4, WALLS, max_cluster=5)


@pytest.mark.slow(reason="a soft periodic scene of its own")
def test_three_meet_across_the_edges_of_a_small_cell():
    """They span more than half a period, and each pair meets in its own images."""
    random, period = np.random.default_rng([9, 0]), 0.8
    radius, mass = random.uniform(0.08, 0.12, 3), 10 ** random.uniform(-0.3, 0.5, 3)
    places: list[np.ndarray] = []
    while len(places) < 3:
        place, k = random.uniform(0, period, 2), len(places)
        away = [place - other for other in places]
        gaps = [np.linalg.norm(x - period * np.round(x / period)) for x in away]
        if all(gap > radius[k] + radius[i] + 0.005 for i, gap in enumerate(gaps)):
            places.append(place)
    velocity = random.normal(0, 1.5, (3, 2))
    balls = [Ball(places[k].tolist(), velocity[k].tolist(), radius[k], mass[k]) for k in range(3)]
    stiffness = 10 ** random.uniform(5, 7)
    exact = run(balls, Spring(stiffness, alpha=ALPHA), 0.7, period=period)
    scene = jc.Scene(bodies_of(balls), LAW, stiffness=stiffness, periodic=[period, period])
    found = jc.simulate(scene, 0.7, rtol=RTOL)
    assert found.status == jc.Ending.COMPLETED
    assert len(found.impacts) == len(exact.touches) >= 3
    assert jc.SolvedBy.COUPLED in np.asarray(found.impacts.solved_by)
    # A change of the start grows about seven thousandfold.
    assert np.abs(found.velocity[-1] - exact.velocity).max() <= 100 * RTOL
    away = found.position[-1] - exact.position
    assert np.abs(away - period * np.round(away / period)).max() <= 100 * RTOL


RING = 6.0
STIFFNESS, DURATION = 1e5, 0.3
MASS = np.array([1.0, 2.0, 0.5, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0])

# The first hits the second, which touches the third across the border. Two others meet separately
# before this has ended.
PLACES = np.array([5.749, 5.95, 6.1501, 1.0, 1.21, 2.0, 3.0, 4.0, 5.0])
SPEEDS = np.array([1.0, 0.0, 0.0, 0.6, 0.1, 0.0, 0.0, 0.0, 0.0])
RADII = np.full(9, 0.1)
WRAPPED = np.where(np.arange(9) == 2, RING, 0.0)
"""The third one is given on the other side of the face."""


def around(numbers):
    """The end of a run, of places, speeds and radii; and its status and impacts."""
    places, speeds, radii = numbers.reshape(3, 9)
    discs = in_a_line(radii, MASS, places - WRAPPED, speeds)
    scene = jc.Scene(discs, LAW, stiffness=STIFFNESS, periodic=[RING])
    how = {"rtol": 1e-10, "max_impacts": 8, "max_cluster": 4, "throw": False}
    run = jc.simulate(scene, DURATION, **how)
    return ended(run), (run.status, run.impacts)


@pytest.mark.slow(reason="derivatives of coupled solves")
def test_values_and_derivatives_across_a_border():
    numbers = np.concatenate([PLACES, SPEEDS, RADII])
    # A change of all numbers that is far below an indentation.
    status, impacts = check_modes(around, numbers, np.ones(27), 1e-6, 1e-6)
    assert status == jc.Ending.COMPLETED
    hits, touched = impacts.to_dict(), []
    ways = [jc.SolvedBy.CLOSED_FORM, jc.SolvedBy.COUPLED, jc.SolvedBy.COUPLED]
    assert sorted(hits["solved_by"]) == ways
    places, speeds = np.asarray(around(numbers)[0]).reshape(2, 9)
    for who in ([0, 1, 2], [3, 4]):
        balls = [Ball([PLACES[k]], [SPEEDS[k]], RADII[k], MASS[k]) for k in who]
        known = run(balls, Spring(STIFFNESS, alpha=ALPHA), DURATION)
        touched += [touch.begin for touch in known.touches]
        np.testing.assert_allclose((places + WRAPPED)[who], known.position[:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(speeds[who], known.velocity[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(touched), rtol=0, atol=1e-9)
    assert max(touched) < 0.03


@pytest.mark.slow(reason="the same scene of coupled solves")
def test_three_that_span_more_than_half_of_the_ring_are_refused():
    radii, places = RADII.copy(), [2.79, 4.0, 5.2 + RING, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8]
    radii[:3] = 0.6
    end, (status, _) = around(np.concatenate([places, np.eye(9)[0], radii]))
    assert np.all(np.isnan(end)) and status == jc.Ending.CROWDED
