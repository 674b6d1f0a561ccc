"""Kinds of laws by their e(v): one curve each, with the parameters that e(v) can determine.

e(v) contains the contact only through c/K or A (K/m)^(2/5), so any contact serves to fit a curve;
mass and stiffness only convert these combinations to c and A.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._contact import Contact
from .._fit import AbstractTransform, Between, FitData, Free, Positive
from .._impact import restitution
from .._laws import (
    AbstractLaw,
    ConstantDamping,
    Damped,
    KuwabaraKono,
    PowerDamping,
    constant_laws,
    get_law,
)
from ._estimate import Estimate
from ._viscous import viscous_restitution

Params = Mapping[str, Any]

WIDEST_LOGARITHM = 2.0
"""A parameter whose logarithm (or logit) has a larger standard error is not identifiable."""


_SHORTEST = 256
"""Compiling takes a thousand times as long as fitting so many points."""


@dataclasses.dataclass(frozen=True)
class AbstractKind(abc.ABC):
    """A kind of law: how its e(v) follows from a few parameters, and what these mean.

    `law` is the registered name of a law of this kind. Hashable: it selects compiled code.
    """

    law: str

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """The kind in a few words."""

    @property
    @abc.abstractmethod
    def unidentified(self) -> str:
        """What e(v) leaves open about this law."""

    @property
    @abc.abstractmethod
    def transforms(self) -> dict[str, AbstractTransform]:
        """Where the parameters may lie."""

    @abc.abstractmethod
    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Parameters whose curve passes near `e` at the speed `reference` in m/s."""

    @abc.abstractmethod
    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """The law with these parameters; `reference` in m/s is the speed of a power law's c."""

    @abc.abstractmethod
    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """What e(v) determines: parameter, name, factor to the parameter's value, and unit."""

    def serves(self, exponent: float | Array) -> bool:
        """Whether the curve is known for a contact with this exponent."""
        return True

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """e at closing speeds `velocity` in m/s: of a Hunt-Crossley law, from its α alone."""
        alpha = self.law_of(params, contact, reference).damping_factor(contact, velocity)
        # Without contact and speed `restitution` is one formula, and compiles in half the time.
        return jnp.broadcast_to(restitution(Damped(alpha=alpha)), velocity.shape)

    def estimates(
        self, fit: FitData, contact: Contact, known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """What e(v) determines, then what follows from it with the `known` mass and stiffness."""
        errors = dict(zip(fit.names, fit.errors.tolist(), strict=True))
        good = is_identifiable(fit)
        found = []
        for parameter, name, factor, unit in self.identified(contact):
            value, error = float(fit.params[parameter]) * factor, errors[parameter] * factor
            found.append(Estimate(name, value, error if good else None, unit))
        return (*found, *self.derived(fit, found, known, speed))

    def derived(
        self, fit: FitData, found: list[Estimate], known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """What follows from the estimates `found`: e at a typical speed, and the law's own c or A.

        The parameters of the law itself follow where the mass or stiffness they need is `known`.
        """
        e, error = delivered(fit, np.array([speed]))
        known_error = float(error[0]) if is_identifiable(fit) else None
        typical = Estimate(f"e at {speed:.2f} m/s", float(e[0]), known_error, "")
        return (typical, *self.own(fit, known))

    def own(self, fit: FitData, known: frozenset[str]) -> tuple[Estimate, ...]:
        """The law's own parameters, where the mass or stiffness they need is `known`."""
        return ()


@dataclasses.dataclass(frozen=True)
class ConstantE(AbstractKind):
    """The same e at every speed, as the law `law` of one parameter e delivers it."""

    law: str = "exact"

    @property
    def name(self) -> str:
        """The kind, and the law that delivers it where that is not the exact one."""
        return "constant e" if self.law == "exact" else f"constant e ({self.law})"

    @property
    def unidentified(self) -> str:
        """Everything of the contact."""
        return "mass, stiffness and exponent: e does not depend on them"

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """e in (0, 1)."""
        return {"e": Between(0, 1)}

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """e itself."""
        return {"e": e}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """The law of one parameter e."""
        return get_law(self.law, e=params["e"])

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """The e of the law."""
        return (("e", "e", 1.0, ""),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """What the law delivers, at every speed."""
        if self.law == "exact":  # by definition, and nothing needs to be compiled
            return jnp.broadcast_to(params["e"], velocity.shape)
        return jnp.broadcast_to(restitution(get_law(self.law, e=params["e"])), velocity.shape)

    def derived(
        self, fit: FitData, found: list[Estimate], known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """The e delivered, where it is not the e of the law."""
        if self.law == "exact":
            return ()
        at_speed = super().derived(fit, found, known, speed)[0]
        return (dataclasses.replace(at_speed, name="e delivered"),)


def _alpha_for(e: float) -> float:
    """Hu and Guo's α = 3(1-e)/(2e), which nearly delivers e."""
    return 1.5 * (1 - e) / e


@dataclasses.dataclass(frozen=True)
class ConstantC(AbstractKind):
    """A constant damping factor c: α = c v/K."""

    law: str = "constant_damping"

    @property
    def name(self) -> str:
        return "constant c"

    @property
    def unidentified(self) -> str:
        return "c and K one by one: e(v) determines only c/K, and nothing of m"

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """c > 0."""
        return {"c": Positive()}

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """The c of Hu and Guo's α."""
        return {"c": _alpha_for(e) * float(contact.stiffness) / reference}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """`ConstantDamping`."""
        return ConstantDamping(c=params["c"])

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """c/K."""
        return (("c", "c/K", 1 / float(contact.stiffness), "s/m"),)

    def own(self, fit: FitData, known: frozenset[str]) -> tuple[Estimate, ...]:
        """c, which needs K."""
        error = fit.standard_errors["c"] if is_identifiable(fit) else None
        c = Estimate("c", float(fit.params["c"]), error, "N s/m^(5/2)")
        return (c,) if "stiffness" in known else ()


@dataclasses.dataclass(frozen=True)
class PowerOfSpeed(ConstantC):
    """A damping factor that goes as a power of the closing speed: α = c (v/v_r)^p v/K."""

    law: str = "power_damping"

    @property
    def name(self) -> str:
        return "c as a power of v"

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """c > 0, any power."""
        return {"c": Positive(), "power": Free()}

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """A constant c."""
        return super().start(e, contact, reference) | {"power": 0.0}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """`PowerDamping`."""
        return PowerDamping(c=params["c"], power=params["power"], reference=reference)

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """c/K at the reference speed, and the power."""
        return (*super().identified(contact), ("power", "power", 1.0, ""))


@dataclasses.dataclass(frozen=True)
class Viscoelastic(AbstractKind):
    """Kuwabara and Kono's law for n = 3/2: e depends on A (K/m)^(2/5) v^(1/5)."""

    law: str = "kuwabara_kono"

    @property
    def name(self) -> str:
        return "Kuwabara-Kono"

    @property
    def unidentified(self) -> str:
        return "A, K and m one by one: e(v) determines only A (K/m)^(2/5)"

    @property
    def transforms(self) -> dict[str, AbstractTransform]:
        """A > 0."""
        return {"A": Positive()}

    def serves(self, exponent: float | Array) -> bool:
        return isinstance(exponent, float) and exponent == 1.5

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """1 - e ≈ 1.15344 (3/2) A (K/m)^(2/5) v^(1/5), capped where it is too much."""
        strength = min((1 - e) / 1.73, 0.4) / reference**0.2
        return {"A": strength / float(_frequency(contact))}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """`KuwabaraKono`."""
        return KuwabaraKono(A=params["A"])

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """A (K/m)^(2/5)."""
        return (("A", "A (K/m)^(2/5)", float(_frequency(contact)), "(m/s)^(-1/5)"),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """e by a polynomial in the strength of the damping, which stays within its range."""
        return viscous_restitution(params["A"] * _frequency(contact) * velocity**0.2)

    def own(self, fit: FitData, known: frozenset[str]) -> tuple[Estimate, ...]:
        """A, which needs K and m."""
        error = fit.standard_errors["A"] if is_identifiable(fit) else None
        a = Estimate("A", float(fit.params["A"]), error, "s")
        return (a,) if known >= {"mass", "stiffness"} else ()


def _frequency(contact: Contact) -> Array:
    return (contact.stiffness / contact.mass) ** 0.4


class LogRestitution(eqx.Module):
    """ln e(v) of a kind of law: what is compared with the measured ln e."""

    kind: AbstractKind = eqx.field(static=True)
    contact: Contact
    reference: Float[Array, ""]

    def __call__(self, params: Params, velocity: Float[Array, " n"]) -> Float[Array, " n"]:
        return jnp.log(self.kind.restitution(params, self.contact, self.reference, velocity))


def is_identifiable(fit: FitData) -> bool:
    """Whether the data determine every parameter: its logarithm or logit to `WIDEST_LOGARITHM`."""
    return bool(np.all(fit.scaled_errors < WIDEST_LOGARITHM))


def delivered(fit: FitData, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e of a fitted kind at speeds (n,) in m/s, and its standard error."""
    log_e, error = fit.predict_with_error(padded(speeds, speeds[0]))
    e = np.exp(log_e[: len(speeds)])
    return e, e * error[: len(speeds)]


def padded(values: np.ndarray, filling: float) -> np.ndarray:
    """`values` filled up to a power of two of at least 256: such arrays share compiled code."""
    length = max(_SHORTEST, 1 << (len(values) - 1).bit_length())
    return np.concatenate([values, np.full(length - len(values), filling)])


SPEED_DEPENDENT: tuple[AbstractKind, ...] = (ConstantC(), PowerOfSpeed(), Viscoelastic())


def kinds_of(law: str, exponent: float | Array) -> tuple[AbstractKind, ...]:
    """The kinds to compare: a constant e first, then one or all speed-dependent kinds.

    `law` "all" compares the exact constant e with all of them; the name of a speed-dependent law
    compares that one with the exact constant e; the name of a law with parameter e makes that law
    deliver the constant e. Kinds that are not known for the exponent are left out. Raises
    ValueError for any other name.
    """
    others = tuple(kind for kind in SPEED_DEPENDENT if kind.serves(exponent))
    if law == "all":
        return (ConstantE(), *others)
    for kind in others:
        if law == kind.law:
            return (ConstantE(), kind)
    if law not in constant_laws():
        choices = ", ".join(["all", *constant_laws(), *(kind.law for kind in others)])
        raise ValueError(f"Argument `law` must be one of {choices}, but is {law!r}.")
    return (ConstantE(law), *others)
