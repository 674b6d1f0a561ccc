"""The damping factor c and the power β of the energy-loss family that deliver restitutions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact, require_contact
from .._entry import POSITIVE, require_count, require_flag
from .._fit import Fit, Positive, fit
from .._fit.fit import FitKeywords, takes
from .._functions import chebyshev
from .._impact import AbstractMethod, method_of, restitution
from .._laws import ConstantDamping, EnergyLoss, PowerDamping
from .._text.units import Shown
from .columns import (
    ASKED_AND_DELIVERED,
    MEASURED_RESTITUTION,
    asked_and_delivered,
    column,
    with_transforms,
)


class DeliveredByDamping(eqx.Module):
    """e(v) of the contact with c, or c (v/reference)^power, in N s/m^(n+1)."""

    contact: Contact
    reference: Float[Array, ""]
    method: AbstractMethod = eqx.field(converter=method_of)
    shown: ClassVar[Mapping[str, Shown]] = {"x": Shown("velocity"), "": Shown("restitution")}

    def __call__(
        self, params: dict[str, Float[Array, ""]], velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        if "power" in params:
            law = PowerDamping(params["c"], params["power"], self.reference)
        else:
            law = ConstantDamping(params["c"])
        return restitution(law, self.contact, velocity, method=self.method)


@takes(FitKeywords)
def fit_damping(
    contact: Contact,
    velocity: ArrayLike,
    e: ArrayLike,
    *,
    power: bool = False,
    method: str | AbstractMethod = "auto",
    **how: Unpack[FitKeywords],
) -> Fit:
    """Fit the hysteresis damping factor c with which a contact delivers e(v0): F = K δⁿ + c δⁿ δ'.

    Arguments: the `contact`; closing speeds `velocity` in m/s and restitutions `e` in (0, 1.2]
    (noise may raise a measured one above 1), both (points,). `power`: whether c, in N s/m^(n+1), is
    a power of the speed, c(v0) = c (v0/v_r)^power with v_r the geometric mean of the speeds.
    `method` as in `impact`. Other keywords go to `fit` (`sigma`, `loss`, ...). With a constant c, e
    falls with speed, since α = c v0/K. A power of -1 is a constant α, and so a constant e.

    Returns a `Fit` whose params are a dict with "c" (and "power"), and whose `predict(v)` is e(v).
    Raises ValueError for columns that do not match or are out of range.

    Source: Hunt & Crossley (1975), doi 10.1115/1.3423596.
    """
    require_contact(contact)
    power = require_flag("power", power)
    v = column(velocity, "velocity", POSITIVE)
    measured = column(e, "e", MEASURED_RESTITUTION, ("velocity", v))
    # Near the middle of the data Hu and Guo's relation gives a close enough α.
    middle, typical = float(np.exp(np.mean(np.log(v)))), min(float(np.median(measured)), 0.999)
    alpha = 1.5 * (1 - typical) / typical
    start: dict[str, Any] = {"c": alpha * np.asarray(contact.stiffness, float) / middle}
    if power:
        start["power"] = 0.0
    model = DeliveredByDamping(contact, jnp.asarray(middle), method)
    return fit(model, measured, start, x=v, **with_transforms({"c": Positive()}, how))


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
