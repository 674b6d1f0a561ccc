"""The power β of the energy-loss family that delivers the requested restitution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._contact import Contact, require_contact
from ..._entry import require_count
from ..._fit import Fit, Positive, fit
from ..._fit.keywords import FitKeywords, takes
from ..._functions import chebyshev
from ..._impact import AbstractMethod, method_of, restitution
from ..._laws import EnergyLoss
from ..._text.units import Shown
from ..pairs.columns import ASKED_AND_DELIVERED, asked_and_delivered, with_transforms


class DeliveredByEnergyLoss(eqx.Module):
    """e_out(e_in) of the energy-loss family, with constant β or ln β a polynomial of e_in.

    ln β = Σ b_k T_k(t), t = 2 (e_in - low)/(1 - low) - 1, in Chebyshev polynomials.
    """

    contact: Contact
    low: Float[Array, ""]
    method: AbstractMethod = eqx.field(converter=method_of)
    shown: ClassVar[Mapping[str, Shown]] = ASKED_AND_DELIVERED

    def __call__(self, params: dict[str, Array], asked: Float[Array, " n"]) -> Float[Array, " n"]:
        law = EnergyLoss(e=asked, beta=self.beta(params, asked))
        return restitution(law, self.contact, jnp.ones(()), method=self.method)

    def beta(self, params: dict[str, Array], asked: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return β at the requested restitutions."""
        if "beta" in params:
            return params["beta"]
        t = 2 * (jnp.maximum(asked, self.low) - self.low) / (1 - self.low) - 1
        return jnp.exp(chebyshev(params["log_beta"], t))


@takes(FitKeywords)
def fit_energy_loss(
    e_in: ArrayLike,
    e_out: ArrayLike | None = None,
    *,
    degree: int | None = None,
    contact: Contact | None = None,
    method: str | AbstractMethod = "auto",
    **how: Unpack[FitKeywords],
) -> Fit:
    """Fit the power β with which the energy-loss family, given e_in, delivers e_out.

    α = (1-e)/e / ((n+1) I(β)), see `EnergyLoss`. Arguments: `e_in` in (0, 1] and `e_out` in (0,
    1.2] (noise may raise a measured one above 1), both (points,); `e_out` is `e_in` by default.
    `degree`: None for a constant β, otherwise ln β is a polynomial of that degree in e_in over
    [least e_in, 1]. `contact` for an exponent other than 3/2. `method` as in `impact`. Other
    keywords go to `fit`. At e = 1 nothing depends on β.

    Returns a `Fit` whose params are {"beta": β}, or {"log_beta": Chebyshev coefficients of ln β}.
    `predict(e)` is the delivered e, and `problem.predict.beta(params, e)` is β(e). Raises
    ValueError for columns that do not match or are out of range.

    Source: Hu & Guo (2015), Eq. 22-37, doi 10.1007/s11044-015-9453-z.
    """
    asked, wanted = asked_and_delivered(e_in, e_out)
    # e depends on neither mass nor stiffness.
    contact = Contact(mass=1.0, stiffness=1.0) if contact is None else require_contact(contact)
    model = DeliveredByEnergyLoss(contact, jnp.asarray(float(asked.min())), method)
    if degree is None:
        given = with_transforms({"beta": Positive()}, how)
        return fit(model, wanted, {"beta": 2.5}, x=asked, **given)
    degree = require_count("degree", degree, 0)
    start = {"log_beta": np.array([np.log(2.5), *np.zeros(degree)])}
    return fit(model, wanted, start, x=asked, **how)
