"""Ready-made fits of a contact and its law: c and β that deliver restitutions, and all numbers of
both from measured outcomes of single impacts, e(v), t_c(v) and F_max(v).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import EXPONENT, Contact, require_contact
from .._entry import POSITIVE, did_you_mean, refusal, rendered, require_count, require_flag
from .._fit import AbstractTransform, Between, Fit, Fixed, Positive, fit, names_in
from .._fit.fit import ColumnKeywords, FitKeywords, takes
from .._functions import chebyshev
from .._impact import AbstractMethod, impact, method_of, restitution
from .._laws import AbstractLaw, ConstantDamping, EnergyLoss, PowerDamping, require_law
from .._text.units import Shown
from .columns import (
    ASKED_AND_DELIVERED,
    MEASURED_RESTITUTION,
    MEASURED_RESTITUTION_FROM_ZERO,
    asked_and_delivered,
    column,
    measured,
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
    wanted = column(e, "e", MEASURED_RESTITUTION, ("velocity", v))
    # Near the middle of the data Hu and Guo's relation gives a close enough α.
    middle, typical = float(np.exp(np.mean(np.log(v)))), min(float(np.median(wanted)), 0.999)
    alpha = 1.5 * (1 - typical) / typical
    start: dict[str, Any] = {"c": alpha * np.asarray(contact.stiffness, float) / middle}
    if power:
        start["power"] = 0.0
    model = DeliveredByDamping(contact, jnp.asarray(middle), method)
    return fit(model, wanted, start, x=v, **with_transforms({"c": Positive()}, how))


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


class ImpactModel(eqx.Module):
    """The parameters of a fit of impacts: a law and a contact."""

    law: AbstractLaw
    contact: Contact


class Outcome(eqx.Module):
    """The outcomes in `fields`: e, and the logarithms of contact time and largest force.

    Errors of the logarithms are relative.
    """

    method: AbstractMethod = eqx.field(converter=method_of)
    fields: tuple[str, ...] = eqx.field(static=True)
    shown: ClassVar[Mapping[str, Shown]] = {
        "x": Shown("velocity"),
        "e": Shown("restitution"),
        "duration": Shown("duration", logarithm=True),
        "max_force": Shown("max_force", logarithm=True),
    }

    def __call__(self, model: ImpactModel, velocity: Float[Array, " n"]) -> dict[str, Array]:
        hit = impact(model.law, model.contact, velocity, method=self.method)
        outcome = {
            "e": lambda: hit.restitution,
            "duration": lambda: jnp.log(hit.duration),
            "max_force": lambda: jnp.log(hit.max_force),
        }
        return {field: outcome[field]() for field in self.fields}


@takes(ColumnKeywords)
def fit_impacts(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    e: ArrayLike | None = None,
    duration: ArrayLike | None = None,
    max_force: ArrayLike | None = None,
    sigma_e: ArrayLike | None = None,
    sigma_duration: ArrayLike | None = None,
    sigma_max_force: ArrayLike | None = None,
    fixed: tuple[str, ...] = ("mass",),
    method: str | AbstractMethod = "auto",
    **how: Unpack[ColumnKeywords],
) -> Fit:
    """Fit a law and a contact to restitutions, contact times and peak forces over closing speed.

    Arguments: `law` and `contact` are the start. All their numbers are fitted except the `fixed`
    ones, named as the fit prints them ("law.c") or without the owner. By default "mass" is fixed,
    because times determine only K/m. n is fitted if the contact's exponent is an array. `velocity`
    in m/s. `e` in [0, 1.2], `duration` in s and `max_force` in N, at least one of them, NaN for
    missing readings, all (points,).

    `sigma_e`, and `sigma_duration` and `sigma_max_force` relative to their column, are standard
    deviations (one number, or one for each point). Give those of all columns or of none. `method`
    as in `impact`. Other keywords go to `fit` (such as `noise="by column"`).

    Returns a `Fit` whose params have `.law` and `.contact`. Raises ValueError for columns that do
    not match or are out of range.
    """
    require_law(law)
    require_contact(contact)
    v = column(velocity, "velocity", POSITIVE)
    columns = {
        "e": (e, sigma_e, MEASURED_RESTITUTION_FROM_ZERO),
        "duration": (duration, sigma_duration, POSITIVE),
        "max_force": (max_force, sigma_max_force, POSITIVE),
    }
    table = measured(columns, ("velocity", v), gaps=True)
    for name in table["data"].keys() - {"e"}:
        table["data"][name] = np.log(table["data"][name])
    start = ImpactModel(law, contact)
    given = with_transforms(transforms_of(start, fixed), how)
    model = Outcome(method, tuple(table["data"]))
    return fit(model, start=start, x=v, **(table | given))


def _full_name(start: Any, name: Any) -> str | None:
    """Return the name of a number with its owner, "law.c" of "c"; None for unknown names."""
    if not isinstance(name, str):
        return None
    for prefix, owner in (("", start), ("contact.", start.contact), ("law.", start.law)):
        own = name.removeprefix(prefix)
        fields = {field.name.lstrip("_") for field in dataclasses.fields(owner)}
        if own in fields and own != "tension":
            return prefix + own
    return None


def transforms_of(
    start: Any, fixed: tuple[str, ...], beside: Any = None
) -> dict[str, AbstractTransform]:
    """Return the transforms of the numbers of a model.

    `fixed` names numbers of the model, its contact or its law, as "c" or as "law.c"; it may also
    name those of another model `beside` it. A number that is None or static, such as an exponent
    that is not an array, is never fitted.
    """
    transforms: dict[str, AbstractTransform] = {}
    if not isinstance(start.contact.exponent, float):
        transforms["contact.exponent"] = Between(EXPONENT.low, EXPONENT.high)
    if not isinstance(fixed, list | tuple | set | frozenset):
        raise refusal("fixed", "be a tuple of names of numbers of the law or the contact", fixed)
    known = names_in(start)
    for given in fixed:
        name = _full_name(start, given)
        if name is None:
            if beside is not None and _full_name(beside, given) is not None:
                continue
            raise ValueError(
                "Argument `fixed` must name numbers of the law or the contact "
                f"({', '.join(known)}), but holds {rendered(given)}.{did_you_mean(given, known)}"
            )
        if any(one == name or one.startswith((f"{name}.", f"{name}[")) for one in known):
            transforms[name] = Fixed()
    return transforms
