"""The scaled numbers of the laws with a tangential spring."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import jax.numpy as jnp

from .base import Lane, Tangential


class HasSpring(Protocol):
    """The part of a friction law that scales the tangential motion."""

    @property
    def mu(self) -> Lane:
        """The coefficient μ."""
        ...

    @property
    def ratio(self) -> Lane | None:
        """The stiffness ratio κ; None for that of the contact."""
        ...


class ScaledCurve(NamedTuple):
    """ψ1 = κ u0/(μ v0), χ = λκ/2, α, and the unit μ/κ of slip; without friction ψ1 counts as 0."""

    psi: Lane
    chi: Lane
    alpha: Lane
    unit: Lane
    free: Lane
    given: Lane

    def slip(self, psi: Lane) -> Lane:
        """Return the slip u'/v0 of a ψ2; without friction the slip given."""
        return jnp.where(self.free, self.given, self.unit * psi)


def scaled_curve(law: HasSpring, problem: Tangential) -> ScaledCurve:
    """Return the scaled numbers. Raises ValueError without a stiffness ratio, and for a normal
    force that is not x^(3/2) (1 + αx').
    """
    name = type(law).__name__
    kappa = problem.ratio if law.ratio is None else law.ratio
    if kappa is None:
        raise ValueError(
            f"Argument `ratio` of `{name}` must be given, or the contact be built from materials "
            "(`Contact.sphere_plane`), but both are None."
        )
    if problem.alpha is None or problem.exponent != 1.5:
        raise ValueError(
            f"Argument `friction` {name} needs a normal force K δ^1.5 (1 + α δ'/v0), of exponent "
            f"1.5 and a law of the Hunt-Crossley family, but the exponent is {problem.exponent}"
            f"{' and the law has no α' if problem.alpha is None else ''}."
        )
    free = law.mu <= 0
    mu = jnp.where(free, 1, law.mu)
    psi = jnp.where(free, 0, kappa * problem.slip / mu)
    return ScaledCurve(
        psi, problem.mobility * kappa / 2, problem.alpha, mu / kappa, free, problem.slip
    )
