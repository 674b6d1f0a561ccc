"""Friction of the bodies in a coupled solve: its numbers, its start, and what follows from its end.

A regularised law acts there by its ramp, every other one by its μ and one spring.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._contact import Contact
from ..._coupled.modes import AT_REST, PAUSED, PerContact
from ..._coupled.rows import rows_of
from ..._coupled.scalars import Flag, Number
from ..._coupled.springs import Vectors, lengths
from ..._functions import spin_axes
from ..._laws import AbstractLaw, force_of_closed
from ..arrays.arrays import Numbers, SceneLayout, least_speed
from ..arrays.flight import Flying
from ..cluster.equations import ClusterPairs, ClusterState
from ..cluster.friction import HALF, PairFriction, Rubbing, in_plane
from ..cluster.problem import ClusterEnd
from ..pair_impact.friction import (
    Arms,
    SlipSpeeds,
    arms_of,
    coefficient_of,
    friction_impulse,
    has_impulse,
    is_followed,
    ramps_of,
    spring_ratio_of,
    wall_drift,
)
from ..pair_impact.half_impulses import coulomb_impulse
from ..pair_impact.rolling import footing, slips
from .cluster_slots import Slots, slot_pairs

Flags = Bool[Array, " P"]

_PRESSED = 0.4
"""The closing speed that forces across a contact may add in X/v0, of that at its touch. Faster
pressing makes a contact that lasts rather than an impact."""

_LASTS = 8
"""The time in X/v0, about a third of an impact, after which a contact counts as lasting."""


def pair_friction(
    layout: SceneLayout,
    numbers: Numbers,
    seats: Slots,
    pairs: tuple[Int[Array, " P"], Int[Array, " P"]],
    begins: Flags,
    halves: Halves | None,
) -> PairFriction | None:
    """Return the friction of the `pairs` of bodies, of which some touch just now; None without. In
    contacts of `halves` nothing rubs.
    """
    if numbers.rotation is None:
        return None
    one, other = pairs
    members = seats.who.shape[0]
    who = jnp.minimum(seats.who, layout.spheres - 1)
    flat = jnp.ones(layout.walls, numbers.dtype)
    turns = rows_of(numbers.rotation.inverse_inertia, who)
    turns = jnp.where(seats.present, turns, 0)
    wall = jnp.maximum(jnp.asarray(slot_pairs(layout, members)[1]) - members, 0)
    mu = jax.vmap(lambda i, j: coefficient_of(layout, numbers, i, j))(one, other)
    if halves is not None:
        mu, begins = jnp.where(halves.acts, 0, mu), halves.others
    return PairFriction(
        mu=mu,
        ratio=jax.vmap(lambda i, j: spring_ratio_of(layout, numbers, i, j))(one, other),
        ramp=ramps_of(layout, numbers, one, other),
        radius=jnp.concatenate([rows_of(numbers.radius, who), flat]),
        inverse_inertia=jnp.concatenate([turns, jnp.zeros_like(flat)]),
        begins=begins,
        drift=numbers.rotation.drift if layout.walls else None,
        wall=wall,
    )


def fresh_rubbing(
    layout: SceneLayout,
    numbers: Numbers,
    seats: Slots,
    there: Flying,
    support: Int[Array, " M"],
    rests: Flags,
) -> Rubbing | None:
    """Return spins, and the friction of spheres that rest on walls; other pairs have none yet."""
    members, dtype = seats.who.shape[0], numbers.dtype
    first, _ = slot_pairs(layout, members)
    blank = blank_rubbing(layout, members + layout.walls, first.shape[0], dtype)
    if there.turning is None or blank is None:
        return None
    who = jnp.minimum(seats.who, layout.spheres - 1)
    still = jnp.zeros((layout.walls, spin_axes(layout.dimensions)), dtype)
    spin = jnp.concatenate([there.turning.spin, still])
    if not layout.walls:
        return blank._replace(spin=spin)
    inverse = rows_of(numbers.inverse_mass, who)
    force = there.turning.drag / jnp.where(inverse > 0, inverse, 1)[:, None]
    moves = slips(footing(layout, numbers, who, jnp.maximum(support, 0), there))
    spring = jnp.where(rests[:, None], rows_of(force, first), 0)
    slides = rests & rows_of(moves, first)
    return blank._replace(spin=spin, spring=spring, slides=slides.astype(dtype))


def joined_rubbing(
    fresh: Rubbing | None, before: Rubbing | None, came: Bool[Array, "slots 1"], new: Flags
) -> Rubbing | None:
    """Return the state of friction: `fresh` for bodies that `came` and `new` pairs."""
    if fresh is None or before is None:
        return None
    return Rubbing(
        jnp.where(came, fresh.spin, before.spin),
        jnp.where(new[:, None], fresh.spring, before.spring),
        jnp.where(new, fresh.slides, before.slides),
        jnp.where(new, fresh.taken, before.taken),
    )


def blank_rubbing(layout: SceneLayout, slots: int, pairs: int, dtype: Any) -> Rubbing | None:
    """Return no friction; None in a scene without."""
    if layout.frictions is None:
        return None
    spin = jnp.zeros((slots, spin_axes(layout.dimensions)), dtype)
    spring = jnp.zeros((pairs, layout.dimensions), dtype)
    each = jnp.zeros(pairs, dtype)
    return Rubbing(spin, spring, each, each)


def spin_energy_lost(
    layout: SceneLayout, numbers: Numbers, seats: Slots, began: ClusterState, end: ClusterState
) -> Number:
    """Return the energy of rotation that the members lose in a call, in J."""
    assert began.rubbing is not None and end.rubbing is not None and numbers.rotation is not None
    who, members = jnp.minimum(seats.who, layout.spheres - 1), seats.who.shape[0]
    turns = rows_of(numbers.rotation.inverse_inertia, who)
    counts = seats.present & (turns > 0)
    inertia = jnp.where(counts, 1 / jnp.where(counts, turns, 1), 0)
    spins = began.rubbing.spin[:members], end.rubbing.spin[:members]
    before, after = (jnp.sum(jnp.square(spin), axis=1) for spin in spins)
    return jnp.sum(inertia * (before - after)) / 2


def pace_of_contact(contact: Contact, speed: Number) -> Number:
    """Return X/v at a closing speed, about a third of an impact's duration in s."""
    n = contact.exponent
    return (contact.mass / contact.stiffness / speed ** (n - 1)) ** (1 / (n + 1))


