"""The inside of a sphere: chords, parabolas, and soft impacts against Newton's equations."""

import math

import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.shaken_spheres import pressed, sine
from tests.test_scene.support import go, missing

EXACT = 1e-12  # of 50 chords; measured 3e-13
SOFT = 1e-8  # ten times `rtol`
SLIDING = 1e-9  # in m and m/s after 5 s and some 1e4 steps; measured 1e-11
PEAK = 1e-10  # in m and m/s, a tenth of `rtol`: measured 3e-12

RUBBER = jc.Material(4.1e3, 0.3, 1100.0)


def test_a_billiard_in_a_circle():
    """All chords are alike: the place of the touch turns by the same angle every time."""
    speed, angle, reach = 2.0, 0.4, 0.9
    # The first touch at angle 0, after leaving the foot of the first chord.
    chord = 2 * reach * math.cos(angle)
    start = np.array([reach, 0.0]) - np.array([math.cos(angle), math.sin(angle)]) * chord / 2
    ball = jc.Sphere(0.1, 1.0, start, [speed * math.cos(angle), speed * math.sin(angle)])
    scene = jc.Scene([ball, jc.Shell([0.0, 0.0], 1.0)], jc.ExactRestitution(e=1.0))
    touches = 50
    time = chord / speed
    run = go(scene, (touches + 0.25) * time)
    assert len(run.impacts) == touches
    np.testing.assert_allclose(run.impacts.time, time * (np.arange(touches) + 0.5), rtol=EXACT)
    at = run.at(run.impacts.time[-1]).position[0, 0]
    turn = (math.pi - 2 * angle) * (touches - 1)
    np.testing.assert_allclose(at, reach * np.array([math.cos(turn), math.sin(turn)]), atol=EXACT)
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=EXACT)


STIFFNESS, ALPHA, MASS, SMALL, LARGE = 1e5, 0.4, 1.0, 0.1, 1.0
REACH = LARGE - SMALL
SOCKET = jc.Contact.sphere_socket(SMALL, LARGE, RUBBER, RUBBER, mass=MASS)


def in_a_shell(position, velocity=None, *, law=None, stiffness=STIFFNESS, gravity=None, of=None):
    """A soft ball in a shell, both `of` a material if there is no stiffness."""
    pull = None if gravity is None else [0.0, -gravity]
    bodies = [jc.Sphere(SMALL, MASS, position, velocity, of), jc.Shell([0.0, 0.0], LARGE, of)]
    return jc.Scene(bodies, law or jc.Damped(alpha=ALPHA), stiffness=stiffness, gravity=pull)


def newton(position, velocity, gravity, duration, stiffness=STIFFNESS, alpha=ALPHA, **how):
    """Its Cartesian equations, restarted at the touch and at the opening."""
    shell = sine([0.0, 0.0], [0.0, 0.0], 0.0, 0.0, -REACH)
    pull, more = [0.0, -gravity], {"most": 2e-4} | how
    return pressed([shell], position, velocity, pull, stiffness, alpha, duration, **more)[-1]


@pytest.mark.slow(reason="soft scenes with a shell")
@pytest.mark.parametrize(
    ("gravity", "way"), [(0.0, jc.SolvedBy.RADIAL), (9.81, jc.SolvedBy.COUPLED)]
)
def test_soft_impacts_in_a_shell(gravity, way):
    position, velocity, duration = [0.3, 0.1], [1.5, 1.2], 0.8
    run = jc.simulate(in_a_shell(position, velocity, gravity=gravity), duration, v0="touch")
    assert len(run.impacts) >= 1
    assert run.impacts.solved_by[0] == way
    end = newton(position, velocity, gravity, duration)
    fastest = np.max(run.impacts.closing_speed)
    np.testing.assert_allclose(run.velocity[-1, 0], end[2:], atol=SOFT * fastest)
    np.testing.assert_allclose(run.position[-1, 0], end[:2], atol=SOFT * fastest * duration)
    assert missing(run) < 100 * 1e-9 * run.energy[0]
    inside = run.at(run.impacts.time[0] + run.impacts.duration[0] / 2)
    assert np.linalg.norm(inside.position[0, 0]) > REACH
    if way == jc.SolvedBy.RADIAL:
        # Pressed to the shell, the line of centres rotates backwards as seen from the ball.
        assert run.impacts.turn[0] < 0


def test_what_passes_along_a_shell_closes_faster_at_first():
    """v0 is the peak, which is no longer the speed at touch."""
    position, duration, stiffness = [0.3, 0.1], 0.6, float(SOCKET.stiffness)
    for velocity in ([0.3, 1.9], [1.9, -0.1]):
        run = jc.simulate(in_a_shell(position, velocity, stiffness=None, of=RUBBER), duration)
        assert run.status == jc.Ending.COMPLETED
        assert list(run.impacts.solved_by) == [jc.SolvedBy.COUPLED]
        end = newton(position, velocity, 0.0, duration, stiffness, peak=True)
        np.testing.assert_allclose(run.position[-1, 0], end[:2], atol=PEAK)
        np.testing.assert_allclose(run.velocity[-1, 0], end[2:], atol=PEAK)
        touch = newton(position, velocity, 0.0, duration, stiffness)
        assert np.abs(touch - end).max() > 1e4 * PEAK


@pytest.mark.slow(reason="a long slide")
def test_a_ball_that_slides_in_a_shell_for_longer_than_one_solve():
    """At most 4096 steps are one call: the next one goes on from there."""
    e, stiffness, duration = 0.5, 1e8, 5.0
    start = REACH * np.array([np.sin(0.6), -np.cos(0.6)])
    scene = in_a_shell(start, law=jc.HuGuo(e=e), stiffness=stiffness, gravity=9.81)
    run = jc.simulate(scene, duration, rtol=1e-8)
    assert run.status == jc.Ending.COMPLETED
    assert np.sum(run._record.calls) >= 3
    # From rest at touch δ' rises to its peak, which is v0 from then on.
    alpha, inside = 1.5 * (1 - e) / e, (1 - 1e-15) * start
    end = newton(inside, [0.0, 0.0], 9.81, duration, stiffness, alpha, peak=True)
    np.testing.assert_allclose(run.velocity[-1, 0], end[2:], atol=SLIDING)
    np.testing.assert_allclose(run.position[-1, 0], end[:2], atol=SLIDING)


def test_materials_make_the_contact_of_a_ball_in_a_socket():
    run = jc.simulate(in_a_shell([0.3, 0.1], [0.3, 0.1], stiffness=None, of=RUBBER), 3.0)
    single = jc.impact(jc.Damped(alpha=ALPHA), SOCKET, np.hypot(0.3, 0.1))
    np.testing.assert_allclose(run.impacts.max_force[0], single.max_force, rtol=1e-12)
    np.testing.assert_allclose(run.impacts.duration[0], single.duration, rtol=1e-12)


def test_a_ball_must_fit_into_its_shell():
    with pytest.raises(ValueError, match=r"Sphere .* and Shell 'bowl' .* do, by 0\.1 m"):
        jc.Scene([jc.Sphere(0.1, 1.0, [0.5]), jc.Shell([0.0], 0.5, name="bowl")], jc.Hertz())
    with pytest.raises(ValueError, match="`periodic` must be None beside Shell"):
        jc.Scene([jc.Sphere(0.1, 1.0, [0.0]), jc.Shell([0.0], 0.5)], jc.Hertz(), periodic=[9.0])
