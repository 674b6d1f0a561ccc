"""The kinds of laws that are compared, each with its curve e(v), and their choice by name."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import AbstractLaw, Between, Contact, Damped, Free, Positive, impact, restitution
from ...extend import LOSS, constant_laws, describe, did_you_mean, force_of, rendered, scale_of
from .kind import AbstractKind, Combination

_STEPS = 256


def clamped_restitution(
    law: AbstractLaw, contact: Contact, velocity: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Return e at closing speeds in m/s, of a law without tension for n = 3/2.

    The error is within 1e-5 for e above 0.7, and 2e-3 for e above 0.15 (for a linear dashpot, whose
    force jumps). After the force has vanished the bodies separate, and the polar angle of (√x, v)
    continues to π. Equal steps of it need neither an event nor a step controller, whose jumps would
    stop a line search. The steps are classical Runge-Kutta steps.
    """
    scale = scale_of(contact, velocity)
    step = np.pi / _STEPS
    nodes = np.arange(_STEPS)[:, None] * step + np.array([0, step / 2, step])
    sines, cosines = (jnp.asarray(f(nodes), velocity.dtype) for f in (np.sin, np.cos))

    def slope(radius: Array, sine: Array, cosine: Array) -> Array:
        """Return d ln r/dψ of w = r sin ψ, v = r cos ψ, with w' = v/2 and v' = -w f."""
        w, v = radius * sine, radius * cosine
        force = force_of(law, scale.length * w * w, scale.speed * v, contact, scale.speed)
        across, along = v / 2, -w * force / scale.force
        return (sine * across + cosine * along) / (cosine * across - sine * along)

    def advance(logarithm: Array, at: tuple[Array, Array]) -> tuple[Array, None]:
        def rate(shift: Array | float, node: int) -> Array:
            return slope(jnp.exp(logarithm + shift), at[0][node], at[1][node])

        first = rate(0.0, 0)
        second = rate(step / 2 * first, 1)
        third = rate(step / 2 * second, 1)
        last = rate(step * third, 2)
        return logarithm + step / 6 * (first + 2 * second + 2 * third + last), None

    end, _ = jax.lax.scan(advance, jnp.zeros_like(velocity), (sines, cosines))
    return jnp.exp(end)


_LEAST_E = 1e-6
_LEAST_LEFT = 1e-4
"""The share of the energy or of e that bodies keep, below which a curve is continued above 0."""

_ABOVE_STICKING = 1 + 1e-6
"""The slowest speed at which a contact ends, over the sticking speed."""

_VISCOUS_SHARE = 0.8
"""The share of ln e from which a search for two losses begins; with less it may miss the damping
that describes the data alone.
"""

_HERTZ = 1.5
_POWER = Combination(Free(), "power")
_STIFFNESS = frozenset({"stiffness"})
_BOTH = frozenset({"mass", "stiffness"})


def _spring(mass: Any, stiffness: Any) -> Any:
    """Return a damping factor over a time and a length."""
    return stiffness


def _depth(mass: Any, stiffness: Any) -> Any:
    """Return an indentation in m over v^(4/5), or a time in s over v^(-1/5)."""
    return (mass / stiffness) ** 0.4


def _dashpot(mass: Any, stiffness: Any) -> Any:
    """Return a dashpot in N s/m over v^(1/5)."""
    return mass**0.6 * stiffness**0.4


def _kept_above_zero(left: Array) -> Array:
    """Return what bodies keep; below a least value a continuation with a value and slope above 0.

    A search that starts where slow bodies stick can thus leave it.
    """
    low = left < _LEAST_LEFT
    return jnp.where(
        low, _LEAST_LEFT**2 / (2 * _LEAST_LEFT - jnp.where(low, left, _LEAST_LEFT)), left
    )


