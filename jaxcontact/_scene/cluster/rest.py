"""Whether bodies in contact have come to rest."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .equations import PerBody, PerPair, Touching
from .problem import AT_REST, PAUSED

ASLEEP = PAUSED + 1
"""Nothing moves any more, whatever leans on what, until the time is up."""

_STILL = 100
"""In tolerances of a step: speeds, and accelerations beside those of a contact."""


def rest_of(
    system: Touching,
    closed: Bool[Array, " pairs"],
    along: tuple[PerPair, PerPair],
    moving: tuple[PerBody, PerBody],
    tolerance: Float[Array, ""],
) -> Int[Array, ""]:
    """AT_REST where each body that touches anything touches one plane and is still `along` the
    normal (δ' and δ'' of the pairs): it can be left to slide. ASLEEP where bodies lean on others
    and all of them are still; -1 otherwise.

    `moving`: the velocities and accelerations of the bodies, in units of the cluster.
    """
    rate, second = along
    still = jnp.abs(rate) + jnp.abs(second) < _STILL * tolerance
    at_rest = jnp.all(still | ~(closed & system.pairs.used))
    # Beside a contact's own the weight may be next to nothing; what it moves is not asleep.
    speed, pace = moving
    weight = jnp.sqrt(jnp.max(jnp.sum(jnp.square(system.acceleration), axis=1)))
    weight = jnp.where(weight > 0, jnp.minimum(weight, 1), 1)
    stands = jnp.abs(speed) + jnp.abs(pace) / weight < _STILL * tolerance
    # Nor is anything near a fixed sphere that moves.
    fixed = (system.inverse_mass == 0)[:, None]
    asleep = jnp.all(jnp.where(fixed, jnp.abs(speed) < _STILL * tolerance, stands))
    if system.drive is not None:
        # What a wall shakes is never at rest.
        shakes, pairs = system.drive.shakes, system.pairs
        shaken = shakes[pairs.first] | shakes[pairs.second]
        at_rest = at_rest & ~jnp.any(closed & pairs.used & shaken)
        asleep = asleep & ~jnp.any(system.drive.moves)
    resting = jnp.where(system.on_planes(closed), AT_REST, jnp.where(asleep, ASLEEP, -1))
    return jnp.where(at_rest, resting, -1)
