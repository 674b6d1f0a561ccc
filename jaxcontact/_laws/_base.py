"""What a contact law is: a pure force function and its parameters."""

from __future__ import annotations

import abc
import dataclasses
from typing import TYPE_CHECKING, ClassVar, TypeVar

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._forms import AbstractForm, GeneralForm, Scale
from .._parameter import shown

if TYPE_CHECKING:
    from .._contact import Contact

_Given = TypeVar("_Given")

VELOCITY_THRESHOLD = 1e-9
"""Closing speed in m/s below which the damping of a law stops growing.

The hysteresis damping factor c = α K/v0 has no limit as v0 → 0. A contact that closes more slowly
than this speed (a resting one, say) is given the c of this speed, in `force` and in `impact` alike.
"""


class AbstractLaw(eqx.Module):
    """A contact law: parameters as leaves, and the force they make.

    A subclass with a `force` works in `impact`, `trajectory`, `restitution` and under every JAX
    transformation. `force` gets SI quantities that broadcast, and should be zero for a negative
    indentation. Every array held by a law broadcasts with the contact and the speed. A law with a
    closed form or another shortcut returns it from `form`.

    The keyword `tension` (static) says whether the contact may pull. With False a pull counts as no
    force, and the contact ends when its force vanishes; with True it ends when δ is back at zero.
    """

    tension: bool = eqx.field(static=True, default=True, kw_only=True)

    exponents: ClassVar[tuple[float, ...] | None] = None
    """The contact exponents n the law is made for; None if any will do."""

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


def needed(argument: _Given | None, name: str, law: AbstractLaw) -> _Given:
    """An argument that the law depends on; ValueError if it is None."""
    if argument is None:
        raise ValueError(
            f"Argument `{name}` is needed for `{type(law).__name__}`, which depends on it, "
            "but is None."
        )
    return argument
