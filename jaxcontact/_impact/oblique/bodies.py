"""The bodies of an oblique impact: their radii and inertias."""

from __future__ import annotations

import functools
import operator
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..._entry import (
    POSITIVE,
    concrete,
    optional_parameter,
    parameter,
    refuses_unknown,
    require_choice,
    require_kind,
    shown,
)

INERTIA = {"sphere": 2 / 5, "shell": 2 / 3, "disc": 1 / 2}
"""I/(m R²) by shape."""

_MASSES_AGREE = 1e-4


class RoundBodies(eqx.Module):
    """The radii and inertias of two round bodies, or of one against a wall.

    - `radius`, `other_radius`: R1, R2 > 0 in m; None for the second is a wall that does not turn.
    - `mass`, `other_mass`: in kg. Against a wall the mass is that of the contact by default. Two
      bodies need both for their inertia.
    - `inertia`, `other_inertia`: I about the axis of spin in kg m²; by default that of the `shape`,
      2/5 m R² for a "sphere", 2/3 for a "shell", 1/2 for a "disc".

    Numbers are leaves. Raises ValueError for a Python scalar out of range.
    """

    radius: Float[Array, "..."] = parameter("radius", POSITIVE)
    other_radius: Float[Array, "..."] | None = optional_parameter("other_radius", POSITIVE, "m")
    mass: Float[Array, "..."] | None = optional_parameter("mass", POSITIVE, "kg")
    other_mass: Float[Array, "..."] | None = optional_parameter("other_mass", POSITIVE, "kg")
    inertia: Float[Array, "..."] | None = optional_parameter("inertia", POSITIVE, "kg m^2")
    other_inertia: Float[Array, "..."] | None = optional_parameter(
        "other_inertia", POSITIVE, "kg m^2"
    )
    shape: Literal["sphere", "shell", "disc"] = eqx.field(static=True, default="sphere")

    @refuses_unknown
    def __init__(
        self,
        radius: ArrayLike,
        other_radius: ArrayLike | None = None,
        *,
        mass: ArrayLike | None = None,
        other_mass: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        other_inertia: ArrayLike | None = None,
        shape: Literal["sphere", "shell", "disc"] = "sphere",
    ):
        # The fields have converters.
        numbers: Any = (radius, other_radius, mass, other_mass, inertia, other_inertia)
        self.radius, self.other_radius, self.mass, self.other_mass = numbers[:4]
        self.inertia, self.other_inertia = numbers[4:]
        require_choice("shape", shape, INERTIA)
        self.shape = shape
        if other_radius is None and not (other_mass is None and other_inertia is None):
            raise ValueError(
                "Argument `other_radius` must be given with `other_mass` or `other_inertia`, "
                "but is None, which is a wall."
            )

    @property
    def radii(self) -> list[Float[Array, "..."]]:
        """R1, and R2 of a second body that turns."""
        return [self.radius] if self.other_radius is None else [self.radius, self.other_radius]

    def mobility(self, contact_mass: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return λ = 1 + m (R1²/I1 + R2²/I2), the velocity of the contact point of unit impulse."""
        pairs = zip(self.radii, self.arms(contact_mass), strict=True)
        return 1 + contact_mass * functools.reduce(operator.add, (r * arm for r, arm in pairs))

    def arms(self, contact_mass: Float[Array, "..."]) -> list[Float[Array, "..."]]:
        """Return R/I in 1/(kg m) of each body that turns, the angular velocity of unit impulse."""
        first = contact_mass if self.other_radius is None and self.mass is None else self.mass
        arms = [self.radius / self._inertia("", self.radius, self.inertia, first)]
        if self.other_radius is not None:
            inertia = self._inertia(
                "other_", self.other_radius, self.other_inertia, self.other_mass
            )
            arms.append(self.other_radius / inertia)
        return arms

    def _inertia(
        self, which: str, radius: Array, inertia: Array | None, mass: Array | None
    ) -> Float[Array, "..."]:
        if inertia is not None:
            return inertia
        if mass is None:
            raise ValueError(
                f"Argument `{which}mass` or `{which}inertia` of the bodies must be given for two "
                "bodies, but both are None."
            )
        return INERTIA[self.shape] * mass * jnp.square(radius)

    def require_mass(self, contact_mass: Float[Array, "..."]) -> None:
        """Raise ValueError if two known masses do not make up the mass of the contact."""
        first, second, effective = map(concrete, (self.mass, self.other_mass, contact_mass))
        if effective is None or first is None or (self.other_radius is not None and second is None):
            return
        own = first if second is None else first / (first + second) * second
        if abs(own / effective - 1) > _MASSES_AGREE:
            raise ValueError(
                f"Argument `bodies` must have the effective mass of the contact, {effective:g} kg, "
                f"but has {own:g} kg."
            )

    def __repr__(self) -> str:
        names = ("radius", "other_radius", "mass", "other_mass", "inertia", "other_inertia")
        given = {name: getattr(self, name) for name in names}
        numbers = [f"{name}={shown(x)}" for name, x in given.items() if x is not None]
        return f"RoundBodies({', '.join([*numbers, f'shape={self.shape!r}'])})"


class NamedShape(eqx.Module):
    """Two round bodies of one shape, of unknown radii."""

    name: str = eqx.field(static=True)

    @property
    def radii(self) -> list[Float[Array, "..."]]:
        """The radii that are known: none."""
        return []

    def arms(self, contact_mass: Float[Array, "..."]) -> list[Float[Array, "..."]]:
        """Return R/I of the bodies whose radii are known: none."""
        return []

    def mobility(self, contact_mass: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return λ = 1 + m R²/I, the same for two bodies as for one against a wall."""
        return jnp.full_like(contact_mass, 1 + 1 / INERTIA[self.name])


def require_bodies(value: Any) -> RoundBodies | NamedShape:
    """Return bodies from an argument; spheres for None. ValueError for anything else."""
    if value is None or isinstance(value, str):
        return NamedShape(require_choice("bodies", "sphere" if value is None else value, INERTIA))
    allowed = f"a `RoundBodies`, {', '.join(map(repr, INERTIA))} or None"
    return require_kind("bodies", value, RoundBodies, allowed)