class ContactPoints(NamedTuple):
    """All pairs at one state: unit normals, the velocities of the first bodies `relative` to the
    second ones, those of the contact points, those of the second bodies, and the arms.
    """

    normal: Vectors
    relative: Vectors
    slip: Vectors
    second: Vectors
    arms: Arms


def contact_points(
    layout: SceneLayout,
    numbers: Numbers,
    bodies: tuple[Int[Array, " P"], Int[Array, " P"]],
    pairs: ClusterPairs,
    state: ClusterState,
    depth: PerContact | None = None,
) -> ContactPoints:
    """Return the contact points of all pairs of `bodies`, by default at the distance of touch."""
    assert state.rubbing is not None
    spin, first, second = state.rubbing.spin, pairs.first, pairs.second
    apart = pairs.between(state.position)
    curved = (pairs.used & ~pairs.flat)[:, None]
    safe = jnp.where(curved, apart, 1)
    length = jnp.sqrt(jnp.sum(jnp.square(safe), axis=1, keepdims=True))
    outwards = jnp.where(pairs.distance < 0, -1, 1)[:, None]
    normal = jnp.where(pairs.flat[:, None], pairs.normal, outwards * safe / length)
    wall = jnp.maximum(second - spin.shape[0] + layout.walls, 0)
    velocity, spins = state.velocity, jnp.stack([spin[first], spin[second]], axis=1)

    def of(i: Array, j: Array, n: Array, v: Array, w: Array, wall: Array, flat: Array, d: Any):
        carried = jnp.where(flat, wall_drift(numbers, wall, state.time, n), 0) + w
        return arms_of(layout, numbers, i, j, d), v - carried, carried

    columns = normal, velocity[first], velocity[second], wall, pairs.flat, depth
    arms, relative, carried = jax.vmap(of)(*bodies, *columns)
    slip = jax.vmap(Arms.slip)(arms, normal, relative, spins)
    return ContactPoints(normal, relative, slip, carried, arms)


