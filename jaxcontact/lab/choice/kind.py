"""A kind of law by its e(v): one curve, with the parameters that e(v) can determine.

e(v) contains the contact only through c/K or A (K/m)^(2/5), so any contact serves to fit a curve.
Mass and stiffness only convert these combinations to c and A.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import AbstractLaw, Contact, get_law, impact
from ...extend import AbstractTransform, FitData, Shown, parameters_of, why_no_error, with_error


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


@dataclasses.dataclass(frozen=True)
class AbstractKind(abc.ABC):
    """A kind of law: its e(v) from a few parameters, and their meaning.

    `law` is the registered name of a law of this kind, `name` the kind in a few words, and
    `unidentified` what e(v) leaves open. `parameters` are those of the law, in its order. Kinds are
    hashable, since they select compiled code.
    """

    law: str
    name: str
    unidentified: ClassVar[str]
    parameters: ClassVar[Mapping[str, Combination]]
    special: ClassVar[tuple[type[AbstractKind], ...]] = ()
    """Kinds all of whose curves are also curves of this kind."""
    exponent: ClassVar[float | None] = None
    """The only exponent of a contact for which the curve is known; None if it serves any."""

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """The ranges of the parameters."""
        return {name: one.range for name, one in self.parameters.items()}

    def contains(self, other: AbstractKind) -> bool:
        """Return whether every curve of another kind is one of this kind."""
        return type(other) in self.special

    @abc.abstractmethod
    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return parameters whose curve passes near `e` at the speed `reference` in m/s."""

    def starts(self, e: float, contact: Contact, reference: float) -> list[dict[str, float]]:
        """Return the parameters from which the searches begin, of which the best one counts."""
        return [self.start(e, contact, reference)]

    def law_of(self, params: Params, reference: Any) -> AbstractLaw:
        """Return the law of these parameters; `reference` in m/s is that of a power law's c."""
        given = {**params, "reference": reference}
        return get_law(self.law, **{name: given[name] for name in parameters_of(self.law)})

    def serves(self, exponent: float | Array) -> bool:
        """Return whether the curve is known for a contact with this exponent."""
        return self.exponent is None or (isinstance(exponent, float) and exponent == self.exponent)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return e at closing speeds `velocity` in m/s."""
        e = self.curve(self.law_of(params, reference), contact, velocity)
        return jnp.broadcast_to(e, velocity.shape)

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return e of a law of this kind at speeds (n,), or at all; here as the law gives it."""
        return law.restitution_at(velocity)

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        """Return the parameters that give the same e(v) in another contact."""
        ratios = other.mass / contact.mass, other.stiffness / contact.stiffness
        scaled = {name: one.scale for name, one in self.parameters.items() if one.needs}
        return {**params, **{name: params[name] * scale(*ratios) for name, scale in scaled.items()}}

    def outcome(self, law: Any, contact: Contact, velocity: Array) -> Any:
        """Return `duration` and `max_force` of impacts of a law of this kind."""
        return impact(law, contact, velocity)

    def estimates(
        self, fit: FitData, contact: Contact, known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """Return what e(v) determines, e at a typical speed, and what `known` adds.

        `known` names the contact numbers that were given, "mass" and "stiffness".
        """
        good = is_identifiable(fit)

        def estimate(parameter: str, name: str, scale: float, unit: str) -> Estimate:
            error = fit.standard_errors[parameter] / scale if good else None
            value = float(fit.params[parameter]) / scale
            return Estimate(name, value, error, unit, why_no_error(fit, parameter))

        found, own = [], []
        for parameter, one in self.parameters.items():
            scale = one.scale(float(contact.mass), float(contact.stiffness))
            found.append(estimate(parameter, one.name, scale, one.unit))
            if one.needs and known >= one.needs:
                own.append(estimate(parameter, parameter, 1.0, one.own_unit))
        if name := self.at_speed(speed):
            e, error = delivered(fit, np.array([speed]))
            found.append(Estimate(name, float(e[0]), float(error[0]) if good else None, ""))
        if "stiffness" in fit.names:
            own = [estimate("stiffness", "K", 1.0, "N/m^n")]
        return (*found, *own)

    def at_speed(self, speed: float) -> str:
        """Return the name of e at a speed in m/s; "" if it is a parameter."""
        return f"e at {speed:.2f} m/s"


class LogRestitution(eqx.Module):
    """ln e(v) of a kind of law, for comparison with the measured ln e."""

    is_formula: ClassVar[bool] = True
    shown: ClassVar[Mapping[str, Shown]] = {
        "x": Shown("velocity"),
        "": Shown("restitution", logarithm=True),
    }
    kind: AbstractKind = eqx.field(static=True)
    contact: Contact
    reference: Float[Array, ""]

    def __call__(self, params: Params, velocity: Float[Array, " n"]) -> Float[Array, " n"]:
        return jnp.log(self.kind.restitution(params, self.contact, self.reference, velocity))


def is_identifiable(fit: FitData) -> bool:
    """Return whether the data determine the logarithm or logit of every parameter.

    The limit of its standard error is `WIDEST_LOGARITHM`.
    """
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
