"""Friction laws, oblique impacts, and friction laws from measured ones."""

import importlib.resources

import jaxcontact as jc
from tests.test_every_argument.case import OUT, V, case
from tests.test_every_argument.kinds import LAW

FRICTION = jc.RigidCoulomb(0.2)
TWO = {"one": FRICTION, "two": jc.WaltonFriction(0.2, 0.1)}
BODIES = jc.RoundBodies(1.0)
TABLE = str(importlib.resources.files("jaxcontact.data") / "oblique_rebounds.csv")
SPEEDS = {"law": LAW, "velocity": V, "tangential_velocity": V}
MEASURED = ("tangential_restitution", "rebound_angle", "rebound_spin")
STAGES = "FLAG or None or function"


def fitted(name, friction):
    """The cases of a function that takes measured rebounds."""
    given = SPEEDS | {"friction": friction}
    every = {**given, **dict.fromkeys(MEASURED, OUT), "bodies": BODIES}
    apart = " ".join(f"sigma_{one}" for one in MEASURED)
    return [
        case(name, "NOTHING: velocity tangential_velocity bodies", apart=apart, **every),
        case(f"{name}, of a shape", "None: bodies", **given, rebound_angle=OUT),
        *(
            case(
                f"{name}, known errors of {one}",
                f"POSITIVE or None: sigma_{one}",
                **given | {one: OUT, "bodies": BODIES},
            )
            for one in MEASURED
        ),
    ]


def cases():
    return [
        case("RigidCoulomb"),
        case("WaltonFriction", "E or zero or minus one: beta0", beta0=0.4),
        case("RegularizedCoulomb", "POSITIVES: v_d", v_d=0.01),
        case("SpringSlider", "POSITIVES or None: ratio"),
        case("MawBarberFawcett", "POSITIVES or None: ratio"),
        case(
            "RoundBodies", "POSITIVES or None: other_mass inertia other_inertia", other_radius=0.1
        ),
        case(
            "tangential_rebound", "REALS: psi1; EXPONENT: chi; E or zero: alpha", psi1=1.0, chi=1.4
        ),
        case("oblique_impact", "POSITIVES: velocity"),
        case("oblique_trajectory", "POSITIVES: velocity"),
        *fitted("fit_oblique", FRICTION),
        *fitted("choose_friction", TWO),
        case(
            "choose_friction, stages",
            f"{STAGES}: progress",
            untested="class or law class",
            **SPEEDS | {"tangential_restitution": OUT, "friction": TWO},
        ),
        case(
            "calibrate_friction",
            "INSIDE: restitution; POSITIVES: radius; POSITIVES or None: tangential_ratio; "
            f"{STAGES}: progress",
            untested="TEXT or class or law class",
            source=TABLE,
            restitution=0.5,
            radius=1.0,
            friction=TWO,
        ),
    ]
