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
from ..._functions import ratio, spin_axes
from ..arrays.arrays import Numbers, SceneLayout, least_speed
from ..arrays.flight import Flying
from ..arrays.turning import spin_energy
from ..cluster.equations import ClusterPairs, ClusterState, Drive
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
    return jax.tree.map(jnp.where, Rubbing(came, new[:, None], new, new), fresh, before)


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
    turns = jnp.where(seats.present, rows_of(numbers.rotation.inverse_inertia, who), 0)
    one, other = (spin_energy(turns, x.rubbing.spin[:members]) for x in (began, end))
    return jnp.sum(one - other)


def pace_of_contact(contact: Contact, speed: Number) -> Number:
    """Return X/v at a closing speed, about a third of an impact's duration in s."""
    n = contact.exponent
    return (contact.mass / contact.stiffness / speed ** (n - 1)) ** (1 / (n + 1))


class ContactPoints(NamedTuple):
    """All pairs at one state: unit normals, the velocities of first bodies `relative` to second
    ones, those of the contact points, those of the second bodies, and the arms.
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
    velocity, spin, first, second = state.velocity, state.rubbing.spin, pairs.first, pairs.second
    apart = pairs.between(state.position)
    curved = (pairs.used & ~pairs.flat)[:, None]
    safe = jnp.where(curved, apart, 1)
    length = jnp.sqrt(jnp.sum(jnp.square(safe), axis=1, keepdims=True))
    outwards = jnp.where(pairs.distance < 0, -1, 1)[:, None]
    normal = jnp.where(pairs.flat[:, None], pairs.normal, outwards * safe / length)

    def of(i: Array, j: Array, n: Array, flat: Array, d: Array | None) -> tuple[Arms, Array]:
        drift = wall_drift(numbers, jnp.maximum(j - layout.spheres, 0), state.time, n)
        return arms_of(layout, numbers, i, j, d), jnp.where(flat, drift, 0)

    arms, drift = jax.vmap(of)(*bodies, normal, pairs.flat, depth)
    moves = velocity[second] + drift
    relative, spins = velocity[first] - moves, jnp.stack([spin[first], spin[second]], axis=1)
    slip = jax.vmap(Arms.slip)(arms, normal, relative, spins)
    return ContactPoints(normal, relative, slip, moves, arms)


def speeds_of(before: Float[Array, "... D"], after: Float[Array, "... D"]) -> SlipSpeeds:
    """Return slip speeds before and after contacts; `after` is negative after a reversal."""
    one, other = (jnp.sum(jnp.square(x), axis=-1) for x in (before, after))
    sizes = [jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1)), 0) for x in (one, other)]
    reverses = jnp.sum(before * after, axis=-1) < 0
    return SlipSpeeds(sizes[0], jnp.where(reverses, -sizes[1], sizes[1]))


def without_halves(rubbing: Rubbing) -> Rubbing:
    """Return a state of friction in which pairs that had an impulse have springs without force."""
    half = rubbing.slides == HALF
    spring = jnp.where(half[:, None], 0, rubbing.spring)
    return rubbing._replace(spring=spring, slides=jnp.where(half, 0, rubbing.slides))


class Halves(NamedTuple):
    """The contacts of two bodies in a call whose friction is the impulse of a law's formula. As in
    isolated impacts it acts in halves, at the touch and at the opening; in between nothing rubs.

    `state` is that after the first halves. `acts` (P,) marks the contacts, and `others` those that
    begin with a spring. The call lasts `until` a time in s at most. `completed` is a function that
    adds the second halves to its end.
    """

    state: ClusterState
    acts: Flags
    others: Flags
    until: Number
    completed: Callable[[ClusterEnd], ClusterEnd]


def impulses(
    layout: SceneLayout,
    numbers: Numbers,
    bodies: tuple[Int[Array, " P"], Int[Array, " P"]],
    pairs: ClusterPairs,
    contact: Contact,
    slots: tuple[Float[Array, " slots"], Float[Array, "slots D"], Drive | None],
    state: ClusterState,
    decided: tuple[Flags, Any, Number, Flag],
) -> Halves | None:
    """Return the contacts with a friction impulse in a call; None if no law has one.

    `slots` holds 1/m, gravity and the drive, and what is `decided` are the pairs at rest, the rule
    of v0, the end of the call in s, and whether it goes to the end. A contact begins with an
    impulse if its bodies touch nothing else, and touched faster than forces could press them
    together within a part of the impact.
    """
    rubbing, (inverse, pull, drive), (rests, v0, until, to_the_end) = state.rubbing, slots, decided
    if rubbing is None or is_followed(numbers):
        return None
    first, second, mass = pairs.first, pairs.second, contact.mass

    def each(of: Callable[..., Any], *columns: Any) -> Any:
        return jax.vmap(lambda *row: of(layout, numbers, *row))(*bodies, *columns)

    def points(state: ClusterState) -> ContactPoints:
        depth = jnp.where(state.closed, state.indentation, 0)
        return contact_points(layout, numbers, bodies, pairs, state, depth)

    def alone(state: ClusterState) -> Flags:
        closed = state.closed & pairs.used
        contacts = jnp.zeros(inverse.shape, int)
        contacts = contacts.at[first].add(closed.astype(int)).at[second].add(closed.astype(int))
        single = (inverse == 0) | (contacts <= 1)
        return closed & single[first] & single[second]

    at, single, half = points(state), alone(state), rubbing.slides == HALF
    speed = jnp.maximum(jnp.where(single, state.latched, 1), least_speed(numbers))
    pace = pace_of_contact(contact, speed)
    closing = -jnp.sum(at.relative * at.normal, axis=1)
    begins = state.closed & pairs.used & ~rests & (state.since == state.time)
    press = jnp.sum(jnp.square(in_plane(at.relative, at.normal)), axis=1)
    press = press * jnp.maximum(-1 / pairs.distance, 0) + lengths(pull[first] - pull[second])
    if drive is not None:
        strong = lengths(drive.strength)
        for user, slot in drive.own:
            strong = strong.at[slot].add(user.bound, mode="drop")
        press = press + strong[first] + strong[second]
    touches = begins & single & ~half & each(has_impulse) & (press * pace < _PRESSED * closing)
    acts, mu = touches | (single & half), each(coefficient_of)
    most = jnp.where(touches, 2 * mu * mass * closing, 0)
    before = jax.vmap(coulomb_impulse)(at.arms, at.slip, most) / 2
    began, taken, work = _rubbed(pairs, at, state, before)
    before = jnp.where(touches[:, None], before, in_plane(rubbing.spring, at.normal))
    pressed = jnp.sum(rubbing.spring * at.normal, axis=1)
    lasts = jnp.where(acts, state.since + _LASTS * pace, jnp.inf)
    assert began.rubbing is not None
    still = without_halves(began.rubbing)
    # The last call may have changed the closing speed, and the slip, of a touch.
    least = 0.0 if isinstance(v0, str) else v0
    latched = jnp.where(begins, jnp.maximum(closing, least), state.latched)
    still = still._replace(slides=jnp.where(acts, 1, still.slides))
    began = began._replace(latched=latched, rubbing=still)

    def completed(end: ClusterEnd) -> ClusterEnd:
        """Add second halves. Contacts that last, are at rest, or whose bodies touch others, get a
        spring. They are at its start as after a whole impact with the normal impulse so far.
        """
        state, rubbing, at = end.state, end.state.rubbing, points(end.state)
        assert rubbing is not None
        # Gravity and one contact move a body that is free.
        gained = state.velocity - began.velocity - pull * (state.time - began.time)
        gained = ratio(gained, inverse[:, None])
        free = (inverse > 0)[first][:, None]
        push = pressed + lengths(jnp.where(free, gained[first], gained[second]))
        turned = in_plane(before, at.normal)
        turned = turned * ratio(lengths(before), lengths(turned))[:, None]
        late = state.time - state.since >= 0.99 * (lasts - state.since)
        stops = to_the_end | (end.status == AT_REST) | (end.status == PAUSED)
        ends, opens = acts & (~alone(state) | late | stops), ~state.closed
        mobility = at.arms.tangential[:, None]
        slip = jnp.where(ends[:, None], at.slip - mobility * turned, 0)
        speed = jnp.maximum(jnp.where(ends, state.latched, 1), least_speed(numbers))
        e = jnp.where(ends, push / (mass * speed) - 1, 0)
        whole, _, known = each(friction_impulse, at.arms, slip, speed, e)
        whole = jnp.where(known[:, None], whole, jnp.nan)
        # The law of an impact may not hold for one that lasts.
        by_law = opens | (known & (e >= 0) & (e <= 1))
        coulomb = jax.vmap(coulomb_impulse)(at.arms, slip, mu * push)
        whole = jnp.where(by_law[:, None], whole, coulomb)
        done = _rubbed(pairs, at, state, jnp.where(ends[:, None], whole - turned, 0))
        left = slip + mobility * whole
        slides = lengths(left) > 8 * jnp.finfo(speed.dtype).eps * lengths(slip)
        # In sliding only the direction of the spring counts; its force here is above all limits.
        force = jnp.where(slides, mu * mass * speed * _LASTS / pace, 0)
        spring = -ratio(force, lengths(left))[:, None] * left
        spring = jnp.where(ends[:, None], spring, turned + push[:, None] * at.normal)
        slides = jnp.where(ends & ~opens, slides.astype(speed.dtype), HALF)
        # The error of the frozen normal, see `HalfImpulses`.
        turn = jnp.where(pairs.flat, 0, (state.time - state.since) / jnp.abs(pairs.distance))
        fast = jnp.hypot(speed, lengths(in_plane(at.relative, at.normal)))
        doubt = lengths(whole) * jnp.sum(at.arms.inverse_mass, axis=1) * turn * fast
        lost = taken + done[1]
        return end._replace(
            state=done[0]._replace(
                rubbing=Rubbing(
                    done[0].rubbing.spin,
                    jnp.where(acts[:, None], spring, rubbing.spring),
                    jnp.where(acts, slides, rubbing.slides),
                    rubbing.taken + lost,
                )
            ),
            work=end.work + work + done[2],
            error=end.error + jax.lax.stop_gradient(jnp.sum(jnp.where(ends, doubt, 0))),
            rubbed=end.rubbed + jnp.sum(lost),
        )

    return Halves(began, acts, begins & ~acts, jnp.minimum(until, jnp.min(lasts)), completed)


def _rubbed(
    pairs: ClusterPairs, at: ContactPoints, state: ClusterState, impulse: Vectors
) -> tuple[ClusterState, PerContact, Number]:
    """Return a state after friction impulses on the first bodies, the energies they take, and the
    work of bodies in prescribed motion.
    """
    assert state.rubbing is not None
    moved, turned = jax.vmap(Arms.kick)(at.arms, at.normal, impulse)
    first, second, inverse = pairs.first, pairs.second, at.arms.inverse_mass

    def both(old: Array, change: Array) -> Array:
        return old.at[first].add(change[:, 0]).at[second].add(change[:, 1])

    taken = jax.vmap(Arms.lost)(at.arms, at.slip, impulse)
    drives = jnp.where(inverse[:, 1:] > 0, 0, at.second)
    drives = drives - jnp.where(inverse[:, :1] > 0, 0, state.velocity[first])
    rubbing = state.rubbing._replace(spin=both(state.rubbing.spin, turned))
    state = state._replace(velocity=both(state.velocity, moved), rubbing=rubbing)
    return state, taken, jnp.sum(impulse * drives)
