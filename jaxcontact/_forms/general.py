"""The forms of any law, and of any elastic-plastic law: their forces in SI units, scaled."""

from __future__ import annotations

import functools
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._entry import as_parameter, rendered
from .._functions import power
from .base import AbstractForm, Exponent, Flag, Lane
from .plastic import AbstractPlasticForm
from .scale import ContactLike, Scale


class HasForce(Protocol):
    """The part of a law's interface that the form uses."""

    @property
    def tension(self) -> bool:
        """True if its force pulls where it is negative."""
        ...

    def force(
        self, indentation: Any, velocity: Any, contact: Any, impact_velocity: Any
    ) -> ArrayLike:
        """Return the force in N at an indentation in m and velocities in m/s."""
        ...


class GeneralForm(AbstractForm):
    """f = F(X x, v0 v) in units of m v0²/X, for the SI force F of a law."""

    law: HasForce
    contact: ContactLike
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


class HasTwoCurves(Protocol):
    """The part of an elastic-plastic law's interface that its form uses."""

    def loading(self, indentation: Any, contact: Any) -> ArrayLike:
        """Return the force in N of a contact that is loading, without damping."""
        ...

    def unloading(self, largest: Any, contact: Any) -> tuple[ArrayLike, ArrayLike]:
        """Return the stiffness of unloading in N/mⁿ, and the indentation in m at which it ends."""
        ...

    def corners(self, contact: Any) -> tuple[ArrayLike, ...]:
        """Return the indentations in m at which the curve of loading is not smooth."""
        ...


class TwoCurvesForm(AbstractPlasticForm):
    """f from the curves of a law, in units of `length` X and of the `unit` of force."""

    law: HasTwoCurves
    contact: ContactLike
    length: Lane
    unit: Lane
    own_exponent: float = eqx.field(static=True)

    def loading(self, x: Lane) -> Lane:
        force = self.law.loading(self.length * x, self.contact)
        return as_parameter(force, "force") / self.unit

    def unloading(self, deepest: Lane) -> tuple[Lane, Lane]:
        # A contact that has not been loaded is never asked, but its derivative is.
        loaded = deepest > 0
        most = self.length * jnp.where(loaded, deepest, 1)
        found = self.law.unloading(most, self.contact)
        if not (isinstance(found, tuple) and len(found) == 2):
            raise TypeError(
                f"`{type(self.law).__name__}.unloading` must return the stiffness of unloading and "
                f"the indentation at its end, but returns {rendered(found)}."
            )
        stiffness, end = map(jnp.asarray, found)
        scaled = stiffness * self.length**self.own_exponent / self.unit
        # Curves that do not meet have no impact.
        force = self.law.loading(most, self.contact)
        gap = stiffness * power(most - end, self.own_exponent) - force
        meet = jnp.abs(gap) <= jnp.sqrt(jnp.finfo(scaled.dtype).eps) * jnp.abs(force)
        return jnp.where(meet, scaled, jnp.nan), jnp.where(loaded, end / self.length, 0)

    def work(self, x: Lane) -> Lane:
        """Return the work of loading by Gauss rules between the corners. In √x, any sum of powers
        of √x up to that of degree 30 is exact.
        """
        nodes, weights = np.polynomial.legendre.leggauss(16)
        rule = list(zip(nodes.tolist(), weights.tolist(), strict=True))
        corners = self.law.corners(self.contact)
        if not isinstance(corners, tuple):
            raise TypeError(
                f"`{type(self.law).__name__}.corners` must return a tuple of indentations, but "
                f"returns {rendered(corners)}."
            )
        corners = [jnp.asarray(corner) / self.length for corner in corners]
        begins = [jnp.zeros_like(x), *(jnp.clip(corner, 0, x) for corner in corners)]
        total = jnp.zeros_like(x)
        for begin, end in zip(begins, [*begins[1:], x], strict=True):
            low, high = power(begin, 0.5), power(end, 0.5)
            half = (high - low) / 2
            for node, weight in rule:
                root = low + half * (1 + node)
                total = total + 2 * weight * half * root * self.loading(jnp.square(root))
        return total
