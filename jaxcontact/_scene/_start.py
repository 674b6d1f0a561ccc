"""What a scene goes on from where it is the end of a run: what rests, and what is in contact."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._touching import ClusterState


class Contacts(NamedTuple):
    """A coupled solve in progress at time zero, if it is `active`: the spheres `who` (M,) have its
    places, those that are `present`, `shift` (M, D) periods away; the rest is as in `Coupling`.
    """

    active: Bool[Array, ""]
    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]
    pace: Float[Array, ""]
    reserve: Float[Array, ""]
    state: ClusterState


class Start(eqx.Module):
    """Of every sphere the wall that it rests on, `support`, or -1, and the v0 `held` in m/s; the
    `contacts` in progress. `soft`: whether impacts took time in the run that ended so.
    """

    support: Int[Array, " N"]
    held: Float[Array, " N"]
    contacts: Contacts | None
    soft: bool = eqx.field(static=True)

    @property
    def needed(self) -> Bool[Array, ""]:
        """Whether places and velocities do not say it all."""
        rests = jnp.any(self.support >= 0)
        return rests if self.contacts is None else rests | self.contacts.active
