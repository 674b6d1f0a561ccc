"""The kinds of laws that are compared, each with its curve e(v), and their choice by name."""

from __future__ import annotations

import copyreg
import functools
import math
import operator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import AbstractLaw, Between, Contact, Damped, Free, Positive, impact, restitution
from ...extend import constant_laws, describe, did_you_mean, force_of, refusal, rendered, scale_of
from .kind import Combination, Kind, Start

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

_LOSS = 3 ** (-4 / 3) * (4 / 15 + 0.4 * 4 ** (4 / 3))
"""Energy that a neck takes, scaled, see `JKR`."""

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


def _at_once(law: Any, contact: Contact, velocity: Array) -> Array:
    """Return e of a damping factor: one formula, which compiles in half the time."""
    return restitution(Damped(alpha=law.damping_factor(contact, velocity)))


def _power_of_loss(law: Any, contact: Contact, velocity: Array) -> Array:
    """Return the curve, kept above 0, where its logarithm is defined."""
    return jnp.maximum(law.restitution_at(velocity), _LEAST_E)


def _wet(law: Any, contact: Contact, velocity: Array) -> Array:
    return law.e * _kept_above_zero(1 - law.critical_speed / velocity)


def _wet_outcome(law: Any, contact: Contact, velocity: Array) -> Any:
    """Return contact time and force; for bodies that stick those of the least e."""
    return impact(Damped(alpha=law.damping_factor(contact, velocity)), contact, velocity)


def _adhesive(law: Any, contact: Contact, velocity: Array) -> Array:
    sticking = law.sticking_speed(contact)
    return jnp.sqrt(_kept_above_zero(1 - jnp.square(sticking / velocity)))


def _adhesive_outcome(law: Any, contact: Contact, velocity: Array) -> Any:
    """Return contact time and force; for bodies that stick those of the slowest that part."""
    slowest = _ABOVE_STICKING * law.sticking_speed(contact)
    return impact(law, contact, jnp.maximum(velocity, slowest))


def _two_losses(viscous: float) -> Start:
    """Return the start of two losses, of which the viscous one has this share of ln e."""
    return lambda e, v: {**_PLASTIC.start(e ** (1 - viscous), v), **_DAMPED.start(e**viscous, v)}


@functools.cache
def constant_e(law: str = "exact") -> Kind:
    """Return the kind with the same e at every speed, as a law of one parameter e delivers it."""
    exact = law == "exact"
    return Kind(
        law,
        "constant e" if exact else f"constant e ({law})",
        "mass, stiffness and exponent: e does not depend on them",
        {"e": Combination(Between(0, 1), "e")},
        start=lambda e, v: {"e": e},
        # The exact law delivers its parameter by definition, so nothing is compiled.
        curve=lambda law, contact, velocity: law.e if exact else restitution(law),
        at_speed="" if exact else "e delivered",
    )


_DAMPED = Kind(
    "constant_damping",
    "constant c",
    "c and K separately, and m: e(v) determines only c/K",
    {"c": Combination(Positive(), "c/K", "s/m", _spring, "N s/m^(5/2)", _STIFFNESS)},
    # Hu and Guo's α = 3(1-e)/(2e) nearly delivers e.
    start=lambda e, v: {"c": 1.5 * (1 - e) / e / v},
    curve=_at_once,
)

# r = v_y/v by a formula that is 1 at e = 1, and near e⁴ far beyond yielding.
_PLASTIC = Kind(
    "thornton_plastic",
    "elastic-plastic",
    "yield pressure, E, R and m separately: e(v) determines only the yield speed",
    {"yield_speed": Combination(Positive(), "yield speed", "m/s")},
    start=lambda e, v: {"yield_speed": e**4 * (1 - 0.6 * (1 - e) ** 0.3) * v},
    exponent=_HERTZ,
)

_EMPIRICAL = "mass, stiffness and exponent: the curve is empirical"

SPEED_DEPENDENT: tuple[Kind, ...] = (
    _DAMPED,
    Kind(
        "power_damping",
        "c as a power of v",
        _DAMPED.unidentified,
        {**_DAMPED.parameters, "power": _POWER},
        start=lambda e, v: {**_DAMPED.start(e, v), "power": 0.0},
        curve=_at_once,
        special=("constant e", "constant c"),
    ),
    # 1 - e ≈ 1.15344 (3/2) A (K/m)^(2/5) v^(1/5), capped for large losses.
    Kind(
        "kuwabara_kono",
        "Kuwabara-Kono",
        "A, K and m separately: e(v) determines only A (K/m)^(2/5)",
        {"A": Combination(Positive(), "A (K/m)^(2/5)", "(m/s)^(-1/5)", _depth, "s", _BOTH)},
        start=lambda e, v: {"A": min((1 - e) / 1.73, 0.4) / v**0.2},
        curve=restitution,
        exponent=_HERTZ,
    ),
    _PLASTIC,
    # The plastic loss ends at the yield speed. A search that starts with it above the data does not
    # see it, and stops at a constant c.
    Kind(
        "viscoplastic",
        "viscous and plastic",
        "c and K separately; yield pressure, E, R and m: e(v) determines v_y and c/K",
        {**_PLASTIC.parameters, **_DAMPED.parameters},
        start=_two_losses(_VISCOUS_SHARE),
        also=(_two_losses(0.3), _two_losses(0.02)),
        curve=restitution,
        special=("constant c", "elastic-plastic"),
        exponent=_HERTZ,
    ),
    # The film takes a fifth of the loss.
    Kind(
        "wet_restitution",
        "wet",
        "viscosity, radius, mass and St_c separately: e(v) determines the dry e and v_c",
        {
            "e": Combination(Between(0, 1), "dry e"),
            "critical_speed": Combination(Positive(), "v_c", "m/s"),
        },
        start=lambda e, v: {"e": e**0.8, "critical_speed": (1 - e / e**0.8) * v},
        curve=_wet,
        special=("constant e",),
        outcome=_wet_outcome,
    ),
    # v_s = v √(1 - e²).
    Kind(
        "jkr",
        "adhesive (JKR)",
        "pull-off force, K and m separately: e(v) determines the sticking speed",
        {
            "pull_off": Combination(
                Positive(), "F_po/(m³K²)^(1/5)", "(m/s)^(6/5)", _dashpot, "N", _BOTH
            )
        },
        start=lambda e, v: {"pull_off": ((1 - e) * (1 + e) * v**2 / (2 * _LOSS)) ** 0.6},
        curve=_adhesive,
        exponent=_HERTZ,
        outcome=_adhesive_outcome,
    ),
    Kind(
        "power_restitution",
        "1 - b v^p",
        _EMPIRICAL,
        {"loss": Combination(Between(0, 1), "b"), "power": _POWER},
        start=lambda e, v: {"loss": 1 - e, "power": 0.0},
        curve=_power_of_loss,
        special=("constant e",),
    ),
)

