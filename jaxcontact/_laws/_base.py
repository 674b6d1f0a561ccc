"""What a contact law is: a pure force function and its parameters."""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._forms import AbstractForm, GeneralForm, Scale
from .._parameter import (
    as_parameter,
    rendered,
    require_broadcast,
    require_flag,
    require_kind,
    shown,
)

if TYPE_CHECKING:
    from .._contact import Contact

_Given = TypeVar("_Given")

VELOCITY_THRESHOLD = 1e-9
"""Closing speed in m/s below which the damping of a law stops growing.

The hysteresis damping factor c = α K/v0 has no limit as v0 → 0. A contact that closes more slowly
than this speed (a resting one, say) is given the c of this speed, in `force` and in `impact` alike.
"""


as_tension = functools.partial(require_flag, "tension")
"""The converter of a law's keyword `tension`."""


class AbstractLaw(eqx.Module):
    """A contact law: parameters as leaves, and the force they make.

    A subclass with a `force` works in `impact`, `trajectory`, `restitution` and under every JAX
    transformation. `force` gets SI quantities that broadcast, and should be zero for a negative
    indentation. Every array held by a law broadcasts with the contact and the speed. A law with a
    closed form or another shortcut returns it from `form`.

    The keyword `tension` (static) says whether the contact may pull. With False a pull counts as no
    force, and the contact ends when its force vanishes; with True it ends when δ is back at zero.
    """

    tension: bool = eqx.field(static=True, default=True, kw_only=True, converter=as_tension)

    exponents: ClassVar[tuple[float, ...] | None] = None
    """The contact exponents n the law is made for; None if any will do."""

    @property
    def damped(self) -> bool:
        """Whether the force depends on the velocity, for any parameters. Where a law says that it
        does not, solves leave out what damping alone needs.
        """
        return True

    @property
    def refers_to_peak(self) -> bool:
        """Whether the damping of a pushed impact refers to the largest closing speed since touch,
        where that is asked for. It makes no difference to forces without v0.
        """
        return False

    @abc.abstractmethod
    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """Normal contact force in N, positive when it pushes the bodies apart.

        Arguments: indentation δ in m; its rate δ' in m/s, positive while closing; the contact; the
        closing speed v0 in m/s at the moment of touch. All of them broadcast.
        """

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """The dimensionless α of F = K δⁿ (1 + α δ'/v0); ValueError for laws of another form."""
        raise ValueError(
            f"`{type(self).__name__}` has no damping factor: its force is not of the form "
            "K δ^n (1 + α δ'/v0)."
        )

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        """The law in scaled units: a general form, replaced by laws with a special one.

        Arguments: the contact and the units of the impact. Either may be None where only the
        restitution is wanted; without a contact a scale has no unit but the speed. Raises
        ValueError where the form depends on what is missing.
        """
        return GeneralForm(
            law=self,
            contact=needed(contact, "contact", self),
            scale=needed(scale, "velocity", self),
            tension=self.tension,
        )

    def __repr__(self) -> str:
        numbers = (
            f"{field.name}={shown(getattr(self, field.name))}"
            for field in sorted(dataclasses.fields(self), key=lambda field: bool(field.kw_only))
            if field.name != "tension" or self.tension is not field.default
        )
        return f"{type(self).__name__}({', '.join(numbers)})"


def require_law(value: object) -> AbstractLaw:
    """A law; ValueError for anything else."""
    return require_kind("law", value, AbstractLaw, "a contact law (see `list_laws`)")


def require_contact_like(value: Any) -> None:
    """Raise ValueError for what has no mass, stiffness and exponent."""
    # By what it holds: contacts are in a room above the laws.
    if not all(hasattr(value, name) for name in ("mass", "stiffness", "exponent")):
        raise ValueError(f"Argument `contact` must be a `Contact`, but is {rendered(value)}.")


def contact_for(contact: Contact | None, law: AbstractLaw) -> Contact:
    """The contact that a law depends on; ValueError if it is missing or none."""
    given = needed(contact, "contact", law)
    require_contact_like(given)
    return given


def speed_for(velocity: ArrayLike | None, law: AbstractLaw) -> Float[Array, "..."]:
    """The closing speed that a law depends on; ValueError if it is missing or no number."""
    return as_parameter(needed(velocity, "velocity", law), "velocity")


def force_arguments(
    indentation: ArrayLike, velocity: ArrayLike, contact: Contact, impact_velocity: ArrayLike
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """The three numbers of `AbstractLaw.force` as arrays.

    Raises ValueError for what is no number or contact, and for shapes that do not broadcast.
    """
    require_contact_like(contact)
    numbers = {
        "indentation": as_parameter(indentation, "indentation"),
        "velocity": as_parameter(velocity, "velocity"),
        "impact_velocity": as_parameter(impact_velocity, "impact_velocity"),
    }
    require_broadcast(**numbers, contact=contact)
    depth, rate, speed = numbers.values()
    return depth, rate, speed


def needed(argument: _Given | None, name: str, law: AbstractLaw) -> _Given:
    """An argument that the law depends on; ValueError if it is None."""
    if argument is None:
        raise ValueError(
            f"Argument `{name}` is needed for `{type(law).__name__}`, which depends on it, "
            "but is None."
        )
    return argument
