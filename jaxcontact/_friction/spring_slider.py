"""One tangential spring and slider, as discrete element codes have it."""

from __future__ import annotations

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import (
    NOT_NEGATIVE,
    POSITIVE,
    as_parameter,
    optional_parameter,
    parameter,
    refuses_unknown,
    require_choice,
)
from .base import AbstractFriction, Lane, NormalPath, Tangential, TangentialOutcome
from .return_mapping import hertzian, slider_along, spring_of
from .slider.phases import slider_phases

FORMS = ("force", "displacement", "rescaled")


class SpringSlider(AbstractFriction):
    """One tangential spring and slider at each contact: f' = κ n K δ^(n-1) u in stick, |f| ≤ μ F.

    - `mu`: the coefficient μ ≥ 0.
    - `ratio`: κ > 0, the tangential stiffness over the normal one; None for that of the contact's
      materials, 4G*/E*.
    - `form`: "force" adds up increments of the force (LAMMPS `mindlin/force`); "displacement" has f
      = κ n K δ^(n-1) ξ, ξ' = u (`mindlin`); "rescaled" is the first while loading and the second
      while unloading (`mindlin_rescale/force`).

    At small angles "force" and "displacement" may create energy; "rescaled" does not. Raises
    ValueError for a Python scalar out of range. Source: Mindlin & Deresiewicz (1953), doi
    10.1115/1.4010702, as simplified in codes; Thornton et al. (2011), doi
    10.1016/j.powtec.2011.01.013.
    """

    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    ratio: Float[Array, "..."] | None = optional_parameter("ratio", POSITIVE, "-")
    form: Literal["force", "displacement", "rescaled"] = eqx.field(static=True, default="force")

    @refuses_unknown
    def __init__(
        self,
        mu: ArrayLike,
        ratio: ArrayLike | None = None,
        form: Literal["force", "displacement", "rescaled"] = "force",
    ):
        self.mu = as_parameter(mu, "mu", NOT_NEGATIVE)
        self.ratio = None if ratio is None else as_parameter(ratio, "ratio", POSITIVE)
        require_choice("form", form, FORMS)
        self.form = form

    def has_formula(self, problem: Tangential) -> bool:
        return hertzian(problem)

    @property
    def held(self) -> str:
        return self.form

    @property
    def substeps(self) -> int:
        return 16

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        slip, force = slider_along(spring_of(self, problem), problem.exponent, self.form, path)
        return slip, self.mu * force

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        scaled = spring_of(self, problem)
        assert problem.alpha is not None
        found = slider_phases(scaled.psi, scaled.chi, problem.alpha, self.form)
        slid, e = scaled.free | (found.stop <= -problem.restitution), problem.restitution
        return TangentialOutcome(
            slip=scaled.slip(found.psi2),
            slid=slid,
            stop=jnp.where(slid, -e, found.stop),
            start=jnp.where(slid, -e, found.slip),
            converged=found.converged,
        )
