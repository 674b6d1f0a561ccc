"""The interface of a friction law: the tangential part of an impact in scaled units.

The units are those of the normal motion: v0 of speed, m v0²/X of force. With u the slip speed of
the contact point, `u' = -λ f`, λ = m/m_t = 1 + m (R1²/I1 + R2²/I2). The normal force has the
impulse 1 + e.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._entry import require_kind, shown

Lane = Float[Array, "..."]
Exponent = float | Float[Array, "..."]


class Tangential(NamedTuple):
    """The tangential problem u' = -λ f of an impact in scaled units, u the slip velocity.

    Lengths are in units of X, speeds in units of v0, forces in units of m v0²/X. All fields are
    numbers or arrays whose shapes broadcast, and have no unit but `speed`:

    - `slip`: u0 ≥ 0, the slip speed at touch over v0.
    - `mobility`: λ = 1 + m (R1²/I1 + R2²/I2), 7/2 for solid spheres.
    - `restitution`: e of the normal motion, whose impulse is 1 + e.
    - `alpha`: α of a normal force xⁿ (1 + α x'), None for other forces.
    - `exponent`: n, a Python number if it is known before compilation.
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
        """Return the slip after sliding throughout, u0 - λ μ (1 + e), for every normal law.

        A negative value means that the contact point stops before the end.
        """
        return self.slip - self.mobility * mu * (1 + self.restitution)


class TangentialOutcome(NamedTuple):
    """The outcome of a `Tangential` problem: the slip after the impact, and its phases.

    The tangential impulse is (u0 - u')/λ. Arrays have the shape of the problem, and no unit:

    - `slip`: u' over v0, negative if the contact point has reversed. Lanes that are NaN are flagged
      as `Status.INVALID_INPUT`.
    - `slid`: True where the contact point slid throughout.
    - `stop`, `start`: the normal velocities over v0, from 1 at touch to -e, at which the first
      sliding ends and the last one begins; None if the law does not say.
    - `margin`: |u0/u_jump - 1|, the distance to a jump of the outcome or of its slope; None without
      jumps.
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

    A subclass has the friction coefficient `mu` μ, and its other numbers as fields; all are leaves.
    It defines

    - `rebound(problem)`: the `TangentialOutcome` of a `Tangential` problem, as JAX operations on
      arrays that broadcast. `oblique_impact`, scenes with instantaneous or soft impacts, and fits
      call it. Raises ValueError if the law has no solution for the normal force;
    - `along(problem, path)`, which is optional: slip and friction over time in scaled units, for
      `oblique_trajectory`. The `path` has `time`, `indentation`, `velocity` (from 1 to -e) and
      `force`, scaled, with the moments along axis 0;
    - `uncovered(problem)`, which is optional: why a single problem has no outcome, for errors.
    """

    mu: eqx.AbstractVar[Float[Array, "..."]]

    def has_formula(self, problem: Tangential) -> bool:
        """Return whether `rebound` applies; otherwise the motion is followed by an event solve."""
        return True

    @property
    def held(self) -> str | None:
        """How one spring holds its force, a form of `SpringSlider`; None for other laws."""
        return None

    @property
    def substeps(self) -> int:
        """The number of steps of a `NormalPath` between two samples that are shown."""
        return 1

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane] | None:
        """Return slip and friction along a normal motion; None if the law has no force in time."""
        return None

    def uncovered(self, problem: Tangential) -> str | None:
        """Return why a single valid problem has no outcome, in words; None if it has one.

        It is called with concrete numbers, after `rebound` has returned NaN.
        """
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


def require_friction(value: Any) -> AbstractFriction:
    """Return `value` if it is a friction law; raise ValueError otherwise."""
    allowed = "a friction law, such as `MawBarberFawcett`"
    return require_kind("friction", value, AbstractFriction, allowed)
