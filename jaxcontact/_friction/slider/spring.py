"""The spring of a contact that sticks: its rate, its limit, and when the three forms use which."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Lane = Float[Array, "..."]
Flag = Bool[Array, "..."]


class Spring(NamedTuple):
    """A spring that keeps its force (`keeps_force`) or its displacement as the contact grows.

    Its state z is the force φ or the displacement η = φ/(1.5 w), with w = √x. With dt = w dτ

        dz/dτ = g w ψ,  dψ/dτ = -b χ w z;  force: g = 1.5 w, b = 2; displacement: g = 1, b = 3 w.

    The limit of z is Z = w³ (1 + αv) or 2/3 w² (1 + αv). It changes by dZ/dτ = g w T with
    T = c (1 + αv)(v - kα X), X = w⁵; force: c = 1, k = 2/3; displacement: c = 2/3, k = 1.
    """

    keeps_force: bool | Flag

    def either(self, force: Any, displacement: Any) -> Any:
        """Return the number of the spring at hand."""
        if isinstance(self.keeps_force, bool):
            return force if self.keeps_force else displacement
        return jnp.where(self.keeps_force, force, displacement)

    def gain(self, w: Lane) -> Lane:
        """Return g."""
        return self.either(1.5 * w, jnp.ones_like(w))

    def pull(self, w: Lane) -> Lane:
        """Return b."""
        return self.either(jnp.full_like(w, 2), 3 * w)

    def limit(self, w: Lane, v: Lane, alpha: Lane) -> Lane:
        """Return Z, odd in w, so that it changes sign at separation."""
        return w * (1 + alpha * v) * self.either(jnp.square(w), 2 / 3 * jnp.abs(w))

    def slope(self, v: Lane, stored: Lane, alpha: Lane) -> Lane:
        """Return T."""
        return self.either(1.0, 2 / 3) * (1 + alpha * v) * (v - self.damping * alpha * stored)

    def expansion(self, v: Lane, stored: Lane, alpha: Lane) -> tuple[Lane, Lane, Lane]:
        """Return T, dT/dv and d²T/dv², with dX/dv = -5/2 v/(1 + αv)."""
        c, k, y = self.either(1.0, 2 / 3), self.damping, alpha * v
        first = c * (1 + (2 + 2.5 * k) * y - k * jnp.square(alpha) * stored)
        second = c * alpha * (2 + 2.5 * k + 2.5 * k * y / (1 + y))
        return self.slope(v, stored, alpha), first, second

    @property
    def damping(self) -> Any:
        """Return k."""
        return self.either(2 / 3, 1.0)

    @property
    def inflection(self) -> Any:
        """Return the αv at which d²T/dv² = 0: -0.69 or -0.64."""
        return -(2 + 2.5 * self.damping) / (2 + 5 * self.damping)


class SpringForm(NamedTuple):
    """A form of the spring: in loading (v > 0) and in unloading it keeps its force or not."""

    loading: bool
    unloading: bool

    @property
    def changes(self) -> bool:
        """Return whether the spring changes at v = 0."""
        return self.loading != self.unloading

    def spring(self, loading: Flag) -> Spring:
        """Return the spring of lanes that are `loading` or not."""
        return Spring(loading if self.changes else self.loading)


FORMS = {
    "force": SpringForm(True, True),
    "displacement": SpringForm(False, False),
    "rescaled": SpringForm(True, False),
}
