"""LAMMPS: pair_style granular with a hertz contact and three kinds of damping."""

from __future__ import annotations

import math
from collections.abc import Callable

import jax.numpy as jnp
from scipy.optimize import root_scalar

from .._contact import Contact
from .._impact import restitution
from .._laws import AbstractLaw, AntypovElliott, KuwabaraKono, Tsuji
from ._laws import TsujiWithoutRoot, Viscoelastic
from ._wanted import Draft, Wanted, matched_stiffness

_PAGE = "docs.lammps.org/pair_granular.html; "


def lammps(wanted: Wanted, *, radius: float, damping: str = "coeff_restitution") -> Draft:
    """The pair_coeff line of granular hertz: k_n = K/√R, and a coefficient for the damping."""
    if damping not in _DAMPINGS:
        known = ", ".join(map(repr, _DAMPINGS))
        raise ValueError(f"Argument `damping` must be one of {known}, but is {damping!r}.")
    return _DAMPINGS[damping](wanted, radius)


def _draft(
    wanted: Wanted,
    radius: float,
    law: AbstractLaw,
    stiffness: float,
    coefficient: tuple[str, float, str],
    keyword: str,
    limit: str,
    source: str,
    *,
    run: bool = True,
) -> Draft:
    name, value, unit = coefficient
    normal = stiffness / math.sqrt(radius)
    return Draft(
        model=f"pair_style granular, hertz, damping {keyword}",
        law=law,
        contact=Contact(wanted.mass, stiffness, 1.5),
        parameters={"k_n": normal, name: value},
        units={"k_n": "Pa", name: unit},
        snippet=(
            "pair_style granular\n"
            f"pair_coeff * * hertz {normal:.12g} {value:.12g} "
            f"tangential linear_nohistory 0 0 damping {keyword}"
        ),
        steps=400 if run else None,
        expected_error=0.009 if run else None,
        limit=f"{limit} The contact pulls at its end, so not for limit_damping. Units si.",
        source=_PAGE + source,
    )


def _coeff_restitution(wanted: Wanted, radius: float) -> Draft:
    law = AntypovElliott(e=jnp.asarray(wanted.restitution))
    return _draft(
        wanted,
        radius,
        law,
        matched_stiffness(wanted, 1.5, law),
        ("e", wanted.restitution, ""),
        "coeff_restitution",
        "e does not depend on speed.",
        "Antypov & Elliott 2011, doi 10.1209/0295-5075/94/50004",
    )


def _tsuji(wanted: Wanted, radius: float) -> Draft:
    asked = _asked(lambda e: TsujiWithoutRoot(e=jnp.asarray(e)), wanted.restitution)
    law = TsujiWithoutRoot(e=jnp.asarray(asked))
    return _draft(
        wanted,
        radius,
        law,
        matched_stiffness(wanted, 1.5, law),
        ("e", asked, ""),
        "tsuji",
        "releases up to 22 July 2025, which lack the √2 of the effective mass (for later ones take "
        "'tsuji_sqrt2'); delivers 0.114 to 0.9996. e does not depend on speed.",
        "Tsuji et al. 1992, doi 10.1016/0032-5910(92)88030-L",
    )


def _tsuji_sqrt2(wanted: Wanted, radius: float) -> Draft:
    asked = _asked(lambda e: Tsuji(e=jnp.asarray(e)), wanted.restitution)
    law = Tsuji(e=jnp.asarray(asked))
    return _draft(
        wanted,
        radius,
        law,
        matched_stiffness(wanted, 1.5, law),
        ("e", asked, ""),
        "tsuji",
        "versions of 2026 that multiply by the √2 of the effective mass (for earlier ones take "
        "'tsuji'); not run, the wheel of 22 July 2025 is without it. "
        "e does not depend on speed.",
        "Tsuji et al. 1992, doi 10.1016/0032-5910(92)88030-L",
        run=False,
    )


def _viscoelastic(wanted: Wanted, radius: float) -> Draft:
    # In units where mass, stiffness and speed are 1 the law has one number left, A.
    unit = Contact(1.0, 1.0, 1.5)
    scaled = KuwabaraKono(A=jnp.asarray(_scaled_relaxation(wanted.restitution, unit)))
    stiffness = matched_stiffness(wanted, 1.5, scaled)
    time = (wanted.mass / stiffness) ** 0.4 * wanted.velocity**-0.2
    eta = 1.5 * stiffness * float(scaled.A) * time / (wanted.mass * math.sqrt(radius))
    return _draft(
        wanted,
        radius,
        Viscoelastic(eta=jnp.asarray(eta), radius=jnp.asarray(radius)),
        stiffness,
        ("eta_n0", eta, "1/(m s)"),
        "viscoelastic",
        "e is that at this speed, mass and radius; it falls with speed.",
        "Brilliantov et al. 1996, doi 10.1103/PhysRevE.53.5382",
    )


def _asked(law: Callable[[float], AbstractLaw], wanted: float) -> float:
    """The e to ask for, so that e is delivered; ValueError where the polynomial does not reach."""

    def excess(e: float) -> float:
        return float(restitution(law(e))) - wanted

    lowest, highest = excess(0.0), excess(1.0)
    if not lowest <= 0 <= highest:
        raise ValueError(
            f"Argument `damping` must be one that delivers the restitution {wanted:g}, but 'tsuji' "
            f"delivers {lowest + wanted:.4g} to {highest + wanted:.4g}; try 'coeff_restitution'."
        )
    return root_scalar(excess, bracket=(0.0, 1.0), xtol=1e-14).root


def _scaled_relaxation(wanted: float, unit: Contact) -> float:
    """The A of Kuwabara and Kono that delivers e in a contact of mass, stiffness and speed 1."""

    def excess(relaxation: float) -> float:
        return float(restitution(KuwabaraKono(A=jnp.asarray(relaxation)), unit, 1.0)) - wanted

    # Elastic, or so within the error of the solver.
    if wanted >= 1 or excess(0.0) <= 0:
        return 0.0
    high = 1.0
    # e falls without end as A grows, in the end as A⁻⁵.
    while (left := excess(high)) > 0:
        high *= 2
    if math.isnan(left):
        raise ValueError(
            f"Argument `damping` must be one that can be solved for the restitution {wanted:g}, "
            "but is 'viscoelastic', whose steps become too many; try 'coeff_restitution'."
        )
    return root_scalar(excess, bracket=(0.0, high), xtol=1e-14).root


_DAMPINGS = {
    "coeff_restitution": _coeff_restitution,
    "tsuji": _tsuji,
    "tsuji_sqrt2": _tsuji_sqrt2,
    "viscoelastic": _viscoelastic,
}