@dataclasses.dataclass(frozen=True)
class ConstantE(AbstractKind):
    """The same e at every speed, as delivered by the law `law` of one parameter e."""

    law: str = "exact"
    name: str = "constant e"
    unidentified = "mass, stiffness and exponent: e does not depend on them"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"e": Combination(Between(0, 1), "e")}
    )

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        return {"e": e}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the delivered e, the same at every speed."""
        # The exact law delivers its parameter by definition, so nothing is compiled.
        return law.e if self.law == "exact" else restitution(law)

    def at_speed(self, speed: float) -> str:
        return "" if self.law == "exact" else "e delivered"


@dataclasses.dataclass(frozen=True)
class ConstantC(AbstractKind):
    """A constant damping factor c: α = c v/K."""

    law: str = "constant_damping"
    name: str = "constant c"
    unidentified = "c and K separately, and m: e(v) determines only c/K"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"c": Combination(Positive(), "c/K", "s/m", _spring, "N s/m^(5/2)", _STIFFNESS)}
    )

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return the c of Hu and Guo's α = 3(1-e)/(2e), which nearly delivers e."""
        return {"c": 1.5 * (1 - e) / e * float(contact.stiffness) / reference}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        # Without contact and speed `restitution` is one formula, which compiles in half the time.
        return restitution(Damped(alpha=law.damping_factor(contact, velocity)))


@dataclasses.dataclass(frozen=True)
class PowerOfSpeed(ConstantC):
    """A damping factor that is a power of the closing speed: α = c (v/v_r)^p v/K."""

    law: str = "power_damping"
    name: str = "c as a power of v"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {**ConstantC.parameters, "power": _POWER}
    )
    special: ClassVar[tuple[type[AbstractKind], ...]] = (ConstantE, ConstantC)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant c."""
        return super().start(e, contact, reference) | {"power": 0.0}


@dataclasses.dataclass(frozen=True)
class Viscoelastic(AbstractKind):
    """Kuwabara and Kono's law for n = 3/2: e depends on A (K/m)^(2/5) v^(1/5)."""

    law: str = "kuwabara_kono"
    name: str = "Kuwabara-Kono"
    unidentified = "A, K and m separately: e(v) determines only A (K/m)^(2/5)"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"A": Combination(Positive(), "A (K/m)^(2/5)", "(m/s)^(-1/5)", _depth, "s", _BOTH)}
    )
    exponent: ClassVar[float | None] = _HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return A of 1 - e ≈ 1.15344 (3/2) A (K/m)^(2/5) v^(1/5), capped for large losses."""
        strength = min((1 - e) / 1.73, 0.4) / reference**0.2
        return {"A": strength * _depth(float(contact.mass), float(contact.stiffness))}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return e by the series of the law's form."""
        return restitution(law, contact, velocity)


@dataclasses.dataclass(frozen=True)
class Plastic(AbstractKind):
    """Thornton's elastic-plastic spheres: e depends on the yield speed alone."""

    law: str = "thornton_plastic"
    name: str = "elastic-plastic"
    unidentified = "yield pressure, E, R and m separately: e(v) determines only the yield speed"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"yield_speed": Combination(Positive(), "yield speed", "m/s")}
    )
    exponent: ClassVar[float | None] = _HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return r = v_y/v from a formula that is 1 at e = 1 and near e⁴ far beyond yielding."""
        ratio = e**4 * (1 - 0.6 * (1 - e) ** 0.3)
        return {"yield_speed": ratio * reference}


@dataclasses.dataclass(frozen=True)
class PowerOfLoss(AbstractKind):
    """A loss that is a power of the closing speed: e = 1 - b (v/v_r)^p."""

    law: str = "power_restitution"
    name: str = "1 - b v^p"
    unidentified = "mass, stiffness and exponent: the curve is empirical"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"loss": Combination(Between(0, 1), "b"), "power": _POWER}
    )
    special: ClassVar[tuple[type[AbstractKind], ...]] = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant e."""
        return {"loss": 1 - e, "power": 0.0}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the curve, kept above 0, where its logarithm is defined."""
        return jnp.maximum(super().curve(law, contact, velocity), _LEAST_E)


@dataclasses.dataclass(frozen=True)
class PowerOfRestitution(AbstractKind):
    """A restitution that falls as a power of the closing speed: e = min(1, a (v/v_r)^-p)."""

    law: str = "bridges"
    name: str = "a v^-p"
    unidentified: ClassVar[str] = PowerOfLoss.unidentified
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {"a": Combination(Positive(), "a"), "power": _POWER}
    )
    special: ClassVar[tuple[type[AbstractKind], ...]] = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a constant e."""
        return {"a": e, "power": 0.0}


