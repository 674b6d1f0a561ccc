"""Several kinds of laws in one scene, selected by pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._contact import Contact
from ..._coupled.energies import stored_energy
from ..._coupled.modes import Index
from ..._forms import Exponent
from ..._friction import AbstractFriction
from ..._laws import (
    AbstractLaw,
    Instant,
    adhesion_below,
    end_of,
    energies_of,
    force_of,
    force_of_closed,
    pressing,
    shrunk_memory,
)

Law = TypeVar("Law", AbstractLaw, AbstractFriction)


class MixedLaw(AbstractLaw):
    """One law of each kind; the `kind` of the selected one is a float. Its force is that of the
    selected law. Solves that are specialised by kind use `one_of_each` instead.
    """

    laws: tuple[AbstractLaw, ...]
    kind: Float[Array, "..."]
    tension = True  # each law's force includes its own tension

    @property
    def damped(self) -> bool:
        return any(law.damped for law in self.laws)

    @property
    def fades(self) -> bool:
        return any(law.fades for law in self.laws)

    def jumps(self, exponent: Exponent) -> bool:
        return any(law.jumps(exponent) for law in self.laws)

    @property
    def remembers(self) -> bool:
        """True if one of the laws has a memory; the others do not use it."""
        return any(law.remembers for law in self.laws)

    @property
    def forgets(self) -> bool:
        """True if one of the laws forgets."""
        return any(law.forgets for law in self.laws)

    def _adheres_below(self, largest: ArrayLike) -> Float[Array, "..."]:
        zero = jnp.zeros_like(jnp.asarray(largest))
        below = (adhesion_below(x, largest) if x.forgets else zero for x in self.laws)
        return self._chosen(*below)

    def _shrunk(self, indentation: ArrayLike) -> Float[Array, "..."]:
        depth = jnp.asarray(indentation)
        return self._chosen(*(shrunk_memory(x, depth) if x.forgets else depth for x in self.laws))

    @property
    def ends_apart(self) -> bool:
        """True if contacts of one of the laws end at δ < 0."""
        return any(law.ends_apart for law in self.laws)

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        at = indentation, velocity, contact, impact_velocity
        return self._chosen(*(force_of(law, *at) for law in self.laws))

    def _force_of_closed(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        # The other laws are not defined at δ < 0.
        pressed = at._replace(indentation=jnp.maximum(at.indentation, 0)) if self.ends_apart else at
        moments = ((law, at if law.ends_apart else pressed) for law in self.laws)
        forces = (force_of_closed(law, *moment, deepest) for law, moment in moments)
        return self._chosen(*forces)

    def _pressing(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        one = jnp.ones_like(jnp.asarray(at.velocity))
        return self._chosen(
            *(pressing(law, *at, deepest) if law.fades else one for law in self.laws)
        )

    def _end_indentation(self, contact: Contact) -> Float[Array, "..."]:
        zero = jnp.zeros_like(contact.stiffness)
        return self._chosen(*(end_of(x, contact) if x.ends_apart else zero for x in self.laws))

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        return self._chosen(*(force_of(law, *at, deepest) for law in self.laws))

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        depth, speed = jnp.asarray(indentation), jnp.asarray(speed)

        def of(law: AbstractLaw) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
            if law.remembers or law.ends_apart:
                return energies_of(law, depth, contact, speed, largest)
            return stored_energy(law, contact, depth, speed), jnp.zeros_like(depth)

        returned, kept = zip(*map(of, self.laws), strict=True)
        return self._chosen(*returned), self._chosen(*kept)

    def _chosen(
        self, first: Float[Array, "..."], *rest: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        for number, other in enumerate(rest, 1):
            first = jnp.where(self.kind == number, other, first)
        return first


def one_of_each(laws: Sequence[Law], which: Index) -> tuple[list[Law], Index]:
    """Return a law of every kind, and the kind of law number `which`. The entry of that kind is the
    law itself. The other entries are arbitrary laws of their kinds, with valid numbers.
    """
    structures = [jax.tree.structure(law) for law in laws]
    kinds = list(dict.fromkeys(structures))
    chosen = []
    for kind in kinds:
        members = [k for k, structure in enumerate(structures) if structure == kind]
        place = np.zeros(len(laws), int)
        place[members] = np.arange(len(members))
        at = jnp.asarray(place)[which]
        same = (laws[k] for k in members)
        chosen.append(jax.tree.map(lambda *leaves, at=at: jnp.stack(leaves)[at], *same))
    return chosen, jnp.asarray([kinds.index(structure) for structure in structures])[which]
