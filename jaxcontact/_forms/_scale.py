"""The units in which mass, stiffness and speed drop out of an impact, and its outcome in them."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class ContactLike(Protocol):
    """What a form needs of a contact: `mass` in kg, `stiffness` in N/mⁿ and the `exponent` n."""

    mass: Float[Array, "..."]
    stiffness: Float[Array, "..."]

    @property
    def exponent(self) -> Any:
        """The exponent n, a float where it is concrete."""


class Scale(eqx.Module):
    """The units X = (m v0²/K)^(1/(n+1)) of length, v0 of speed, X/v0 of time, m v0²/X of force.

    The unit of `energy` is ½ m v0². Without a contact only the unit of speed is known, the others
    are None.
    """

    length: Float[Array, "..."]
    speed: Float[Array, "..."]
    time: Float[Array, "..."]
    force: Float[Array, "..."]
    energy: Float[Array, "..."]


def scale_of(contact: ContactLike | None, velocity: Float[Array, "..."]) -> Scale:
    """The scale of an impact; finite in float32 for any SI values that float32 can hold."""
    if contact is None:
        unknown = cast(Array, None)
        return Scale(unknown, velocity, unknown, unknown, unknown)
    # m v0²/K leaves float32 where its fractional power does not: add logarithms instead.
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
    `min_force`: the least force, of a contact that may pull; None for others and where unknown.
    `converged`: whether the numbers can be trusted; `settled`: whether the bodies stay together.
    `energy_loss`: the part of the initial energy that is lost, for solutions that know it without
    forming 1 - e², which has few digits where e is near 1; None for 1 - e².
    `error_estimate` (relative, of restitution and duration) and `steps` for methods that have them.
    `end_indentation` in X, at which the contact ends, where it may end before x = 0; None for 0 or,
    beside a form that knows its damping, for where that force vanishes. `spare_energy` in m v0²:
    that with which bodies under a push come to x = 0 again, or what they lack to do so, negative.
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


class Change(NamedTuple):
    """What a weak push adds to a free impact, in the units of the scaled problem; or bounds on the
    errors of that.

    `turning`: by how much the angle θ, ∫ dt/(1-κx)² until separation, exceeds the duration.
    """

    restitution: Float[Array, "..."]
    duration: Float[Array, "..."]
    turning: Float[Array, "..."]
    max_indentation: Float[Array, "..."]
    max_force: Float[Array, "..."]
