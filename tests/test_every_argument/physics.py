"""Contacts, laws, impacts and bounces."""

import dataclasses
import functools

import jax.numpy as jnp

import jaxcontact as jc
from jaxcontact._bounce.result import TOUCHES
from jaxcontact._laws.registry import _REGISTRY
from tests.test_every_argument.case import (
    CONTACTS,
    COUNT,
    LAWS,
    MATERIALS,
    METHODS,
    NOTHING,
    SWITCH,
    UNSOLVED,
    Case,
    Unsolved,
)
from tests.test_every_argument.kinds import (
    ABOVE_ONE,
    ARRAYS,
    CONTACT,
    FLAG,
    INSIDE,
    JAX_SCALARS,
    LAW,
    NONE,
    POSITIVES,
    REALS,
    STEEL,
    TEXT,
    E,
)


def constructed(law):
    """The cases of a law's own parameters."""
    from jaxcontact._entry import ranges

    good = {name: allowed.inside for name, allowed in ranges(law).items()}
    legal = {
        name: {
            "[0, 1]": E | {"zero"},
            "(0, 1]": E,
            "[0, inf)": POSITIVES | {"zero"},
            "(0, inf)": POSITIVES,
            "[1, inf)": ABOVE_ONE | ARRAYS | JAX_SCALARS,
            "(-inf, inf)": REALS,
        }[str(allowed)]
        for name, allowed in ranges(law).items()
    }
    # What unloads to zero force never pulls.
    # Laws that remember never pull, except Luding's.
    never = law.remembers and law is not jc.Luding
    return Case(law, good, legal | {"tension": NOTHING if never else FLAG})


def a_bounce():
    two, one = jnp.ones(2), jnp.ones(())
    names = [field.name for field in dataclasses.fields(jc.Bounce)]
    return jc.Bounce(**{name: two if name in TOUCHES else one for name in names})


def _register(name, cls=Unsolved, **words):
    made = jc.register_law(name, **words)(cls)
    del _REGISTRY[name]
    return made


IMPACT = {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0}
SPEED = POSITIVES
IMPACT_LEGAL = {"law": LAWS, "contact": CONTACTS, "velocity": SPEED}
FORCE = {"indentation": 1e-3, "velocity": 0.1, "contact": CONTACT, "impact_velocity": 1.0}
FORCE_LEGAL = {
    "indentation": REALS,
    "velocity": REALS,
    "contact": CONTACTS,
    "impact_velocity": REALS,
}


