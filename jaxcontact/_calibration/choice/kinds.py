"""Kinds of laws by their e(v): one curve each, with the parameters that e(v) can determine.

e(v) contains the contact only through c/K or A (K/m)^(2/5), so any contact serves to fit a curve.
Mass and stiffness only convert these combinations to c and A.
"""

from __future__ import annotations

import abc
import dataclasses
import math
import operator
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._contact import Contact
from ..._fit import AbstractTransform, Between, FitData, Free, Positive
from ..._impact import impact, restitution
from ..._laws import (
    AbstractLaw,
    Bridges,
    ConstantDamping,
    Damped,
    KuwabaraKono,
    LinearDashpot,
    PowerDamping,
    PowerRestitution,
    StepDamping,
    ThorntonPlastic,
    constant_laws,
    describe,
    get_law,
    plastic_restitution,
)
from ..._parameter import did_you_mean, rendered
from ..._text.units import Shown
from .clamped import clamped_restitution
from .estimate import Estimate
from .plastic import plastic_impact

Params = Mapping[str, Any]

WIDEST_LOGARITHM = 2.0
"""Standard error of a logarithm (or logit) above which a parameter is not identifiable."""

_LEAST_E = 1e-6
_SHORTEST = 256
"""Least padded length; compiling takes a thousand times as long as fitting it."""


