"""Granular codes that are not run here: YADE, Chrono and MercuryDPM."""

from __future__ import annotations

import math
from typing import ClassVar

from ... import Contact, Luding
from ...extend import POSITIVE, Range, require_number
from ..at_time_step import Scheme
from ..engine import Draft, Engine, Wanted, as_luding, register_engine
from .dashpots import PULLS, clamped_sphere, pulling_dashpot

_NOT_RUN = "Not run: MercuryDPM is not a Python package."
_POISSON = Range(low=-1.0, high=0.5, low_open=True, inside=0.3)


class AbstractSpheres(Engine):
    """A Hertz contact of K = (4/3) √R E*, damped by a restitution, clamped instead of pulling.

    `parameters` are the engine's names of Young's modulus, Poisson's ratio and the restitution, and
    `snippet` is a format of these three. `model`, `limit` and `source` are those of `Draft`.
    """

    model: ClassVar[str]
    parameters: ClassVar[tuple[str, str, str]]
    snippet: ClassVar[str]
    limit: ClassVar[str]
    source: ClassVar[str]

    def draft(self, wanted: Wanted, *, radius: float, poisson_ratio: float = 0.3) -> Draft:
        radius = require_number("radius", radius, POSITIVE)
        poisson = require_number("poisson_ratio", poisson_ratio, _POISSON)
        law, stiffness, nominal = clamped_sphere(
            wanted, f"engine {self.name!r}", "'drake', 'exudyn' or 'lammps'"
        )
        # Two equal bodies have E* = E/(2(1-ν²)).
        young = 2 * (1 - poisson**2) * 0.75 * stiffness / math.sqrt(radius)
        numbers = young, poisson, nominal
        return Draft(
            model=self.model,
            law=law,
            contact=Contact(wanted.mass, stiffness, 1.5),
            parameters=dict(zip(self.parameters, numbers, strict=True)),
            units=dict(zip(self.parameters, ("Pa", "", ""), strict=True)),
            snippet=self.snippet.format(*numbers),
            limit=self.limit,
            source=f"{self.source}; Antypov & Elliott 2011, doi 10.1209/0295-5075/94/50004",
        )


@register_engine
class Yade(AbstractSpheres):
    """YADE's Hertz contact: K = (4/3) √R E*, and damping by `en`, clamped instead of pulling.

    F = K δ^(3/2) + √5 ζ √(Km) δ^(1/4) δ' with ζ = -ln en/√(π² + ln² en). This is the law of Antypov
    and Elliott without tension, which delivers more than `en`.
    """

    name = "yade"
    model = "Law2_ScGeom_MindlinPhys_Mindlin"
    parameters: ClassVar[tuple[str, str, str]] = ("young", "poisson", "en")
    snippet = (
        "FrictMat(young={0:.12g}, poisson={1:.12g}, frictionAngle=0)\n"
        "Ip2_FrictMat_FrictMat_MindlinPhys(en={2:.12g}, es={2:.12g})\n"
        "Law2_ScGeom_MindlinPhys_Mindlin()"
    )
    limit = (
        "for both materials. `radius` is YADE's effective one, R1 R2/(R1+R2), and half of the "
        "sphere's against a wall or facet; the mass is the effective one. e does not depend on "
        "speed; 0.136 at least. Not run: YADE is not a Python package."
    )
    source = "pkg/dem/HertzMindlin.cpp of gitlab.com/yade-dev/trunk"


@register_engine
class Chrono(AbstractSpheres):
    """Chrono's smooth contact (SMC) of Hertz: as in YADE, with the restitution of the material."""

    name = "chrono"
    model = "ChSystemSMC, ContactForceModel Hertz"
    parameters: ClassVar[tuple[str, str, str]] = ("young_modulus", "poisson_ratio", "restitution")
    snippet = (
        "material = chrono.ChContactMaterialSMC()\n"
        "material.SetYoungModulus({:.12g})\n"
        "material.SetPoissonRatio({:.12g})\n"
        "material.SetRestitution({:.12g})\n"
        "system.SetContactForceModel(chrono.ChSystemSMC.Hertz)"
    )
    limit = (
        "for both materials, used by their properties and without adhesion. The effective mass "
        "counts a fixed body with its own mass: make that a thousand times the ball's. e does not "
        "depend on speed; 0.136 at least. Not run: Chrono comes from conda, not as a wheel."
    )
    source = "ChContactSMC.h and ChSystemSMC.cpp of github.com/projectchrono/chrono"


