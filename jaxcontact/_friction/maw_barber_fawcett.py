"""Spheres whose surfaces stick and slip in parts, and the curve of Maw, Barber and Fawcett."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import (
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    as_parameter,
    optional_parameter,
    parameter,
    refuses_unknown,
    require_broadcast,
)
from .base import AbstractFriction, Lane, NormalPath, Tangential, TangentialOutcome
from .mbf_curve import ALPHA, CHI, CHI_DAMPED, full_sliding, in_table, mbf_curve
from .return_mapping import springs_along
from .scaled import hertzian, spring_of


class MawBarberFawcett(AbstractFriction):
    """The friction of elastic spheres, parts of whose contact stick while others slip.

    u' = (μ/κ) ψ2(ψ1, χ, α) with ψ1 = κ u0/(μ v0), χ = λκ/2, by the table of `tangential_rebound`,
    which tells its errors and range. Beyond the range only full sliding is known, and other lanes
    are flagged. Valid for Hertz contacts (n = 3/2) with a force K δⁿ (1 + α δ'/v0). For α > 0 the
    limit of friction within the contact is a choice of modelling.

    Arguments: the coefficient `mu` μ ≥ 0; `ratio` κ > 0, the tangential stiffness over the normal
    one, None for that of the contact's materials, 4G*/E*. Leaves. Raises ValueError for a Python
    scalar out of range. Source: Maw, Barber & Fawcett (1976), doi 10.1016/0043-1648(76)90201-5.
    """

    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    ratio: Float[Array, "..."] | None = optional_parameter(POSITIVE, "-")

    @refuses_unknown
    def __init__(self, mu: ArrayLike, ratio: ArrayLike | None = None):
        self.mu = as_parameter(mu, "mu", NOT_NEGATIVE)
        self.ratio = None if ratio is None else as_parameter(ratio, "ratio", POSITIVE)

    @property
    def substeps(self) -> int:
        return 16

    def uncovered(self, problem: Tangential) -> str | None:
        chi, alpha = spring_of(self, problem).chi, problem.alpha
        if alpha is None or bool(in_table(chi, alpha)):
            return None
        return (
            f"The table of `{type(self).__name__}` does not cover χ = λκ/2 = {float(chi):.4g} with "
            f"α = {float(alpha):.4g}. It covers χ from {CHI[0]} to {CHI[1]} for α = 0, and from "
            f"{CHI_DAMPED[0]:g} to {CHI_DAMPED[1]:g} for α up to {ALPHA:g} (e ≥ 0.5). "
            "`SpringSlider` takes any χ and α."
        )

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        slip, force = springs_along(spring_of(self, problem), path)
        return slip, self.mu * force

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        scaled, alpha = spring_of(self, problem), problem.alpha
        if alpha is None or not hertzian(problem):
            raise ValueError(
                "Argument `friction` must not be a `MawBarberFawcett` for a normal force other "
                "than K δ^1.5 (1 + α δ'/v0), for which its table is; `SpringSlider` takes any."
            )
        slid = scaled.free | (scaled.psi >= full_sliding(scaled.chi, alpha))
        inside = in_table(scaled.chi, alpha)
        # Full sliding is a formula for every χ and α; the table has a range.
        known = (jnp.where(inside, x, y) for x, y in ((scaled.chi, 1.2), (alpha, 0.0)))
        part = jnp.where(inside, scaled.slip(mbf_curve(scaled.psi, *known)), jnp.nan)
        return TangentialOutcome(
            slip=jnp.where(slid, problem.after_sliding(self.mu), part), slid=slid
        )


_CHI = Range(*CHI, inside=1.2)
_ALPHA = Range(0.0, ALPHA, inside=0.0)


def tangential_rebound(psi1: ArrayLike, chi: ArrayLike, alpha: ArrayLike = 0.0) -> Lane:
    """Return the scaled rebound speed along the contact of spheres, by Maw, Barber and Fawcett.

    `ψ2 = ψ2(ψ1; χ, α)` with ψ = κu/μ, from springs q < √x with t' = ψ while they stick and |t| ≤ (x
    - q²)(1 + αx'), ψ' = -3χ ∫ t dq and x'' = -x^1.5 (1 + αx'). Gross slip has ψ2 = ψ1 - 2χ(1+e).

    Arguments: `psi1` ψ1 = κu0/μ, with the speed u0 along the contact over the normal speed, the
    ratio κ of tangential to normal stiffness, and the friction μ. `chi` χ = λκ/2 in [0.8, 1.8],
    with the ratio λ of the mass to the mass along the contact (7/2 for solid spheres). `alpha` the
    damping factor α in [0, 1.433], see `exact_damping_factor`; only for χ in [1, 1.75] may it be
    other than 0. They have any shapes that broadcast and no dimension. A single χ and α are much
    faster than one for each impact.

    Returns ψ2, odd in ψ1, of the common shape; NaN where χ or α is out of range. Its first
    derivatives are continuous, but for that error.

    Valid for Hertz contact with Hunt-Crossley damping, and a constant direction of slip.
    Interpolated from a table. At random places its error is at most 6e-9 without damping (1e-10 in
    the median). With damping it is 6e-8 in the median, 3e-6 at most for χ < 1.65 and 7e-6 beyond,
    and the derivative by ψ1 jumps by up to 2e-3 at ψ1 = 1 + α. Where χ is outside [1, 1.75], the
    derivative by α has no meaning. Raises ValueError for a Python scalar out of range and for
    shapes that do not broadcast. Source: doi 10.1016/0043-1648(76)90201-5.
    """
    psi1 = as_parameter(psi1, "psi1")
    chi, alpha = as_parameter(chi, "chi", _CHI), as_parameter(alpha, "alpha", _ALPHA)
    require_broadcast(psi1=psi1, chi=chi, alpha=alpha)
    return _odd_curve(psi1, chi, alpha)


@jax.jit
def _odd_curve(psi1: Lane, chi: Lane, alpha: Lane) -> Lane:
    rank = max(psi1.ndim, chi.ndim, alpha.ndim)
    psi1, chi, alpha = (x.reshape((1,) * (rank - x.ndim) + x.shape) for x in (psi1, chi, alpha))
    good = in_table(chi, alpha)
    chi, alpha = jnp.where(good, chi, _CHI.inside), jnp.where(good, alpha, _ALPHA.inside)
    backward = psi1 < 0
    # abs would have the derivative 0 at 0.
    psi2 = mbf_curve(jnp.where(backward, -psi1, psi1), chi, alpha)
    return jnp.where(good, jnp.where(backward, -psi2, psi2), jnp.nan)
