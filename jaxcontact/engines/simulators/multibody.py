"""Adams, and the engines with a Hunt-Crossley contact: Drake, Simbody and Exudyn."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float
from scipy.optimize import root_scalar

from ... import (
    AbstractHuntCrossley,
    CarvalhoMartins,
    Contact,
    Damped,
    Gonthier,
    HuntCrossley,
    KelvinVoigt,
    Luding,
    MarhefkaOrin,
    Status,
    StepDamping,
    exact_damping_factor,
    impact,
)
from ...extend import (
    POSITIVE,
    RESTITUTION,
    concrete,
    parameter,
    rendered,
    require_choice,
    require_number,
)
from ..at_time_step import Scheme
from ..engine import Draft, Engine, Wanted, as_luding, matched_stiffness, register_engine
from .rigid_body import SpringAndDashpot, pulling_dashpot

SHARE = 0.01
"""The default d of Adams, as a fraction of the largest indentation without damping."""

_TRIES = 30
_UNITS = {"m": 1.0, "mm": 1000.0}


@register_engine
class Adams(Engine):
    """IMPACT of Adams, max(0, K δⁿ + STEP(δ, 0, 0, d, c_max) δ'), with the c_max that delivers e.

    `d` in m is the depth of the full damping. The default is that of an exported `StepDamping`, and
    for other laws 1 % of the largest indentation without damping. `length` is the model's unit, "m"
    or "mm".
    """

    name = "adams"

    def draft(self, wanted: Wanted, *, d: float | None = None, length: str = "m") -> Draft:
        unit = _UNITS[require_choice("length", length, tuple(_UNITS))]
        n = wanted.exponent
        energy = wanted.mass * wanted.velocity**2
        deepest = ((n + 1) / 2 * energy / wanted.stiffness) ** (1 / (n + 1))
        if d is not None:
            depth = require_number("d", d, POSITIVE)
        elif isinstance(wanted.law, StepDamping):
            depth = float(wanted.law.d)
        else:
            depth = SHARE * deepest
        contact = Contact(wanted.mass, wanted.stiffness, n)
        # The dashpot with e near 1/2 if the full damping acted from touch to the end.
        usual = wanted.mass * wanted.velocity / deepest
        c_max = _delivering(wanted, contact, depth, usual * max(1.0, depth / deepest) ** 2)
        parameters = {
            "stiffness": wanted.stiffness / unit**n,
            "force_exponent": n,
            "damping": c_max / unit,
            "penetration_depth": depth * unit,
        }
        numbers = ", ".join(f"{x:.12g}" for x in parameters.values())
        return Draft(
            model="IMPACT function",
            law=StepDamping(c_max=jnp.asarray(c_max), d=jnp.asarray(depth)),
            contact=contact,
            parameters=parameters,
            units={
                "stiffness": f"N/{length}^{n:g}",
                "force_exponent": "",
                "damping": f"N s/{length}",
                "penetration_depth": length,
            },
            snippet=f"IMPACT(DM(i, j), VR(i, j), x1, {numbers})",
            limit=(
                f"for a model in N, {length} and s. i and j are the markers, x1 their distance at "
                "touch (the radius of a ball on a plane, with DZ and VZ). e depends on speed, "
                "and mostly rises with it for small d. Not run: Adams needs a licence. A step of "
                "its integrator must resolve d."
            ),
            source="IMPACT and STEP in the Adams Solver documentation, MSC Software (Hexagon)",
        )


def _delivering(wanted: Wanted, contact: Contact, depth: float, usual: float) -> float:
    """Return the c_max in N s/m with which the contact delivers the wanted e, or ValueError."""

    def logarithm(c_max: float) -> float:
        law = StepDamping(c_max=jnp.asarray(c_max), d=jnp.asarray(depth))
        hit = impact(law, contact, speed, throw=False)
        e = float(hit.restitution)
        if int(hit.status) != Status.SEPARATED or not e > 0:
            return -math.inf
        return math.log(e / wanted.restitution)

    speed = jnp.asarray(wanted.velocity)
    if wanted.restitution >= 1:
        return 0.0
    low, high = 0.0, usual
    for _ in range(_TRIES):
        if not logarithm(high) > 0:
            break
        low, high = high, 4 * high
    if not math.isfinite(logarithm(high)) or logarithm(high) > 0:
        raise ValueError(
            f"Argument `d` must let IMPACT deliver the restitution {wanted.restitution:.6g}, but "
            f"is {depth:g} m, for which no c_max was found; reduce it."
        )
    root = root_scalar(logarithm, bracket=(low, high), xtol=1e-13 * high, rtol=1e-13)
    return float(root.root)


_DRAKE = "drake.mit.edu/doxygen_cxx/group__compliant__contact.html"
_APPROXIMATIONS = "lagged", "similar", "sap"


@register_engine
class Drake(Engine):
    """Drake's point contact F = k δ (1 + d δ'): α = d v0, so d = α(e)/v0, exactly.

    This is the law of Marhefka and Orin with a = (2/3) d. The approximation "sap" has the law F = k
    (δ + τ δ') while positive, which is Kelvin-Voigt without tension.
    """

    name = "drake"

    def draft(self, wanted: Wanted, *, discrete_contact_approximation: str = "lagged") -> Draft:
        name = "discrete_contact_approximation"
        if require_choice(name, discrete_contact_approximation, _APPROXIMATIONS) == "sap":
            return _sap(wanted)
        alpha = exact_damping_factor(wanted.restitution)
        dissipation = float(alpha) / wanted.velocity
        stiffness = matched_stiffness(wanted, 1.0, Damped(alpha=alpha))
        # Two geometries in series: each has twice the stiffness and the same dissipation.
        of_each = 2 * stiffness
        return Draft(
            model="point contact",
            law=MarhefkaOrin(a=jnp.asarray(dissipation / 1.5)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters={
                "hunt_crossley_dissipation": dissipation,
                "point_contact_stiffness": of_each,
            },
            units={"hunt_crossley_dissipation": "s/m", "point_contact_stiffness": "N/m"},
            snippet=(
                "<drake:proximity_properties>\n"
                f"  <drake:hunt_crossley_dissipation>{dissipation:.12g}"
                "</drake:hunt_crossley_dissipation>\n"
                f"  <drake:point_contact_stiffness>{of_each:.12g}</drake:point_contact_stiffness>\n"
                "</drake:proximity_properties>"
            ),
            steps=1000,
            expected_error=0.006,
            limit=(
                "for both geometries, each with these numbers. e falls with speed. A discrete "
                "plant adds damping of first order in the time step; a continuous one "
                "(time_step=0) does not. Contact approximation lagged or similar; for sap ask for "
                "discrete_contact_approximation=sap."
            ),
            scheme=Scheme.IMPLICIT,
            source=f"{_DRAKE}; Hunt & Crossley 1975, doi 10.1115/1.3423596",
        )


def _sap(wanted: Wanted) -> Draft:
    law = KelvinVoigt(e=jnp.asarray(wanted.restitution), tension=False)
    zeta = float(law.damping_ratio())
    stiffness = matched_stiffness(wanted, 1.0, law)
    # δ'' = -ω² (δ + τ δ'), and 2 ζ ω = ω² τ.
    rate = math.sqrt(stiffness / wanted.mass)
    relaxation = max(0.0, 2 * zeta / rate)
    # Two geometries in series: their relaxation times add.
    parameters = {"relaxation_time": relaxation / 2, "point_contact_stiffness": 2 * stiffness}
    lines = [f"  <drake:{name}>{x:.12g}</drake:{name}>\n" for name, x in parameters.items()]
    return Draft(
        model="point contact, discrete_contact_approximation sap",
        law=SpringAndDashpot(rate=jnp.asarray(relaxation * rate**2)),
        contact=Contact(wanted.mass, stiffness, 1.0),
        parameters=parameters,
        units={"relaxation_time": "s", "point_contact_stiffness": "N/m"},
        snippet=f"<drake:proximity_properties>\n{''.join(lines)}</drake:proximity_properties>",
        scheme=Scheme.IMPLICIT,
        limit=(
            "for both geometries, each with these numbers. Linear: the duration is that of the "
            "law at this speed; the force differs, it jumps at touch. e is the same at all "
            "speeds, for this mass. Only for a discrete plant; sap lowers a stiffness that its "
            "time step does not resolve. Not run."
        ),
        source=(
            f"{_DRAKE}; contact_properties.cc of github.com/RobotLocomotion/drake; Castro et al. "
            "2021, arXiv 2110.10107; Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z"
        ),
    )


@register_engine
class Simbody(Engine):
    """Simbody's HuntCrossleyForce F = (4/3) √R E* δ^(3/2) (1 + (3/2) c δ'): c = 2 α(e)/(3 v0)."""

    name = "simbody"

    def draft(self, wanted: Wanted, *, radius: float) -> Draft:
        radius = require_number("radius", radius, POSITIVE)
        alpha = exact_damping_factor(wanted.restitution)
        dissipation = float(alpha) / (1.5 * wanted.velocity)
        stiffness = matched_stiffness(wanted, 1.5, Damped(alpha=alpha))
        # For two equal surfaces Simbody halves E^(2/3) and then raises it to the power 3/2.
        of_each = 1.5 * math.sqrt(2 / radius) * stiffness
        return Draft(
            model="HuntCrossleyForce",
            law=MarhefkaOrin(a=jnp.asarray(dissipation)),
            contact=Contact(wanted.mass, stiffness, 1.5),
            parameters={"dissipation": dissipation, "stiffness": of_each},
            units={"dissipation": "s/m", "stiffness": "Pa"},
            snippet=(
                f"force.setBodyParameters(surface, {of_each:.12g}, {dissipation:.12g}, 0, 0, 0);"
            ),
            limit=(
                "for both surfaces, each with these numbers. e falls with speed. Not run: Simbody "
                "has no Python package; its integrators control their own step."
            ),
            source="HuntCrossleyForce in Simbody's documentation, simtk.org/projects/simbody; "
            "Hunt & Crossley 1975, doi 10.1115/1.3423596",
        )


class GonthierCarvalhoMartins(AbstractHuntCrossley):
    """Exudyn's impactModel 2: α of Carvalho and Martins for e > 1/3, of Gonthier et al. below.

    `e` in (0, 1] is the restitutionCoefficient of the connector. The two formulas agree at e = 1/3.
    Source: ObjectContactSphereSphere in Exudyn's documentation, exudyn.readthedocs.io.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    def damping_factor(
        self, contact: Contact | None = None, velocity: Any = None
    ) -> Float[Array, "..."]:
        above = CarvalhoMartins(e=self.e).damping_factor()
        return jnp.where(self.e > 1 / 3, above, Gonthier(e=self.e).damping_factor())


