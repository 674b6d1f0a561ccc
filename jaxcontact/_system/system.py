"""A mechanism: its equations of motion and the gaps of its contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._contact import EXPONENT
from .._entry import (
    POSITIVE,
    Specialised,
    as_parameter,
    as_parameters,
    parameter,
    refuses_unknown,
    require_function,
    require_kind,
    shown,
    specialised,
)
from .._friction import AbstractFriction
from .._laws import AbstractLaw, require_law, require_no_adhesion


class LagrangianMass(eqx.Module):
    """M(t, q) = ∂²L/∂v². L is quadratic in v, so that any v gives it."""

    lagrangian: Callable[..., Array]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        momentum = jax.grad(self.lagrangian, argnums=2)
        return jax.jacfwd(lambda v: momentum(t, q, v, args))(jnp.zeros_like(q))


class LagrangianForce(eqx.Module):
    """All generalised forces but those of contacts."""

    lagrangian: Callable[..., Array]
    forces: Callable[..., Array] | None

    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        def momentum(t: Array, q: Array) -> Array:
            return jax.grad(self.lagrangian, argnums=2)(t, q, v, args)

        pull = jax.grad(self.lagrangian, argnums=1)(t, q, v, args)
        pull = pull - jax.jvp(momentum, (t, q), (jnp.ones_like(t), v))[1]
        return pull if self.forces is None else pull + self.forces(t, q, v, args)


class LagrangianEnergy(eqx.Module):
    """The energy v·p - L in J."""

    lagrangian: Callable[..., Array]

    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        value, momentum = jax.value_and_grad(self.lagrangian, argnums=2)(t, q, v, args)
        return jnp.sum(v * momentum) - value


class PlainFunction(eqx.Module):
    """A function without numbers of its own, which is a static part of a program."""

    function: Callable[..., Any] = eqx.field(static=True)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)


def _function(name: str, value: Any) -> Any:
    """Return a user's function as a module; its numbers are leaves if it is a module already."""
    if not isinstance(value, eqx.Module):
        return PlainFunction(require_function(name, value))
    require_function(name, value)
    return as_parameters(value, name)


_NEEDS = {
    "rigid": ["mu"],
    "spring": ["ratio"],
    "ramp": ["force"],
    "state": ["force_and_rate", "unit"],
}
"""What a friction law of each kind has."""


def _require_friction(friction: Any) -> None:
    """Raise ValueError for a friction law that no mechanism can have."""
    allowed = "a `RigidCoulomb`, a `SpringSlider` or a `RegularizedCoulomb`"
    friction = require_kind("friction", friction, AbstractFriction, allowed)
    needs, name = _NEEDS.get(str(friction.kind)), type(friction).__name__
    if needs is None:
        raise ValueError(
            f"Argument `friction` of a `System` must be {allowed}, or a law with a `kind` of "
            f"{', '.join(map(repr, _NEEDS))}, but is a `{name}` of the kind {friction.kind!r}. "
            "It gives the outcome of an impact and no force."
        )
    for missing in (one for one in needs if getattr(friction, one, None) is None):
        raise ValueError(
            f"Argument `{missing}` of the `{name}` of a `System` must be given, as no materials or "
            "defaults replace it, but is None."
        )
    friction.require_for_system()


