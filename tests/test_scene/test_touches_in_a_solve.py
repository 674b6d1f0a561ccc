"""Touches during a coupled solve of other bodies: their slopes, and a bound that does not hold."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import fourth, spheres

LAW = jc.Damped(alpha=0.5)


def check_slopes(ended, forces, atol):
    """Beside finite differences, of a function whose last results are so many forces."""
    slopes = np.asarray(jax.jvp(ended, (0.0,), (1.0,))[1])
    beside = fourth(lambda h: np.asarray(ended(h)), 1e-3)
    np.testing.assert_allclose(slopes[:-forces], beside[:-forces], atol=atol)
    # The largest force is found between two steps; its slopes reach 27.
    np.testing.assert_allclose(slopes[-forces:], beside[-forces:], atol=1e-3)


def test_slopes_of_a_touch_in_a_running_solve():
    """Two bounce and meet obliquely, with friction, while a heavy one is in the floor."""

    def ended(change):
        places = [(1.0, 0.12), (1.224, 0.326), (0.0, 0.11), (3.0, 5.0)]
        speeds = [(1.0, change - 2.1), (-0.3, 0.0), (change, -1.0), (0.0, 0.0)]
        discs = spheres(0.1, [0.3, 0.3, 40.0, 40.0], places, speeds)
        ways = {"stiffness": 1e4, "friction": jc.SpringSlider(0.3, 0.8), "gravity": [0.0, -9.81]}
        scene = jc.Scene([*discs, jc.Plane([0.0, 0.0], [0.0, 1.0])], LAW, **ways)
        run = jc.simulate(scene, 0.12, max_cluster=3)
        return jnp.concatenate([run.velocity[-1].ravel(), run.impacts.max_force[:3]])

    # Without the derivative of the touch they differ by 7e-5.
    check_slopes(ended, 3, 1e-7)


def test_slopes_of_a_touch_without_tension():
    """The second touch ends a solve; the force jumps, so that v0 ceases to rise with it."""

    def ended(change):
        places, speeds = [(0.0, 0.12), (0.05, 0.33)], [(0.3, -2.0 - change), (0.0, -2.0)]
        bodies = [*spheres(0.1, 0.3, places, speeds), jc.Plane([0.0, 0.0], [0.0, 1.0])]
        law, ways = jc.KelvinVoigt(e=0.5, tension=False), {"stiffness": 3e3, "exponent": 1.0}
        run = jc.simulate(jc.Scene(bodies, law, gravity=[0.0, -9.81], **ways), 0.1)
        hits = run.impacts
        return jnp.concatenate([run.velocity[-1].ravel(), hits.duration[:2], hits.max_force[:2]])

    check_slopes(ended, 2, 1e-8)


def test_slopes_of_work_where_a_force_jumps():
    """With adhesion a touch pulls at once at the moving floor, on which a heavy one is."""

    def ended(change):
        places, speeds = [(0.0, 0.11), (1.0, 0.131), (3.0, 5.0)], [(0.0, -1.0), (0.0, change - 1.0)]
        discs = spheres(0.1, [40.0, 0.2, 1.0], places, [*speeds, (0.0, 0.0)])
        floor = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Vibration(0.004, 30.0))
        scene = jc.Scene([*discs, floor], jc.JKR(pull_off=0.5), stiffness=1e4)
        run = jc.simulate(scene, 0.1, max_cluster=2)
        work = run.wall_work[None]
        return jnp.concatenate([run.velocity[-1].ravel(), work, run.impacts.max_force[:2]])

    # With the pull before the touch the work differs by 6e-3, of .3.
    check_slopes(ended, 2, 1e-6)


def test_slopes_of_two_touches_at_once():
    """A disc meets two in the same moment. By its shift the mirror image moves the other way."""

    def ended(shift):
        places = [(0.0, 1.0 + shift), (0.25, 1.101), (0.25, 0.899), (2.0, 0.1)]
        speeds = [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, -1.0)]
        discs = spheres(0.1, [0.3, 0.3, 0.3, 30.0], places, speeds)
        scene = jc.Scene([*discs, jc.Plane([0.0, 0.0], [0.0, 1.0])], LAW, stiffness=1e4)
        run = jc.simulate(scene, 0.15)
        return run.velocity[-1, :3], run.impacts.time[1:]

    (velocity, time), slopes = jax.jvp(ended, (0.0,), (1.0,))
    assert time[0] == time[1]
    mirrored = np.array([1.0, -1.0]) * np.asarray(velocity)[[0, 2, 1]]
    np.testing.assert_allclose(velocity, mirrored, atol=1e-9)
    velocity, time = map(np.asarray, slopes)
    # With the v0 of the first touch for both, they differ by a hundredth.
    np.testing.assert_allclose(velocity, np.array([-1.0, 1.0]) * velocity[[0, 2, 1]], atol=1e-7)
    assert velocity[1, 0] > 1 and time[0] == pytest.approx(-time[1], rel=1e-9)


def test_squeezed_past_the_bound():
    """A light disc between a rising floor and a fixed disc is faster than twice the floor."""
    place = np.array([1.1 * np.sin(0.1), 2 - 1.1 * np.cos(0.1)])
    floor = jc.Plane([0.0, place[1] - 0.101], [0.0, 1.0], motion=jc.Steady([0.0, 1.0]))
    fixed = [(1.0, [0.0, 2.0]), (0.1, place + np.array([0.218, 0.0]))]
    bodies = [jc.Sphere(radius, None, at, fixed=True) for radius, at in fixed]
    bodies += spheres(0.1, 0.01, [place.tolist(), [30.0, 5.0]])
    scene = jc.Scene([*bodies, floor], LAW, stiffness=1e7)
    few, all = (jc.simulate(scene, 0.01, max_cluster=most, throw=False) for most in (3, 4))
    assert (few.status, all.status) == (jc.Ending.CROWDED, jc.Ending.COMPLETED)
    assert len(all.impacts.to_dict()["time"]) > 3
