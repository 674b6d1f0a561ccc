"""Adhesive contacts of elastic spheres, each by its pull-off force: JKR and DMT, without damping.

A JKR contact of the radius a has in scaled units, with z = a²/R and the pull-off force φ = μ²,

    f = z^(3/2) - 2 μ z^(3/4),        x = z - (4/3) μ z^(1/4).

Both are polynomials in q = z^(1/4), and so is the energy Φ(q) = ∫ f dx. The contact forms at x = 0,
where q³ = 4μ/3. It snaps where dx/dq = 0, at q³ = μ/3 and x = -μ q. It is at equilibrium at q³ = 2μ
and pulls most at q³ = μ. Source: Johnson, Kendall & Roberts (1971), doi 10.1098/rspa.1971.0141.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, as_parameter, parameter
from .._forms import AbstractForm, Exponent, Flag, Lane, Scale, ScaledImpact, integrate, lanewise
from .._functions import implicit_root, power
from .base import AbstractRateLaw, Instant, contact_for, needed, require_exponent
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact

LOSS = 3 ** (-4 / 3) * (4 / 15 + 0.4 * 4 ** (4 / 3))
"""The energy lost between touch and snap, in units of φ^(5/3)."""

_FALLS = 0.4 * (4 / 3) ** (4 / 3)
"""-Φ at touch in the same units."""


class DMTForm(AbstractForm):
    """f = xⁿ - φ for x ≥ 0."""

    adhesion: Lane
    tension: bool = eqx.field(static=True, default=True, kw_only=True)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) - self.adhesion + 0 * v

    def well(self) -> Lane:
        # From touch to equilibrium, at x = φ^(2/3).
        return 0.6 * power(self.adhesion, 5 / 3)

    def restitution(self) -> Lane:
        return jnp.ones_like(self.adhesion)


class JKRForm(AbstractForm):
    """The JKR contact with the root μ of its pull-off force.

    Its motion is solved in w = q - q_snap, in which x, the force and the energy are polynomials and
    the snap is a simple root.
    """

    root: Lane
    tension: bool = eqx.field(static=True, default=True, kw_only=True)
    ends_apart: ClassVar[bool] = True

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return jkr_force(x, jnp.square(self.root)) + 0 * v

    @property
    def follows_phase_angle(self) -> bool:
        """False: the contact ends beyond x = 0."""
        return False

    def _neck(self, cubed: Lane | float) -> Lane:
        """Return the q of q³ = `cubed` μ."""
        return power(cubed * self.root, 1 / 3)

    def touch_at(self) -> Lane:
        """Return w at touch."""
        return self._neck(4 / 3) - self._neck(1 / 3)

    def indentation_at(self, w: Lane) -> Lane:
        """Return x at w."""
        snap = self._neck(1 / 3)
        return jnp.square(w) * (6 * jnp.square(snap) + (4 * snap + w) * w) - self.root * snap

    def pace_at(self, w: Lane) -> Lane:
        """Return dx/dw at w."""
        snap = self._neck(1 / 3)
        return 4 * w * (3 * jnp.square(snap) + (3 * snap + w) * w)

    def force_at(self, w: Lane) -> Lane:
        """Return f at w."""
        cube = (w + self._neck(1 / 3)) ** 3
        return cube * (cube - 2 * self.root)

    def energy_at(self, w: Lane) -> Lane:
        """Return ∫ f dx from touch to w."""
        return _energy(w + self._neck(1 / 3), self.root) + _FALLS * power(self.root, 10 / 3)

    def well(self) -> Lane:
        # From touch to equilibrium, at q³ = 2μ; the loss is larger, and of the same kind.
        return LOSS * power(self.root, 10 / 3)

    def barrier(self, push: Lane) -> Lane:
        # It is at the snap, or under a pull beyond 5/9 φ at the unstable equilibrium.
        pull = -push / jnp.where(self.root > 0, jnp.square(self.root), 1)
        rest = jnp.sqrt(jnp.where(pull < 1, 1 - pull, 1))
        top = self._neck(jnp.maximum(1 - rest, 1 / 3)) - self._neck(1 / 3)
        height = self.energy_at(top) - push * self.indentation_at(top)
        return jnp.where((self.root > 0) & (pull < 1), height, -jnp.inf)

    def restitution(self) -> Lane:
        return self._end()[0]

    def _end(self) -> tuple[Lane, Flag]:
        """Return e, and whether the bodies stick."""
        left = 1 - 2 * LOSS * power(self.root, 10 / 3)
        sticks = left <= 0
        return jnp.where(sticks, 0, jnp.sqrt(jnp.where(sticks, 1, left))), sticks

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return e by formula, the turn as a root, and the times by quadrature."""
        root, (e, sticks) = self.root, self._end()
        turn = _turn(root)
        way_in, way_out = lanewise(_times, root, 0.0)
        cube = turn**3
        return ScaledImpact(
            restitution=e,
            duration=way_in + way_out,
            compression_time=way_in,
            max_indentation=turn * (cube - (4 / 3) * root),
            max_force=cube * (cube - 2 * root),
            settled=sticks,
            energy_loss=2 * LOSS * power(root, 10 / 3),
            # Bodies that stick need not reach the largest pull.
            min_force=jnp.where(sticks, jnp.nan, -jnp.square(root)),
            end_indentation=-root * power(root / 3, 1 / 3),
        )


