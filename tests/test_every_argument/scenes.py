"""Scenes and their runs."""

import functools

import jaxcontact as jc
from tests.test_every_argument.case import COUNT, LAWS, MATERIALS, NOTHING, UNSOLVED, Blank, Case
from tests.test_every_argument.kinds import (
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
            BODY | {"centre": THREE | ONE, "radius": POSITIVE},
        ),
        "Steady": Case(jc.Steady, {"velocity": [0.0, 0.0, 1.0]}, {"velocity": THREE | ONE}),
        "Vibration": Case(
            jc.Vibration,
            {"amplitude": 0.1, "frequency": 1.0},
            {"amplitude": REAL | THREE | ONE, "frequency": POSITIVE, "phase": REAL},
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
            },
        ),
        "simulate": Case(
            jc.simulate,
            {"scene": scene, "duration": 10.0},
            {
                "scene": NOTHING,
                "duration": POSITIVE,
                "times": ONE | NONE | {"tuple", "range"},
                "rtol": INSIDE,
                "instantaneous": FLAG,
                "v0": POSITIVE,
                "max_impacts": COUNT | NONE,
            },
        ),
        "Run.at": Case(
            functools.partial(jc.Run.at, Blank()),
            {},
            {"time": REALS - {"shape (2, 3)", "DataFrame"}},
            staged=True,
        ),
    }
