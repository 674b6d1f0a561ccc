"""Contact and law from measured outcomes of single impacts: e(v), t_c(v) and F_max(v)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import EXPONENT, Contact, require_contact
from .._entry import POSITIVE, did_you_mean, rendered
from .._fit import AbstractTransform, Between, Fit, Fixed, fit, names_in
from .._fit.fit import ColumnKeywords, takes
from .._impact import AbstractMethod, impact, method_of
from .._laws import AbstractLaw, require_law
from .._text.units import Shown
from .columns import MEASURED_RESTITUTION_FROM_ZERO, column, measured, with_transforms


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


def full_name(start: Any, name: Any) -> str | None:
    """Return the name of a number with its owner, "law.c" of "c"; None for unknown names."""
    if not isinstance(name, str):
        return None
    for prefix, owner in (("", start), ("contact.", start.contact), ("law.", start.law)):
        own = name.removeprefix(prefix)
        fields = {field.name.lstrip("_") for field in dataclasses.fields(owner)}
        if own in fields and own != "tension":
            return prefix + own
    return None


def transforms_of(start: Any, fixed: tuple[str, ...]) -> dict[str, AbstractTransform]:
    """Return the transforms of the numbers of a model.

    `fixed` names numbers of the model, its contact or its law, as "c" or as "law.c". A number that
    is None or static, such as an exponent that is not an array, is never fitted.
    """
    transforms: dict[str, AbstractTransform] = {}
    if not isinstance(start.contact.exponent, float):
        transforms["contact.exponent"] = Between(EXPONENT.low, EXPONENT.high)
    if not isinstance(fixed, list | tuple | set | frozenset):
        raise ValueError(
            "Argument `fixed` must be a tuple of names of numbers of the law or the contact, but "
            f"is {rendered(fixed)}."
        )
    known = names_in(start)
    for given in fixed:
        name = full_name(start, given)
        if name is None:
            raise ValueError(
                "Argument `fixed` must name numbers of the law or the contact "
                f"({', '.join(known)}), but holds {rendered(given)}.{did_you_mean(given, known)}"
            )
        if any(one == name or one.startswith((f"{name}.", f"{name}[")) for one in known):
            transforms[name] = Fixed()
    return transforms
