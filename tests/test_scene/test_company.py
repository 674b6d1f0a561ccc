"""Coupled solves of some of many spheres, and across periodic faces: against Newton's equations."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.oracle.scene_oracle import Ball, Spring, Wall, run

RTOL = 1e-6
ALPHA = 0.5


def followed(balls, stiffness, duration, walls=(), **options):
    bodies = [jc.Sphere(b.radius, b.mass, b.position, b.velocity) for b in balls]
    bodies += [jc.Plane(w.point, w.normal) for w in walls]
    periodic = options.pop("periodic", None)
    scene = jc.Scene(bodies, jc.Damped(alpha=ALPHA), stiffness=stiffness, periodic=periodic)
    return jc.simulate(scene, duration, rtol=RTOL, **options)


def agrees(found, exact, speed=1.0):
    assert found.status == jc.Ending.COMPLETED
    assert np.abs(found.velocity[-1] - exact.velocity).max() <= 10 * RTOL * speed
    assert np.abs(found.position[-1] - exact.position).max() <= 10 * RTOL * speed * exact.time
    hits = found.impacts.to_dict()
    touched = [touch.begin for touch in exact.touches]
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(touched), atol=10 * RTOL * exact.time)
    # What is estimated is neither missing nor far off.
    assert np.all((hits["error_estimate"] > 0) & (hits["error_estimate"] < 10 * RTOL))


def line():
    """Twelve unequal ones with gaps of some 1e-4 m; a wave of a few contacts runs through them."""
    rng = np.random.default_rng(1)
    mass = rng.uniform(0.5, 3, 12)
    place = np.cumsum(np.full(12, 0.2) + 1e-4 * rng.uniform(0.2, 2, 12))
    return [Ball([place[k]], [float(k == 0)], 0.1, mass[k]) for k in range(12)]


def test_a_line_of_more_spheres_than_a_solve_has_room_for():
    balls, inside, end = line(), 0.0012, 0.03
    found = followed(balls, 1e9, end, times=[inside, end])
    agrees(found, run(balls, Spring(1e9, alpha=ALPHA), end))
    # Inside of several contacts, which are solved again from the call that they belong to.
    middle = run(balls, Spring(1e9, alpha=ALPHA), inside)
    assert np.abs(found.velocity[0] - middle.velocity).max() <= 10 * RTOL
    mass = np.array([ball.mass for ball in balls])
    kinetic = mass @ np.square(middle.velocity[:, 0]) / 2
    assert found.energy[0] > kinetic + 1e-3


def test_two_touch_in_a_corner_among_ten():
    places = [(1.0, 0.3), (1.4, 0.5), (1.2, 1.0), (0.6, 1.2)]
    places += [(1.7, 1.3), (0.3, 1.7), (1.0, 1.6), (1.6, 1.9)]
    balls = [Ball([0.35, 0.36], [-1.0, -0.9], 0.1, 1.0), Ball([0.11, 0.3], [0.0, 0.0], 0.1, 2.0)]
    balls += [
        Ball(list(place), [0.3 * (-1) ** k, 0.2 * (-1) ** (k // 2)], 0.1, 1 + 0.1 * k)
        for k, place in enumerate(places)
    ]
    walls = [Wall([0.0, 0.0], [1.0, 0.0]), Wall([0.0, 0.0], [0.0, 1.0])]
    found = followed(balls, 1e6, 0.6, walls)
    agrees(found, run(balls, Spring(1e6, alpha=ALPHA), 0.6, walls), speed=1.4)
    assert np.any(found.impacts.way == jc.Way.COUPLED)


RING = 2.0


def across(speed, wrapped):
    """Three in a row across the face of a ring; the last one from its other side, or unwrapped."""
    last = 2.1001 - (RING if wrapped else 0.0)
    places = [(1.7, speed, 1.0), (1.9, 0.0, 2.0), (last, 0.0, 0.5)]
    return [([place], [v], 0.1, m) for place, v, m in places]


@functools.cache
def ends():
    def of(speed):
        bodies = [
            jc.Sphere(r, m, x, jnp.stack([jnp.asarray(u, float) for u in v]))
            for x, v, r, m in across(speed, True)
        ]
        scene = jc.Scene(bodies, jc.Damped(alpha=ALPHA), stiffness=1e6, periodic=[RING])
        found = jc.simulate(scene, 0.3, rtol=1e-9, max_impacts=4)
        return jnp.concatenate([found.position[-1, :, 0], found.velocity[-1, :, 0]]), found.status

    return jax.jit(lambda speed: jax.jvp(of, (speed,), (jnp.ones_like(speed),)))


def test_a_ring_of_three_touching_balls_and_its_derivative():
    (state, status), (slope, _) = ends()(jnp.asarray(1.0))
    assert status == jc.Ending.COMPLETED

    def exact(speed):
        end = run([Ball(*b) for b in across(speed, False)], Spring(1e6, alpha=ALPHA), 0.3)
        return np.concatenate([end.position[:, 0] - [0, 0, RING], end.velocity[:, 0]])

    np.testing.assert_allclose(state, exact(1.0), atol=1e-8)
    h = 2e-3
    found = (8 * (exact(1 + h) - exact(1 - h)) - (exact(1 + 2 * h) - exact(1 - 2 * h))) / (12 * h)
    np.testing.assert_allclose(slope, found, atol=1e-6)


def test_a_cluster_that_spans_more_than_half_a_period_is_refused():
    balls = [Ball([0.2 * k], [float(k == 0)], 0.1, 1.0) for k in range(3)]
    found = followed(balls, 1e6, 0.3, periodic=[0.7])
    assert found.status == jc.Ending.CROWDED