def _of_both(alpha: float) -> float:
    """Return the e whose α is that of Carvalho and Martins (above 1/3) or of Gonthier et al."""
    # Both are quadratic in e: 3(1-e)(11-e) = 2α(1+9e), and 1-e² = αe. Their α agree at e = 1/3.
    if alpha < 8 / 3:
        half = 6 + 3 * alpha
        constant = 11 - 2 * alpha / 3
        return constant / (half + math.sqrt(half**2 - constant))
    return 2 / (alpha + math.sqrt(alpha**2 + 4))


# For each impactModel: its law, the e for a given α, and its source.
_MODELS = {
    1: (HuntCrossley, lambda alpha: 1 - alpha / 1.5, "Hunt & Crossley 1975, doi 10.1115/1.3423596"),
    2: (
        GonthierCarvalhoMartins,
        _of_both,
        "Gonthier et al. 2004, doi 10.1023/B:MUBO.0000029392.21648.bc; "
        "Carvalho & Martins 2019, doi 10.1016/j.mechmachtheory.2019.04.018",
    ),
}


def _plastic(wanted: Wanted, law: Luding) -> Draft:
    """Return Exudyn's model 0: K δ, back K (δ - λ δ_m)/(1-λ), and at least -k_adh δ."""
    if float(law.slope) != 0:
        raise ValueError(
            "Argument `law` must have the slope 0 for engine 'exudyn', but has "
            f"{float(law.slope):g} 1/m; to match its restitution alone, give `impact_model=2`."
        )
    parameters = {
        "contactStiffness": wanted.stiffness,
        "contactStiffnessExponent": 1.0,
        "contactPlasticityRatio": 1 - 1 / float(law.ratio),
        "adhesionCoefficient": float(law.adhesion) * wanted.stiffness,
        "adhesionExponent": 1.0,
    }
    pasted = ", ".join(f"{name}={x:.12g}" for name, x in parameters.items())
    return Draft(
        model="ObjectContactSphereSphere, impactModel 0",
        law=law,
        contact=Contact(wanted.mass, wanted.stiffness, 1.0),
        parameters=parameters,
        units=dict(zip(parameters, ("N/m", "", "", "N/m", ""), strict=True)),
        snippet=f"{pasted}, contactDamping=0, impactModel=0",
        steps=200,
        expected_error=0.004,
        limit="The same law at all speeds, for all masses. The bodies must start apart.",
        source=(
            "ObjectContactSphereSphere, exudyn.readthedocs.io; Luding 2008, "
            "doi 10.1007/s10035-008-0099-x"
        ),
    )