def speeds_of(before: Float[Array, "... D"], after: Float[Array, "... D"]) -> SlipSpeeds:
    """Return slip speeds before and after contacts; `after` is negative after a reversal."""
    one, other = (jnp.sum(jnp.square(x), axis=-1) for x in (before, after))
    sizes = [jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1)), 0) for x in (one, other)]
    reverses = jnp.sum(before * after, axis=-1) < 0
    return SlipSpeeds(sizes[0], jnp.where(reverses, -sizes[1], sizes[1]))


class Halves(NamedTuple):
    """The contacts of two bodies whose friction is the impulse of a law's formula. It acts in two
    halves, at the touch and at the opening, as in isolated impacts; in between nothing rubs.

    `acts` (P,) marks them in a call, which starts at `state`, after the first halves, and `others`
    the pairs that touch then with a spring. `rubbed` (P, D) and `pressed` are the impulses of
    friction and of the normal force so far, in N s. A contact that lasts beyond `until` in s gets a
    spring. `taken` and `work` in J are the energies that the first halves take, and the work of
    moving bodies.
    """

    state: ClusterState
    acts: Flags
    others: Flags
    rubbed: Vectors
    pressed: PerContact
    until: PerContact
    taken: PerContact
    work: Number


class Setting(NamedTuple):
    """The scene of a call, its bodies, laws and contacts by pair, and 1/m and gravity by slot."""

    layout: SceneLayout
    numbers: Numbers
    bodies: tuple[Int[Array, " P"], Int[Array, " P"]]
    pairs: ClusterPairs
    law: AbstractLaw
    contact: Contact
    inverse: Float[Array, " slots"]
    pull: Float[Array, "slots D"]

    def points(self, state: ClusterState) -> ContactPoints:
        """Return the contact points of all pairs."""
        depth = jnp.where(state.closed, state.indentation, 0)
        return contact_points(*self[:4], state, depth)

    def each(self, of: Callable[..., Any], *columns: Any) -> Any:
        """Return a function of the scene and the bodies for all pairs."""
        return jax.vmap(lambda *row: of(self.layout, self.numbers, *row))(*self.bodies, *columns)

    def alone(self, state: ClusterState) -> Flags:
        """Return the pairs in contact of which no body that moves has another contact."""
        closed, (first, second) = state.closed & self.pairs.used, self.pairs[:2]
        count = closed.astype(int)
        contacts = jnp.zeros(self.inverse.shape, int).at[first].add(count).at[second].add(count)
        single = (self.inverse == 0) | (contacts <= 1)
        return closed & rows_of(single, first) & rows_of(single, second)

    def pressing(self, at: ContactPoints) -> PerContact:
        """Return a bound on the accelerations that press the bodies of pairs together, in m/s²."""
        layout, numbers, (first, second) = self.layout, self.numbers, self.pairs[:2]
        inside = jnp.where(self.pairs.distance < 0, -self.pairs.distance, jnp.inf)
        press = jnp.sum(jnp.square(in_plane(at.relative, at.normal)), axis=1) / inside
        press = press + lengths(rows_of(self.pull, first) - rows_of(self.pull, second))
        if numbers.shaking is not None:
            strong = jnp.append(numbers.shaking.strongest, jnp.zeros(1, press.dtype))
            for body in self.bodies:
                row = layout.shaken_row(jnp.minimum(body, layout.spheres - 1))
                press = press + jnp.where(body < layout.spheres, strong[row], 0)
        if numbers.motion is not None:
            wall = self.bodies[1] - layout.spheres
            strong = rows_of(numbers.motion.strongest, jnp.maximum(wall, 0))
            press = press + jnp.where(wall < 0, 0, strong)
        return press

    def rubbed(
        self, at: ContactPoints, state: ClusterState, impulse: Vectors
    ) -> tuple[ClusterState, PerContact, Number]:
        """Return a state after friction impulses on the first bodies, the energies they take, and
        the work of bodies in prescribed motion.
        """
        assert state.rubbing is not None
        moved, turned = jax.vmap(Arms.kick)(at.arms, at.normal, impulse)
        first, second, inverse = *self.pairs[:2], at.arms.inverse_mass

        def both(old: Array, change: Array) -> Array:
            return old.at[first].add(change[:, 0]).at[second].add(change[:, 1])

        taken = jax.vmap(Arms.lost)(at.arms, at.slip, impulse)
        drives = jnp.where(inverse[:, 1:] > 0, 0, at.second)
        drives = drives - jnp.where(inverse[:, :1] > 0, 0, rows_of(state.velocity, first))
        rubbing = state.rubbing._replace(spin=both(state.rubbing.spin, turned))
        state = state._replace(velocity=both(state.velocity, moved), rubbing=rubbing)
        return state, taken, jnp.sum(impulse * drives)


