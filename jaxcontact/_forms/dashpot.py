"""The form of a linear dashpot in parallel with a power of the indentation."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._functions import power
from .base import AbstractForm, Exponent, Flag, Lane, sound_damping


class DashpotForm(AbstractForm):
    """f = xⁿ + a v for x ≥ 0, with a = c X/(m v0) ≥ 0."""

    a: Lane
    tension: bool = eqx.field(static=True)
    creeps_free: ClassVar[bool] = True

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent] | None:
        # With tension and n > 1 a strongly damped contact creeps back without end, a weakly damped
        # one separates. No formula gives the limit, so the contact is solved like a general force.
        return None if self.tension else (self.a, n)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) + self.a * v

    def sound(self) -> tuple[DashpotForm, Flag]:
        a, good = sound_damping(self.a)
        return eqx.tree_at(lambda form: form.a, self, jnp.asarray(a)), good
