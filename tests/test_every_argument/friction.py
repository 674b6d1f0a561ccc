"""Friction laws and oblique impacts."""

import jaxcontact as jc
from tests.test_every_argument.case import CONTACTS, LAWS, METHODS, NOTHING, SWITCH, UNSOLVED, Case
from tests.test_every_argument.kinds import (
    ARRAYS,
    CONTACT,
    JAX_SCALARS,
    NONE,
    POSITIVES,
    REALS,
    WHOLE,
    E,
)

NOT_NEGATIVE = POSITIVES | {"zero"}
OBLIQUE = {
    "law": UNSOLVED,
    "contact": CONTACT,
    "velocity": 1.0,
    "tangential_velocity": 1.0,
    "friction": jc.RigidCoulomb(mu=0.1),
}
OBLIQUE_LEGAL = {
    "law": LAWS,
    "contact": CONTACTS,
    "velocity": POSITIVES,
    "tangential_velocity": REALS,
    "friction": NOTHING,
    "bodies": NONE,
    "spin": NOTHING,
    "method": METHODS,
}


def cases():
    return {
        "RigidCoulomb": Case(jc.RigidCoulomb, {"mu": 0.1}, {"mu": NOT_NEGATIVE}),
        "WaltonFriction": Case(
            jc.WaltonFriction,
            {"mu": 0.1, "beta0": 0.4},
            {"mu": NOT_NEGATIVE, "beta0": E | {"zero", "minus one"}},
        ),
        "RegularizedCoulomb": Case(
            jc.RegularizedCoulomb, {"mu": 0.1, "v_d": 0.01}, {"mu": NOT_NEGATIVE, "v_d": POSITIVES}
        ),
        "SpringSlider": Case(
            jc.SpringSlider,
            {"mu": 0.1},
            {"mu": NOT_NEGATIVE, "ratio": POSITIVES | NONE, "form": NOTHING},
        ),
        "MawBarberFawcett": Case(
            jc.MawBarberFawcett, {"mu": 0.1}, {"mu": NOT_NEGATIVE, "ratio": POSITIVES | NONE}
        ),
        "RoundBodies": Case(
            jc.RoundBodies,
            {"radius": 0.1, "other_radius": 0.1},
            {
                "radius": POSITIVES,
                "other_radius": POSITIVES | NONE,
                "mass": POSITIVES | NONE,
                "other_mass": POSITIVES | NONE,
                "inertia": POSITIVES | NONE,
                "other_inertia": POSITIVES | NONE,
                "shape": NOTHING,
            },
        ),
        "tangential_rebound": Case(
            jc.tangential_rebound,
            {"psi1": 1.0, "chi": 1.4},
            {
                "psi1": REALS,
                "chi": ARRAYS | JAX_SCALARS | {"one and a half"},
                "alpha": E | {"zero"},
            },
            staged=True,
        ),
        "oblique_impact": Case(jc.oblique_impact, OBLIQUE, OBLIQUE_LEGAL | {"throw": SWITCH}),
        "oblique_trajectory": Case(
            jc.oblique_trajectory, OBLIQUE, OBLIQUE_LEGAL | {"samples": WHOLE}
        ),
    }
