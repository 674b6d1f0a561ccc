"""LAMMPS: pair_style granular with six dampings, and its dmt, which is our `DMT`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float
from scipy.optimize import root_scalar

from ... import DMT, JKR, AbstractLaw, AntypovElliott, Contact, KuwabaraKono, Tsuji, restitution
from ...extend import (
    POSITIVE,
    AbstractOscillator,
    Range,
    parameter,
    require_choice,
    require_number,
)
from ..at_time_step import Scheme
from ..engine import Draft, Wanted, matched_stiffness, register_engine
from .dashpots import clamped_sphere, pulling_dashpot
from .lammps_scene import LammpsScene


class TsujiWithoutRoot(AbstractOscillator):
    """LAMMPS' damping tsuji up to the release of 22 July 2025: Tsuji's polynomial without the √2.

    F = K δ^(3/2) + p(e) √(Km) δ^(1/4) δ', with p the polynomial of `Tsuji` and m the effective
    mass, for which the fit was not made. `e` in [0, 1] is the coefficient in the pair_coeff line.
    Source: the page of pair_style granular, docs.lammps.org/pair_granular.html.
    """

    e: Float[Array, "..."] = parameter("e", Range(low=0.0, high=1.0, inside=0.5))
    tension = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return ζ = p(e)/√5."""
        return Tsuji(e=self.e).damping_ratio() / math.sqrt(2)


Solved = tuple[AbstractLaw, float, float]
"""A law that delivers the restitution, K in N/mⁿ, and the coefficient of the damping."""


class Damping(NamedTuple):
    """A kind of damping: its solver, and its texts in the export."""

    solve: Callable[[Wanted, float], Solved]
    keyword: str
    coefficient: str
    unit: str
    limit: str
    source: str
    run: bool = True
    """True if LAMMPS itself was run with it."""
    normal: str = "hertz"
    """Its elastic force here: "hertz", or "hooke" with n = 1."""


def _coeff_restitution(wanted: Wanted, radius: float) -> Solved:
    law = AntypovElliott(e=jnp.asarray(wanted.restitution))
    return law, matched_stiffness(wanted, 1.5, law), wanted.restitution


def _clamped(wanted: Wanted, radius: float) -> Solved:
    where = "LAMMPS' damping 'limit_damping', which `RigidCoulomb` needs"
    instead = "in a scene a `SpringSlider`, and in `export` the damping 'coeff_restitution'"
    return clamped_sphere(wanted, where, instead)


def _polynomial(kind: Callable[..., AbstractLaw]) -> Callable[[Wanted, float], Solved]:
    """Return a solver for a law whose parameter e is not the restitution that it delivers."""

    def solve(wanted: Wanted, radius: float) -> Solved:
        def excess(e: float) -> float:
            return float(restitution(kind(e=jnp.asarray(e)))) - wanted.restitution

        lowest, highest = excess(0.0), excess(1.0)
        if not lowest <= 0 <= highest:
            raise ValueError(
                "Argument `damping` must be one that delivers the restitution "
                f"{wanted.restitution:g}, but 'tsuji' delivers {lowest + wanted.restitution:.4g} "
                f"to {highest + wanted.restitution:.4g}; try 'coeff_restitution'."
            )
        e = root_scalar(excess, bracket=(0.0, 1.0), xtol=1e-14).root
        law = kind(e=jnp.asarray(e))
        return law, matched_stiffness(wanted, 1.5, law), e

    return solve


def _mass_velocity(wanted: Wanted, radius: float) -> Solved:
    # The force in LAMMPS is F = k δ + η m δ'.
    law, stiffness, damping = pulling_dashpot(wanted)
    return law, stiffness, damping / wanted.mass


def _viscoelastic(wanted: Wanted, radius: float) -> Solved:
    # The force in LAMMPS is F = K δ^(3/2) + η m √(R δ) δ': the law of Kuwabara and Kono with A = 2
    # η m √R/(3K). In units where mass, stiffness and speed are 1, A is its only number.
    scaled = KuwabaraKono(A=jnp.asarray(_scaled_relaxation(wanted.restitution)))
    stiffness = matched_stiffness(wanted, 1.5, scaled)
    time = (wanted.mass / stiffness) ** 0.4 * wanted.velocity**-0.2
    law = KuwabaraKono(A=scaled.A * time)
    eta = 1.5 * stiffness * float(law.A) / (wanted.mass * math.sqrt(radius))
    return law, stiffness, eta


def _scaled_relaxation(wanted: float) -> float:
    """Return the A of Kuwabara and Kono that delivers e in a contact of mass, stiffness and speed
    1.
    """
    unit = Contact(1.0, 1.0, 1.5)

    def excess(relaxation: float) -> float:
        return float(restitution(KuwabaraKono(A=jnp.asarray(relaxation)), unit, 1.0)) - wanted

    if wanted >= 1 or excess(0.0) <= 0:
        return 0.0
    high = 1.0
    # e falls to zero as A grows, finally as A⁻⁵.
    while excess(high) > 0:
        high *= 2
    return root_scalar(excess, bracket=(0.0, high), xtol=1e-14).root


