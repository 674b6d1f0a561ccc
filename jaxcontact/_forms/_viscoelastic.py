"""The form of viscoelastic spheres."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from .._elementary import power
from ._base import AbstractForm, Exponent, Flag, Lane


class ViscoelasticForm(AbstractForm):
    """f = xⁿ + n a x^(n-1) v with a = A v0/X."""

    a: Lane
    tension: bool = eqx.field(static=True)
    creeps_free: ClassVar[bool] = True

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent]:
        return n * self.a, 1.0

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) + n * self.a * v * power(x, n - 1)