def jkr_force(x: Lane, adhesion: Lane, goes_on: bool = False) -> Lane:
    """Return f of a JKR contact that has formed; 0 beyond its snap, at x < -μ (μ/3)^(1/3).

    If it `goes_on`, f continues beyond the snap x_s as a smooth function of the signed √(x - x_s).
    Little `adhesion` φ = μ² takes φ 2/3 from Hertz's force, so that there is a slope at φ = 0.
    """
    adheres, scale, p, holds = _neck(x, adhesion, goes_on)
    adhesive = jnp.where(holds, scale**6 * (p**6 - 2 * p**3), 0)
    little = power(x, 1.5) - jnp.where(x > 0, 2 / 3, jnp.where(x < 0, 0, 8 / 9)) * adhesion
    return jnp.where(adheres, adhesive, little)


def jkr_energy(x: Lane, adhesion: Lane) -> Lane:
    """Return ∫ f dx of a JKR contact from touch to x, not beyond the snap but for rounding."""
    adheres, scale, p, _ = _neck(x, adhesion, True)
    little = 0.4 * power(x, 2.5) - (2 / 3) * adhesion * jnp.maximum(x, 0)
    return jnp.where(adheres, scale**10 * (_energy(p, 1.0) + _FALLS), little)


def jkr_snap(adhesion: Lane) -> Lane:
    """Return the x at which a JKR contact snaps."""
    return -((1 / 3) ** (1 / 3)) * power(adhesion, 2 / 3)


def _neck(x: Lane, adhesion: Lane, goes_on: bool) -> tuple[Flag, Lane, Lane, Flag]:
    """Return whether there is adhesion, the unit μ^(1/3) of q, q in this unit, and whether the
    contact lasts at x.
    """
    adheres = adhesion > 0
    scale = jnp.where(adheres, adhesion, 1) ** (1 / 6)
    reduced, sign, least = x / scale**4, 1.0, jkr_snap(jnp.ones_like(x))
    holds = reduced >= least
    if goes_on:
        sign = jnp.where(holds, 1.0, -1.0)
        reduced, holds = least + jnp.abs(reduced - least), jnp.ones_like(holds)
    # The quartic p⁴ - 4p/3 = d has the solution p = (√S + √(8/(3√S) - S))/2, S³ + 4 d S = 16/9.
    # This cubic has no double root.
    side = jnp.sqrt(_resolvent(jnp.where(holds, reduced, 1)))
    rest = 8 / (3 * side) - jnp.square(side)
    snaps = rest <= 0
    root = jnp.where(snaps, 0, jnp.sqrt(jnp.where(snaps, 1, rest)))
    return adheres, scale, (side + sign * root) / 2, holds


_resolvent = implicit_root(
    lambda s, d: s * (jnp.square(s) + 4 * d) - 16 / 9,
    # An upper bound, from which Newton's steps fall to the root.
    lambda d: jnp.minimum(
        (16 / 9) ** (1 / 3) + 2 * jnp.sqrt(jnp.maximum(-d, 0)), 4 / (9 * jnp.maximum(d, 0.1))
    ),
    iterations=12,
)


def _energy(q: Lane, root: Lane | float) -> Lane:
    cube = q**3
    return q**4 * (0.4 * jnp.square(cube) - (4 / 3) * root * cube + (2 / 3) * jnp.square(root))


_turn = implicit_root(
    lambda q, root: _energy(q, root) + _FALLS * power(root, 10 / 3) - 0.5,
    # At or above the root: Newton's steps fall to it.
    lambda root: power(1.25 + 0 * root, 0.1) + power(10 / 3 * root, 1 / 3),
    iterations=16,
)


