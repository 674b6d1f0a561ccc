"""The interface of a contact law: a pure force function and its parameters."""

from __future__ import annotations

import abc
import dataclasses
import functools
import inspect
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import (
    OfNumbers,
    as_parameter,
    refusal,
    require_broadcast,
    require_flag,
    require_kind,
    shown,
)
from .._forms import AbstractForm, Exponent, Flag, Lane, Scale, scale_of

if TYPE_CHECKING:
    from .._contact import Contact

_Given = TypeVar("_Given")

VELOCITY_THRESHOLD = 1e-9
"""Closing speed in m/s below which `impact` and `bounce` report no impact.

The hysteresis damping factor c = α K/v0 has no limit as v0 → 0. The force of a law and the impacts
of a scene have no such threshold.
"""


as_tension = functools.partial(require_flag, "tension")
"""Converter of a law's keyword `tension`."""

# Type checkers recognise `eqx.field` and would take the converter's type for the type of the field.
_TENSION: dict[str, Any] = {"static": True, "converter": as_tension}


def _is_abstract(cls: type) -> bool:
    """Return whether a class has abstract methods, even before its abstract flag is set."""
    return any(getattr(getattr(cls, n, None), "__isabstractmethod__", False) for n in dir(cls))


class Instant(NamedTuple):
    """A contact at one moment, by the arguments of `AbstractLaw.force`."""

    indentation: ArrayLike
    velocity: ArrayLike
    contact: Contact
    impact_velocity: ArrayLike


