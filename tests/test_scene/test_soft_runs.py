"""Whole runs with impacts of finite duration, against Newton's equations with restarts."""

import functools

import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.scene_oracle import Ball, Spring, Wall, run

K = 1e6
"""In N/m^1.5: a contact of two balls of 1 kg at 1 m/s lasts about 0.01 s."""

BELOW = Wall([0.0, -0.5], [0.0, 1.0])
FAR = Wall([-9.0, 0.0], [1.0, 0.0])
CORNER = [Wall([0.0, 0.0], [1.0, 0.0]), Wall([0.0, 0.0], [0.0, 1.0])]

# To share a compiled program, two scenes are padded to the same shape with a distant body.
RUNS = {
    # Unequal balls, some so close that their impacts overlap.
    "line": (
        [
            Ball([0.0], [1.0], 0.1, 1.0),
            Ball([0.3], [0.0], 0.1, 2.0),
            Ball([0.5001], [0.0], 0.1, 0.5),
            Ball([0.7002], [0.0], 0.1, 3.0),
            Ball([1.2], [-0.5], 0.1, 1.0),
        ],
        [],
        None,
        0.5,
        1.0,
    ),
    # Two unequal balls that pass each other, and a wall for the one that flies on.
    "oblique": (
        [Ball([0.0, 0.0], [1.0, 0.0], 0.1, 1.0), Ball([0.5, 0.12], [-0.5, 0.1], 0.1, 2.0)],
        [BELOW, FAR],
        None,
        1.0,
        0.8,
    ),
    "corner": (
        [Ball([0.5, 0.5], [-1.0, -1.0], 0.1, 1.0), Ball([9.0, 9.0], [0.0, 0.0], 0.1, 1.0)],
        CORNER,
        None,
        0.5,
        0.8,
    ),
    # Under its weight; the third contact is permanent.
    "floor": ([Ball([0.15], [0.0], 0.1, 1.0)], [Wall([0.0], [1.0])], [-9.81], 1.5, 0.3),
    # The weight acts from the touch on, so v0 is slightly larger than the speed at touch.
    "bounces": ([Ball([0.6], [0.0], 0.1, 1.0)], [Wall([0.0], [1.0])], [-9.81], 0.9, 1.6),
}


def scene_of(name):
    balls, walls, gravity, alpha, _ = RUNS[name]
    bodies = [jc.Sphere(b.radius, b.mass, b.position, b.velocity) for b in balls]
    bodies += [jc.Plane(w.point, w.normal) for w in walls]
    return jc.Scene(bodies, jc.Damped(alpha=alpha), stiffness=K, gravity=gravity)


@functools.cache
def reference(name):
    balls, walls, gravity, alpha, duration = RUNS[name]
    return run(balls, Spring(K, alpha=alpha), duration, walls, gravity)


@pytest.mark.slow(
    "bounces-1e-06", "line-1e-06", "oblique-1e-06", reason="the run once more at another tolerance"
)
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
@pytest.mark.parametrize("name", RUNS)
def test_runs_end_where_newtons_equations_do(name, rtol):
    balls, _, _, _, duration = RUNS[name]
    exact, found = reference(name), jc.simulate(scene_of(name), duration, rtol=rtol)
    assert found.status == jc.Ending.COMPLETED
    speed = max(np.abs(b.velocity).max() for b in balls) or 1.0
    assert np.abs(found.velocity[-1] - exact.velocity).max() <= 10 * rtol * speed
    assert np.abs(found.position[-1] - exact.position).max() <= 10 * rtol * speed * duration
    hits = found.impacts.to_dict()
    began = np.array([touch.begin for touch in exact.touches])
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(began), atol=10 * rtol * duration)
    over = np.array([touch.end is not None for touch in exact.touches])
    if len(set(began)) == len(began):
        order = np.argsort(hits["time"])
        lost = np.array([touch.lost for touch in exact.touches])[np.argsort(began)]
        over = over[np.argsort(began)]
        loss = hits["energy_loss"][order]
        np.testing.assert_allclose(loss[over], lost[over], atol=10 * rtol)


@pytest.mark.parametrize("name", ["line", "oblique", "corner"])
def test_what_is_lost_is_what_is_missing(name):
    # A little later no contact continues.
    found = jc.simulate(scene_of(name), RUNS[name][-1] + 0.05)
    missing = found.energy[0] - found.energy[-1]
    lost = found.impacts.to_dict()["energy_loss"].sum()
    np.testing.assert_allclose(missing, lost, atol=1e-7 * float(found.energy[0]))
