"""Materials, and the contact of two bodies made of them."""

from __future__ import annotations

import functools
import operator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ._entry import (
    POSITIVE,
    OfNumbers,
    Range,
    Specialised,
    as_parameter,
    is_plain,
    optional_parameter,
    parameter,
    refusal,
    refuses_unknown,
    rendered,
    require_broadcast,
    require_kind,
    shown,
    specialised,
)

EXPONENT = Range(low=1.0, high=3.0, inside=1.5)
POISSON = Range(low=-1.0, high=0.5, low_open=True, inside=0.25)

_solid = jax.jit(lambda radius, density: 4 / 3 * jnp.pi * radius**3 * density)
_effective = jax.jit(lambda first, second: first / (first + second) * second)


class Material(eqx.Module):
    """An isotropic elastic material.

    Arguments: `youngs_modulus` E > 0 in Pa; `poisson_ratio` ν in (-1, 0.5]; `density` ρ > 0 in
    kg/m³, needed only to compute a mass. Raises ValueError for a Python scalar out of range.
    """

    youngs_modulus: Float[Array, "..."] = parameter("youngs_modulus", POSITIVE)
    poisson_ratio: Float[Array, "..."] = parameter("poisson_ratio", POISSON)
    density: Float[Array, "..."] | None = None

    @refuses_unknown
    def __init__(
        self,
        youngs_modulus: ArrayLike,
        poisson_ratio: ArrayLike,
        density: ArrayLike | None = None,
    ):
        self.youngs_modulus = as_parameter(youngs_modulus, "youngs_modulus", POSITIVE)
        self.poisson_ratio = as_parameter(poisson_ratio, "poisson_ratio", POISSON)
        self.density = None if density is None else as_parameter(density, "density", POSITIVE)

    @property
    def compliance(self) -> Float[Array, "..."]:
        """h = (1-ν²)/E in 1/Pa, the material's contribution to the Hertz stiffness."""
        return (1 - jnp.square(self.poisson_ratio)) / self.youngs_modulus

    @property
    def shear_compliance(self) -> Float[Array, "..."]:
        """(2-ν)/G in 1/Pa with G = E/(2(1+ν)), the contribution to the tangential stiffness."""
        nu = self.poisson_ratio
        return 2 * (2 - nu) * (1 + nu) / self.youngs_modulus

    def sphere_mass(self, radius: ArrayLike) -> Float[Array, "..."]:
        """Return the mass (4/3)π R³ ρ in kg of a solid sphere; ValueError without a density."""
        if self.density is None:
            raise ValueError(
                "Argument `density` of the material must be given for a mass, but is None; "
                "or give `mass` to the contact."
            )
        radius = as_parameter(radius, "radius", POSITIVE)
        require_broadcast(radius=radius, density=self.density)
        return _solid(radius, self.density)


def require_contact(value: object) -> Contact:
    """Return `value` if it is a contact; raise ValueError otherwise."""
    return require_kind("contact", value, Contact, "a `Contact`")


def _require_materials(**given: object) -> None:
    for name, value in given.items():
        require_kind(name, value, Material, "a `Material`")


@jax.jit
def _hertz(
    sphere: Material, other: Material | None, radius: Float[Array, "..."]
) -> dict[str, Float[Array, "..."]]:
    """Return the Hertz stiffness, and 4G*/E*: the tangential stiffness over the normal one."""
    pair = [sphere] if other is None else [sphere, other]
    compliance = functools.reduce(operator.add, (body.compliance for body in pair))
    shear = functools.reduce(operator.add, (body.shear_compliance for body in pair))
    stiffness = 4 / 3 * jnp.sqrt(radius) / compliance
    return {"stiffness": stiffness, "tangential_ratio": 4 * compliance / shear}


@jax.jit
def _inside(inner: Float[Array, "..."], outer: Float[Array, "..."]) -> Float[Array, "..."]:
    wider = outer > inner
    clearance = jnp.where(wider, outer - inner, 1)
    return jnp.where(wider, inner / clearance * outer, jnp.nan)