def _dashpot(wanted: Wanted) -> Draft:
    """Return Exudyn's model 0 with damping: K δ + d δ', which may pull."""
    law, stiffness, damping = pulling_dashpot(wanted)
    parameters = {
        "contactStiffness": stiffness,
        "contactStiffnessExponent": 1.0,
        "contactDamping": damping,
    }
    pasted = ", ".join(f"{name}={x:.12g}" for name, x in parameters.items())
    return Draft(
        model="ObjectContactSphereSphere, impactModel 0",
        law=law,
        contact=Contact(wanted.mass, stiffness, 1.0),
        parameters=parameters,
        units=dict(zip(parameters, ("N/m", "", "N s/m"), strict=True)),
        snippet=f"{pasted}, impactModel=0",
        steps=800,
        expected_error=0.008,
        limit=(
            "Linear: the duration is that of the law at this speed; the force differs, it jumps "
            "at touch and pulls at the end. e is the same at all speeds, for this mass. The "
            "bodies must start apart."
        ),
        source=(
            "ObjectContactSphereSphere, exudyn.readthedocs.io; Anagnostopoulos 1988, "
            "doi 10.1002/eqe.4290160311"
        ),
    )


@register_engine
class Exudyn(Engine):
    """Exudyn's ObjectContactSphereSphere, with the coefficient for which its α is α(e).

    A `Luding` or `WaltonBraun` is exported as it is, unless an `impact_model` of 1 or 2 is given.
    """

    name = "exudyn"

    def draft(self, wanted: Wanted, *, impact_model: int | None = None) -> Draft:
        if impact_model is not None and concrete(impact_model) not in (0, *_MODELS):
            raise ValueError(
                f"Argument `impact_model` must be 0, 1 or 2, but is {rendered(impact_model)}."
            )
        if not impact_model and (law := as_luding(wanted.law)) is not None:
            return _plastic(wanted, law)
        if impact_model == 0:
            return _dashpot(wanted)
        impact_model = 2 if impact_model is None else int(impact_model)
        alpha = float(exact_damping_factor(wanted.restitution))
        kind, inverse, source = _MODELS[impact_model]
        nominal = inverse(alpha)
        if not nominal > 0:
            raise ValueError(
                "Argument `impact_model` must be 2 here, but is 1, which delivers at least "
                f"0.48774: {wanted.restitution:g} is wanted."
            )
        return Draft(
            model=f"ObjectContactSphereSphere, impactModel {impact_model}",
            law=kind(e=jnp.asarray(nominal)),
            contact=Contact(wanted.mass, wanted.stiffness, wanted.exponent),
            parameters={
                "restitutionCoefficient": nominal,
                "contactStiffness": wanted.stiffness,
                "contactStiffnessExponent": wanted.exponent,
            },
            units={
                "restitutionCoefficient": "",
                "contactStiffness": f"N/m^{wanted.exponent:g}",
                "contactStiffnessExponent": "",
            },
            snippet=(
                f"contactStiffness={wanted.stiffness:.12g}, "
                f"contactStiffnessExponent={wanted.exponent:.12g}, contactDamping=0, "
                f"restitutionCoefficient={nominal:.12g}, impactModel={impact_model}"
            ),
            steps=50,
            expected_error=0.002,
            limit=(
                "e does not depend on speed, down to minimumImpactVelocity: the connector stores "
                "the speed at touch. The bodies must start apart: a ball that starts in touch is "
                "never damped."
            ),
            source=f"ObjectContactSphereSphere, exudyn.readthedocs.io; {source}",
        )
