"""A kind of law by its e(v): one curve, with the parameters that e(v) can determine.

e(v) contains the contact only through c/K or A (K/m)^(2/5), so any contact serves to fit a curve.
Mass and stiffness only convert these combinations to c and A.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import AbstractLaw, Contact, get_law, impact
from ...extend import AbstractTransform, FitData, Shown, describe, with_error


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number with unit and standard error; the error is None for the reason `lacking`."""

    name: str
    value: float
    standard_error: float | None
    unit: str
    lacking: str = "not identifiable"

    def __str__(self) -> str:
        """Return `0.8799 ± 0.0010 unit`: two digits of the error, equal places of the value."""
        unit = f" {self.unit}" if self.unit else ""
        if self.standard_error is None:
            return f"{self.value:.3g}{unit} ({self.lacking})"
        return with_error(self.value, self.standard_error) + unit


Params = Mapping[str, Any]

WIDEST_LOGARITHM = 2.0
"""Standard error of a logarithm (or logit) above which a parameter is not identifiable."""

_SHORTEST = 256
"""Least padded length; compiling takes a thousand times as long as fitting it."""


class Combination(NamedTuple):
    """A parameter of a law, and the combination with mass and stiffness that e(v) determines.

    `range` is that of the parameter, `name` and `unit` are those of the combination. The parameter
    is the combination times `scale`(mass, stiffness). It follows if the contact numbers `needs` are
    known, in `own_unit`.
    """

    range: AbstractTransform
    name: str
    unit: str = ""
    scale: Callable[[Any, Any], Any] = lambda mass, stiffness: 1.0
    own_unit: str = ""
    needs: frozenset[str] = frozenset()


Start = Callable[[float, float], Mapping[str, float]]
"""Combinations whose curve passes near an e at a speed in m/s."""


def _of_law(law: Any, contact: Contact, velocity: Array) -> Array:
    return law.restitution_at(velocity)


