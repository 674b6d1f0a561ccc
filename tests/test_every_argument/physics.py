"""Contacts, laws, impacts and bounces."""

import dataclasses
import functools

import jax.numpy as jnp

import jaxcontact as jc
from jaxcontact._bounce.result import TOUCHES
from jaxcontact._entry import ranges
from jaxcontact._laws.registry import _REGISTRY
from tests.test_every_argument.case import Unsolved, case, method
from tests.test_every_argument.kinds import CONTACT, LAW, STEEL

RANGES = {
    "[0, 1]": "E or zero", "(0, 1]": "E", "[0, inf)": "POSITIVES or zero", "(0, inf)": "POSITIVES",
    "[1, inf)": "EXPONENT or ABOVE_ONE", "(-inf, inf)": "REALS",
}  # fmt: skip


def constructed(name, law):
    """The case of a law's own parameters."""
    # What unloads to zero force never pulls: laws that remember, except Luding's.
    never = law.remembers and law is not jc.Luding
    groups = [f"{RANGES[str(allowed)]}: {parameter}" for parameter, allowed in ranges(law).items()]
    groups = "; ".join([f"{'NOTHING' if never else 'FLAG'}: tension", *groups])
    return case(name, groups, **{one: allowed.inside for one, allowed in ranges(law).items()})


def a_bounce():
    two, one = jnp.ones(2), jnp.ones(())
    names = [field.name for field in dataclasses.fields(jc.Bounce)]
    return jc.Bounce(**{name: two if name in TOUCHES else one for name in names})


def _register(name, cls=Unsolved, **words):
    made = jc.register_law(name, **words)(cls)
    del _REGISTRY[name]
    return made


IMPACT = "law: law; contact: contact; POSITIVES: velocity"
MOTION = "REALS: indentation velocity impact_velocity"
FORCE = f"{MOTION}; contact: contact"
LARGEST = "REALS or None: largest"
PLASTIC = jc.ThorntonPlastic(yield_speed=0.1)
POWER = jc.PowerRestitution(loss=0.1, power=0.2, reference=1.0)
BRIDGES = jc.Bridges(a=0.5, power=0.2, reference=1.0)
WET = jc.WetRestitution(e=0.5, critical_speed=0.1)
LAWS = (
    *(LAW, jc.Tsuji(e=0.5), jc.KuwabaraKono(A=1e-3), jc.ConstantDamping(c=1.0)),
    *(jc.LinearDashpot(c=1.0), jc.StepDamping(c_max=1.0, d=0.1)),
    *(jc.DMT(pull_off=0.1), jc.JKR(pull_off=0.1)),
)
DAMPING = (
    (jc.ConstantDamping(c=1.0), "contact: contact; REALS: velocity"),
    (jc.PowerDamping(c=1.0, power=1.0, reference=1.0), "contact: contact; REALS: velocity"),
    *((law, "REALS: velocity") for law in (POWER, BRIDGES, WET, jc.MarhefkaOrin(a=1.0))),
    (jc.EnergyLoss(e=0.5, beta=2.5), "contact or None: contact"),
)


@functools.cache
def cases():
    laws = {name: getattr(jc, name) for name in dir(jc) if not name.startswith("Abstract")}
    laws = {
        name: kind
        for name, kind in laws.items()
        if isinstance(kind, type) and issubclass(kind, jc.AbstractLaw)
    }
    return [
        *(constructed(name, kind) for name, kind in laws.items()),
        # Contacts
        case(
            "Material",
            "POSITIVES: youngs_modulus; INSIDE or ARRAYS or SCALARS or zero: poisson_ratio; "
            "POSITIVES or None: density",
            youngs_modulus=1.0,
            poisson_ratio=0.3,
        ),
        method(STEEL, "sphere_mass", "POSITIVES: radius", staged=True),
        case(
            "Contact",
            "POSITIVES: mass stiffness; EXPONENT: exponent; POSITIVES or None: tangential_ratio",
        ),
        case(
            "Contact.sphere_sphere",
            "POSITIVES: radius other_radius; material: sphere other; POSITIVES or None: mass",
            staged=True,
        ),
        *(
            case(
                f"Contact.sphere_{other}",
                f"POSITIVES: {sizes}; material: sphere; material or None: {other}; "
                "POSITIVES or None: mass",
                staged=True,
                **good,
            )
            for other, sizes, good in (
                ("plane", "radius", {}),
                ("socket", "radius socket_radius", {"socket_radius": 5.0}),
            )
        ),
        # Laws
        *(method(law, "force", FORCE, staged=True) for law in LAWS),
        *(
            case(
                f"{name}.of_surfaces",
                "POSITIVES or zero: work_of_adhesion radius",
                staged=True,
                work_of_adhesion=0.1,
            )
            for name in ("DMT", "JKR")
        ),
        case(
            "WetRestitution.of_liquid",
            "INSIDE or ARRAYS or SCALARS: e; POSITIVES or zero: critical_stokes viscosity radius; "
            "POSITIVES: mass",
            staged=True,
            critical_stokes=1.0,
            viscosity=0.1,
        ),
        method(jc.JKR(pull_off=0.1), "sticking_speed", "contact: contact", staged=True),
        *(
            method(law, "force", f"{FORCE}; {LARGEST}", staged=True)
            for law in (PLASTIC, jc.Viscoplastic(yield_speed=0.1, c=1.0))
        ),
        method(
            jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5),
            "force",
            f"{MOTION}; {LARGEST}",
            staged=True,
            contact=jc.Contact(1.0, 1e6, 1.0),
        ),
        *(
            method(law, "damping_factor", groups, staged=True, contact=CONTACT, velocity=1.0)
            for law, groups in DAMPING
        ),
        *(
            method(law, "restitution_at", "REALS: velocity", staged=True)
            for law in (PLASTIC, POWER, BRIDGES, WET)
        ),
        case("get_law", "NOTHING: name", name="hertz"),
        case("register_law", "NAME: name; TEXT: formula source valid; law class: cls", _register),
        case("exact_damping_factor", "E: e", staged=True),
        case("power", "REALS: x exponent", staged=True),
        # One impact
        case("impact", f"{IMPACT}; NOTHING: method; REALS or None: external_force; FLAG: throw"),
        case(
            "restitution",
            "law: law; contact or None: contact; POSITIVES or None: velocity; NOTHING: method",
            contact=CONTACT,
            velocity=1.0,
        ),
        case(
            "trajectory",
            f"{IMPACT}; WHOLE: samples; NOTHING: method; REALS or None: external_force",
        ),
        case(
            "bounce",
            "law: law; contact: contact; POSITIVES: height gravity; WHOLE or None: bounces; "
            "FLAG: gravity_in_contact throw; POSITIVES or None: rest_velocity; NOTHING: v0 method",
        ),
        method(a_bounce(), "height_at", "REALS: time", staged=True),
        case("Event", "INSIDE or None: rtol atol; None: solver adjoint; WHOLE: max_steps"),
        case("Phase", "WHOLE: steps; INSIDE or None: tolerance"),
    ]