class Contact(OfNumbers):
    """One contact: the effective mass and the elastic force K δⁿ.

    - `mass`: m > 0 in kg, the effective mass m1 m2/(m1+m2).
    - `stiffness`: K > 0 in N/mⁿ.
    - `exponent`: n in [1, 3]. A plain number is static and specialises the compiled code, so that
      another number triggers a new compilation. An array makes n a leaf, which can be
      differentiated and batched at some cost in speed.
    - `tangential_ratio`: κ > 0, the tangential stiffness over the normal one, for friction with a
      spring; None if unknown. Contacts of materials have κ = `4G*/E*`.

    All broadcast; mass, stiffness and κ are leaves. Raises ValueError for a Python scalar out of
    range. For Hertz contacts use `sphere_sphere`, `sphere_plane` and `sphere_socket`.
    """

    mass: Float[Array, "..."] = parameter("mass", POSITIVE)
    stiffness: Float[Array, "..."] = parameter("stiffness", POSITIVE)
    # `__init__` always sets it. The default is required because the fields before have one.
    _exponent: Specialised = eqx.field(default=Specialised(1.5))
    tangential_ratio: Float[Array, "..."] | None = optional_parameter(
        "tangential_ratio", POSITIVE, "-"
    )

    @refuses_unknown
    def __init__(
        self,
        mass: ArrayLike,
        stiffness: ArrayLike,
        exponent: ArrayLike = 1.5,
        tangential_ratio: ArrayLike | None = None,
    ):
        # The fields have converters.
        numbers: Any = (mass, stiffness, tangential_ratio)
        self.mass, self.stiffness, self.tangential_ratio = numbers
        self._exponent = specialised(exponent, "exponent", EXPONENT)

    def __repr__(self) -> str:
        return (
            f"Contact(mass={shown(self.mass)}, stiffness={shown(self.stiffness)}, "
            f"exponent={shown(self.exponent)})"
        )

    @property
    def normal(self) -> Contact:
        """The contact without its tangential ratio, which no normal impact needs."""
        if self.tangential_ratio is None:
            return self
        # `equinox.tree_at` takes longer than to solve an impact.
        contact = object.__new__(type(self))
        vars(contact).update(vars(self), tangential_ratio=None)
        return contact

    @property
    def exponent(self) -> float | Float[Array, "..."]:
        """The exponent n: a float if it was given as a Python number, an array otherwise."""
        return self._exponent.value

    @classmethod
    def sphere_sphere(
        cls,
        radius: ArrayLike,
        other_radius: ArrayLike,
        sphere: Material,
        other: Material,
        *,
        mass: ArrayLike | None = None,
    ) -> Contact:
        """Build the Hertz contact of two solid spheres: K = 4/(3(h1+h2)) √(R1 R2/(R1+R2)), n = 3/2.

        Arguments: radii in m and materials; h = (1-ν²)/E. `mass` is the effective mass in kg; by
        default it follows from the densities. Raises ValueError for a Python scalar out of range or
        a missing density or material. Source: Johnson (1985), Contact Mechanics, ch. 4, doi
        10.1017/CBO9781139171731.
        """
        first = as_parameter(radius, "radius", POSITIVE)
        second = as_parameter(other_radius, "other_radius", POSITIVE)
        _require_materials(sphere=sphere, other=other)
        require_broadcast(radius=first, other_radius=second, sphere=sphere, other=other)
        numbers = _hertz(sphere, other, _effective(first, second))
        if mass is not None:
            return cls(mass, **numbers)
        return cls(_effective(sphere.sphere_mass(first), other.sphere_mass(second)), **numbers)

    @classmethod
    def sphere_plane(
        cls,
        radius: ArrayLike,
        sphere: Material,
        plane: Material | None = None,
        *,
        mass: ArrayLike | None = None,
    ) -> Contact:
        """Build the Hertz contact of a solid sphere and a fixed plane: K = 4/(3(h1+h2)) √R, n =
        3/2.

        Arguments: radius in m; the sphere's material; the plane's material, or None for a rigid
        plane (h2 = 0). `mass` in kg is the sphere's mass by default. Raises ValueError for a Python
        scalar out of range or a missing density. Source: Johnson (1985), Contact Mechanics, ch. 4,
        doi 10.1017/CBO9781139171731.
        """
        _require_materials(sphere=sphere, plane=sphere if plane is None else plane)
        radius = as_parameter(radius, "radius", POSITIVE)
        require_broadcast(radius=radius, sphere=sphere, plane=plane)
        mass = sphere.sphere_mass(radius) if mass is None else mass
        return cls(mass, **_hertz(sphere, plane, radius))

    @classmethod
    def sphere_socket(
        cls,
        radius: ArrayLike,
        socket_radius: ArrayLike,
        sphere: Material,
        socket: Material | None = None,
        *,
        mass: ArrayLike | None = None,
    ) -> Contact:
        """Build the Hertz contact of a sphere in a fixed socket.

        K = 4/(3(h1+h2)) √(R1 R2/(R2-R1)), n = 3/2. Arguments: `radius` R1 of the sphere and
        `socket_radius` R2 > R1 in m; the materials, None for a rigid socket. `mass` in kg is the
        sphere's mass by default. A lane whose socket is not wider than the sphere is NaN. Hertz's
        theory is valid for an indentation much smaller than the clearance R2 - R1. Raises
        ValueError for Python scalars out of range (including R2 ≤ R1) or a missing density. Source:
        Johnson (1985), Contact Mechanics, ch. 4, doi 10.1017/CBO9781139171731.
        """
        _require_materials(sphere=sphere, socket=sphere if socket is None else socket)
        inner = as_parameter(radius, "radius", POSITIVE)
        outer = as_parameter(socket_radius, "socket_radius", POSITIVE)
        require_broadcast(radius=inner, socket_radius=outer, sphere=sphere, socket=socket)
        # Plain numbers are compared: under `jit` the arrays made from them cannot be.
        if is_plain(radius) and is_plain(socket_radius) and not socket_radius > radius:
            wider = f"be larger than `radius` = {rendered(radius)}"
            raise refusal("socket_radius", wider, socket_radius)
        mass = sphere.sphere_mass(inner) if mass is None else mass
        return cls(mass, **_hertz(sphere, socket, _inside(inner, outer)))
