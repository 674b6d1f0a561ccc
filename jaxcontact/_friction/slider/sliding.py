"""The sliding of one spring and slider, where everything is a function of the normal velocity v."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._forms import restitution_of
from ..._functions import log_remainder
from .spring import Flag, Lane, SpringForm

# Steps of order 3 from one side. The error of the outcome is of second order in that of the root.
_ITERATIONS = 7


class Normal(NamedTuple):
    """The normal motion x'' = -x^1.5 (1 + α x'), from v = 1 at touch to v = -e at separation."""

    alpha: Lane
    e: Lane

    @classmethod
    def of(cls, alpha: Lane) -> Normal:
        """Return the motion with the damping factor α ≥ 0."""
        return cls(alpha, restitution_of(alpha))

    def stored(self, v: Lane) -> Lane:
        """Return X = x^(5/2) = 5/2 (G(1) - G(v)), G(v) = ∫ v dv/(1 + αv), at the velocity v.

        It is measured from touch in loading and from separation in unloading, where G(1) = G(-e).
        Both terms of the sum then have the same sign, so nothing cancels.
        """
        outer = jnp.where(v > 0, 1, -self.e)
        delta = (outer - v) / (1 + self.alpha * v)
        return 2.5 * delta * (v + delta * log_remainder(self.alpha * delta))


class SlidingPhase(NamedTuple):
    """A contact that slides from the velocity v = `start` on, in the direction s = `sign`."""

    psi: Lane
    start: Lane
    sign: Lane

    def psi_at(self, v: Lane, chi: Lane) -> Lane:
        """Return ψ = ψ_a - 2χ s (v_a - v)."""
        return self.psi - 2 * chi * self.sign * (self.start - v)

    def end(self, chi: Lane, normal: Normal, form: SpringForm) -> tuple[Lane, Flag]:
        """Return the velocity at which the sliding ends, and whether it lasts to separation.

        It lasts while S(v) = s ψ(v) - T(v) ≥ 0. S'' = -T'' < 0 except for αv below the inflection
        of T, where S' > 2χ. So S has one root if S(-e) < 0, else none. Steps from the inflection,
        or from -e if it is not reached, approach the root from one side.
        """
        alpha = normal.alpha

        def excess(v: Lane) -> tuple[Lane, Lane, Lane]:
            value, first, second = form.spring(v > 0).expansion(v, normal.stored(v), alpha)
            return self.sign * self.psi_at(v, chi) - value, 2 * chi - first, -second

        def improved(_: int, v: Lane) -> Lane:
            value, first, second = excess(v)
            newton = value / first
            return jnp.clip(v - newton / (1 - newton * second / (2 * first)), last, self.start)

        last, eps = -normal.e, float(jnp.finfo(alpha.dtype).eps)
        # A stop so late changes ψ by S(-e)². Its stick would stay within rounding of the limit.
        lasts, begins = excess(last)[0] >= -4 * eps**0.5, excess(self.start)[0] >= 0
        bend = form.spring(last > 0).inflection / jnp.maximum(alpha, 0.1)
        guess = jnp.minimum(self.start, jnp.maximum(last, bend))
        root = jax.lax.fori_loop(0, _ITERATIONS, improved, guess)
        return jnp.where(begins, root, self.start), begins & lasts
