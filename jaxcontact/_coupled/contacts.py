"""The law of contacts that last together, asked in the units of a solve."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .._contact import Contact
from .._laws import (
    AbstractLaw,
    adhesion_below,
    energies_of,
    force_of_closed,
    pressing,
    shrunk_memory,
)
from .energies import in_contact, stored_energy
from .modes import SLOWEST, Flags, Modes, Number, PerContact, Units


class ScaledContacts(NamedTuple):
    """The law of all contacts in units of a solve; the law itself receives SI quantities.

    `ends` are the indentations ≤ 0 at which closed contacts end; None if all of them are 0.
    """

    law: AbstractLaw
    contact: Contact
    units: Units
    ends: PerContact | None

    def within(self, units: Units) -> ScaledContacts:
        """Return the contacts in other units."""
        by = self.units.length / units.length
        return self._replace(units=units, ends=None if self.ends is None else self.ends * by)

    @property
    def count(self) -> int:
        """The number of contacts."""
        return self.contact.mass.shape[0]

    @property
    def jumps(self) -> bool:
        """True if forces may jump where contacts begin or end."""
        return self.law.jumps(self.contact.exponent)

    def height(self, depth: PerContact) -> PerContact:
        """Return how far contacts of these indentations are from their ends."""
        return depth if self.ends is None else depth - self.ends

    def refers_to_peak(self, which: Flags) -> Flags:
        """Return which of the contacts have a v0 that may rise after touch. Where adhesion pulls
        bodies together, v0 is the speed at touch.
        """
        return which if self.ends is None else which & (self.ends == 0)

    def left_of(self, w: Number) -> PerContact | Number:
        """Return the indentation of the leaving contact by its clock."""
        if self.ends is None:
            return jnp.square(w)
        # The force beyond the end is that of a negative root.
        return self.ends + w * jnp.abs(w)

    def _touched(self, modes: Modes, speed: PerContact) -> tuple[Contact, PerContact]:
        """Return the contacts, with the effective masses at touch, and their v0 in m/s."""
        contact = self.contact
        if modes.mass is not None:
            contact = eqx.tree_at(lambda c: c.mass, contact, modes.mass)
        return contact, self.units.speed * jnp.maximum(speed, SLOWEST)

    def _at(self, depth: PerContact, rate: PerContact, modes: Modes) -> tuple[Any, ...]:
        """Return the law and its arguments in SI units."""
        units, memory = self.units, modes.memory
        touched = self._touched(modes, jnp.where(modes.rising, jnp.maximum(rate, 0), modes.latched))
        depth = units.length * in_contact(depth, self.ends)
        rate = units.speed * (rate if self.law.damped else jnp.zeros_like(rate))
        return self.law, depth, rate, *touched, None if memory is None else units.length * memory

    def _whole_force(self, depth: PerContact, rate: PerContact, modes: Modes) -> PerContact:
        """Return the forces of the closed contacts as if none had vanished."""
        force = force_of_closed(*self._at(depth, rate, modes)) / self.units.force
        return jnp.where(modes.closed, force, 0)

    def force(self, depth: PerContact, rate: PerContact, modes: Modes) -> PerContact:
        """Return the forces of the closed contacts. One that vanishes within a step becomes a pull
        up to its event, so that forces are smooth.
        """
        force = self._whole_force(depth, rate, modes)
        return force if modes.faded is None else jnp.where(modes.faded, 0, force)

    def force_slope(
        self, modes: Modes, at: tuple[PerContact, PerContact], along: tuple[PerContact, PerContact]
    ) -> PerContact:
        """Return the slope of the forces if depths and their rates change `along`."""
        return jax.jvp(lambda d, r: self.force(d, r, modes), at, along)[1]

    def pressing(self, depth: PerContact, rate: PerContact, modes: Modes) -> PerContact:
        """Return the numbers for `press` of a `Look`, if forces fade."""
        return pressing(*self._at(depth, rate, modes))

    def power(
        self, force: PerContact, depth: PerContact, rate: PerContact, modes: Modes
    ) -> PerContact:
        """Return the power that damping takes from contacts with these forces."""
        if not self.law.damped:
            return jnp.zeros_like(force)
        still = self._whole_force(depth, jnp.zeros_like(rate), modes)
        if modes.faded is not None:
            # Beyond their way back plastic contacts have no elastic force.
            still = jnp.maximum(still, jnp.minimum(force, 0))
        return (force - still) * rate

    def stored(self, depth: PerContact, modes: Modes) -> PerContact:
        """Return ∫ F(δ, 0) dδ of the closed contacts."""
        units, deepest = self.units, modes.deepest
        depth = jnp.where(modes.closed, units.length * depth, 0)
        deepest = None if deepest is None else units.length * deepest
        contact, speed = self._touched(modes, modes.latched)
        return stored_energy(self.law, contact, depth, speed, deepest) / units.energy

    def torn(self, modes: Modes) -> PerContact:
        """Return the energy that is lost when closed contacts end, if they end apart."""
        assert self.ends is not None
        return self.stored(self.ends, modes)

    def kept(self, deepest: PerContact, modes: Modes) -> PerContact:
        """Return the energy that contacts with these largest indentations do not return, if forces
        depend on them.
        """
        largest, units = self.units.length * jnp.maximum(deepest, 0), self.units
        touched = self._touched(modes, modes.latched)
        return energies_of(self.law, largest, *touched, largest)[1] / units.energy

    def least(self, deepest: PerContact) -> PerContact:
        """Return the indentations below which contacts that unload follow their adhesion, if a law
        forgets.
        """
        return adhesion_below(self.law, self.units.length * deepest) / self.units.length

    def shrunk(self, depth: PerContact) -> PerContact:
        """Return the largest indentations of contacts that close again from there."""
        return shrunk_memory(self.law, self.units.length * depth) / self.units.length