@dataclasses.dataclass(frozen=True)
class AbstractKind(abc.ABC):
    """A kind of law: its e(v) from a few parameters, and their meaning.

    `law` is the registered name of a law of this kind, `name` the kind in a few words, and
    `unidentified` what e(v) leaves open. `transforms` give the ranges of the parameters. `own` are
    the parameters of the law that e(v) alone does not determine. Each has its unit and the contact
    numbers from which it follows. Kinds are hashable, since they select compiled code.
    """

    law: str
    name: str
    unidentified: ClassVar[str]
    transforms: ClassVar[Mapping[str, AbstractTransform]]
    own: ClassVar[tuple[tuple[str, str, frozenset[str]], ...]] = ()
    special: ClassVar[tuple[type[AbstractKind], ...]] = ()
    """Kinds all of whose curves are also curves of this kind."""

    def contains(self, other: AbstractKind) -> bool:
        """Return whether every curve of another kind is one of this kind."""
        return type(other) in self.special

    @abc.abstractmethod
    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return parameters whose curve passes near `e` at the speed `reference` in m/s."""

    @abc.abstractmethod
    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        """Return the law of these parameters; `reference` in m/s is that of a power law's c."""

    @abc.abstractmethod
    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """Return what e(v) determines: parameter, name, factor to its value, and unit."""

    def serves(self, exponent: float | Array) -> bool:
        """Return whether the curve is known for a contact with this exponent."""
        return True

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return e at closing speeds `velocity` in m/s; by default from the law's α alone."""
        alpha = self.law_of(params, contact, reference).damping_factor(contact, velocity)
        # Without contact and speed `restitution` is one formula, which compiles in half the time.
        return jnp.broadcast_to(restitution(Damped(alpha=alpha)), velocity.shape)

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        """Return the parameters that give the same e(v) in another contact."""
        return params

    def outcome(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Any:
        """Return `duration` and `max_force` of impacts of the law."""
        return impact(self.law_of(params, contact, reference), contact, velocity)

    def estimates(
        self, fit: FitData, contact: Contact, known: frozenset[str], speed: float
    ) -> tuple[Estimate, ...]:
        """Return what e(v) determines, e at a typical speed, and what `known` adds.

        `known` names the contact numbers that were given, "mass" and "stiffness".
        """
        good = is_identifiable(fit)

        def estimate(parameter: str, name: str, factor: float, unit: str) -> Estimate:
            error = fit.standard_errors[parameter] * factor if good else None
            return Estimate(name, float(fit.params[parameter]) * factor, error, unit)

        found = [estimate(*one) for one in self.identified(contact)]
        if name := self.at_speed(speed):
            e, error = delivered(fit, np.array([speed]))
            found.append(Estimate(name, float(e[0]), float(error[0]) if good else None, ""))
        own = (estimate(one, one, 1.0, unit) for one, unit, needs in self.own if known >= needs)
        if "stiffness" in fit.names:
            own = (estimate("stiffness", "K", 1.0, "N/m^n"),)
        return (*found, *own)

    def at_speed(self, speed: float) -> str:
        """Return the name of e at a speed in m/s; "" if it is a parameter."""
        return f"e at {speed:.2f} m/s"


@dataclasses.dataclass(frozen=True)
class ConstantE(AbstractKind):
    """The same e at every speed, as delivered by the law `law` of one parameter e."""

    law: str = "exact"
    name: str = "constant e"
    unidentified = "mass, stiffness and exponent: e does not depend on them"
    transforms = MappingProxyType({"e": Between(0, 1)})

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        return {"e": e}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return get_law(self.law, e=params["e"])

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        return (("e", "e", 1.0, ""),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return the delivered e, the same at every speed."""
        if self.law == "exact":  # by definition, so nothing is compiled
            return jnp.broadcast_to(params["e"], velocity.shape)
        return jnp.broadcast_to(restitution(get_law(self.law, e=params["e"])), velocity.shape)

    def at_speed(self, speed: float) -> str:
        return "" if self.law == "exact" else "e delivered"


@dataclasses.dataclass(frozen=True)
class ConstantC(AbstractKind):
    """A constant damping factor c: α = c v/K."""

    law: str = "constant_damping"
    name: str = "constant c"
    unidentified = "c and K separately, and m: e(v) determines only c/K"
    transforms = MappingProxyType({"c": Positive()})
    own = (("c", "N s/m^(5/2)", frozenset({"stiffness"})),)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return the c of Hu and Guo's α = 3(1-e)/(2e), which nearly delivers e."""
        return {"c": 1.5 * (1 - e) / e * float(contact.stiffness) / reference}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return ConstantDamping(c=params["c"])

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        return {**params, "c": params["c"] * other.stiffness / contact.stiffness}

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        return (("c", "c/K", 1 / float(contact.stiffness), "s/m"),)


@dataclasses.dataclass(frozen=True)
class PowerOfSpeed(ConstantC):
    """A damping factor that is a power of the closing speed: α = c (v/v_r)^p v/K."""

    law: str = "power_damping"
    name: str = "c as a power of v"
    transforms = MappingProxyType({"c": Positive(), "power": Free()})
    special = (ConstantE, ConstantC)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant c."""
        return super().start(e, contact, reference) | {"power": 0.0}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return PowerDamping(c=params["c"], power=params["power"], reference=reference)

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """Return c/K at the reference speed, and the power."""
        return (*super().identified(contact), ("power", "power", 1.0, ""))


@dataclasses.dataclass(frozen=True)
class Viscoelastic(AbstractKind):
    """Kuwabara and Kono's law for n = 3/2: e depends on A (K/m)^(2/5) v^(1/5)."""

    law: str = "kuwabara_kono"
    name: str = "Kuwabara-Kono"
    unidentified = "A, K and m separately: e(v) determines only A (K/m)^(2/5)"
    transforms = MappingProxyType({"A": Positive()})
    own = (("A", "s", frozenset({"mass", "stiffness"})),)

    def serves(self, exponent: float | Array) -> bool:
        return isinstance(exponent, float) and exponent == 1.5

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return A of 1 - e ≈ 1.15344 (3/2) A (K/m)^(2/5) v^(1/5), capped for large losses."""
        strength = min((1 - e) / 1.73, 0.4) / reference**0.2
        return {"A": strength / _frequency(contact)}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return KuwabaraKono(A=params["A"])

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        old, new = contact.stiffness / contact.mass, other.stiffness / other.mass
        return {**params, "A": params["A"] * (old / new) ** 0.4}

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        return (("A", "A (K/m)^(2/5)", _frequency(contact), "(m/s)^(-1/5)"),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return e by the series of the law's form."""
        e = restitution(self.law_of(params, contact, reference), contact, velocity)
        return jnp.broadcast_to(e, velocity.shape)


@dataclasses.dataclass(frozen=True)
class Plastic(AbstractKind):
    """Thornton's elastic-plastic spheres: e depends on the yield speed alone."""

    law: str = "thornton_plastic"
    name: str = "elastic-plastic"
    unidentified = "yield pressure, E, R and m separately: e(v) determines only the yield speed"
    transforms = MappingProxyType({"yield_speed": Positive()})

    def serves(self, exponent: float | Array) -> bool:
        return isinstance(exponent, float) and exponent == 1.5

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return r = v_y/v from a formula that is 1 at e = 1 and near e⁴ far beyond yielding."""
        ratio = e**4 * (1 - 0.6 * (1 - e) ** 0.3)
        return {"yield_speed": ratio * reference}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return ThorntonPlastic(yield_speed=params["yield_speed"])

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        return (("yield_speed", "yield speed", 1.0, "m/s"),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        return plastic_restitution(params["yield_speed"], velocity)

    def outcome(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Any:
        """Return the outcome of plastic spheres; the law's own force delivers only their e."""
        return plastic_impact(params["yield_speed"], contact, velocity)


@dataclasses.dataclass(frozen=True)
class PowerOfLoss(AbstractKind):
    """A loss that is a power of the closing speed: e = 1 - b (v/v_r)^p."""

    law: str = "power_restitution"
    name: str = "1 - b v^p"
    unidentified = "mass, stiffness and exponent: the curve is empirical"
    transforms = MappingProxyType({"loss": Between(0, 1), "power": Free()})
    special = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant e."""
        return {"loss": 1 - e, "power": 0.0}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return PowerRestitution(params["loss"], params["power"], reference)

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """Return b at the reference speed, and the power."""
        return (("loss", "b", 1.0, ""), ("power", "power", 1.0, ""))

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Return the curve, kept above 0, where its logarithm is defined."""
        e = PowerRestitution(params["loss"], params["power"], reference).restitution_at(velocity)
        return jnp.maximum(e, _LEAST_E)


@dataclasses.dataclass(frozen=True)
class PowerOfRestitution(AbstractKind):
    """A restitution that falls as a power of the closing speed: e = min(1, a (v/v_r)^-p)."""

    law: str = "bridges"
    name: str = "a v^-p"
    unidentified = "mass, stiffness and exponent: the curve is empirical"
    transforms = MappingProxyType({"a": Positive(), "power": Free()})
    special = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant e."""
        return {"a": e, "power": 0.0}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return Bridges(params["a"], params["power"], reference)

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        """Return a at the reference speed, and the power."""
        return (("a", "a", 1.0, ""), ("power", "power", 1.0, ""))

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        return Bridges(params["a"], params["power"], reference).restitution_at(velocity)


@dataclasses.dataclass(frozen=True)
class Dashpot(AbstractKind):
    """A linear dashpot parallel to Hertz's force: e depends on c/(m^(3/5) K^(2/5)) v^(-1/5)."""

    law: str = "linear_dashpot"
    name: str = "linear dashpot"
    unidentified = "c, K and m separately: e(v) determines only c/(m^(3/5) K^(2/5))"
    transforms = MappingProxyType({"c": Positive()})
    own = (("c", "N s/m", frozenset({"mass", "stiffness"})),)

    def serves(self, exponent: float | Array) -> bool:
        return isinstance(exponent, float) and exponent == 1.5

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return c of ln e = -1.6 c/(m^(3/5) K^(2/5)) v^(-1/5), which nearly delivers e."""
        return {"c": -math.log(e) / 1.6 * reference**0.2 * _dashpot(contact)}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return LinearDashpot(c=params["c"])

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        return {**params, "c": params["c"] * _dashpot(other) / _dashpot(contact)}

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        return (("c", "c/(m^(3/5) K^(2/5))", 1 / float(_dashpot(contact)), "(m/s)^(1/5)"),)

    def restitution(
        self, params: Params, contact: Contact, reference: Any, velocity: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        return clamped_restitution(self.law_of(params, contact, reference), contact, velocity)


@dataclasses.dataclass(frozen=True)
class Stepped(Dashpot):
    """Adams' IMPACT with Hertz's force: e also depends on d (K/m)^(2/5) v^(-4/5)."""

    law: str = "step_damping"
    name: str = "step damping"
    unidentified = "c_max, d, K and m separately: e(v) determines only two combinations"
    transforms = MappingProxyType({"c_max": Positive(), "d": Positive()})
    own = (
        ("c_max", "N s/m", frozenset({"mass", "stiffness"})),
        ("d", "m", frozenset({"mass", "stiffness"})),
    )

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return d as 0.3 of the elastic indentation, and c_max."""
        depth = 0.3 * reference**0.8 / _frequency(contact)
        return {"c_max": 1.1 * super().start(e, contact, reference)["c"], "d": depth}

    def law_of(self, params: Params, contact: Contact, reference: Any) -> AbstractLaw:
        return StepDamping(c_max=params["c_max"], d=params["d"])

    def moved(self, params: Params, contact: Contact, other: Contact) -> Params:
        c_max = params["c_max"] * _dashpot(other) / _dashpot(contact)
        return {**params, "c_max": c_max, "d": params["d"] * _depth(other) / _depth(contact)}

    def identified(self, contact: Contact) -> tuple[tuple[str, str, float, str], ...]:
        (_, _, factor, unit), *_ = super().identified(contact)
        return (
            ("c_max", "c_max/(m^(3/5) K^(2/5))", factor, unit),
            ("d", "d (K/m)^(2/5)", _frequency(contact), "(m/s)^(4/5)"),
        )


def _frequency(contact: Contact) -> float:
    return (float(contact.stiffness) / float(contact.mass)) ** 0.4


def _depth(contact: Contact) -> Any:
    return (contact.mass / contact.stiffness) ** 0.4


def _dashpot(contact: Contact) -> Any:
    return contact.mass**0.6 * contact.stiffness**0.4


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


SPEED_DEPENDENT: tuple[AbstractKind, ...] = (
    *(ConstantC(), PowerOfSpeed(), Viscoelastic()),
    *(Plastic(), PowerOfLoss()),
)

ON_REQUEST: tuple[AbstractKind, ...] = (PowerOfRestitution(), Dashpot(), Stepped())
"""Kinds that are compared only if their law is named.

Few tables of e(v) separate a v^-p from the curve of plastic spheres, which falls as v^(-1/4). If
both were compared, no choice of either would be sure. The curves of dashpots have no formula.
"""


def kinds_of(law: str, exponent: float | Array) -> tuple[AbstractKind, ...]:
    """Return the kinds to compare: a constant e first, then one or all speed-dependent kinds.

    `law` "all" compares the exact constant e with all of them, except those on request. The name of
    a speed-dependent law, including those on request, compares it with the exact constant e. The
    name of a law with parameter e makes that law deliver the constant e. Kinds that are unknown for
    the exponent are left out. Raises ValueError for any other name.
    """
    others = tuple(kind for kind in SPEED_DEPENDENT if kind.serves(exponent))
    asked = tuple(kind for kind in ON_REQUEST if kind.serves(exponent))
    choices = ["all", *constant_laws(), *(kind.law for kind in (*others, *asked))]
    if not isinstance(law, str) or law not in choices:
        raise ValueError(
            f"Argument `law` must be one of {', '.join(choices)}, but is {rendered(law)}."
            f"{did_you_mean(law, choices)}"
        )
    if law == "all":
        return (ConstantE(), *others)
    for kind in (*others, *asked):
        if law == kind.law:
            return (ConstantE(), kind)
    name = "constant e" if law == "exact" else f"constant e ({law})"
    return (ConstantE(law, name), *others)


def kind_of_law(law: AbstractLaw) -> AbstractKind:
    """Return the kind with the e(v) of a law."""
    for kind in (*SPEED_DEPENDENT, *ON_REQUEST):
        if describe(kind.law).cls is type(law):
            return kind
    return ConstantE()


def law_in(law: AbstractLaw, old: Contact, new: Contact) -> AbstractLaw:
    """Return the law with the same e(v) in another contact."""
    kind = kind_of_law(law)
    params = {name: getattr(law, name) for name in kind.transforms if hasattr(law, name)}
    for name, value in kind.moved(params, old, new).items():
        law = eqx.tree_at(operator.attrgetter(name), law, value)
    return law
