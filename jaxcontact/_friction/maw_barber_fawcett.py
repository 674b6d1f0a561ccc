"""Spheres whose surfaces stick and slip in parts."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import (
    NOT_NEGATIVE,
    POSITIVE,
    as_parameter,
    optional_parameter,
    parameter,
    refuses_unknown,
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
