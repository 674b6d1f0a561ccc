"""Scenes and their runs."""

import functools

import jaxcontact as jc
from tests.test_every_argument.case import UNSOLVED, blank, case, drawn, method
from tests.test_every_argument.kinds import STEEL

ORIGIN = [0.0, 0.0, 0.0]


def shaken(t, args):
    """A displacement along the normal."""
    return 0.0 * t


@functools.cache
def a_run():
    disc = jc.Sphere(0.1, 1.0, [0.0, 0.0], [1.0, 0.0])
    return jc.simulate(jc.Scene([disc], jc.ExactRestitution(e=0.5)), 1.0, instantaneous=True)


@functools.cache
def cases():
    ball = jc.Sphere(0.1, None, ORIGIN, material=STEEL)
    scene = jc.Scene([ball], UNSOLVED)
    return [
        case(
            "Sphere",
            "POSITIVE: radius; POSITIVE or None: mass inertia; THREE or ONE: position; "
            "THREE or None: velocity spin; material: material; FLAG: fixed",
            position=ORIGIN,
            material=STEEL,
        ),
        case("Plane", "THREE: point normal", point=ORIGIN, normal=[0.0, 0.0, 1.0]),
        case("Box", "THREE: low high", low=[-9.0] * 3, high=[9.0] * 3),
        case("Shell", "THREE or ONE: centre; POSITIVE: radius", centre=ORIGIN, radius=9.0),
        case("Steady", "THREE or ONE: velocity"),
        case("Vibration", "REAL or THREE or ONE: amplitude; POSITIVE: frequency; REAL: phase"),
        case("Prescribed", "POSITIVE: max_acceleration", displacement=shaken, max_acceleration=1.0),
        case(
            "Scene",
            "POSITIVE or None: stiffness; one and a half: exponent; THREE or None: gravity; "
            "tuple or None: periodic",
            bodies=[ball],
            stiffness=1.0,
        ),
        case(
            "simulate",
            "POSITIVE: v0; ONE or None or tuple or range: times; INSIDE: rtol; FLAG: instantaneous",
            apart="position velocity breakpoints",
            model=scene,
            duration=10.0,
        ),
        case(
            "random_spheres",
            "WHOLE: count; THREE: low high; POSITIVE: radius; POSITIVE or None: mass speed",
            **{"count": 2, "low": [-9.0] * 3, "high": [9.0] * 3, "mass": 1.0, "material": STEEL},
        ),
        case(
            "export_scene",
            "None or range: times; INSIDE: tolerance; None: velocity",
            **{"scene": scene, "engine": "mujoco", "duration": 10.0, "velocity": (1.0, 2.0)},
        ),
        case("read_scene", "NAME: file; NOTHING: example"),
        drawn("scene", a_run),
        drawn("energy", a_run),
        drawn("animate", a_run, "POSITIVE: seconds; WHOLE: fps", seconds=1.0, fps=2),
        case("Run.to_csv", "", lambda path: a_run().to_csv(path)),
        case("Impacts.to_csv", "", lambda path: a_run().impacts.to_csv(path)),
        method(blank(jc.Run), "at", "REALS but shape (2, 3) or DataFrame: time", staged=True),
    ]