class System(eqx.Module):
    """A mechanism with contacts: M(t, q) v' = Q(t, q, v) + Σ F_k ∇g_k, with gaps g_k(t, q).

    - `mass(t, q, args)`: the matrix M (n, n), symmetric and positive definite.
    - `force(t, q, v, args)`: all generalised forces (n,) but those of contacts, with Coriolis
      terms.
    - `gap(t, q, args)`: the distances (m,) in m, negative in contact.
    - `law`, `stiffness` in N/mⁿ, `exponent` n in [1, 3]: the contact law, with one number for all
      gaps or one for each. A plain number for n is static.
    - `friction`: a `RegularizedCoulomb`; a `SpringSlider` with a `ratio`, of the form "force"; in
      the plane a `RigidCoulomb`; a law of one's own of such a `kind`, or of "state"; or None.
      Contacts that are rigid or have springs stick and slip. μ is one number, or one for each gap.
    - `slip(t, q, v, args)`: the tangential speeds in m/s, affine in v; (m,) in the plane, (m, 2) in
      space. Friction needs it.
    - `rate(t, q, v, args)`: q', where q has more numbers than v, as with quaternions. Default: v.

    The contact Jacobian, the generalised contact force and the effective mass 1/(J M⁻¹ Jᵀ) follow
    from `gap` by automatic differentiation. The closing speed is -dg/dt with ∂g/∂t, so that walls
    may move. Functions are static. Numbers to differentiate belong in `args`, or are leaves of
    functions that are `equinox.Module`s. Raises ValueError for arguments of the wrong kind and for
    Python scalars out of range.
    """

    mass: Callable[..., Array]
    force: Callable[..., Array]
    gap: Callable[..., Array]
    law: AbstractLaw
    stiffness: Float[Array, "..."] = parameter("stiffness", POSITIVE)
    _exponent: Specialised = eqx.field(default=Specialised(1.5))
    friction: AbstractFriction | None = None
    slip: Callable[..., Array] | None = None
    rate: Callable[..., Array] | None = None
    _energy: LagrangianEnergy | None = None

    @refuses_unknown
    def __init__(
        self,
        mass: Callable[..., Array],
        force: Callable[..., Array],
        gap: Callable[..., Array],
        *,
        law: AbstractLaw,
        stiffness: ArrayLike,
        exponent: ArrayLike = 1.5,
        friction: AbstractFriction | None = None,
        slip: Callable[..., Array] | None = None,
        rate: Callable[..., Array] | None = None,
    ):
        self.mass, self.force = _function("mass", mass), _function("force", force)
        self.gap, self.law = _function("gap", gap), require_law(law)
        self.stiffness = as_parameter(stiffness, "stiffness", POSITIVE)
        self._exponent = specialised(exponent, "exponent", EXPONENT)
        if friction is not None:
            _require_friction(friction)
            require_no_adhesion(self.law, "in a mechanism with friction")
        if (friction is None) != (slip is None):
            missing, given = ("slip", "friction") if slip is None else ("friction", "slip")
            raise ValueError(f"Argument `{missing}` must be given with `{given}`, but is None.")
        self.friction = as_parameters(friction, "friction")
        self.slip = None if slip is None else _function("slip", slip)
        self.rate = None if rate is None else _function("rate", rate)
        self._energy = None

    @classmethod
    @refuses_unknown
    def from_lagrangian(
        cls,
        lagrangian: Callable[..., Array],
        gap: Callable[..., Array],
        forces: Callable[..., Array] | None = None,
        *,
        law: AbstractLaw,
        stiffness: ArrayLike,
        exponent: ArrayLike = 1.5,
        friction: AbstractFriction | None = None,
        slip: Callable[..., Array] | None = None,
    ) -> System:
        """Build a mechanism from its Lagrangian: d/dt ∂L/∂v - ∂L/∂q = Q + Σ F_k ∇g_k.

        - `lagrangian(t, q, v, args)`: L in J, quadratic in v.
        - `forces(t, q, v, args)`: generalised forces Q (n,) that L lacks; None without.

        The other arguments are those of `System`. Here v = q'. The mass matrix is ∂²L/∂v², which
        `simulate` requires to be positive definite. The energy of a run is v·∂L/∂v - L plus that
        stored in contacts. Raises ValueError as `System` does.
        """
        of = _function("lagrangian", lagrangian)
        others = None if forces is None else _function("forces", forces)
        system = cls(
            LagrangianMass(of),
            LagrangianForce(of, others),
            gap,
            law=law,
            stiffness=stiffness,
            exponent=exponent,
            friction=friction,
            slip=slip,
        )
        return eqx.tree_at(
            lambda s: s._energy, system, LagrangianEnergy(of), is_leaf=lambda leaf: leaf is None
        )

    @property
    def sticks(self) -> bool:
        """True if contacts stick and slip."""
        return self.rigid or self.springs

    @property
    def rigid(self) -> bool:
        """True if contacts that stick do not move at all."""
        return self.friction is not None and self.friction.kind == "rigid"

    @property
    def springs(self) -> bool:
        """True if contacts have tangential springs."""
        return self.friction is not None and self.friction.kind == "spring"

    @property
    def states(self) -> bool:
        """True if the friction of a contact has a state, such as the force of a spring."""
        return self.friction is not None and self.friction.kind in ("spring", "state")

    @property
    def exponent(self) -> float | Float[Array, "..."]:
        """The exponent n: a float if it was given as a Python number, an array otherwise."""
        return self._exponent.value

    def __repr__(self) -> str:
        return (
            f"System(law={type(self.law).__name__}, stiffness={shown(self.stiffness)}, "
            f"exponent={shown(self.exponent)}, friction={self.friction!r})"
        )