@dataclasses.dataclass(frozen=True)
class Dashpot(AbstractKind):
    """A linear dashpot parallel to Hertz's force: e depends on c/(m^(3/5) K^(2/5)) v^(-1/5)."""

    law: str = "linear_dashpot"
    name: str = "linear dashpot"
    unidentified = "c, K and m separately: e(v) determines only c/(m^(3/5) K^(2/5))"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {
            "c": Combination(
                Positive(), "c/(m^(3/5) K^(2/5))", "(m/s)^(1/5)", _dashpot, "N s/m", _BOTH
            )
        }
    )
    exponent: ClassVar[float | None] = _HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return c of ln e = -1.6 c/(m^(3/5) K^(2/5)) v^(-1/5), which nearly delivers e."""
        scale = _dashpot(contact.mass, contact.stiffness)
        return {"c": -math.log(e) / 1.6 * reference**0.2 * scale}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        return clamped_restitution(law, contact, velocity)


@dataclasses.dataclass(frozen=True)
class Stepped(Dashpot):
    """Adams' IMPACT with Hertz's force: e also depends on d (K/m)^(2/5) v^(-4/5)."""

    law: str = "step_damping"
    name: str = "step damping"
    unidentified = "c_max, d, K and m separately: e(v) determines only two combinations"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {
            "c_max": Dashpot.parameters["c"]._replace(name="c_max/(m^(3/5) K^(2/5))"),
            "d": Combination(Positive(), "d (K/m)^(2/5)", "(m/s)^(4/5)", _depth, "m", _BOTH),
        }
    )

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return d as 0.3 of the elastic indentation, and c_max."""
        depth = 0.3 * reference**0.8 * _depth(float(contact.mass), float(contact.stiffness))
        return {"c_max": 1.1 * super().start(e, contact, reference)["c"], "d": depth}


@dataclasses.dataclass(frozen=True)
class ViscousAndPlastic(AbstractKind):
    """Elastic-plastic spheres with Hunt and Crossley's damping: e depends on v_y/v and c v/K."""

    law: str = "viscoplastic"
    name: str = "viscous and plastic"
    unidentified = "c and K separately; yield pressure, E, R and m: e(v) determines v_y and c/K"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {**Plastic.parameters, **ConstantC.parameters}
    )
    special: ClassVar[tuple[type[AbstractKind], ...]] = (ConstantC, Plastic)
    exponent: ClassVar[float | None] = _HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return most of ln e for the viscous loss."""
        return self._shared(_VISCOUS_SHARE, e, contact, reference)

    def starts(self, e: float, contact: Contact, reference: float) -> list[dict[str, float]]:
        """Return several shares of ln e for the two losses.

        The plastic loss ends at the yield speed. A search that starts with it above the data does
        not see it, and stops at a constant c.
        """
        return [self._shared(share, e, contact, reference) for share in (_VISCOUS_SHARE, 0.3, 0.02)]

    def _shared(
        self, viscous: float, e: float, contact: Contact, reference: float
    ) -> dict[str, float]:
        plastic = Plastic().start(e ** (1 - viscous), contact, reference)
        return {**plastic, **ConstantC().start(e**viscous, contact, reference)}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        return restitution(law, contact, velocity)


@dataclasses.dataclass(frozen=True)
class Wet(AbstractKind):
    """Bodies with a film of liquid: e (1 - v_c/v)."""

    law: str = "wet_restitution"
    name: str = "wet"
    unidentified = "viscosity, radius, mass and St_c separately: e(v) determines the dry e and v_c"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {
            "e": Combination(Between(0, 1), "dry e"),
            "critical_speed": Combination(Positive(), "v_c", "m/s"),
        }
    )
    special: ClassVar[tuple[type[AbstractKind], ...]] = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a film that takes a fifth of the loss."""
        dry = e**0.8
        return {"e": dry, "critical_speed": (1 - e / dry) * reference}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the curve, continued above 0, where its logarithm is defined."""
        return law.e * _kept_above_zero(1 - law.critical_speed / velocity)

    def outcome(self, law: Any, contact: Contact, velocity: Array) -> Any:
        """Return those of the least e for bodies that stick."""
        return impact(Damped(alpha=law.damping_factor(contact, velocity)), contact, velocity)


@dataclasses.dataclass(frozen=True)
class Adhesive(AbstractKind):
    """Elastic spheres with a neck (JKR): e = √(1 - (v_s/v)²)."""

    law: str = "jkr"
    name: str = "adhesive (JKR)"
    unidentified = "pull-off force, K and m separately: e(v) determines the sticking speed"
    parameters: ClassVar[Mapping[str, Combination]] = MappingProxyType(
        {
            "pull_off": Combination(
                Positive(), "F_po/(m³K²)^(1/5)", "(m/s)^(6/5)", _dashpot, "N", _BOTH
            )
        }
    )
    exponent: ClassVar[float | None] = _HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return the pull-off force of v_s = v √(1 - e²)."""
        lost = (1 - e) * (1 + e) * reference**2 / (2 * LOSS)
        return {"pull_off": lost**0.6 * float(_dashpot(contact.mass, contact.stiffness))}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the curve, continued above 0, where its logarithm is defined."""
        sticking = law.sticking_speed(contact)
        return jnp.sqrt(_kept_above_zero(1 - jnp.square(sticking / velocity)))

    def outcome(self, law: Any, contact: Contact, velocity: Array) -> Any:
        """Return those of the slowest bodies that part for bodies that stick."""
        slowest = _ABOVE_STICKING * law.sticking_speed(contact)
        return impact(law, contact, jnp.maximum(velocity, slowest))


SPEED_DEPENDENT: tuple[AbstractKind, ...] = (
    *(ConstantC(), PowerOfSpeed(), Viscoelastic(), Plastic()),
    *(ViscousAndPlastic(), Wet(), Adhesive(), PowerOfLoss()),
)

ON_REQUEST: tuple[AbstractKind, ...] = (PowerOfRestitution(), Dashpot(), Stepped())
"""Kinds that are compared only if their law is named.