def _plastic(wanted: Wanted, law: Luding, radius: float | None) -> Draft:
    """Return MercuryDPM's LinearPlasticViscoelasticSpecies without dissipation.

    It unloads with k2 = k1 + (k2max - k1) δ_m/δ*, δ* = φ 2R k2max/(k2max - k1), and pulls with kc.
    Here φ = 1, its largest value, which a contact of spheres does not reach.
    """
    ratio, slope = float(law.ratio), float(law.slope)
    if slope > 0 and ratio != 1:
        raise ValueError(
            "Argument `law` must have the ratio 1 or the slope 0 for engine 'mercurydpm', but has "
            f"the ratio {ratio:g} and the slope {slope:g} 1/m."
        )
    if slope > 0:
        if radius is None:
            raise ValueError(
                "Argument `radius` is needed for a law with a slope for engine 'mercurydpm', but "
                "is None."
            )
        ratio = 1 + slope * (radius + math.sqrt(radius * (radius + 2 / slope)))
    loading = wanted.stiffness
    names = "loadingStiffness", "unloadingStiffnessMax", "cohesionStiffness", "penetrationDepthMax"
    numbers = loading, ratio * loading, float(law.adhesion) * loading, 1.0
    option = "" if slope > 0 else "// with the option doConstantUnloadingStiffness\n"
    return Draft(
        model="LinearPlasticViscoelasticSpecies",
        law=law,
        contact=Contact(wanted.mass, loading, 1.0),
        parameters=dict(zip(names, numbers, strict=True)),
        units=dict(zip(names, ("N/m", "N/m", "N/m", ""), strict=True)),
        snippet=(
            f"{option}species->setPlasticParameters({', '.join(f'{x:.12g}' for x in numbers)});\n"
            "species->setDissipation(0);"
        ),
        limit=(
            "The same law at all speeds, for all masses, and with a slope for this effective "
            "radius. computeTimeStep is then shorter than needed: k2max is that of an overlap of "
            f"the whole sphere. {_NOT_RUN}"
        ),
        source=(
            "LinearPlasticViscoelasticInteraction.cc of bitbucket.org/mercurydpm; Luding 2008, "
            "doi 10.1007/s10035-008-0099-x"
        ),
    )


@register_engine
class MercuryDPM(Engine):
    """MercuryDPM's linear species: F = k δ + γ δ', which may pull and delivers exactly its e.

    A `Luding` or `WaltonBraun` is exported as it is, to the linear plastic species.
    """

    name = "mercurydpm"

    def draft(self, wanted: Wanted, *, radius: float | None = None) -> Draft:
        law = as_luding(wanted.law)
        if radius is not None:
            radius = require_number("radius", radius, POSITIVE)
        return self._dashpot(wanted) if law is None else _plastic(wanted, law, radius)

    def _dashpot(self, wanted: Wanted) -> Draft:
        law, stiffness, dissipation = pulling_dashpot(wanted)
        return Draft(
            model="LinearViscoelasticSpecies",
            law=law,
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters={"stiffness": stiffness, "dissipation": dissipation},
            units={"stiffness": "N/m", "dissipation": "N s/m"},
            snippet=(
                f"species->setStiffness({stiffness:.12g});\n"
                f"species->setDissipation({dissipation:.12g});"
            ),
            scheme=Scheme.SEMI_IMPLICIT,
            limit=f"{PULLS}. e is the same at all speeds, for this effective mass. {_NOT_RUN}",
            source=(
                "LinearViscoelasticInteraction.cc of bitbucket.org/mercurydpm; Anagnostopoulos "
                "1988, doi 10.1002/eqe.4290160311"
            ),
        )