_DASHPOT = Combination(Positive(), "c/(m^(3/5) K^(2/5))", "(m/s)^(1/5)", _dashpot, "N s/m", _BOTH)

ON_REQUEST: tuple[Kind, ...] = (
    Kind(
        "bridges",
        "a v^-p",
        _EMPIRICAL,
        {"a": Combination(Positive(), "a"), "power": _POWER},
        start=lambda e, v: {"a": e, "power": 0.0},
        special=("constant e",),
    ),
    # ln e = -1.6 c/(m^(3/5) K^(2/5)) v^(-1/5) nearly delivers e.
    Kind(
        "linear_dashpot",
        "linear dashpot",
        "c, K and m separately: e(v) determines only c/(m^(3/5) K^(2/5))",
        {"c": _DASHPOT},
        start=lambda e, v: {"c": -math.log(e) / 1.6 * v**0.2},
        curve=clamped_restitution,
        exponent=_HERTZ,
    ),
    # d is 0.3 of the elastic indentation.
    Kind(
        "step_damping",
        "step damping",
        "c_max, d, K and m separately: e(v) determines only two combinations",
        {
            "c_max": _DASHPOT._replace(name="c_max/(m^(3/5) K^(2/5))"),
            "d": Combination(Positive(), "d (K/m)^(2/5)", "(m/s)^(4/5)", _depth, "m", _BOTH),
        },
        start=lambda e, v: {"c_max": -1.1 * math.log(e) / 1.6 * v**0.2, "d": 0.3 * v**0.8},
        curve=clamped_restitution,
        exponent=_HERTZ,
    ),
)
"""Kinds that are compared only if their law is named.

Few tables of e(v) separate a v^-p from the curve of plastic spheres, which falls as v^(-1/4). If
both were compared, no choice of either would be sure. The curves of dashpots have no formula.
"""


def kinds_of(laws: str, exponent: float | Array) -> tuple[Kind, ...]:
    """Return the kinds to compare: a constant e first, then one or all speed-dependent kinds.

    `laws` "all" compares the exact constant e with all of them, except those on request. The name
    of a speed-dependent law, including those on request, compares it with the exact constant e. The
    name of a law with parameter e makes that law deliver the constant e. Kinds that are unknown for
    the exponent are left out. Raises ValueError for any other name.
    """
    serves = operator.methodcaller("serves", exponent)
    others, asked = tuple(filter(serves, SPEED_DEPENDENT)), filter(serves, ON_REQUEST)
    by_law = {kind.law: kind for kind in (*others, *asked)}
    choices = ["all", *constant_laws(), *by_law]
    if not isinstance(laws, str) or laws not in choices:
        meant = [
            f" Did you mean {kind.law!r}?"
            for kind in by_law.values()
            if repr(kind.name) == rendered(laws)
        ]
        must = f"be one of {', '.join(choices)}"
        raise refusal("laws", must, laws, meant[0] if meant else did_you_mean(laws, choices))
    if laws == "all":
        return (constant_e(), *others)
    return (constant_e(), by_law[laws]) if laws in by_law else (constant_e(laws), *others)


def _named(law: str) -> Kind:
    kinds = {kind.law: kind for kind in (*SPEED_DEPENDENT, *ON_REQUEST)}
    return kinds.get(law) or constant_e(law)


# There is one of each kind: a pickle holds its law.
copyreg.pickle(Kind, lambda kind: (_named, (kind.law,)))


def kind_of_law(law: AbstractLaw) -> Kind:
    """Return the kind with the e(v) of a law."""
    kinds = (*SPEED_DEPENDENT, *ON_REQUEST)
    return next((one for one in kinds if describe(one.law).cls is type(law)), constant_e())


def law_in(law: AbstractLaw, old: Contact, new: Contact) -> AbstractLaw:
    """Return the law with the same e(v) in another contact."""
    kind = kind_of_law(law)
    params = {name: getattr(law, name) for name in kind.transforms if hasattr(law, name)}
    for name, value in kind.moved(params, old, new).items():
        law = eqx.tree_at(operator.attrgetter(name), law, value)
    return law
