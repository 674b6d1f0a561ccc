"""Contact and law from measured outcomes of single impacts: e(v) and t_c(v)."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import EXPONENT, Contact
from .._fit import AbstractTransform, Between, Fit, Fixed, fit
from .._impact import impact
from .._laws import AbstractLaw
from .._parameter import POSITIVE, Range
from ._checks import all_or_none, column

_RESTITUTION = Range(low=0.0, high=1.0, inside=0.5)


class ImpactModel(eqx.Module):
    """What a fit of impacts moves: a law and a contact."""

    law: AbstractLaw
    contact: Contact


class Outcome(eqx.Module):
    """The measured columns of an impact, in their order, each where it was asked for."""

    method: str = eqx.field(static=True)
    fields: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, model: ImpactModel, velocity: Float[Array, " n"]) -> dict[str, Array]:
        hit = impact(model.law, model.contact, velocity, method=self.method)
        # Durations are compared as logarithms: their error is relative.
        return {
            field: jnp.log(hit.duration) if field == "duration" else getattr(hit, field)
            for field in self.fields
        }


def fit_impacts(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    e: ArrayLike | None = None,
    duration: ArrayLike | None = None,
    sigma_e: ArrayLike | None = None,
    sigma_duration: ArrayLike | None = None,
    fixed: tuple[str, ...] = ("mass",),
    method: str = "auto",
    **how: Any,
) -> Fit:
    """A law and a contact from tables of restitution and of contact time over the closing speed.

    Arguments: the `law` and the `contact` to start from, all of whose numbers are fitted but the
    `fixed` ones ("mass" by default: times know K/m only; n is fitted if the contact's exponent is
    an array); `velocity` in m/s; `e` in [0, 1] and `duration` in s, at least one of them, NaN where
    a speed was not measured, all (points,). `sigma_e`, and `sigma_duration` relative to the
    duration (one number, or one for each point), are standard deviations; give both or none, if
    both columns are there. `method` as in `impact`; what else `fit` takes.

    Returns a `Fit` whose params have `.law` and `.contact`. Raises ValueError for columns that do
    not match or leave their range.
    """
    v = column(velocity, "velocity", POSITIVE)
    columns: dict[str, np.ndarray] = {}
    noise: dict[str, Any] = {}
    if e is not None:
        columns["restitution"] = column(e, "e", _RESTITUTION, len(v), gaps=True)
        noise["restitution"] = sigma_e
    if duration is not None:
        columns["duration"] = np.log(column(duration, "duration", POSITIVE, len(v), gaps=True))
        noise["duration"] = sigma_duration
    if not columns:
        raise ValueError("Argument `e` or `duration` must be given, but both are None.")
    known = all_or_none("`sigma_e` and `sigma_duration`", noise.values())
    spread = {
        name: np.broadcast_to(
            1.0 if noise[name] is None else np.asarray(noise[name], float), v.shape
        )
        for name in columns
    }
    there = {name: np.isfinite(values) for name, values in columns.items()}
    start = ImpactModel(law, contact)
    scale: dict[str, Any]
    if known:
        scale = {"sigma": {name: np.where(there[name], spread[name], np.inf) for name in columns}}
    else:
        scale = {"weights": {name: there[name].astype(float) for name in columns}}
    return fit(
        Outcome(method, tuple(sorted(columns))),
        {name: np.where(there[name], columns[name], 0.0) for name in columns},
        start,
        x=v,
        transforms=transforms_of(start, fixed),
        **scale,
        **how,
    )


def transforms_of(start: Any, fixed: tuple[str, ...]) -> dict[str, AbstractTransform]:
    """How the numbers of a model move, and which of them stay."""
    transforms: dict[str, AbstractTransform] = {}
    if not isinstance(start.contact.exponent, float):
        transforms["contact.exponent"] = Between(EXPONENT.low, EXPONENT.high)
    for name in fixed:
        owner = "contact" if name in ("mass", "stiffness", "exponent") else "law"
        if owner == "law" and not hasattr(start.law, name):
            raise ValueError(
                f"Argument `fixed` must name numbers of the law or the contact, but holds {name!r}."
            )
        if name != "exponent" or "contact.exponent" in transforms:
            transforms[f"{owner}.{name}"] = Fixed()
    return transforms
