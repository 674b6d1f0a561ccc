"""Contacts, laws, impacts and bounces."""

import functools

import jaxcontact as jc
from jaxcontact._entry import ranges
from jaxcontact._laws.registry import _REGISTRY
from tests.test_every_argument.case import Unsolved, blank, case, method
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


def _register(name, cls=Unsolved, **words):
    made = jc.register_law(name, **words)(cls)
    del _REGISTRY[name]
    return made


PLASTIC = jc.ThorntonPlastic(yield_speed=0.1)
VISCOPLASTIC = jc.Viscoplastic(yield_speed=0.1, c=1.0)
LUDING = jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5)
POWER = jc.PowerRestitution(loss=0.1, power=0.2, reference=1.0)
BRIDGES = jc.Bridges(a=0.5, power=0.2, reference=1.0)
WET = jc.WetRestitution(e=0.5, critical_speed=0.1)
LAWS = (
    *(LAW, jc.Tsuji(e=0.5), jc.KuwabaraKono(A=1e-3), jc.ConstantDamping(c=1.0)),
    *(jc.LinearDashpot(c=1.0), jc.StepDamping(c_max=1.0, d=0.1)),
    *(jc.DMT(pull_off=0.1), jc.JKR(pull_off=0.1)),
)
DAMPING = {
    "contact: contact; REALS: velocity": (
        jc.ConstantDamping(c=1.0),
        jc.PowerDamping(c=1.0, power=1.0, reference=1.0),
    ),
    "REALS: velocity": (POWER, BRIDGES, WET, jc.MarhefkaOrin(a=1.0)),
    "contact or None: contact": (jc.EnergyLoss(e=0.5, beta=2.5),),
}


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
            "INSIDE or ARRAYS or SCALARS or zero: poisson_ratio; "
            "POSITIVES: youngs_modulus; POSITIVES or None: density",
        ),
        method(STEEL, "sphere_mass", staged=True),
        case("Contact", "POSITIVES or None: tangential_ratio"),
        *(case(f"Contact.sphere_{what}", staged=True) for what in ("sphere", "plane", "socket")),
        # Laws
        *(method(law, "force", staged=True) for law in (*LAWS, PLASTIC, VISCOPLASTIC)),
        *(
            case(f"{name}.of_surfaces", "POSITIVES or zero: work_of_adhesion radius", staged=True)
            for name in ("DMT", "JKR")
        ),
        case(
            "WetRestitution.of_liquid",
            "INSIDE or ARRAYS or SCALARS: e; POSITIVES or zero: critical_stokes viscosity radius",
            staged=True,
        ),
        method(jc.JKR(pull_off=0.1), "sticking_speed", staged=True),
        method(LUDING, "force", staged=True, contact=jc.Contact(1.0, 1e6, 1.0)),
        *(
            method(law, "damping_factor", groups, staged=True, contact=CONTACT, velocity=1.0)
            for groups, some in DAMPING.items()
            for law in some
        ),
        *(method(law, "restitution_at", staged=True) for law in (PLASTIC, POWER, BRIDGES, WET)),
        case("get_law", "NOTHING: name", name="hertz"),
        case("register_law", "NAME: name; TEXT: formula source valid; law class: cls", _register),
        case("exact_damping_factor", "E: e", staged=True),
        case("power", "REALS: x exponent", staged=True),
        # One impact
        case("impact", "POSITIVES: velocity"),
        case("restitution", "POSITIVES or None: velocity", contact=CONTACT, velocity=1.0),
        case("trajectory", "POSITIVES: velocity"),
        case(
            "bounce",
            "POSITIVES: height gravity; WHOLE or None: bounces; FLAG: gravity_in_contact; "
            "POSITIVES or None: rest_velocity",
        ),
        method(blank(jc.Bounce), "height_at", "REALS: time", staged=True),
        case("Event", "INSIDE or None: rtol atol"),
        case("Phase", "WHOLE: steps; INSIDE or None: tolerance"),
    ]
