"""Friction laws from measured oblique impacts."""

import importlib.resources

import jaxcontact as jc
from tests.test_every_argument.case import COLUMN, CONTACTS, LAWS, NOTHING, OUT, Case, V
from tests.test_every_argument.kinds import (
    CONTACT,
    FLAG,
    INSIDE,
    LAW,
    NONE,
    POSITIVE,
    POSITIVES,
    TEXT,
)

FRICTION = jc.RigidCoulomb(0.2)
TWO = {"one": FRICTION, "two": jc.WaltonFriction(0.2, 0.1)}
BODIES = jc.RoundBodies(1.0)
TABLE = str(importlib.resources.files("jaxcontact.data") / "oblique_rebounds.csv")
SPEEDS = {"law": LAW, "contact": CONTACT, "velocity": V, "tangential_velocity": V}
LEGAL = {"law": LAWS, "contact": CONTACTS, "velocity": COLUMN, "tangential_velocity": COLUMN}
SIGMAS = ("tangential_restitution", "rebound_angle", "rebound_spin")


def _cases(name, function, own, legal):
    """The cases of a function that takes measured rebounds."""
    three = {"tangential_restitution": OUT, "rebound_angle": OUT, "rebound_spin": OUT}
    cases = {
        name: Case(
            function,
            SPEEDS | three | {"bodies": BODIES} | own,
            LEGAL | dict.fromkeys(three, NONE) | {"bodies": NOTHING} | legal,
        ),
        f"{name}, of a shape": Case(
            function, SPEEDS | {"rebound_angle": OUT} | own, {"bodies": NONE}
        ),
    }
    for one in SIGMAS:
        cases[f"{name}, known errors of {one}"] = Case(
            function, SPEEDS | {one: OUT, "bodies": BODIES} | own, {f"sigma_{one}": POSITIVE | NONE}
        )
    return cases


def cases() -> dict[str, Case]:
    return {
        **_cases("fit_oblique", jc.fit_oblique, {"friction": FRICTION}, {"friction": NOTHING}),
        **_cases("choose_friction", jc.choose_friction, {"friction": TWO}, {"friction": NONE}),
        "choose_friction, stages": Case(
            jc.choose_friction,
            SPEEDS | {"tangential_restitution": OUT, "friction": TWO},
            {"progress": FLAG | NONE | {"function"}},
            untested=frozenset({"class", "law class"}),
        ),
        "calibrate_friction": Case(
            jc.calibrate_friction,
            {"source": TABLE, "restitution": 0.5, "radius": 1.0, "friction": TWO},
            {
                "source": NOTHING,
                "restitution": INSIDE,
                "tangential_ratio": POSITIVES | NONE,
                "radius": POSITIVES,
                "shape": NOTHING,
                "friction": NONE,
                "columns": NONE,
                "decimal": NONE,
                "ball": NONE,
                "sheet": NONE,
                "progress": FLAG | NONE | {"function"},
            },
            untested=TEXT | {"class", "law class"},
        ),
    }