@dataclasses.dataclass(frozen=True, eq=False)
class Kind:
    """A kind of law: its e(v) from a few parameters, and their meaning.

    `law` is the registered name of a law of this kind, `name` the kind in a few words, and
    `unidentified` what e(v) leaves open. `parameters` are those of the law, in its order. A search
    begins at `start`, and at each of `also`; the best end counts. `curve` gives e of a law at
    speeds (n,), or one e. `special`: the names of kinds all of whose curves are also curves of this
    kind. `exponent`: the only one of a contact for which the curve is known, None if any. `outcome`
    gives `duration` and `max_force` of impacts of a law. `at_speed`: the name of e at a typical
    speed, "" if it is a parameter. Kinds select compiled code, and there is one of each.
    """

    law: str
    name: str
    unidentified: str
    parameters: Mapping[str, Combination]
    start: Start
    also: tuple[Start, ...] = ()
    curve: Callable[[Any, Contact, Array], Array] = _of_law
    special: tuple[str, ...] = ()
    exponent: float | None = None
    outcome: Callable[[Any, Contact, Array], Any] = impact
    at_speed: str = "e at {:.2f} m/s"

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """The ranges of the parameters."""
        return {name: one.range for name, one in self.parameters.items()}

    def contains(self, other: Kind) -> bool:
        """Return whether every curve of another kind is one of this kind."""
        # The name of a constant e may end with that of its law.
        return other.name.startswith(self.special)

    def starts(self, e: float, contact: Contact, reference: float) -> list[dict[str, float]]:
        """Return the parameters from which searches begin; the first curve passes near `e`."""
        size = float(contact.mass), float(contact.stiffness)
        combined = (one(e, reference) for one in (self.start, *self.also))
        scales = {name: one.scale(*size) for name, one in self.parameters.items()}
        return [{name: x * scales[name] for name, x in one.items()} for one in combined]

    def law_of(self, params: Params, reference: Any) -> AbstractLaw:
        """Return the law of these parameters; `reference` in m/s is that of a power law's c."""
        given = {**params, "reference": reference}
        return get_law(self.law, **{name: given[name] for name in describe(self.law).parameters})

    def serves(self, exponent: float | Array) -> bool:
        """Return whether the curve is known for a contact with this exponent."""
        return self.exponent is None or (isinstance(exponent, float) and exponent == self.exponent)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return e at closing speeds `velocity` in m/s."""
        e = self.curve(self.law_of(params, reference), contact, velocity)
        return jnp.broadcast_to(e, velocity.shape)

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        """Return the parameters that give the same e(v) in another contact."""
        ratios = other.mass / contact.mass, other.stiffness / contact.stiffness
        scaled = {name: one.scale for name, one in self.parameters.items() if one.needs}
        return {**params, **{name: params[name] * scale(*ratios) for name, scale in scaled.items()}}

    def estimates(
        self, fit: FitData, contact: Contact, known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """Return what e(v) determines, e at a typical speed, and what the `known` contact adds."""
        good = is_identifiable(fit)

        def estimate(parameter: str, name: str, scale: float, unit: str) -> Estimate:
            error = fit.standard_errors[parameter] / scale if good else None
            value = float(fit.params[parameter]) / scale
            return Estimate(name, value, error, unit, fit.why_no_error(parameter))

        found, own = [], []
        for parameter, one in self.parameters.items():
            scale = one.scale(float(contact.mass), float(contact.stiffness))
            found.append(estimate(parameter, one.name, scale, one.unit))
            if one.needs and known >= one.needs:
                own.append(estimate(parameter, parameter, 1.0, one.own_unit))
        if name := self.at_speed.format(speed):
            e, error = delivered(fit, np.array([speed]))
            found.append(Estimate(name, float(e[0]), float(error[0]) if good else None, ""))
        if "stiffness" in fit.names:
            own = [estimate("stiffness", "K", 1.0, "N/m^n")]
        return (*found, *own)


class LogOutcomes(eqx.Module):
    """ln e(v) of a kind of law; with other `fields` a tuple of it and their logarithms.

    These are contact time in s and largest force in N. With them the stiffness is a parameter in
    addition to those of the law.
    """

    kind: Kind = eqx.field(static=True)
    contact: Contact
    reference: Float[Array, ""]
    fields: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def is_formula(self) -> bool:
        """True if no impact is solved."""
        return not self.fields

    @property
    def shown(self) -> dict[str, Shown]:
        """The presentation of the columns, which are numbered if there are several."""
        columns = ("restitution", *self.fields)
        names = map(str, range(len(columns))) if self.fields else ("",)
        shown = {name: Shown(one, logarithm=True) for name, one in zip(names, columns, strict=True)}
        return {"x": Shown("velocity"), **shown}

    def __call__(self, params: Params, velocity: Float[Array, " n"]) -> Any:
        log_e = jnp.log(self.kind.restitution(params, self.contact, self.reference, velocity))
        if not self.fields:
            return log_e
        contact = with_stiffness(self.contact, params)
        law = self.kind.law_of(self.kind.moved(params, self.contact, contact), self.reference)
        hit = self.kind.outcome(law, contact, velocity)
        return log_e, *(jnp.log(getattr(hit, name)) for name in self.fields)


def with_stiffness(contact: Contact, params: Params) -> Contact:
    """Return the contact with the fitted stiffness, if it was fitted."""
    stiffness = params.get("stiffness", contact.stiffness)
    return Contact(contact.mass, stiffness, contact.exponent)


def is_identifiable(fit: FitData) -> bool:
    """Return whether the data determine the logarithm or logit of every parameter."""
    return bool(np.all(fit.scaled_errors < WIDEST_LOGARITHM))


def delivered(fit: FitData, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return e of a fitted kind at speeds (n,) in m/s, and its standard error."""
    log_e, error = fit.predict_with_error(padded(speeds, speeds[0]))
    e = np.exp(log_e[: len(speeds)])
    return e, e * error[: len(speeds)]


def padded(values: np.ndarray, filling: float) -> np.ndarray:
    """Pad `values` to a power of two of at least 256, so that arrays share compiled code."""
    length = max(_SHORTEST, 1 << (len(values) - 1).bit_length())
    return np.concatenate([values, np.full(length - len(values), filling)])