def first_halves(setting: Setting, state: ClusterState, rests: Flags, v0: Any) -> Halves | None:
    """Return the contacts with a friction impulse at the start of a call; None if there are none.

    Their bodies touch nothing else, and they touched faster than forces could press them together
    within a part of the impact.
    """
    rubbing, numbers = state.rubbing, setting.numbers
    if rubbing is None or is_followed(numbers):
        return None
    at, alone = setting.points(state), setting.alone(state)
    goes_on = alone & (rubbing.slides == HALF)
    begins = state.closed & setting.pairs.used & ~rests & (state.since == state.time)
    touches = begins & alone & ~goes_on & setting.each(has_impulse)
    speed = jnp.maximum(jnp.where(alone, state.latched, 1), least_speed(numbers))
    pace = pace_of_contact(setting.contact, speed)
    closing = -jnp.sum(at.relative * at.normal, axis=1)
    touches = touches & (setting.pressing(at) * pace <= _PRESSED * closing)
    most = 2 * setting.each(coefficient_of) * setting.contact.mass * closing
    half = jax.vmap(coulomb_impulse)(at.arms, at.slip, jnp.where(touches, most, 0)) / 2
    after, taken, work = setting.rubbed(at, state, half)
    pressed = jnp.where(goes_on, jnp.sum(rubbing.spring * at.normal, axis=1), 0)
    before = jnp.where(goes_on[:, None], in_plane(rubbing.spring, at.normal), half)
    acts = touches | goes_on
    assert after.rubbing is not None
    still = after.rubbing._replace(
        slides=jnp.where(acts, 1, jnp.minimum(rubbing.slides, 1)),
        spring=jnp.where(acts[:, None], 0, rubbing.spring),
    )
    until = jnp.where(acts, state.since + _LASTS * pace, jnp.inf)
    # An impulse of the last call may have changed the closing speed, and the slip, at a touch.
    anew = jnp.where(
        begins, jnp.maximum(closing, 0.0 if isinstance(v0, str) else v0), state.latched
    )
    after, others = after._replace(rubbing=still, latched=anew), begins & ~acts
    return Halves(after, acts, others, before, pressed, until, taken, work)


