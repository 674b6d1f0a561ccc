"""Gaps, contact forces and accelerations of a mechanism in SI units; friction forces of contacts
that stick or slide, and equations with M.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.modes import Flag, Flags, Number, PerContact
from .._friction.base import own_ratio
from .system import System

_LARGE = 8
"""From this size on, Cholesky's factors of the library are used."""


def solve_mass(mass: Float[Array, "n n"], right: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """Return M⁻¹ times vectors, by elimination without pivots; NaN unless M is positive definite.
    Written out, it runs in batches and has short derivatives.
    """
    n = mass.shape[0]
    columns = right.reshape(n, -1)
    if n >= _LARGE:
        factor = jax.scipy.linalg.cho_factor(mass)
        return jax.scipy.linalg.cho_solve(factor, columns).reshape(right.shape)
    if n == 1:
        return right / positive(mass[0, 0])
    rows = jnp.concatenate([mass, columns], axis=1)
    unit = jnp.eye(n, dtype=rows.dtype)
    for k in range(n):
        pivot = rows[k] / positive(rows[k, k])
        rows = rows - (rows[:, k] - unit[k])[:, None] * pivot[None]
    return rows[:, n:].reshape(right.shape)


def positive(number: Number) -> Number:
    """Return a number, or NaN unless it is positive."""
    return jnp.where(number > 0, number, jnp.nan)


SLIDES_ON = 1.0
"""The sign of slip that open contacts keep: any but 0, which would hold them."""


class Friction(NamedTuple):
    """Friction forces in N along the slip, the accelerations v', slip speeds in m/s and their rates
    in m/s², and whether forces of sticking contacts are not unique.
    """

    force: PerContact
    acceleration: Float[Array, " n"]
    slip: PerContact
    slip_rate: PerContact
    redundant: Flag


def hold(matrix: Float[Array, "m m"], sticks: Flags, needed: PerContact) -> tuple[PerContact, Flag]:
    """Return the λ of the contacts that stick, Σ_l A_kl λ_l = b_k, and 0 for all others; and
    whether other forces would hold them as well.

    `matrix` A = J_t M⁻¹ J_tᵀ is symmetric and not negative. A contact whose row follows from those
    before it has λ = 0: others already hold it.
    """
    m = matrix.shape[0]
    diagonal = jnp.diagonal(matrix)
    acts = sticks & (diagonal > 0)
    root = jnp.sqrt(jnp.where(acts, diagonal, 1))
    both = acts[:, None] & acts[None]
    unit = jnp.eye(m, dtype=matrix.dtype)
    scaled = jnp.where(both, matrix / root[:, None] / root[None], unit)
    rows = jnp.concatenate([scaled, jnp.where(acts, needed / root, 0)[:, None]], axis=1)
    # Rows that follow from others leave a pivot of a few roundings.
    least = math.sqrt(jnp.finfo(matrix.dtype).eps) * 1e-2
    independent = []
    for k in range(m):
        fine = rows[k, k] > least
        pivot = jnp.where(fine, rows[k] / jnp.where(fine, rows[k, k], 1), 0)
        rows = rows - (rows[:, k] - unit[k])[:, None] * pivot[None]
        independent.append(fine)
    free = jnp.stack(independent)
    return jnp.where(acts & free, rows[:, m], 0) / root, jnp.any(acts & ~free)


Vector = Float[Array, " n"]

_ROUNDING = 64
"""A slip speed of less than this many rounding errors of the speeds in it is zero."""


class SystemMotion(NamedTuple):
    """The accelerations v', and the power in W of all forces but normal contact forces. It includes
    that of moving surfaces, and ½ v·M' v. `friction` is that of contacts that stick and slip.
    """

    acceleration: Vector
    power: Number
    friction: Friction | None = None


class Opening(NamedTuple):
    """Gaps in m, their rates in m/s, and the map from contact forces to generalised ones."""

    gap: PerContact
    rate: PerContact
    pull: Callable[[PerContact], tuple[Vector]]


class Mechanics(eqx.Module):
    """The equations of a `System` with its `args`."""

    system: System
    args: Any

    def rate(self, t: Number, q: Vector, v: Vector) -> Vector:
        """Return q'."""
        return v if self.system.rate is None else self.system.rate(t, q, v, self.args)

    def mass(self, t: Number, q: Vector) -> Float[Array, "n n"]:
        return self.system.mass(t, q, self.args)

    def gaps(self, t: Number, q: Vector, v: Vector) -> tuple[PerContact, PerContact]:
        """Return gaps and their rates."""
        along = jnp.ones_like(t), self.rate(t, q, v)
        return jax.jvp(lambda t, q: self.system.gap(t, q, self.args), (t, q), along)

    def opening(self, t: Number, q: Vector, v: Vector) -> Opening:
        """Return gaps and their rates, with the transposed contact Jacobian."""

        def of_speed(v: Vector) -> tuple[PerContact, PerContact]:
            gap, rate = self.gaps(t, q, v)
            return rate, gap

        rate, pull, gap = jax.vjp(of_speed, v, has_aux=True)
        return Opening(gap, rate, pull)

    def jacobian(self, opening: Opening) -> Float[Array, "m n"]:
        """Return the contact Jacobian J, the rates of gaps by v."""
        return jax.vmap(opening.pull)(jnp.eye(opening.gap.shape[0], dtype=opening.gap.dtype))[0]

    def motion(
        self,
        t: Number,
        q: Vector,
        v: Vector,
        opening: Opening,
        force: PerContact,
        slide: PerContact | None = None,
        springs: Array | None = None,
    ) -> SystemMotion:
        """Return the motion under contact forces in N. `slide` holds the signs of the slip, 0 for
        contacts that stick, if there is rigid friction. `springs` are the friction forces (m, d) in
        N of springs.
        """
        along = jnp.ones_like(t), self.rate(t, q, v)
        mass, changes = jax.jvp(self.mass, (t, q), along)
        others = self.system.force(t, q, v, self.args)
        law: Any = self.system.friction
        if springs is not None or (law is not None and law.kind == "ramp"):
            speeds, tangential = jax.vjp(lambda v: self.slip(t, q, v), v)
            held = law.force(force, speeds) if springs is None else springs.reshape(speeds.shape)
            others = others + tangential(held)[0]
        (pull,) = opening.pull(force)
        friction = None
        if slide is None:
            acceleration = solve_mass(mass, others + pull)
        else:
            jacobian = self.slips(t, q, v)[1]
            limit = self.limit(force)
            friction = self.stick_slip((t, q, v), mass, others + pull, jacobian, limit, slide)
            others = others + friction.force @ jacobian
            acceleration = friction.acceleration
        # The power that contacts give to moving surfaces, F·∂g/∂t.
        surfaces = jnp.sum(force * opening.rate) - jnp.sum(pull * v)
        power = jnp.sum(others * v) + jnp.sum(v * (changes @ v)) / 2 - surfaces
        return SystemMotion(acceleration, power, friction)

    def slip(self, t: Number, q: Vector, v: Vector) -> Array:
        """Return slip speeds (m,) or (m, 2)."""
        assert self.system.slip is not None
        return self.system.slip(t, q, v, self.args)

    @property
    def spring(self) -> tuple[Array, Array]:
        """Return μ and κ of tangential springs."""
        friction = self.system.friction
        kappa = None if friction is None else own_ratio(friction)
        assert friction is not None and kappa is not None
        return friction.mu, kappa

    def limit(self, force: PerContact) -> PerContact:
        """Return the largest friction forces μF in N."""
        assert self.system.friction is not None
        return self.system.friction.mu * force

    def slips(self, t: Number, q: Vector, v: Vector) -> tuple[PerContact, Float[Array, "m n"]]:
        """Return slip speeds, and their Jacobian by v."""
        speeds, pull = jax.vjp(lambda v: self.slip(t, q, v), v)
        return speeds, jax.vmap(pull)(jnp.eye(speeds.shape[0], dtype=speeds.dtype))[0]

    def slide(self, t: Number, q: Vector, v: Vector) -> PerContact:
        """Return the signs of slip speeds, 0 for those within rounding."""
        slip, jacobian = self.slips(t, q, v)
        noise = _ROUNDING * jnp.finfo(v.dtype).eps * (jnp.abs(jacobian) @ jnp.abs(v))
        return jnp.where(jnp.abs(slip) > noise, jnp.sign(slip), 0)

    def settled(
        self,
        t: Number,
        q: Vector,
        v: Vector,
        opening: Opening,
        force: PerContact,
        slide: PerContact,
    ) -> tuple[PerContact, Flag]:
        """Return `slide` after contacts that cannot stick begin to slide, and whether friction
        forces of those that stick are not unique.
        """
        limit, redundant = self.limit(force), jnp.asarray(False)
        # A contact that slides changes the forces of those that stick.
        for _ in range(min(slide.shape[0], 2)):
            friction = self.motion(t, q, v, opening, force, slide).friction
            assert friction is not None
            slips = (slide == 0) & (jnp.abs(friction.force) > limit)
            slide = jnp.where(slips, -jnp.sign(friction.force), slide)
            redundant = friction.redundant
        return slide, redundant

    def stick_slip(
        self,
        at: tuple[Number, Vector, Vector],
        mass: Array,
        drive: Vector,
        jacobian: Float[Array, "m n"],
        limit: PerContact,
        slide: PerContact,
    ) -> Friction:
        """Return friction and accelerations under the generalised forces `drive`.

        Sliding contacts have the friction ∓μF. Those that stick have the forces with which their
        slip speeds do not change.
        """
        sliding = -slide * limit
        forces = (drive + sliding @ jacobian)[:, None]
        columns = solve_mass(mass, jnp.concatenate([forces, jacobian.T], axis=1))
        free, response = columns[:, 0], columns[:, 1:]
        along = jnp.ones_like(at[0]), self.rate(*at), free
        speeds, rates = jax.jvp(self.slip, at, along)
        matrix, sticks = jacobian @ response, slide == 0
        held, redundant = hold(matrix, sticks, -rates)
        rates = jnp.where(sticks, 0, rates + matrix @ held)
        return Friction(
            force=jnp.where(sticks, held, sliding),
            acceleration=free + response @ held,
            slip=speeds,
            slip_rate=rates,
            redundant=redundant,
        )

    def painleve(self, t: Number, q: Vector, v: Vector, slide: PerContact) -> PerContact:
        """Return J_n M⁻¹ (J_n ∓ μ J_t)ᵀ over J_n M⁻¹ J_nᵀ of every gap, infinite if it sticks.

        If it is not positive, the contact force presses a sliding contact together.
        """
        normal, tangent = self.jacobian(self.opening(t, q, v)), self.slips(t, q, v)[1]
        across = solve_mass(self.mass(t, q), normal.T).T
        compliance = jnp.sum(normal * across, axis=1)
        friction = slide * self.limit(jnp.sum(tangent * across, axis=1))
        acts = (slide != 0) & (compliance > 0)
        return jnp.where(acts, 1 - friction / jnp.where(acts, compliance, 1), jnp.inf)

    def second(self, t: Number, q: Vector, v: Vector, acceleration: Vector) -> PerContact:
        """Return the second rates of the gaps."""
        along = jnp.ones_like(t), self.rate(t, q, v), acceleration
        return jax.jvp(lambda *at: self.gaps(*at)[1], (t, q, v), along)[1]

    def effective_mass(self, t: Number, q: Vector, v: Vector) -> PerContact:
        """Return 1/(J M⁻¹ Jᵀ) of every gap, each with the others open. Where J is zero a
        contact does not act on the mechanism, and the value is 1.
        """
        jacobian = self.jacobian(self.opening(t, q, v))
        compliance = jnp.sum(jacobian * solve_mass(self.mass(t, q), jacobian.T).T, axis=1)
        return 1 / jnp.where(compliance == 0, 1, compliance)

    def kinetic(self, t: Number, q: Vector, v: Vector) -> Number:
        """Return ½ v·M v in J."""
        return jnp.sum(v * (self.mass(t, q) @ v)) / 2
