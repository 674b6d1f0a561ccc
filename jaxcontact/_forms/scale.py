"""The units that remove mass, stiffness and speed from an impact, and its outcome in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

if TYPE_CHECKING:
    from .._contact import Contact


class Scale(eqx.Module):
    """The units X = (m v0²/K)^(1/(n+1)) of length, v0 of speed, X/v0 of time, m v0²/X of force.

    The unit of `energy` is ½ m v0². Without a contact only the unit of speed is known; the others
    are None.
    """

    length: Float[Array, "..."]
    speed: Float[Array, "..."]
    time: Float[Array, "..."]
    force: Float[Array, "..."]
    energy: Float[Array, "..."]


def scale_of(contact: Contact | None, velocity: Float[Array, "..."]) -> Scale:
    """Return the scale of an impact, finite in float32 for all SI values that float32 can hold."""
    if contact is None:
        unknown = cast(Array, None)
        return Scale(unknown, velocity, unknown, unknown, unknown)
    # m v0²/K may overflow float32 although its fractional power does not, hence logarithms.
    logarithm = jnp.log(contact.mass) + 2 * jnp.log(velocity) - jnp.log(contact.stiffness)
    length = jnp.exp(logarithm / (contact.exponent + 1))
    return Scale(
        length=length,
        speed=velocity,
        time=length / velocity,
        force=contact.mass * velocity * (velocity / length),
        energy=0.5 * contact.mass * velocity * velocity,
    )


class ScaledImpact(eqx.Module):
    """The outcome of x'' = Γ - f(x, x'), x(0) = 0, x'(0) = 1, in the units of the scaled problem.

    `restitution` e; `duration` until separation and `compression_time` until the turn, in units of
    X/v0; `max_indentation` in X and `max_force` in m v0²/X, with X = (m v0²/K)^(1/(n+1)).

    `min_force` is the least force of a contact that may pull; None for others and if unknown.
    `converged` is True if the numbers can be trusted, `settled` if the bodies stay together.
    `energy_loss` is the lost fraction of the initial energy. Solutions provide it if they avoid
    forming 1 - e², which has few digits for e near 1; None stands for 1 - e². `error_estimate`
    (relative, of restitution and duration) and `steps` are set by methods that have them.

    `end_indentation` in X is the indentation at the end of a contact that may end before x = 0.
    None stands for 0 or, if the form provides its damping, for the zero of that force.
    `spare_energy` in m v0² is the energy with which bodies under a push return to x = 0; negative
    if it does not suffice.
    """

    restitution: Float[Array, "..."]
    duration: Float[Array, "..."]
    compression_time: Float[Array, "..."]
    max_indentation: Float[Array, "..."]
    max_force: Float[Array, "..."]
    converged: Bool[Array, "..."] | bool = True
    settled: Bool[Array, "..."] | bool = False
    energy_loss: Float[Array, "..."] | None = None
    error_estimate: Float[Array, "..."] | None = None
    steps: Int[Array, "..."] | None = None
    min_force: Float[Array, "..."] | None = None
    end_indentation: Float[Array, "..."] | None = None
    spare_energy: Float[Array, "..."] | None = None
