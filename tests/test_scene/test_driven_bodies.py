"""Fixed spheres and shells that move as they are told, unaffected by impacts."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.shaken_spheres import bounces, circling, pressed, sine
from tests.test_scene.support import check_modes, go, in_a_line, missing, spheres

FRAME = 1e-13  # what a moving frame changes but for rounding: measured 3e-15
SOFT = 1e-8  # ten times `rtol`: measured 4e-12
EXACT = 1e-11  # ten impacts, whose errors grow: measured 1.5e-13 in a plane
BALANCE = 1e-12  # of energies: measured 4e-14


def _seen_from(velocity):
    """A ball, a fixed disc and a bowl, seen from a frame in which the last two have a velocity."""
    motion = jc.Steady(velocity)
    bodies = [
        jc.Sphere(0.1, 1.0, [0.0, 0.03], np.array([1.0, 0.0]) + velocity),
        jc.Sphere(0.15, None, [1.0, 0.0], fixed=True, motion=motion),
        jc.Shell([0.3, 0.0], 1.0, motion=motion),
    ]
    return jc.Scene(bodies, jc.HuGuo(e=0.7), stiffness=1e6)


@pytest.mark.slow(reason="a soft scene of its own, with and without the frame's motion")
def test_isolated_impacts_on_driven_bodies_do_not_know_the_frame():
    """Others: beside references, below."""
    velocity, duration = np.array([-0.3, 0.1]), 3.5
    # In the bowl the largest closing speed is a coupled solve.
    still = jc.simulate(_seen_from(0 * velocity), duration, v0="touch")
    run = jc.simulate(_seen_from(velocity), duration, v0="touch")
    assert len(run.impacts) == len(still.impacts) >= 2
    assert np.all(run.impacts.solved_by == jc.SolvedBy.RADIAL)
    shift = velocity[None] * duration
    np.testing.assert_allclose(run.position[-1], still.position[-1] + shift, atol=FRAME)
    np.testing.assert_allclose(run.velocity[-1, 0], still.velocity[-1, 0] + velocity, atol=FRAME)
    np.testing.assert_allclose(run.velocity[-1, 1], velocity, rtol=1e-15)
    assert abs(run.wall_work) > 0.1 and abs(still.wall_work) < 1e-12
    assert missing(run) < 100 * 1e-9 * run.energy[0]


def under_a_piston(law, place, speed, pull, gap=0.0):
    """Two balls on an axis over a floor, and a piston that comes down from its place."""
    piston = jc.Sphere(0.1, None, [place], fixed=True, motion=jc.Steady([-speed]), name="piston")
    balls = [jc.Sphere(0.1, 2.0, [0.1001]), jc.Sphere(0.1, 1.0, [0.3001 + gap])]
    bodies = [*balls, piston, jc.Plane([0.0], [1.0])]
    scene = jc.Scene(bodies, law, stiffness=1e6, gravity=[-pull])
    return jc.simulate(scene, 1.4, times=[1.2, 1.4])


def test_nothing_sleeps_where_something_comes():
    """Two balls at rest on each other, and a piston that comes down on them."""
    speed, start = 0.1, 0.63
    run = under_a_piston(jc.HuGuo(e=0.3), start, speed, 9.81)
    assert run.status == jc.Ending.COMPLETED
    touch = run.impacts.time[np.asarray(run.impacts.second) == 2][0]
    # By statics the upper ball is at 0.3 m minus the indentations of both contacts.
    high = 0.3 - (3 * 9.81 / 1e6) ** (2 / 3) - (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(touch, (start - 0.2 - high) / speed, atol=SOFT / speed)
    np.testing.assert_allclose(run.velocity[0, :2, 0], 0, atol=SOFT)
    assert np.min(run.velocity[1, :2, 0]) < 0


def test_a_racket():
    """A ball at rest leaves at (1 + e) times the speed of what hits it."""
    law, speed = jc.HuGuo(e=0.7), 0.02
    # A pull that moves nothing, so that the scenes share their program.
    run = under_a_piston(law, 0.61, speed, 1e-12, gap=0.1)
    gained = (1 + float(jc.restitution(law))) * speed
    np.testing.assert_allclose(run.impacts.closing_speed[0], speed, rtol=SOFT)
    np.testing.assert_allclose(run.velocity[0, 1, 0], -gained, rtol=SOFT)
    np.testing.assert_allclose(run.wall_work, 1.0 * gained * speed, rtol=SOFT)


@pytest.mark.slow(reason="a scene with cells and driven bodies")
@pytest.mark.parametrize("motion", [jc.Steady([1.0, 0.0]), jc.Vibration([12.0, 0.0], 0.02)])
def test_a_driven_disc_goes_through_all_cells(motion):
    """It meets what lies on its way, wherever that was when the run began; out of reach of its row
    there are so many discs, or too few, that there are cells, or none.
    """
    driven = jc.Sphere(0.1, None, [-1.0, 2.1], fixed=True, motion=motion)
    near = [[float(x), float(y)] for x in range(20) for y in range(5)]
    far = [[float(x), float(-y)] for x in range(20) for y in range(4, 13)]

    def impacts(places):
        discs = spheres(0.1, 1.0, places)
        return go(jc.Scene([*discs, driven], jc.ExactRestitution(e=0.5)), 6.0).impacts

    among_few, among_many = impacts(near), impacts(near + far)
    assert len(among_few) > 10
    np.testing.assert_allclose(among_many.time, among_few.time, rtol=1e-12)


CIRCLE, SWING, PHASE = 3.0, 7.0, 0.4
START, PULL, DURATION, E = [0.5, 0.1], [0.0, -2.0], 2.0, 0.8


def ellipse(t, args):
    """Around a circle of the radius that is given, or along its diagonal if `ahead` is 0."""
    angle = 2 * jnp.pi * CIRCLE * t
    return args["radius"] * jnp.stack([jnp.sin(angle + args["ahead"]), jnp.sin(angle)])


MOST = 0.05 * (2 * np.pi * CIRCLE) ** 2  # the acceleration of either axis


def bowl(velocity, radius, amplitude, bound=1.001 * MOST, ahead=np.pi / 2, **how):
    """A ball in a shell that shakes, around a disc that goes in a circle."""
    disc = jc.Prescribed(ellipse, bound, {"radius": radius, "ahead": ahead})
    return jc.Scene(
        bodies=[
            jc.Sphere(0.05, 1.0, START, velocity),
            jc.Sphere(0.2, None, [0.0, 0.0], fixed=True, motion=disc),
            jc.Shell([0.0, 0.02], 1.0, motion=jc.Vibration(amplitude, SWING, PHASE)),
        ],
        gravity=PULL,
        **({"law": jc.ExactRestitution(e=E)} | how),
    )


def movers(radius, amplitude):
    disc = circling([0.0, 0.0], radius, CIRCLE, 0.25)
    return disc, sine([0.0, 0.02], amplitude, SWING, PHASE, -0.95)


def test_a_ball_between_a_shell_that_shakes_and_a_disc_in_a_circle():
    seen, amplitude = 0, [0.03, 0.02]
    disc = movers(0.05, amplitude)[0]
    for velocity in ([1.2, -0.4], [-1.5, 0.3], [-2.0, -0.2], [0.1, 0.0]):
        run = go(bowl(velocity, 0.05, amplitude), DURATION)
        known = bounces(list(movers(0.05, amplitude)), START, velocity, PULL, E, DURATION)
        assert run.status == jc.Ending.COMPLETED
        seen += len(known.touches)
        np.testing.assert_allclose(run.impacts.time, known.touches[:, 0], rtol=EXACT)
        np.testing.assert_allclose(run.impacts.closing_speed, known.touches[:, 1], atol=EXACT)
        assert np.all(np.asarray(run.impacts.second) - 1 == known.touches[:, 2])
        np.testing.assert_allclose(run.position[-1, 0], known.position, atol=EXACT)
        np.testing.assert_allclose(run.velocity[-1, 0], known.velocity, atol=10 * EXACT)
        np.testing.assert_allclose(run.wall_work, known.work, atol=10 * EXACT)
        assert missing(run) < BALANCE * run.energy[0]
        np.testing.assert_allclose(run.position[-1, 1], disc.place(DURATION), atol=1e-15)
        np.testing.assert_allclose(run.velocity[-1, 1], disc.velocity(DURATION), atol=1e-14)
        # From halfway on all of them continue as before.
        half = go(run.scene, DURATION / 2)
        rest = go(half.final, DURATION / 2)
        np.testing.assert_allclose(rest.position[-1], run.position[-1], atol=EXACT)
        np.testing.assert_allclose(half.wall_work + rest.wall_work, run.wall_work, atol=EXACT)
    assert seen == 15


@pytest.mark.slow(reason="a soft scene with driven shells")
def test_a_soft_ball_between_a_shell_that_shakes_and_a_disc_in_a_circle():
    velocity, amplitude, law, duration = [-1.5, 0.3], [0.03, 0.02], jc.HuGuo(e=0.7), 1.6
    scene = bowl(velocity, 0.05, amplitude, law=law, stiffness=1e6)
    # The second one falls into the first contact, which takes 0.012 s from 0.2222 s on.
    times = np.array([0.1, 0.2275, 0.5, duration])
    run = jc.simulate(scene, duration, times=times, v0="touch")
    assert run.status == jc.Ending.COMPLETED
    assert len(run.impacts) >= 2 and {1, 2} == set(np.asarray(run.impacts.second).tolist())
    assert np.all(run.impacts.solved_by == jc.SolvedBy.COUPLED)
    assert run.impacts.time[0] < times[1] < run.impacts.time[0] + run.impacts.duration[0]
    both, numbers = movers(0.05, amplitude), (1e6, float(law.damping_factor()), duration)
    known = pressed(list(both), START, velocity, PULL, *numbers, times[:-1])
    fastest = np.max(run.impacts.closing_speed)
    np.testing.assert_allclose(run.position[:, 0], known[:, :2], atol=SOFT * fastest)
    np.testing.assert_allclose(run.velocity[:, 0], known[:, 2:], atol=SOFT * fastest)
    np.testing.assert_allclose(run.position[:, 1], both[0].place(times), atol=1e-15)
    np.testing.assert_allclose(run.velocity[:, 1], both[0].velocity(times), atol=1e-14)
    before = 0.5 * np.sum(np.square(velocity)) - np.dot(PULL, START)
    lost = np.sum(run.impacts.energy_loss)
    assert abs(before + run.wall_work - lost - run.energy[-1]) < 10 * SOFT * before
    assert abs(run.wall_work) > 0.1 * before


def _end(numbers):
    scene = bowl(numbers[:2], numbers[2], numbers[3:])
    run = go(scene, 1.0, max_impacts=8)
    return jnp.concatenate([run.position[-1, 0], run.velocity[-1, 0], run.wall_work[None]])


@pytest.mark.slow(reason="derivatives of a scene with driven bodies")
@pytest.mark.parametrize("velocity", [(-1.5, 0.3), (1.2, -0.4)])
def test_derivatives_by_the_motion_of_spheres_and_shells(velocity):
    numbers = np.array([*velocity, 0.05, 0.03, 0.02])
    check_modes(lambda numbers: (_end(numbers), None), numbers, numbers, 1e-5, 1e-6)


def test_a_sphere_that_exceeds_its_acceleration_is_flagged():
    """Its bound is that of the vector: each axis alone keeps it."""

    def run(bound):
        scene = bowl([1.2, -0.4], 0.05, [0.03, 0.02], bound * MOST, ahead=0.0)
        return go(scene, DURATION, throw=False)

    assert run(1.42).status == jc.Ending.COMPLETED
    wrong, rate = run(1.2), 2 * np.pi * CIRCLE
    assert wrong.status == jc.Ending.WALL_TOO_ABRUPT
    assert abs(np.sqrt(2) * np.sin(rate * wrong.reached) - 1.2) < 2 * rate * DURATION / 4096
    assert np.all(np.isnan(wrong.position[-1]))


def test_a_sphere_that_shakes_into_another_at_the_start_is_refused():
    """It starts where its motion has it, not at the place that it moves about."""

    def scene(phase):
        motion = jc.Vibration([-0.1], 1.0, phase)
        shaken = jc.Sphere(0.1, None, [0.25], fixed=True, motion=motion)
        return jc.Scene([*in_a_line(0.1, 1.0, [0.0], [0.0]), shaken], jc.Hertz())

    assert scene(-np.pi / 2).spheres[1].position == 0.25
    with pytest.raises(ValueError, match=r"must not overlap at the start.*by 0\.05 m"):
        scene(np.pi / 2)
