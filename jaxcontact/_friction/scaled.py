"""The scaled numbers of the laws with a tangential spring."""

from __future__ import annotations

from typing import Protocol

import jax.numpy as jnp

from .base import Lane, ScaledSpring, Tangential


class HasSpring(Protocol):
    """The part of a friction law that scales the tangential motion."""

    @property
    def mu(self) -> Lane:
        """The coefficient μ."""
        ...

    @property
    def ratio(self) -> Lane | None:
        """The stiffness ratio κ; None for that of the contact."""


def ratio_of(law: HasSpring, of_contact: Lane | None) -> Lane:
    """Return κ of the law, or that of the contact. Raises ValueError if both are None."""
    kappa = of_contact if law.ratio is None else law.ratio
    if kappa is None:
        raise ValueError(
            f"Argument `ratio` of `{type(law).__name__}` must be given, or the contact be built "
            "from materials (`Contact.sphere_plane`), but both are None."
        )
    return kappa


def spring_of(law: HasSpring, problem: Tangential) -> ScaledSpring:
    """Return the scaled numbers. Raises ValueError without a stiffness ratio."""
    kappa = ratio_of(law, problem.ratio)
    free = law.mu <= 0
    mu = jnp.where(free, 1, law.mu)
    psi = jnp.where(free, 0, kappa * problem.slip / mu)
    return ScaledSpring(psi, problem.mobility * kappa / 2, mu / kappa, free, problem.slip)


def hertzian(problem: Tangential) -> bool:
    """Return whether the normal force is x^(3/2) (1 + αx')."""
    n = problem.exponent
    return problem.alpha is not None and isinstance(n, float) and n == 1.5
