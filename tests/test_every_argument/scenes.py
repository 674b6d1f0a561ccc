"""Scenes and their runs."""

import functools

import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation

import jaxcontact as jc
from tests.test_every_argument.case import (
    COUNT,
    LAWS,
    MATERIALS,
    NOTHING,
    SEED,
    UNSOLVED,
    Blank,
    Case,
)
from tests.test_every_argument.kinds import (
    CALLABLE,
    FLAG,
    INSIDE,
    NONE,
    POSITIVE,
    REAL,
    REALS,
    STEEL,
    TEXT,
)

ONE = frozenset({"shape (1,)", "jax shape (1,)"})
THREE = frozenset({"tuple", "range", "Series"})
"""Kinds that are three finite numbers."""

BODY = {"material": MATERIALS | NONE, "name": TEXT | NONE}


def shaken(t, args):
    """A displacement along the normal."""
    return 0.0 * t


@functools.cache
def a_run():
    disc = jc.Sphere(0.1, 1.0, [0.0, 0.0], [1.0, 0.0])
    return jc.simulate(jc.Scene([disc], jc.ExactRestitution(e=0.5)), 1.0, instantaneous=True)


def _drawn(draw, **given):
    """A picture of a run that is made when it is needed, not while tests are collected."""
    drawn = draw(**(given if "run" in given else given | {"run": a_run()}))
    # Matplotlib warns of an animation without any frame, once it is gone.
    if isinstance(drawn, FuncAnimation):
        drawn.figure.canvas.draw()
    return drawn


@functools.cache
def cases() -> dict[str, Case]:
    ball = jc.Sphere(0.1, None, [0.0, 0.0, 0.0], material=STEEL)
    scene = jc.Scene([ball], UNSOLVED)
    return {
        "Sphere": Case(
            jc.Sphere,
            {"radius": 0.1, "position": [0.0, 0.0, 0.0], "material": STEEL},
            BODY
            | {
                "radius": POSITIVE,
                "mass": POSITIVE | NONE,
                "position": THREE | ONE,
                "velocity": THREE | NONE,
                "material": MATERIALS,
                "fixed": FLAG,
                "motion": NONE,
                "spin": THREE | NONE,
                "inertia": POSITIVE | NONE,
            },
        ),
        "Plane": Case(
            jc.Plane,
            {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
            BODY | {"point": THREE, "normal": THREE, "motion": NONE},
        ),
        "Box": Case(
            jc.Box,
            {"low": [-9.0, -9.0, -9.0], "high": [9.0, 9.0, 9.0]},
            BODY | {"low": THREE, "high": THREE, "motion": NONE},
        ),
        "Shell": Case(
            jc.Shell,
            {"centre": [0.0, 0.0, 0.0], "radius": 9.0},
            BODY | {"centre": THREE | ONE, "radius": POSITIVE, "motion": NONE},
        ),
        "Steady": Case(jc.Steady, {"velocity": [0.0, 0.0, 1.0]}, {"velocity": THREE | ONE}),
        "Vibration": Case(
            jc.Vibration,
            {"amplitude": 0.1, "frequency": 1.0},
            {"amplitude": REAL | THREE | ONE, "frequency": POSITIVE, "phase": REAL},
        ),
        "Prescribed": Case(
            jc.Prescribed,
            {"displacement": shaken, "max_acceleration": 1.0},
            {"displacement": NOTHING, "max_acceleration": POSITIVE},
        ),
        "Scene": Case(
            jc.Scene,
            {"bodies": [ball], "law": UNSOLVED, "stiffness": 1.0},
            {
                "bodies": NOTHING,
                "law": LAWS,
                "stiffness": POSITIVE | NONE,
                "exponent": frozenset({"one and a half"}),
                "gravity": THREE | NONE,
                "periodic": frozenset({"tuple"}) | NONE,
                "friction": NONE,
            },
        ),
        "simulate": Case(
            jc.simulate,
            {"model": scene, "duration": 10.0},
            {
                "model": NOTHING,
                "duration": POSITIVE,
                "times": ONE | NONE | {"tuple", "range"},
                "rtol": INSIDE,
                "instantaneous": FLAG,
                "throw": FLAG,
                "v0": POSITIVE,
                "max_impacts": COUNT | NONE,
                "max_cluster": COUNT | NONE,
                "progress": FLAG | NONE | CALLABLE,
            },
        ),
        "random_spheres": Case(
            jc.random_spheres,
            {"count": 2, "low": [-9.0] * 3, "high": [9.0] * 3, "radius": 0.1, "mass": 1.0}
            | {"material": STEEL},
            {
                "count": COUNT,
                "low": THREE,
                "high": THREE,
                "radius": POSITIVE,
                "mass": POSITIVE | NONE,
                "material": MATERIALS | NONE,
                "speed": POSITIVE | NONE,
                "periodic": NONE,
                "name": TEXT | NONE,
                "seed": SEED,
            },
        ),
        "export_scene": Case(
            jc.export_scene,
            {"scene": scene, "engine": "mujoco", "duration": 10.0, "velocity": (1.0, 2.0)},
            {
                "scene": NOTHING,
                "engine": NOTHING,
                "duration": POSITIVE,
                "times": NONE | {"range"},
                "tolerance": INSIDE,
                "velocity": NONE,
            },
        ),
        "read_scene": Case(jc.read_scene, {}, {"file": TEXT - {"empty text"}, "example": NOTHING}),
        "plot.scene": Case(
            functools.partial(_drawn, jc.plot.scene),
            {"ax": plt.figure().add_subplot()},
            {"run": NOTHING, "axes": NONE, "ax": NONE},
        ),
        "plot.energy": Case(
            functools.partial(_drawn, jc.plot.energy),
            {"ax": plt.figure().add_subplot()},
            {"run": NOTHING, "ax": NONE},
        ),
        "plot.animate": Case(
            functools.partial(_drawn, jc.plot.animate),
            {"seconds": 1.0, "fps": 2, "ax": plt.figure().add_subplot()},
            {"run": NOTHING, "seconds": POSITIVE, "fps": COUNT, "axes": NONE, "ax": NONE},
        ),
        "Run.to_csv": Case(lambda path: a_run().to_csv(path), {}, {"path": TEXT - {"empty text"}}),
        "Impacts.to_csv": Case(
            lambda path: a_run().impacts.to_csv(path), {}, {"path": TEXT - {"empty text"}}
        ),
        "Run.at": Case(
            functools.partial(jc.Run.at, Blank()),
            {},
            {"time": REALS - {"shape (2, 3)", "DataFrame"}},
            staged=True,
        ),
    }
