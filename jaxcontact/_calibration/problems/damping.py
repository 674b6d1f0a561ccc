"""The damping factor c that delivers measured restitutions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._contact import Contact, require_contact
from ..._entry import POSITIVE, require_flag
from ..._fit import Fit, Positive, fit
from ..._fit.keywords import FitKeywords, takes
from ..._impact import AbstractMethod, method_of, restitution
from ..._laws import ConstantDamping, PowerDamping
from ..._text.units import Shown
from ..pairs.columns import column, with_transforms
from ..pairs.plausible import MEASURED_RESTITUTION


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
