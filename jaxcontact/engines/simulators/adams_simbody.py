"""Multibody codes that are not run here: Adams and Simbody."""

from __future__ import annotations

import math

import jax.numpy as jnp
from scipy.optimize import root_scalar

from ... import (
    Contact,
    Damped,
    MarhefkaOrin,
    Status,
    StepDamping,
    exact_damping_factor,
    impact,
)
from ...extend import POSITIVE, require_choice, require_number
from ..engine import Draft, Engine, Wanted, matched_stiffness, register_engine

_SHARE = 0.01
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
            depth = _SHARE * deepest
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
