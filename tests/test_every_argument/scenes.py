"""Scenes and their runs."""

import functools

import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation

import jaxcontact as jc
from tests.test_every_argument.case import UNSOLVED, Blank, case
from tests.test_every_argument.kinds import STEEL

ORIGIN = [0.0, 0.0, 0.0]
BODY = "material or None: material; TEXT or None: name"


def shaken(t, args):
    """A displacement along the normal."""
    return 0.0 * t


@functools.cache
def a_run():
    disc = jc.Sphere(0.1, 1.0, [0.0, 0.0], [1.0, 0.0])
    return jc.simulate(jc.Scene([disc], jc.ExactRestitution(e=0.5)), 1.0, instantaneous=True)


def _drawn(draw, /, **given):
    """A picture of a run that is made when it is needed, not while tests are collected."""
    made = draw(**({"run": a_run()} | given))
    # Matplotlib warns of an animation without any frame, once it is gone.
    if isinstance(made, FuncAnimation):
        made.figure.canvas.draw()
    return made


def drawn(name, groups, **good):
    draw = functools.partial(_drawn, getattr(jc.plot, name))
    return case(
        f"plot.{name}", f"NOTHING: run; {groups}", draw, ax=plt.figure().add_subplot(), **good
    )


@functools.cache
def cases():
    ball = jc.Sphere(0.1, None, ORIGIN, material=STEEL)
    scene = jc.Scene([ball], UNSOLVED)
    return [
        case(
            "Sphere",
            "POSITIVE: radius; POSITIVE or None: mass inertia; THREE or ONE: position; "
            "THREE or None: velocity spin; material: material; FLAG: fixed; None: motion; "
            "TEXT or None: name",
            position=ORIGIN,
            material=STEEL,
        ),
        case(
            "Plane",
            f"{BODY}; THREE: point normal; None: motion",
            point=ORIGIN,
            normal=[0.0, 0.0, 1.0],
        ),
        case("Box", f"{BODY}; THREE: low high; None: motion", low=[-9.0] * 3, high=[9.0] * 3),
        case(
            "Shell",
            f"{BODY}; THREE or ONE: centre; POSITIVE: radius; None: motion",
            centre=ORIGIN,
            radius=9.0,
        ),
        case("Steady", "THREE or ONE: velocity"),
        case(
            "Vibration",
            "REAL or THREE or ONE: amplitude; POSITIVE: frequency; REAL: phase",
            amplitude=0.1,
            frequency=1.0,
        ),
        case(
            "Prescribed",
            "NOTHING: displacement; POSITIVE: max_acceleration",
            displacement=shaken,
            max_acceleration=1.0,
        ),
        case(
            "Scene",
            "NOTHING: bodies; law: law; POSITIVE or None: stiffness; one and a half: exponent; "
            "THREE or None: gravity; tuple or None: periodic; None: friction",
            bodies=[ball],
            stiffness=1.0,
        ),
        case(
            "simulate",
            "NOTHING: model; POSITIVE: duration v0; ONE or None or tuple or range: times; "
            "INSIDE: rtol; FLAG: instantaneous throw; WHOLE or None: max_impacts max_cluster; "
            "PROGRESS or None: progress",
            model=scene,
            duration=10.0,
        ),
        case(
            "random_spheres",
            "WHOLE: count; THREE: low high; POSITIVE: radius; POSITIVE or None: mass speed; "
            "material or None: material; None: periodic; TEXT or None: name; SEED: seed",
            **{"count": 2, "low": [-9.0] * 3, "high": [9.0] * 3, "mass": 1.0, "material": STEEL},
        ),
        case(
            "export_scene",
            "NOTHING: scene engine; POSITIVE: duration; None or range: times; INSIDE: tolerance; "
            "None: velocity",
            **{"scene": scene, "engine": "mujoco", "duration": 10.0, "velocity": (1.0, 2.0)},
        ),
        case("read_scene", "NAME: file; NOTHING: example"),
        drawn("scene", "None: axes ax"),
        drawn("energy", "None: ax"),
        drawn("animate", "POSITIVE: seconds; WHOLE: fps; None: draw axes ax", seconds=1.0, fps=2),
        case("Run.to_csv", "NAME: path", lambda path: a_run().to_csv(path)),
        case("Impacts.to_csv", "NAME: path", lambda path: a_run().impacts.to_csv(path)),
        case(
            "Run.at",
            "REALS but shape (2, 3) or DataFrame: time",
            functools.partial(jc.Run.at, Blank()),
            staged=True,
        ),
    ]