def _times(root: Lane, _: float, unroll: int) -> tuple[Lane, Lane]:
    """Return the times from touch to turn, and from turn to snap."""
    turn, cube = _turn(root), power(root, 1 / 3)
    touch, balance, snap = ((k ** (1 / 3)) * cube for k in (4 / 3, 2, 1 / 3))

    # Bodies may be slow at touch and at the snap, where this rule is dense.
    dense = jnp.zeros_like(root)

    def from_turn(start: Lane, strength: Lane | float) -> Lane:
        """Return the time between q = `start` and the turn; q is `turn` minus a square there."""
        span = turn - start

        def integrand(node: Lane) -> Lane:
            q = turn - span * jnp.square(node)
            return (4 * q**3 - (4 / 3) * root) / jnp.sqrt(_fall(q, turn, root) / 2)

        return jnp.sqrt(span) * integrate(integrand, strength, root, unroll)

    speed = jnp.square(JKRForm(root=root)._end()[0])

    def near_snap(node: Lane) -> Lane:
        # dx/dq and Φ(snap) - Φ(q) have a single and a double root at the snap.
        r = (balance - snap) * node
        q = snap + r
        slope = 4 * r * (jnp.square(q) + q * snap + jnp.square(snap))
        left = speed + 2 * jnp.square(r) * _double_fall(q, snap, root)
        return slope / jnp.sqrt(jnp.where(left > 0, left, 1))

    ends = (balance - snap) * integrate(near_snap, dense, root, unroll)
    return from_turn(touch, dense), from_turn(balance, 0.0) + ends


def _fall(q: Lane, turn: Lane, root: Lane) -> Lane:
    """Return (Φ(turn) - Φ(q))/(turn - q)."""
    sums, total = jnp.ones_like(q), jnp.zeros_like(q)
    weights = {4: (2 / 3) * jnp.square(root), 7: -(4 / 3) * root, 10: 0.4 + 0 * root}
    for degree in range(1, 11):
        if degree in weights:
            total = total + weights[degree] * sums
        # The sum of turn^i q^j with i + j = degree.
        sums = turn**degree + q * sums
    return total


def _double_fall(q: Lane, snap: Lane, root: Lane) -> Lane:
    """Return (Φ(snap) - Φ(q))/(q - snap)²."""
    seconds, total = jnp.zeros_like(q), jnp.zeros_like(q)
    weights = {4: (2 / 3) * jnp.square(root), 7: -(4 / 3) * root, 10: 0.4 + 0 * root}
    for degree in range(1, 11):
        if degree in weights:
            total = total - weights[degree] * seconds
        # (q^k - s^k)/(q - s) = k s^(k-1) + (q - s) × seconds.
        seconds = degree * snap ** (degree - 1) + q * seconds
    return total


class AbstractAdhesive(AbstractRateLaw):
    """Elastic spheres that attract each other, without damping; they pull by their nature."""

    pull_off: Float[Array, "..."] = parameter("pull_off", NOT_NEGATIVE, "N")
    tension = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)
    damped: ClassVar[bool] = False
    _only_tension: ClassVar[tuple[bool, str] | None] = True, "pulls by adhesion"
    _per_radius: ClassVar[float]
    """The pull-off force over w R."""

    @classmethod
    def of_surfaces(cls, work_of_adhesion: ArrayLike, radius: ArrayLike) -> Self:
        """Return the law of surfaces with a work of adhesion w in J/m² (2γ for like surfaces of the
        surface energy γ) and the effective radius R in m, 1/R = 1/R1 + 1/R2.

        The pull-off force is (3/2) π w R of `JKR`, 2 π w R of `DMT`. Raises ValueError for a Python
        scalar out of range.
        """
        w = as_parameter(work_of_adhesion, "work_of_adhesion", NOT_NEGATIVE)
        return cls(pull_off=cls._per_radius * w * as_parameter(radius, "radius", NOT_NEGATIVE))