def with_second_halves(
    setting: Setting, halves: Halves | None, end: ClusterEnd, to_the_end: Flag
) -> ClusterEnd:
    """Return the end of a call with the second halves of contacts that opened. Those that last, or
    whose bodies touch others, get a spring: they are at its start as after a whole impact with the
    normal impulse so far. So do all at rest, and at the limit of steps.
    """
    if halves is None:
        return end
    state, pairs, acts = end.state, setting.pairs, halves.acts
    at, numbers, rubbing = setting.points(state), setting.numbers, state.rubbing
    assert rubbing is not None
    # Nothing but gravity and one contact moves a body.
    moves = setting.inverse > 0
    fall = setting.pull * (state.time - halves.state.time)
    gained = state.velocity - halves.state.velocity - fall
    gained = gained / jnp.where(moves, setting.inverse, jnp.inf)[:, None]
    one, other = rows_of(gained, pairs.first), rows_of(gained, pairs.second)
    one = jnp.where(rows_of(moves, pairs.first)[:, None], one, -other)
    pressed = halves.pressed + lengths(one)
    turned = in_plane(halves.rubbed, at.normal)
    size = lengths(turned)
    turned = turned * (lengths(halves.rubbed) / jnp.where(size > 0, size, 1))[:, None]
    mobility = at.arms.tangential[:, None]
    stops = to_the_end | (end.status == AT_REST) | (end.status == PAUSED)
    late = state.time - state.since >= 0.99 * (halves.until - state.since)
    ends = acts & (~setting.alone(state) | late | stops)
    slip = jnp.where(ends[:, None], at.slip - mobility * turned, 0)
    speed = jnp.maximum(jnp.where(ends, state.latched, 1), least_speed(numbers))
    e = jnp.where(ends, pressed / (setting.contact.mass * speed) - 1, 0)
    whole, _, known = setting.each(friction_impulse, at.arms, slip, speed, e)
    mu = setting.each(coefficient_of)
    lasting = jax.vmap(coulomb_impulse)(at.arms, slip, mu * pressed)
    by_law = known & (~state.closed | ((e >= 0) & (e <= 1)))
    whole = jnp.where((by_law | ~state.closed)[:, None], whole, lasting)
    whole = jnp.where((by_law | state.closed)[:, None], whole, jnp.nan)
    impulse = jnp.where(ends[:, None], whole - turned, 0)
    after, taken, work = setting.rubbed(at, state, impulse)
    assert after.rubbing is not None
    left = slip + mobility * whole
    pace = lengths(left)
    sliding = pace > 8 * jnp.finfo(speed.dtype).eps * lengths(slip)
    slides = jnp.where(ends, sliding.astype(speed.dtype), rubbing.slides)
    # The spring of a contact that slides has the force at the limit.
    depth, rate = (
        jnp.where(state.closed, state.indentation, 0),
        -jnp.sum(at.relative * at.normal, 1),
    )
    forces = force_of_closed(setting.law, depth, rate, setting.contact, speed, state.deepest)
    grip = mu * jnp.where(sliding, jnp.maximum(forces, 0) / jnp.where(sliding, pace, 1), 0)
    so_far = turned + pressed[:, None] * at.normal
    spring = jnp.where(ends[:, None], -grip[:, None] * left, so_far)
    now = after.rubbing._replace(
        slides=jnp.where(acts & ~(ends & state.closed), HALF, slides),
        spring=jnp.where(acts[:, None], spring, rubbing.spring),
        taken=rubbing.taken + halves.taken + taken,
    )
    lasted = jnp.where(pairs.flat, 0, state.time - state.since) / jnp.abs(pairs.distance)
    angle = lengths(whole) * jnp.sum(at.arms.inverse_mass, axis=1) * lasted
    across = lengths(in_plane(at.relative, at.normal))
    doubt = jnp.where(ends, angle * jnp.hypot(speed, across), 0)
    return end._replace(
        state=after._replace(rubbing=now),
        work=end.work + halves.work + work,
        error=end.error + jax.lax.stop_gradient(jnp.sum(doubt)),
        rubbed=end.rubbed + jnp.sum(halves.taken + taken),
    )
