"""The interface of a form: a contact law in scaled units, as the solvers use it.

Powers of x have no second derivative at touch and separation, which reduces the order of every
solver. Forms are therefore solved in w with `x = w^k`, `dt = w^(k-1) dτ`, so that `w' = v/k` and
`v' = Γ w^(k-1) - pull(w, v)` with `pull = w^(k-1) f(w^k, v)`.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._functions import contraction, power
from .scale import ScaledImpact

Lane = Float[Array, "..."]
Flag = Bool[Array, "..."]
Exponent = float | Float[Array, "..."]


def signed_power(w: Lane, exponent: Exponent) -> Lane:
    """Return w^exponent, continued smoothly to w < 0, which only the last trial step reaches."""
    if isinstance(exponent, float) and exponent == int(exponent):
        return w ** int(exponent)
    return power(w, exponent)


class Momentum(NamedTuple):
    """A coordinate u(v) that replaces the velocity if it makes a free motion smoother.

    `at_touch` is its value at v = 1; `velocity` is v(u); `pull` is -du/dτ as a function of w;
    `lost` is the energy dissipated by damping from one u to another.
    """

    at_touch: Callable[[], Lane]
    velocity: Callable[[Lane], Lane]
    pull: Callable[[Lane], Lane]
    lost: Callable[[Lane, Lane], Lane]


class AbstractForm(eqx.Module):
    """A contact law in scaled units: the f of x'' = Γ - f(x, x'), x(0) = 0, x'(0) = 1.

    The units are those of `Scale`: X = (m v0²/K)^(1/(n+1)) of length, v0 of speed, X/v0 of time, m
    v0²/X of force. Γ is the external force, n the exponent of the contact. A law returns its form
    from `law.form(contact, scale)`, by default a form of its SI force.

    A subclass declares its numbers as fields (at least one array; all broadcast), a static field
    `tension` and the method `force`. `tension` states whether the contact may pull; without it the
    contact ends where the force vanishes. The other members have defaults that mean "not
    available", and a subclass overrides those it can provide: `solve`, `restitution`,
    `never_pulls`, `damping`, `momentum`, `phase_unit`, `static_indentation`,
    `sound`. Source of the scaling: the energy integral of Hunt & Crossley (1975), doi
    10.1115/1.3423596.
    """

    tension: eqx.AbstractVar[bool]

    never_pulls: ClassVar[bool] = False
    """True if f stays positive in every free impact, up to x = 0."""

    creeps_free: ClassVar[bool] = False
    """True if a free contact may creep back for longer than explicit steps can follow."""

    ends_apart: ClassVar[bool] = False
    """True if the contact ends at x < 0."""

    remembers: ClassVar[bool] = False
    """True if the force depends on the largest indentation of the contact so far."""

    damping_number: ClassVar[str | None] = None
    """The field with a number ≥ 0 of damping, which `sound` checks; None without one."""

    @abc.abstractmethod
    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """Return f(x, v), not clamped, with correct value and derivative for x ≥ 0.

        `compressing` is True until the turn of the motion.
        """

    def remembering(self, deepest: Lane) -> AbstractForm:
        """Return the form after the turn at the indentation `deepest`, if it `remembers`."""
        return self

    def well(self) -> Lane | None:
        """Return the largest energy that adhesion alone may turn into motion; None without one."""
        return None

    def barrier(self, push: Lane) -> Lane | None:
        """Return the largest ∫ f dx - Γ x on the way out, which bodies must have to part, if it is
        not that of x = 0; -∞ if they always part. None for forms without adhesion.
        """
        return None

    def kept(self, deepest: Lane) -> Lane:
        """Return the work that the contact has kept after its turn: what it does not return."""
        return jnp.zeros_like(deepest)

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent] | None:
        """Return the c and p of f = x^(n-p) (x^p + c v), 0 ≤ p ≤ n, or None for other forces.

        If they are known, the motion is solved in a coordinate in which f is a polynomial.
        """
        return None

    @property
    def hysteresis_factor(self) -> Lane | None:
        """The α if the free force is xⁿ (1 + α v) for every v; None for other forces."""
        return None

    def time_at(self, v: Lane, n: Exponent, duration: Lane) -> Lane | None:
        """Return the time from touch to the velocity v of a free impact of a known duration; None
        without a formula.
        """
        return None

    def solve(self, n: Exponent) -> ScaledImpact | None:
        """Return the free impact in closed form, in the broadcast shape of the form's numbers and
        n.
        """
        return None

    def as_delivered(self, scaled: ScaledImpact) -> ScaledImpact:
        """Return a free impact with the exact numbers of the form in place of those of a solve."""
        return scaled

    @property
    def closed_form(self) -> bool:
        """True if the class has its own `solve`, so that method "exact" applies."""
        return type(self).solve is not AbstractForm.solve

    def restitution(self) -> Lane | None:
        """Return the e of a free impact if it depends on neither n nor the time; otherwise None."""
        return None

    def sound(self) -> tuple[AbstractForm, Flag]:
        """Return the form with all numbers valid, and the lanes in which they were valid before.

        The other lanes are flagged as invalid input.
        """
        name = self.damping_number
        if name is None or (number := getattr(self, name)) is None:
            return self, jnp.asarray(True)
        good = (number >= 0) & jnp.isfinite(number)
        return dataclasses.replace(self, **{name: jnp.where(good, number, 0)}), good

    def momentum(self, n: Exponent) -> Momentum | None:
        """Return the coordinate that replaces v in a free impact; None for v itself."""
        return None

    def phase_unit(self) -> Lane | float:
        """Return the unit of w in the plane of the phase angle; any positive number is correct."""
        return 1.0

    def static_indentation(self, push: Lane, n: Exponent) -> Lane | None:
        """Return the x at which f(x, 0) balances a push Γ > 0; None if unknown."""
        return None if self.damping(n, jnp.asarray(True)) is None else push ** (1 / n)

    @property
    def may_clamp(self) -> bool:
        """True if `force` may be clamped to zero, which leaves no slope where a contact ends."""
        return False

    def continued(self, x: Lane, v: Lane) -> AbstractForm:
        """Return the same form, without a clamp beyond the state (x, v) of a contact."""
        return self

    def end_indentation(self, n: Exponent, e: Lane) -> Lane | None:
        """Return the end x of a contact without tension at speed e, x^p = c e; None for 0."""
        damping = self.damping(n, jnp.asarray(False))
        if self.tension or self.never_pulls or damping is None:
            return None
        c, p = damping
        return power(c * e, 1 / p)

    def creeping_speed(self, n: Exponent) -> Lane | float:
        """Return the speed that strong damping leaves at the turn, in units of the impact speed.

        Damping alone would stop the bodies at c x^q/q = 1, q = n-p+1. From there they creep back
        with c v = -x^p.
        """
        damping = self.damping(n, jnp.asarray(True))
        if damping is None:
            return 1.0
        c, p = damping
        q = n - p + 1
        strong = jnp.maximum(c, jnp.maximum(q, 1))
        return power(q / strong, p / q) / strong

    def creeping_excess(self, n: Exponent) -> Lane | float:
        """Return the net force 1/c² of a contact that creeps back; its two parts nearly cancel."""
        damping = self.damping(n, jnp.asarray(False))
        return 1.0 if damping is None else 1 / jnp.square(jnp.maximum(damping[0], 1))

    def creeps_back(self, n: Exponent) -> Flag:
        """Return whether damping makes a free contact with tension creep back to x = 0 without end.

        In x'' = -x^(n-p) (x^p + c x') inertia dominates near x = 0 if 2p < n + 1, and the contact
        ends. Damping dominates if 2p > n + 1. For 2p = n + 1 the motion is that of an oscillator,
        which is overdamped from c = 2√p on.
        """
        damping = self.damping(n, jnp.asarray(False))
        if damping is None or not self.tension:
            return jnp.asarray(False)
        c, p = damping
        # A flag has no derivative, and the root has infinite slope at p = 0.
        p = jax.lax.stop_gradient(jnp.asarray(p, c.dtype))
        excess = 2 * p - (n + 1)
        return (c > 0) & ((excess > 0) | ((excess == 0) & (c >= 2 * jnp.sqrt(p))))

    def may_pull(self, pushed: bool) -> bool:
        """Return whether f may become negative, in a free impact or under an external force."""
        return self.tension and (pushed or not self.never_pulls)

    @property
    def follows_phase_angle(self) -> bool:
        """True if a free contact lasts until x = 0, as the phase method requires."""
        return self.tension or self.never_pulls

    def order(self, n: Exponent) -> int:
        """Return the k of x = w^k: the smallest that makes f a polynomial, or 2 if none does.

        For forces without `damping`, 2 makes square roots of x smooth.
        """
        damping = self.damping(n, jnp.asarray(True))
        if not isinstance(n, float):
            return 2
        if damping is None:
            return 1 if n == int(n) else 2
        powers = (n + 1, n - damping[1] + 1)
        return next((k for k in (1, 2, 3, 4) if all(k * p == int(k * p) for p in powers)), 2)

    def pull(
        self, w: Lane, v: Lane, n: Exponent, compressing: Flag, order: int | None = None
    ) -> Lane:
        """Return w^(k-1) f(w^k, v), not clamped; k is `order` (None for the form's own)."""
        k, damping = order or self.order(n), self.damping(n, compressing)
        if damping is not None:
            outer = signed_power(w, k * (n - damping[1] + 1) - 1)
            return outer * self.pulling(w, v, n, compressing, k)
        if k == 1:
            return self.force(w, v, n, compressing)
        # At w = 0 the derivative of f may be infinite, while that of w f is f. f is not evaluated
        # there.
        touching = w == 0
        inside = jnp.where(touching, 1, w)
        return jnp.where(touching, 0, w * self.force(inside**2, v, n, compressing))

    def dissipation(
        self, w: Lane, v: Lane, n: Exponent, compressing: Flag, order: int | None = None
    ) -> Lane:
        """Return w^(k-1) (f(x, v) - f(x, 0)) v, the rate of dissipation by damping."""
        damping = self.damping(n, compressing)
        if damping is not None:
            outer = signed_power(w, (order or self.order(n)) * (n - damping[1] + 1) - 1)
            return outer * damping[0] * jnp.square(v)
        still = self.pull(w, jnp.zeros_like(v), n, compressing)
        return (self.pull(w, v, n, compressing) - still) * v

    def stored(self, w: Lane, n: Exponent, order: int | None = None) -> Lane:
        """Return ∫ f(x, 0) dx from 0 to w^k; by a Gauss rule if it is not a polynomial."""
        if self.damping(n, jnp.asarray(True)) is not None:
            return signed_power(w, (order or self.order(n)) * (n + 1)) / (n + 1)
        nodes, weights = np.polynomial.legendre.leggauss(16)
        still, held = jnp.zeros_like(w), jnp.asarray(True)
        at = jnp.asarray((1 + nodes) / 2, w.dtype)
        pulls = jax.vmap(lambda node: self.pull(w * node, still, n, held))(at)
        return self.order(n) * w * contraction(jnp.asarray(weights / 2, w.dtype), pulls)

    def pulling(
        self, w: Lane, v: Lane, n: Exponent, compressing: Flag, order: int | None = None
    ) -> Lane:
        """Return a smooth function that is negative while the contact pulls."""
        k, damping = order or self.order(n), self.damping(n, compressing)
        if damping is None:
            return self.force(w**k, v, n, compressing)
        coefficient, excess = damping
        return signed_power(w, k * excess) + coefficient * v

    def pressing(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """Return a number of order one with the sign of f, and with a slope where f vanishes."""
        pulling, damping = self.pulling(x, v, n, compressing, 1), self.damping(n, compressing)
        if damping is not None:
            return pulling / (1 + damping[0])
        # A force clamped to zero has vanished already.
        return jnp.where(pulling == 0, -1, pulling) if self.may_clamp else pulling