@functools.cache
def cases() -> dict[str, Case]:
    laws = {name: getattr(jc, name) for name in dir(jc)}
    laws = {
        name: kind
        for name, kind in laws.items()
        if isinstance(kind, type)
        and issubclass(kind, jc.AbstractLaw)
        and not name.startswith("Abstract")
    }
    return {
        **{name: constructed(kind) for name, kind in laws.items()},
        # Contacts
        "Material": Case(
            jc.Material,
            {"youngs_modulus": 1.0, "poisson_ratio": 0.3},
            {
                "youngs_modulus": POSITIVES,
                "poisson_ratio": INSIDE | ARRAYS | JAX_SCALARS | {"zero"},
                "density": POSITIVES | NONE,
            },
        ),
        "Material.sphere_mass": Case(STEEL.sphere_mass, {}, {"radius": POSITIVES}, staged=True),
        "Contact": Case(
            jc.Contact,
            {"mass": 1.0, "stiffness": 1.0},
            {
                "mass": POSITIVES,
                "stiffness": POSITIVES,
                "exponent": ARRAYS | JAX_SCALARS | {"one and a half"},
                "tangential_ratio": POSITIVES | NONE,
            },
        ),
        "Contact.sphere_sphere": Case(
            jc.Contact.sphere_sphere,
            {"radius": 0.1, "other_radius": 0.1, "sphere": STEEL, "other": STEEL},
            {
                "radius": POSITIVES,
                "other_radius": POSITIVES,
                "sphere": MATERIALS,
                "other": MATERIALS,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        "Contact.sphere_plane": Case(
            jc.Contact.sphere_plane,
            {"radius": 0.1, "sphere": STEEL},
            {
                "radius": POSITIVES,
                "sphere": MATERIALS,
                "plane": MATERIALS | NONE,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        "Contact.sphere_socket": Case(
            jc.Contact.sphere_socket,
            {"radius": 0.1, "socket_radius": 5.0, "sphere": STEEL},
            {
                "radius": POSITIVES,
                "socket_radius": POSITIVES,
                "sphere": MATERIALS,
                "socket": MATERIALS | NONE,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        # Laws
        **{
            f"{name}.force": Case(law.force, FORCE, FORCE_LEGAL, staged=True)
            for name, law in {
                "HuGuo": LAW,
                "Tsuji": jc.Tsuji(e=0.5),
                "KuwabaraKono": jc.KuwabaraKono(A=1e-3),
                "ConstantDamping": jc.ConstantDamping(c=1.0),
                "LinearDashpot": jc.LinearDashpot(c=1.0),
                "StepDamping": jc.StepDamping(c_max=1.0, d=0.1),
                "DMT": jc.DMT(pull_off=0.1),
                "JKR": jc.JKR(pull_off=0.1),
            }.items()
        },
        **{
            f"{law.__name__}.of_surfaces": Case(
                law.of_surfaces,
                {"work_of_adhesion": 0.1, "radius": 0.1},
                dict.fromkeys(("work_of_adhesion", "radius"), POSITIVES | {"zero"}),
                staged=True,
            )
            for law in (jc.DMT, jc.JKR)
        },
        "WetRestitution.of_liquid": Case(
            jc.WetRestitution.of_liquid,
            {"e": 0.5, "critical_stokes": 1.0, "viscosity": 0.1, "radius": 0.1, "mass": 1.0},
            {
                "e": INSIDE | ARRAYS | JAX_SCALARS,
                **dict.fromkeys(("critical_stokes", "viscosity", "radius"), POSITIVES | {"zero"}),
                "mass": POSITIVES,
            },
            staged=True,
        ),
        "JKR.sticking_speed": Case(
            jc.JKR(pull_off=0.1).sticking_speed, {}, {"contact": CONTACTS}, staged=True
        ),
        **{
            f"{type(law).__name__}.force": Case(
                law.force, FORCE, FORCE_LEGAL | {"largest": REALS | NONE}, staged=True
            )
            for law in (
                jc.ThorntonPlastic(yield_speed=0.1),
                jc.Viscoplastic(yield_speed=0.1, c=1.0),
            )
        },
        "Luding.force": Case(
            jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5).force,
            FORCE | {"contact": jc.Contact(1.0, 1e6, 1.0)},
            {name: REALS for name in FORCE_LEGAL if name != "contact"} | {"largest": REALS | NONE},
            staged=True,
        ),
        **{
            f"{name}.damping_factor": Case(
                law.damping_factor, {"contact": CONTACT, "velocity": 1.0}, legal
            )
            for name, law, legal in [
                (
                    "ConstantDamping",
                    jc.ConstantDamping(c=1.0),
                    {"contact": CONTACTS, "velocity": REALS},
                ),
                (
                    "PowerDamping",
                    jc.PowerDamping(c=1.0, power=1.0, reference=1.0),
                    {"contact": CONTACTS, "velocity": REALS},
                ),
                (
                    "PowerRestitution",
                    jc.PowerRestitution(loss=0.1, power=0.2, reference=1.0),
                    {"velocity": REALS},
                ),
                ("Bridges", jc.Bridges(a=0.5, power=0.2, reference=1.0), {"velocity": REALS}),
                (
                    "WetRestitution",
                    jc.WetRestitution(e=0.5, critical_speed=0.1),
                    {"velocity": REALS},
                ),
                ("MarhefkaOrin", jc.MarhefkaOrin(a=1.0), {"velocity": REALS}),
                ("EnergyLoss", jc.EnergyLoss(e=0.5, beta=2.5), {"contact": CONTACTS | NONE}),
            ]
        },
        **{
            f"{type(law).__name__}.restitution_at": Case(
                law.restitution_at, {"velocity": 1.0}, {"velocity": REALS}, staged=True
            )
            for law in (
                jc.ThorntonPlastic(yield_speed=0.1),
                jc.PowerRestitution(loss=0.1, power=0.2, reference=1.0),
                jc.Bridges(a=0.5, power=0.2, reference=1.0),
                jc.WetRestitution(e=0.5, critical_speed=0.1),
            )
        },
        "get_law": Case(jc.get_law, {"name": "hertz"}, {"name": NOTHING}),
        "register_law": Case(
            _register,
            {"name": "abc"},
            {
                "name": TEXT - {"empty text"},
                "formula": TEXT,
                "source": TEXT,
                "valid": TEXT,
                "cls": frozenset({"law class"}),
            },
        ),
        "exact_damping_factor": Case(jc.exact_damping_factor, {}, {"e": E}, staged=True),
        "power": Case(
            jc.power, {"x": 0.5, "exponent": 1.5}, {"x": REALS, "exponent": REALS}, staged=True
        ),
        # One impact
        "impact": Case(
            jc.impact,
            IMPACT,
            IMPACT_LEGAL | {"method": METHODS, "external_force": REALS | NONE, "throw": SWITCH},
        ),
        "restitution": Case(
            jc.restitution,
            IMPACT,
            {"law": LAWS, "contact": CONTACTS | NONE, "velocity": SPEED | NONE, "method": METHODS},
        ),
        "trajectory": Case(
            jc.trajectory,
            IMPACT,
            IMPACT_LEGAL | {"samples": COUNT, "method": METHODS, "external_force": REALS | NONE},
        ),
        "bounce": Case(
            jc.bounce,
            {"law": UNSOLVED, "contact": CONTACT, "height": 1.0},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "height": POSITIVES,
                "gravity": POSITIVES,
                "bounces": COUNT | NONE,
                "gravity_in_contact": SWITCH,
                "throw": SWITCH,
                "rest_velocity": POSITIVES | NONE,
                "v0": NOTHING,
                "method": METHODS,
            },
        ),
        "Bounce.height_at": Case(a_bounce().height_at, {}, {"time": REALS}, staged=True),
        "Event": Case(
            jc.Event,
            {},
            {
                "rtol": INSIDE | NONE,
                "atol": INSIDE | NONE,
                "solver": NONE,
                "adjoint": NONE,
                "max_steps": COUNT,
            },
        ),
        "Phase": Case(jc.Phase, {}, {"steps": COUNT, "tolerance": INSIDE | NONE}),
    }