class AbstractLaw(OfNumbers):
    """A contact law: parameters as leaves, and the force they define.

    A subclass with a `force` works in `impact`, `trajectory`, `restitution` and under every JAX
    transformation. `force` receives SI quantities that broadcast, and should return zero for a
    negative indentation. Every array held by a law broadcasts with the contact and the speed. A law
    with a closed form or another shortcut returns it from `form`.

    A subclass must state whether its contact may pull: it sets `tension = False` or `tension =
    True`, or inherits it. With False a negative force counts as zero, and the contact ends where
    the force vanishes. With True the force may pull, and the contact ends when δ returns to zero. A
    class that defines `force` but not `tension` raises TypeError. The keyword `tension` (static) of
    an instance overrides its class: `MyLaw(c=1e4, tension=True)`.
    """

    tension: bool = eqx.field(default=None, kw_only=True, **_TENSION)

    exponents: ClassVar[tuple[float, ...] | None] = None
    """Contact exponents n the law is made for; None if every exponent is allowed."""

    ends_apart: ClassVar[bool] = False
    """True if the contact ends at δ < 0, as that of `JKR`."""

    remembers: ClassVar[bool] = False
    """True if the force depends on the largest indentation of the contact so far, as that of
    `ThorntonPlastic`."""

    forgets: ClassVar[bool] = False
    """True if a contact that pulls and closes again has a smaller largest indentation."""

    damped: ClassVar[bool] = True
    """True if the force depends on the velocity for some parameters. If False, the solvers omit the
    work that only damping needs."""

    refers_to_peak: ClassVar[bool] = False
    """True if the damping of a pushed impact can refer to the largest closing speed since touch,
    where the caller asks for it. Forces without v0 are not affected."""

    _only_tension: ClassVar[tuple[bool, str] | None] = None
    """The one value of `tension` that the law allows, and why; None if it allows both."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        stated = vars(cls).get("tension")
        if stated is not None and not isinstance(stated, dataclasses.Field):
            # The attribute becomes the default of the keyword.
            annotations = {**inspect.get_annotations(cls), "tension": bool}
            cls.__annotations__ = annotations
            field = eqx.field(default=as_tension(stated), kw_only=True, **_TENSION)
            cls.tension = cast(bool, field)
        elif stated is None and cls.tension is None and not _is_abstract(cls):
            raise TypeError(
                f"Law `{cls.__name__}` must set `tension` in the class. False: a negative force "
                "counts as zero, and the contact ends at zero force. True: the force may pull, "
                "and the contact ends at zero indentation."
            )

    def __check_init__(self) -> None:
        if self._only_tension is not None and self.tension is not self._only_tension[0]:
            only, why = self._only_tension
            raise ValueError(
                f"Argument `tension` must be {only} for `{type(self).__name__}`, which {why}, but "
                f"is {self.tension}."
            )

    @property
    def fades(self) -> bool:
        """True if the force may vanish before δ = 0, which ends the contact."""
        return not self.tension and (self.damped or self.remembers)

    def jumps(self, exponent: Exponent) -> bool:
        """Return whether the force may jump where a contact begins or ends."""
        return True

    @abc.abstractmethod
    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """Return the normal contact force in N, positive when it pushes the bodies apart.

        Arguments: indentation δ in m; its rate δ' in m/s, positive while closing; the contact; the
        closing speed v0 in m/s at the moment of touch. All of them broadcast.
        """

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        """Return the force of a contact that unloads from `deepest`, or loads if that is 0."""
        # Only laws that remember have this.
        raise NotImplementedError

    def _pressing(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        """Return the number for `pressing`."""
        # Only laws that fade have this.
        rate, speed = jnp.asarray(at.velocity), jnp.asarray(at.impact_velocity)
        scale = scale_of(at.contact, speed)
        form, closes = self.form(at.contact, scale), rate > 0
        if self.remembers and deepest is not None:
            largest = jnp.asarray(deepest)
            form, closes = form.remembering(largest / scale.length), largest <= 0
        x, v = jnp.asarray(at.indentation) / scale.length, rate / speed
        return form.pressing(x, v, at.contact.exponent, closes)

    def _adheres_below(self, largest: ArrayLike) -> Float[Array, "..."]:
        """Return the indentation in m below which a contact that unloads follows its adhesion."""
        # Only laws that forget have these two. Their `_force_after` receives the negative of the
        # largest indentation below that.
        raise NotImplementedError

    def _shrunk(self, indentation: ArrayLike) -> Float[Array, "..."]:
        """Return the largest indentation in m of a contact that closes again from there."""
        raise NotImplementedError

    def _force_of_closed(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        """Return the force for `force_of_closed`, of a law that fades or ends apart."""
        if self.remembers and deepest is not None:
            return self._force_after(at, deepest)
        return self.force(*at)

    def _end_indentation(self, contact: Contact) -> Float[Array, "..."]:
        """Return the δ ≤ 0 in m at which a contact ends."""
        # Only laws that end apart have this.
        raise NotImplementedError

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Return the energy in J that unloading returns, and that which the contact has kept;
        `largest` is its largest indentation so far.
        """
        # Only laws that remember or end apart have this.
        raise NotImplementedError

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return the dimensionless α of F = K δⁿ (1 + α δ'/v0); ValueError for other laws."""
        raise ValueError(
            f"`{type(self).__name__}` has no damping factor: its force is not of the form "
            "K δ^n (1 + α δ'/v0)."
        )

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        """Return the law in scaled units: a `GeneralForm` unless a law overrides it.

        Arguments: the contact and the units of the impact. Either may be None if only the
        restitution is wanted. Without a contact, a scale has no unit but the speed. Raises
        ValueError if the form depends on a missing argument.
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


class AbstractDampedLaw(AbstractLaw):
    """A law whose damping may pull, which counts as zero unless the law has tension."""

    @abc.abstractmethod
    def _whole_force(self, at: Instant) -> Float[Array, "..."]:
        """Return the force in N as it is with tension."""

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """Return the force F of the class in N, and zero for δ < 0. Without `tension` a pull counts
        as zero.
        """
        force = self._whole_force(Instant(indentation, velocity, contact, impact_velocity))
        return force if self.tension else jnp.where(force < 0, 0, force)

    def _force_of_closed(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        del deepest
        return self._whole_force(at)


class AbstractRateLaw(AbstractDampedLaw):
    """A law whose force depends on the indentation and its rate, and not on the closing speed."""

    @abc.abstractmethod
    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        """Return F in N before it is clamped, and zero for δ < 0."""

    def _whole_force(self, at: Instant) -> Float[Array, "..."]:
        depth, rate, _ = force_arguments(*at)
        return self._force_at(depth, rate, at.contact)


class GeneralForm(AbstractForm):
    """f = F(X x, v0 v) in units of m v0²/X, for the SI force F of a law."""

    law: AbstractLaw
    contact: Contact
    scale: Scale
    tension: bool = eqx.field(static=True)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        scale = self.scale
        force = self.law.force(scale.length * x, scale.speed * v, self.contact, scale.speed)
        return as_parameter(force, "force") / scale.force

    @property
    def may_clamp(self) -> bool:
        """True if the law may clamp its own force to zero; the package's laws do not clamp here."""
        return not (self.tension or self.law.tension)

    def continued(self, x: Lane, v: Lane) -> ContinuedForm:
        """Return the same form, continued from the state (x, v) where the law clamps its force."""
        return ContinuedForm(
            law=self.law, contact=self.contact, scale=self.scale, tension=self.tension, x=x, v=v
        )


class ContinuedForm(GeneralForm):
    """A form whose force follows its tangent at (x, v) wherever the law clamps it to zero.

    A force that is zero beyond the end of a contact has no slope there, but the stages of the last
    step lie on both sides of the end.
    """

    x: Lane
    v: Lane

    @property
    def may_clamp(self) -> bool:
        """False: the clamp is replaced."""
        return False

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        force = functools.partial(super().force, n=n, compressing=compressing)
        value, change = jax.jvp(force, (self.x, self.v), (x - self.x, v - self.v))
        clamped = force(x, v)
        return jnp.where((clamped == 0) & ~compressing, value + change, clamped)


def force_of(
    law: AbstractLaw,
    indentation: ArrayLike,
    velocity: ArrayLike,
    contact: Contact,
    impact_velocity: ArrayLike,
    deepest: ArrayLike | None = None,
) -> Float[Array, "..."]:
    """Return the force of a law in N, with a pull counted as zero if the law has no tension.

    The package's laws clamp their own force; a user's law need not. `deepest` is the largest
    indentation in m of a contact that unloads, 0 for one that loads, for a law that `remembers`.
    """
    at = Instant(indentation, velocity, contact, impact_velocity)
    if law.remembers and deepest is not None:
        force = law._force_after(at, deepest)
    else:
        force = law.force(*at)
    return force if law.tension else jnp.where(force < 0, 0, force)


def force_of_closed(
    law: AbstractLaw,
    indentation: ArrayLike,
    velocity: ArrayLike,
    contact: Contact,
    impact_velocity: ArrayLike,
    deepest: ArrayLike | None = None,
) -> Float[Array, "..."]:
    """Return `force_of` for a contact known to be closed, whose force has not vanished. It
    continues smoothly beyond its end: if the law `ends_apart` in √(δ - δ_end), and if it `fades` as
    a pull, unless a user's law counts that as zero itself.
    """
    at = Instant(indentation, velocity, contact, impact_velocity)
    if law.ends_apart or law.fades:
        return law._force_of_closed(at, deepest)
    return force_of(law, *at, deepest)


def pressing(
    law: AbstractLaw,
    indentation: ArrayLike,
    velocity: ArrayLike,
    contact: Contact,
    impact_velocity: ArrayLike,
    deepest: ArrayLike | None = None,
) -> Float[Array, "..."]:
    """Return a number of order one with the sign of the force before it is clamped, and with a
    slope where that vanishes, for a law that `fades`. The arguments are those of `force_of`.
    """
    return law._pressing(Instant(indentation, velocity, contact, impact_velocity), deepest)


def energies_of(
    law: AbstractLaw, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return the energy in J that unloading returns, and that which the contact has kept, for a law
    that `remembers` or `ends_apart`; `largest` is its largest indentation so far in m.
    """
    return law._energies(indentation, contact, speed, largest)


def end_of(law: AbstractLaw, contact: Contact) -> Float[Array, "..."]:
    """Return the δ ≤ 0 in m at which a closed contact of a law that `ends_apart` ends."""
    return law._end_indentation(contact)


def adhesion_below(law: AbstractLaw, largest: ArrayLike) -> Float[Array, "..."]:
    """Return the indentation in m below which a contact of a law that `forgets` follows its
    adhesion, when it unloads from `largest`.
    """
    return law._adheres_below(largest)


def shrunk_memory(law: AbstractLaw, indentation: ArrayLike) -> Float[Array, "..."]:
    """Return the largest indentation in m of such a contact that closes again from there."""
    return law._shrunk(indentation)


def require_law(value: object) -> AbstractLaw:
    """Return `value` if it is a law; raise ValueError otherwise."""
    return require_kind("law", value, AbstractLaw, "a contact law (see `list_laws`)")


def require_no_adhesion(law: AbstractLaw, where: str) -> None:
    """Raise ValueError for a law whose bodies stick."""
    if law.ends_apart or law.forgets:
        must = f"be a law whose bodies do not stick {where}"
        raise refusal("law", must, law, " Soft contacts without friction are followed in time.")


def require_exponent(law: AbstractLaw, contact: Contact) -> None:
    """Raise ValueError if the exponent of a contact is known and not one that the law supports."""
    n = contact.exponent
    if law.exponents is not None and isinstance(n, float) and n not in law.exponents:
        allowed = " or ".join(f"{exponent:g}" for exponent in law.exponents)
        raise ValueError(
            f"Argument `contact` must have the exponent {allowed} for `{type(law).__name__}`, "
            f"but has {n:g}."
        )


def require_contact_like(value: Any) -> None:
    """Raise ValueError unless `value` has a mass, a stiffness and an exponent."""
    # Checked by attributes, because `Contact` belongs to a room above the laws.
    if not all(hasattr(value, name) for name in ("mass", "stiffness", "exponent")):
        raise refusal("contact", "be a `Contact`", value)


def contact_for(contact: Contact | None, law: AbstractLaw) -> Contact:
    """Return the contact that a law depends on; ValueError if it is missing or not a contact."""
    given = needed(contact, "contact", law)
    require_contact_like(given)
    return given


def speed_for(velocity: ArrayLike | None, law: AbstractLaw) -> Float[Array, "..."]:
    """Return the closing speed that a law depends on; ValueError if missing or not a number."""
    return as_parameter(needed(velocity, "velocity", law), "velocity")


def force_arguments(
    indentation: ArrayLike, velocity: ArrayLike, contact: Contact, impact_velocity: ArrayLike
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """Return the three numbers of `AbstractLaw.force` as arrays.

    Raises ValueError for anything that is not a number or a contact, and for shapes that do not
    broadcast.
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
    """Return an argument that the law depends on; ValueError if it is None."""
    if argument is None:
        raise ValueError(
            f"Argument `{name}` is needed for `{type(law).__name__}`, which depends on it, "
            "but is None."
        )
    return argument