Few tables of e(v) separate a v^-p from the curve of plastic spheres, which falls as v^(-1/4). If
both were compared, no choice of either would be sure. The curves of dashpots have no formula.
"""


def kinds_of(laws: str, exponent: float | Array) -> tuple[AbstractKind, ...]:
    """Return the kinds to compare: a constant e first, then one or all speed-dependent kinds.

    `laws` "all" compares the exact constant e with all of them, except those on request. The name
    of a speed-dependent law, including those on request, compares it with the exact constant e. The
    name of a law with parameter e makes that law deliver the constant e. Kinds that are unknown for
    the exponent are left out. Raises ValueError for any other name.
    """
    others = tuple(kind for kind in SPEED_DEPENDENT if kind.serves(exponent))
    asked = tuple(kind for kind in ON_REQUEST if kind.serves(exponent))
    by_law = {kind.law: kind for kind in (*others, *asked)}
    choices = ["all", *constant_laws(), *by_law]
    if not isinstance(laws, str) or laws not in choices:
        names = {kind.name: kind.law for kind in by_law.values()}
        of_kind = names.get(laws) if isinstance(laws, str) else None
        meant = f" Did you mean {of_kind!r}?" if of_kind else did_you_mean(laws, choices)
        raise ValueError(
            f"Argument `laws` must be one of {', '.join(choices)}, but is {rendered(laws)}.{meant}"
        )
    if laws == "all":
        return (ConstantE(), *others)
    if laws in by_law:
        return (ConstantE(), by_law[laws])
    name = "constant e" if laws == "exact" else f"constant e ({laws})"
    return (ConstantE(laws, name), *others)


def kind_of_law(law: AbstractLaw) -> AbstractKind:
    """Return the kind with the e(v) of a law."""
    kinds = (*SPEED_DEPENDENT, *ON_REQUEST)
    return next((one for one in kinds if describe(one.law).cls is type(law)), ConstantE())


def law_in(law: AbstractLaw, old: Contact, new: Contact) -> AbstractLaw:
    """Return the law with the same e(v) in another contact."""
    kind = kind_of_law(law)
    params = {name: getattr(law, name) for name in kind.transforms if hasattr(law, name)}
    for name, value in kind.moved(params, old, new).items():
        law = eqx.tree_at(operator.attrgetter(name), law, value)
    return law