@register_law(
    "dmt",
    formula="K δ^(3/2) - F_po",
    source="Derjaguin, Muller & Toporov 1975, doi 10.1016/0021-9797(75)90018-1",
    valid="n = 3/2; small hard spheres; e = 1",
)
class DMT(AbstractAdhesive):
    """Derjaguin, Muller and Toporov's adhesion: Hertz less a constant, F = K δ^(3/2) - F_po.

    `pull_off` F_po ≥ 0 in N acts from touch until δ is zero again, so that nothing is lost: e = 1.
    It is valid for small, hard spheres of little adhesion, where `JKR` is for large, soft ones. The
    exponent is 3/2. `DMT.of_surfaces(w, R)` has F_po = 2 π w R.

    Raises ValueError for a Python scalar out of range, for `tension=False`, and, where it is used,
    for another exponent. Source: Derjaguin, Muller & Toporov (1975), J. Colloid Interface Sci.
    53:314, doi 10.1016/0021-9797(75)90018-1; Maugis (2000), Contact, Adhesion and Rupture of
    Elastic Solids, doi 10.1007/978-3-662-04125-3.
    """

    _per_radius: ClassVar[float] = 2 * math.pi

    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        require_exponent(self, contact)
        force = contact.stiffness * power(depth, 1.5) - self.pull_off
        return jnp.where(depth < 0, 0, force)

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        contact_for(contact, self)
        return DMTForm(adhesion=self.pull_off / needed(scale, "velocity", self).force)


@register_law(
    "jkr",
    formula="K z^(3/2) - 2 (K F_po)^(1/2) z^(3/4), δ = z - 4/3 (F_po/K)^(1/2) z^(1/4)",
    source="Johnson, Kendall & Roberts 1971, doi 10.1098/rspa.1971.0141",
    valid="n = 3/2; large soft spheres; e = √(1-(v_s/v0)²), sticks below v_s",
)
class JKR(AbstractAdhesive):
    """Johnson, Kendall and Roberts' adhesion: the neck of the contact snaps at δ < 0.

    `pull_off` F_po ≥ 0 in N is the largest pull. With z = a²/R of the contact radius a,
    F = K z^(3/2) - 2 √(K F_po) z^(3/4) and δ = z - (4/3) √(F_po/K) z^(1/4). The contact forms at
    δ = 0 with -8/9 F_po and snaps at δ = -3^(-1/3) (F_po/K)^(2/3) with -5/9 F_po. Each impact loses
    .648641 (F_po⁵/K²)^(1/3), so that e = √(1 - (v_s/v0)²). At or below the speed v_s of that energy
    the bodies stick: e = 0 and the status is SETTLED. Without damping they would then oscillate for
    ever.

    The exponent is 3/2. `JKR.of_surfaces(w, R)` has F_po = (3/2) π w R. e is a formula, and the
    times of free impacts are quadratures. External forces, trajectories, scenes and mechanisms are
    followed in time until the snap. Instantaneous impacts of scenes, and friction in scenes and
    mechanisms, raise ValueError.

    Raises ValueError for a Python scalar out of range, for `tension=False`, and, where it is used,
    for another exponent. Source: Johnson, Kendall & Roberts (1971), Proc. R. Soc. Lond. A 324:301,
    doi 10.1098/rspa.1971.0141; Johnson & Pollock (1994), J. Adhes. Sci. Technol. 8:1323,
    doi 10.1163/156856194X00672.
    """

    ends_apart: ClassVar[bool] = True
    _per_radius: ClassVar[float] = 1.5 * math.pi

    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        require_exponent(self, contact)
        return self._jkr(depth, contact, goes_on=False)

    def _force_of_closed(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        require_exponent(self, at.contact)
        return self._jkr(jnp.asarray(at.indentation), at.contact, goes_on=True)

    def _jkr(self, depth: Array, contact: Contact, goes_on: bool) -> Float[Array, "..."]:
        stiffness = contact.stiffness
        return stiffness * jkr_force(depth, self.pull_off / stiffness, goes_on)

    def _end_indentation(self, contact: Contact) -> Float[Array, "..."]:
        return jkr_snap(self.pull_off / contact.stiffness)

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        depth, stiffness = jnp.asarray(indentation), contact.stiffness
        energy = stiffness * jkr_energy(depth, self.pull_off / stiffness)
        return energy, jnp.zeros_like(energy)

    def form(self, contact: Contact | None, scale: Scale | None) -> JKRForm:
        contact_for(contact, self)
        force = needed(scale, "velocity", self).force
        return JKRForm(root=power(self.pull_off / force, 0.5))

    def sticking_speed(self, contact: Contact) -> Float[Array, "..."]:
        """Return v_s in m/s, at and below which the bodies stick: m v_s²/2 is the energy lost.

        Raises ValueError for anything that is not a contact.
        """
        stiffness = contact_for(contact, self).stiffness
        lost = LOSS * power(self.pull_off, 5 / 3) * power(stiffness, -2 / 3)
        return jnp.sqrt(2 * lost / contact.mass)
