"""The interface of a friction law: the tangential part of an impact in scaled units.

The units are those of the normal motion: v0 of speed, m v0²/X of force. With u the slip speed of
the contact point, `u' = -λ f`, λ = m/m_t = 1 + m (R1²/I1 + R2²/I2). The normal force has the
impulse 1 + e.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._entry import require_kind, shown
from .._forms import Exponent, Lane


class Tangential(NamedTuple):
    """The tangential problem u' = -λ f of an impact in scaled units, u the slip velocity.

    The fields are numbers or arrays whose shapes broadcast, and have no unit but `speed`:

    - `slip`: u0 ≥ 0, the slip speed at touch over v0.
    - `mobility`: λ = 1 + m (R1²/I1 + R2²/I2), 7/2 for solid spheres.
    - `restitution`: e of the normal motion, whose impulse is 1 + e.
    - `alpha`, `exponent`: of a normal force xⁿ (1 + α x'); α is None for other forces.
    - `ratio`: κ, the tangential stiffness of the contact over the normal one; None if unknown.
    - `speed`: v0, the normal closing speed in m/s.
    """

    slip: Lane
    mobility: Lane
    restitution: Lane
    alpha: Lane | None
    exponent: Exponent
    ratio: Lane | None
    speed: Lane

    def after_sliding(self, mu: Lane) -> Lane:
        """Return the slip after sliding throughout, u0 - λ μ (1 + e), for every normal law."""
        return self.slip - self.mobility * mu * (1 + self.restitution)


class TangentialOutcome(NamedTuple):
    """The outcome of a `Tangential` problem: the slip after the impact, and its phases.

    The tangential impulse is (u0 - u')/λ. Arrays have the shape of the problem, and no unit:

    - `slip`: u' over v0, negative after a reversal, NaN without an outcome.
    - `slid`: True where the contact point slid throughout.
    - `stop`, `start`: the normal velocities over v0, from 1 at touch to -e, at which the first
      sliding ends and the last one begins; None if the law does not say.
    - `margin`: |u0/u_jump - 1|, how near the outcome or its slope is to a jump; None without jumps.
    - `converged`: False where the solve failed; None if the law is a formula.
    """

    slip: Lane
    slid: Bool[Array, "..."]
    stop: Lane | None = None
    start: Lane | None = None
    margin: Lane | None = None
    converged: Bool[Array, "..."] | None = None


class ScaledSpring(NamedTuple):
    """The scaled numbers of a tangential spring: ψ1 = κ u0/(μ v0), χ = λκ/2, and μ/κ, the unit of
    slip. Without friction, where `free`, ψ1 counts as 0 and the slip stays that of `given`.
    """

    psi: Lane
    chi: Lane
    unit: Lane
    free: Bool[Array, "..."]
    given: Lane

    def slip(self, psi: Lane) -> Lane:
        """Return the slip u'/v0 of a ψ2."""
        return jnp.where(self.free, self.given, self.unit * psi)


class NormalPath(NamedTuple):
    """The normal motion at many equal steps of time, in scaled units, the moments along axis 0."""

    time: Lane
    indentation: Lane
    velocity: Lane
    force: Lane


class AbstractFriction(eqx.Module):
    """A friction law: the slip u' of the contact point after an impact, from u0, λ and e.

    A subclass has the coefficient `mu` μ and its other numbers as fields, and defines

    - `rebound(problem)`: the `TangentialOutcome` of a `Tangential` problem of arrays, without `if`;
    - optionally `along(problem, path)`: slip and friction over time, for `oblique_trajectory`. The
      path has scaled `time`, `indentation`, `velocity` (1 to -e) and `force`, moments on axis 0;
    - optionally `uncovered(problem)`: why a problem has no outcome, for the error;
    - optionally `kind`, for contacts that last: "rigid" ones stick and slip, "spring" ones too by a
      spring of κ = `ratio`. Those of a "ramp" have a `force(normal, slip)` in N, up to `v_d` m/s.
      In mechanisms those of a "state" have a number z for each slip, 0 at touch, of size `unit`.
      Their `force_and_rate(normal, slip, z)` gives the force in N and z', both shaped as `slip`.
    """

    mu: eqx.AbstractVar[Float[Array, "..."]]
    kind: ClassVar[str] = "impulse"
    substeps: ClassVar[int] = 1
    """The number of steps of a `NormalPath` between two samples that are shown."""

    def has_formula(self, problem: Tangential) -> bool:
        """Return whether `rebound` applies; otherwise the motion is followed by an event solve."""
        return True

    @property
    def held(self) -> str | None:
        """How one spring holds its force, a form of `SpringSlider`; None for other laws."""
        return None

    @property
    def is_followed(self) -> bool:
        """True if coupled contacts of a scene have the outcome that `rebound` gives."""
        return False

    def require_for_system(self) -> None:
        """Raise ValueError for numbers that a `System` must not have."""

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane] | None:
        """Return slip and friction along a normal motion; None if the law has no force in time."""
        return None

    def uncovered(self, problem: Tangential) -> str | None:
        """Return why a single concrete problem has no outcome, in words; None if it has one."""
        return None

    @abc.abstractmethod
    def rebound(self, problem: Tangential) -> TangentialOutcome:
        """Return the outcome; ValueError if the law has no solution for this normal force."""

    def __repr__(self) -> str:
        texts = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        numbers = (
            f"{name}={value!r}" if isinstance(value, str) else f"{name}={shown(value)}"
            for name, value in texts.items()
            if value is not None
        )
        return f"{type(self).__name__}({', '.join(numbers)})"


def own_ratio(law: AbstractFriction) -> Lane | None:
    """Return the stiffness ratio κ of a law; None for that of the contact."""
    return getattr(law, "ratio", None)


def require_friction(value: Any) -> AbstractFriction:
    """Return `value` if it is a friction law; raise ValueError otherwise."""
    allowed = "a friction law, such as `MawBarberFawcett`"
    return require_kind("friction", value, AbstractFriction, allowed)
