"""Fixed spheres and shells that move at a constant velocity, unaffected by impacts."""

import numpy as np
import pytest

import jaxcontact as jc

FRAME = 1e-13
"""What a moving frame changes but for rounding: measured 3e-15."""

STRIKE = 1e-8
"""Ten times `rtol`."""


def _seen_from(velocity, gravity):
    """A ball, a fixed disc and a bowl, seen from a frame in which the last two have a velocity."""
    motion = jc.Steady(velocity)
    return jc.Scene(
        bodies=[
            jc.Sphere(0.1, 1.0, [0.0, 0.03], np.array([1.0, 0.0]) + velocity),
            jc.Sphere(0.15, None, [1.0, 0.0], fixed=True, motion=motion),
            jc.Shell([0.3, 0.0], 1.0, motion=motion),
        ],
        law=jc.HuGuo(e=0.7),
        stiffness=1e6,
        gravity=gravity,
    )


@pytest.mark.slow(reason="two scenes each, with and without the frame's motion")
@pytest.mark.parametrize(
    ("gravity", "instantaneous", "way"),
    [
        ([0.0, -2.0], True, jc.SolvedBy.INSTANTANEOUS),
        ([0.0, -2.0], False, jc.SolvedBy.COUPLED),
        (None, False, jc.SolvedBy.RADIAL),
    ],
)
def test_impacts_on_driven_bodies_do_not_know_the_frame(gravity, instantaneous, way):
    velocity, duration = np.array([-0.3, 0.1]), 3.5
    # In the bowl the largest closing speed is a coupled solve.
    how = {"instantaneous": instantaneous, "v0": "touch" if way == jc.SolvedBy.RADIAL else "peak"}
    given = {"duration": duration, **how}
    still = jc.simulate(_seen_from(0 * velocity, gravity), **given)
    run = jc.simulate(_seen_from(velocity, gravity), **given)
    assert len(run.impacts) == len(still.impacts) >= 2
    assert np.all(run.impacts.solved_by == way)
    shift = velocity[None] * duration
    np.testing.assert_allclose(run.position[-1], still.position[-1] + shift, atol=FRAME)
    np.testing.assert_allclose(run.velocity[-1, 0], still.velocity[-1, 0] + velocity, atol=FRAME)
    np.testing.assert_allclose(run.velocity[-1, 1], velocity, rtol=1e-15)
    lost = np.sum(run.impacts.energy_loss)
    assert abs(run.wall_work) > 0.1
    missing = run.energy[0] + run.wall_work - lost - run.energy[-1]
    assert abs(missing) < 100 * 1e-9 * run.energy[0]
    assert abs(still.wall_work) < 1e-12
    half = jc.simulate(_seen_from(velocity, gravity), 1.0, **how).final
    rest = jc.simulate(half, duration - 1.0, **how)
    np.testing.assert_allclose(rest.position[-1], run.position[-1], atol=FRAME)


def test_nothing_sleeps_where_something_comes():
    """Two balls at rest on each other, and a piston that comes down on them."""
    speed, start = 0.1, 0.63
    piston = jc.Sphere(0.1, None, [start], fixed=True, motion=jc.Steady([-speed]), name="piston")
    balls = [jc.Sphere(0.1, 2.0, [0.1001]), jc.Sphere(0.1, 1.0, [0.3001])]
    floor = jc.Plane([0.0], [1.0])
    scene = jc.Scene([*balls, piston, floor], jc.HuGuo(e=0.3), stiffness=1e6, gravity=[-9.81])
    run = jc.simulate(scene, 1.4, times=[1.2, 1.4])
    assert run.status == jc.Ending.COMPLETED
    touch = [k for k in range(len(run.impacts)) if run.impacts.second[k] == 2]
    # By statics the upper ball is at 0.3 m minus the indentations of both contacts.
    high = 0.3 - (3 * 9.81 / 1e6) ** (2 / 3) - (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(
        run.impacts.time[touch[0]], (start - 0.2 - high) / speed, atol=STRIKE / speed
    )
    np.testing.assert_allclose(run.velocity[0, :2, 0], 0, atol=STRIKE)
    assert np.min(run.velocity[1, :2, 0]) < 0


def test_a_racket():
    """A ball at rest leaves at (1 + e) times the speed of what hits it."""
    racket = jc.Sphere(0.2, None, [-1.0, 0.0], fixed=True, motion=jc.Steady([2.0, 0.0]))
    # The shell is out of reach; it lets the scene share the programs of the one above.
    around = jc.Shell([0.0, 0.0], 50.0, motion=jc.Steady([0.0, 0.0]))
    law = jc.HuGuo(e=0.7)
    scene = jc.Scene([jc.Sphere(0.1, 0.5, [0.0, 0.0]), racket, around], law, stiffness=1e7)
    run = jc.simulate(scene, 1.0)
    e = float(jc.restitution(law))
    np.testing.assert_allclose(run.velocity[-1, 0, 0], (1 + e) * 2.0, rtol=STRIKE)
    np.testing.assert_allclose(run.wall_work, 0.5 * (1 + e) * 2.0 * 2.0, rtol=STRIKE)


def test_what_is_driven_wrongly_is_refused():
    steady = jc.Steady([1.0, 0.0])
    with pytest.raises(ValueError, match="`motion` must be None for a sphere without `fixed=True`"):
        jc.Sphere(0.1, 1.0, [0.0, 0.0], motion=steady)
    with pytest.raises(ValueError, match=r"`motion` must have 1 numbers, as the body has"):
        jc.Sphere(0.1, None, [0.0], fixed=True, motion=steady)
    with pytest.raises(ValueError, match="`motion` of a shell must have a list of numbers as its"):
        jc.Shell([0.0, 0.0], 1.0, motion=jc.Vibration(0.1, 1.0))
    with pytest.raises(ValueError, match="`motion` of a fixed sphere must have a list of numbers"):
        jc.Sphere(0.1, None, [0.0], fixed=True, motion=jc.Prescribed(lambda t, args: t, 1.0))
    with pytest.raises(ValueError, match=r"`motion` must have 2 numbers, as the body has"):
        jc.Shell([0.0, 0.0], 1.0, motion=jc.Vibration([0.1], 1.0))
    with pytest.raises(ValueError, match="`motion` must be a `Steady`, a `Vibration`, a"):
        jc.Shell([0.0, 0.0], 1.0, motion=[0.1, 0.0])


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
        discs = [jc.Sphere(0.1, 1.0, place) for place in places]
        scene = jc.Scene([*discs, driven], jc.ExactRestitution(e=0.5))
        return jc.simulate(scene, 6.0, instantaneous=True).impacts

    among_few, among_many = impacts(near), impacts(near + far)
    assert len(among_few) > 10
    np.testing.assert_allclose(among_many.time, among_few.time, rtol=1e-12)