_PULLS = "The contact pulls at its end, so not for limit_damping."
_CONSTANT = f"e does not depend on speed. {_PULLS}"
_TSUJI = "Tsuji et al. 1992, doi 10.1016/0032-5910(92)88030-L"
DAMPINGS = {
    "coeff_restitution": Damping(
        _coeff_restitution,
        *("coeff_restitution", "e", "", _CONSTANT),
        "Antypov & Elliott 2011, doi 10.1209/0295-5075/94/50004",
    ),
    "limit_damping": Damping(
        _clamped,
        *("coeff_restitution limit_damping", "e", ""),
        "The force is cut off where it would pull. e does not depend on speed; 0.136 at least.",
        "Antypov & Elliott 2011, doi 10.1209/0295-5075/94/50004",
    ),
    "tsuji": Damping(
        _polynomial(TsujiWithoutRoot),
        *("tsuji", "e", ""),
        "releases up to 22 July 2025, which lack the √2 of the effective mass (for later ones take "
        f"'tsuji_sqrt2'); delivers 0.114 to 0.9996. {_CONSTANT}",
        _TSUJI,
    ),
    "tsuji_sqrt2": Damping(
        _polynomial(Tsuji),
        *("tsuji", "e", ""),
        "versions of 2026 that multiply by the √2 of the effective mass (for earlier ones take "
        f"'tsuji'); not run, the wheel of 22 July 2025 is without it. {_CONSTANT}",
        _TSUJI,
        run=False,
    ),
    "viscoelastic": Damping(
        _viscoelastic,
        *("viscoelastic", "eta_n0", "1/(m s)"),
        f"e is that at this speed, mass and radius; it falls with speed. {_PULLS}",
        "Brilliantov et al. 1996, doi 10.1103/PhysRevE.53.5382",
    ),
    "mass_velocity": Damping(
        _mass_velocity,
        *("mass_velocity", "eta_n0", "1/s"),
        "normal model hooke, linear: the duration is that of the law at this speed; the force "
        f"differs, it jumps at touch. {_CONSTANT} Not run.",
        "Anagnostopoulos 1988, doi 10.1002/eqe.4290160311",
        run=False,
        normal="hooke",
    ),
}

_POISSON = 0.3
"""ν of the snippet: the normal force depends on E/(1-ν²) only."""


def _dmt(wanted: Wanted, law: DMT, radius: float) -> Draft:
    """Return LAMMPS' dmt, F = (4/3) E* √R δ^(3/2) - 4πγR, with E* = E/(2(1-ν²)) of like spheres."""
    young = 1.5 * (1 - _POISSON**2) * wanted.stiffness / math.sqrt(radius)
    energy = float(law.pull_off) / (4 * math.pi * radius)
    return Draft(
        model="pair_style granular, dmt",
        law=law,
        contact=Contact(wanted.mass, wanted.stiffness, 1.5),
        parameters={"E": young, "eta_n0": 0.0, "nu": _POISSON, "gamma": energy},
        units={"E": "Pa", "eta_n0": "1/(m s)", "nu": "", "gamma": "J/m^2"},
        snippet=(
            "pair_style granular\n"
            f"pair_coeff * * dmt {young:.12g} 0 {_POISSON} {energy:.12g} "
            "tangential linear_nohistory 0 0"
        ),
        steps=400,
        expected_error=0.006,
        scheme=Scheme.SEMI_IMPLICIT,
        limit=(
            "The same law at all speeds. E and ν are those of like spheres; any other pair with "
            "the same E/(1-ν²) is as good. γ is half of the work of adhesion. Units si."
        ),
        source=(
            "docs.lammps.org/pair_granular.html; Derjaguin, Muller & Toporov 1975, "
            "doi 10.1016/0021-9797(75)90018-1"
        ),
    )


@register_engine
class Lammps(LammpsScene):
    """The pair_coeff line of granular: k_n = K/√R (hertz) or K (hooke), and the damping.

    A `DMT` is exported as it is. LAMMPS' jkr is another law than `JKR`, which is refused.
    """

    def draft(self, wanted: Wanted, *, radius: float, damping: str | None = None) -> Draft:
        radius = require_number("radius", radius, POSITIVE)
        if isinstance(wanted.law, JKR):
            raise ValueError(
                "Argument `law` must not be a `JKR` for engine 'lammps', whose jkr is another law: "
                "it ends a neck at its largest pull, and loses half of the energy. To match the "
                "restitution alone, export `ExactRestitution` with the e of the impact."
            )
        if isinstance(wanted.law, DMT):
            if damping is not None:
                raise ValueError(
                    "Argument `damping` must be None for a `DMT`, which has no damping, but is "
                    f"{damping!r}."
                )
            return _dmt(wanted, wanted.law, radius)
        kind = DAMPINGS[
            require_choice("damping", "coeff_restitution" if damping is None else damping, DAMPINGS)
        ]
        law, stiffness, coefficient = kind.solve(wanted, radius)
        hooke = kind.normal == "hooke"
        normal = stiffness if hooke else stiffness / math.sqrt(radius)
        return Draft(
            model=f"pair_style granular, {kind.normal}, damping {kind.keyword}",
            law=law,
            contact=Contact(wanted.mass, stiffness, 1.0 if hooke else 1.5),
            parameters={"k_n": normal, kind.coefficient: coefficient},
            units={"k_n": "N/m" if hooke else "Pa", kind.coefficient: kind.unit},
            snippet=(
                "pair_style granular\n"
                f"pair_coeff * * {kind.normal} {normal:.12g} {coefficient:.12g} "
                f"tangential linear_nohistory 0 0 damping {kind.keyword}"
            ),
            steps=400 if kind.run else None,
            expected_error=0.009 if kind.run else None,
            scheme=Scheme.SEMI_IMPLICIT,
            limit=f"{kind.limit} Units si.",
            source=f"docs.lammps.org/pair_granular.html; {kind.source}",
        )
