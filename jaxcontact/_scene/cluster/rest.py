"""The test whether bodies in contact have come to rest."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._coupled.modes import AT_REST, PAUSED
from ..._coupled.scalars import Index, Number
from .equations import PerBody, PerPair, Touching

ASLEEP = PAUSED + 1
"""All bodies are at rest, however they support each other, until the time is up."""

_STILL = 100
"""The limit of speeds and of relative accelerations at rest, in step tolerances."""


def rest_of(
    system: Touching,
    closed: Bool[Array, " pairs"],
    along: tuple[PerPair, PerPair],
    moving: tuple[PerBody, PerBody],
    tolerance: Number,
) -> Index:
    """Return the kind of rest: AT_REST, ASLEEP or -1.

    AT_REST: each body in contact touches one plane, and δ' and δ'' of the pairs, `along`, vanish.
    It can then slide by formula. ASLEEP: bodies support each other and all are at rest. `moving`
    holds the velocities and accelerations of the bodies, in units of the cluster.
    """
    rate, second = along
    still = jnp.abs(rate) + jnp.abs(second) < _STILL * tolerance
    at_rest = jnp.all(still | ~(closed & system.pairs.used))
    # The weight may be tiny relative to contact accelerations. A body moved by it is not asleep.
    speed, pace = moving
    pull = jax.lax.stop_gradient(system.acceleration)
    weight = jnp.sqrt(jnp.max(jnp.sum(jnp.square(pull), axis=1)))
    weight = jnp.where(weight > 0, jnp.minimum(weight, 1), 1)
    stands = jnp.abs(speed) + jnp.abs(pace) / weight < _STILL * tolerance
    # A cluster with a moving fixed sphere is not asleep, either.
    fixed = (system.inverse_mass == 0)[:, None]
    asleep = jnp.all(jnp.where(fixed, jnp.abs(speed) < _STILL * tolerance, stands))
    if system.drive is not None:
        # A body on a shaking wall is never at rest.
        shakes, pairs = system.drive.shakes, system.pairs
        shaken = shakes[pairs.first] | shakes[pairs.second]
        at_rest = at_rest & ~jnp.any(closed & pairs.used & shaken)
        asleep = asleep & ~jnp.any(system.drive.moves)
    resting = jnp.where(asleep, ASLEEP, -1)
    if not (system.law.remembers or system.law.ends_apart):
        # Bodies that rest on planes are followed by formulas, which know no memory and no neck.
        resting = jnp.where(system.on_planes(closed), AT_REST, resting)
    return jnp.where(at_rest, resting, -1)
