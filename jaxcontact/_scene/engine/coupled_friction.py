"""Friction of the bodies in a coupled solve: its numbers, its start, and what follows from its end.

A regularised law acts there by its ramp, every other one by its μ and one spring.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._contact import Contact
from ..._coupled.modes import AT_REST, PAUSED, Flag, Number, PerContact
from ..._coupled.rows import rows_of
from ..._coupled.springs import Vectors, lengths
from ..._functions import ratio, spin_axes
from ..arrays.arrays import Flying, SceneArrays, least_speed
from ..arrays.movers import spin_energy
from ..cluster.friction import HALF, PairFriction, Rubbing, in_plane
from ..cluster.problem import ClusterEnd, ClusterPairs, ClusterState, Drive
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
from ..pair_impact.soft import coulomb_impulse
from .rest import footing, slips
from .slots import pace_of_contact, slot_pairs
from .state import Slots

Flags = Bool[Array, " P"]

_PRESSED = 0.4
"""The closing speed that forces across a contact may add in X/v0, of that at its touch. Faster
pressing makes a contact that lasts rather than an impact."""

_LASTS = 8
"""The time in X/v0, about a third of an impact, after which a contact counts as lasting."""


def pair_friction(
    setting: tuple[SceneArrays, tuple[Array, Array], ClusterPairs],
    slots: Slots,
    begins: Flags,
    impulsive: tuple[Flags, Flags] | None,
) -> PairFriction | None:
    """Return the friction of the pairs, of which some touch just now; None without. Nothing rubs
    in contacts with impulses, for which, and for the `setting`, see `impulses`.
    """
    model, (one, other), pairs = setting
    if model.rotation is None:
        return None
    size = slots.size
    who = jnp.minimum(slots.who, model.spheres - 1)
    flat = jnp.ones(model.walls, model.dtype)
    turns = rows_of(model.rotation.inverse_inertia, who)
    turns = jnp.where(slots.present, turns, 0)
    wall = jnp.maximum(pairs.second - size, 0)
    mu = jax.vmap(lambda i, j: coefficient_of(model, i, j))(one, other)
    if impulsive is not None:
        mu, begins = jnp.where(impulsive[0], 0, mu), impulsive[1]
    return PairFriction(
        mu=mu,
        ratio=jax.vmap(lambda i, j: spring_ratio_of(model, i, j))(one, other),
        ramp=ramps_of(model, one, other),
        radius=jnp.concatenate([rows_of(model.radius, who), flat]),
        inverse_inertia=jnp.concatenate([turns, jnp.zeros_like(flat)]),
        begins=begins,
        drift=model.rotation.drift if model.walls else None,
        wall=wall,
    )


def fresh_rubbing(
    model: SceneArrays, slots: Slots, there: Flying, support: Int[Array, " M"], rests: Flags
) -> Rubbing | None:
    """Return spins, and the friction of spheres that rest on walls; other pairs have none yet."""
    size, dtype = slots.size, model.dtype
    first, _ = slot_pairs(model, size)
    blank = blank_rubbing(model, size + model.walls, first.shape[0])
    if there.turning is None or blank is None:
        return None
    who = jnp.minimum(slots.who, model.spheres - 1)
    still = jnp.zeros((model.walls, spin_axes(model.dimensions)), dtype)
    spin = jnp.concatenate([there.turning.spin, still])
    if not model.walls:
        return blank._replace(spin=spin)
    inverse = rows_of(model.inverse_mass, who)
    force = there.turning.drag / jnp.where(inverse > 0, inverse, 1)[:, None]
    moves = slips(footing(model, who, jnp.maximum(support, 0), there))
    spring = jnp.where(rests[:, None], rows_of(force, first), 0)
    slides = rests & rows_of(moves, first)
    return blank._replace(spin=spin, spring=spring, slides=slides.astype(dtype))


def joined_rubbing(
    fresh: Rubbing | None, before: Rubbing | None, came: Bool[Array, "S 1"], new: Flags
) -> Rubbing | None:
    """Return the state of friction: `fresh` for bodies that `came` and `new` pairs."""
    if fresh is None or before is None:
        return None
    return jax.tree.map(jnp.where, Rubbing(came, new[:, None], new, new), fresh, before)


def blank_rubbing(model: SceneArrays, total: int, pairs: int) -> Rubbing | None:
    """Return no friction; None in a scene without."""
    if model.frictions is None:
        return None
    spin = jnp.zeros((total, spin_axes(model.dimensions)), model.dtype)
    spring = jnp.zeros((pairs, model.dimensions), model.dtype)
    each = jnp.zeros(pairs, model.dtype)
    return Rubbing(spin, spring, each, each)


def spin_energy_lost(
    model: SceneArrays, slots: Slots, began: ClusterState, end: ClusterState
) -> Number:
    """Return the energy of rotation that the spheres lose in a call, in J."""
    assert began.rubbing is not None and end.rubbing is not None and model.rotation is not None
    who, size = jnp.minimum(slots.who, model.spheres - 1), slots.size
    turns = jnp.where(slots.present, rows_of(model.rotation.inverse_inertia, who), 0)
    before = spin_energy(turns, began.rubbing.spin[:size])
    return jnp.sum(before - spin_energy(turns, end.rubbing.spin[:size]))


def contact_points(
    model: SceneArrays,
    bodies: tuple[Int[Array, " P"], Int[Array, " P"]],
    pairs: ClusterPairs,
    state: ClusterState,
    depth: PerContact | None = None,
) -> tuple[Vectors, Vectors, Vectors, Vectors, Arms]:
    """Return the unit normals of all pairs of `bodies`, relative velocities of their centres and of
    their contact points, the velocities of the second ones, and the arms. These are by default at
    the distance of touch.
    """
    assert state.rubbing is not None
    velocity, spin, first, second = state.velocity, state.rubbing.spin, pairs.first, pairs.second
    apart = pairs.between(state.position)
    curved = (pairs.used & ~pairs.flat)[:, None]
    safe = jnp.where(curved, apart, 1)
    length = jnp.sqrt(jnp.sum(jnp.square(safe), axis=1, keepdims=True))
    outwards = jnp.where(pairs.distance < 0, -1, 1)[:, None]
    normal = jnp.where(pairs.flat[:, None], pairs.normal, outwards * safe / length)

    def of(i: Array, j: Array, n: Array, flat: Array, d: Array | None) -> tuple[Arms, Array]:
        drift = wall_drift(model, jnp.maximum(j - model.spheres, 0), state.time, n)
        return arms_of(model, i, j, d), jnp.where(flat, drift, 0)

    arms, drift = jax.vmap(of)(*bodies, normal, pairs.flat, depth)
    moves = velocity[second] + drift
    relative, spins = velocity[first] - moves, jnp.stack([spin[first], spin[second]], axis=1)
    slip = jax.vmap(Arms.slip)(arms, normal, relative, spins)
    return normal, relative, slip, moves, arms


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


def _added(pairs: ClusterPairs, old: Array, change: Array) -> Array:
    """Return numbers of bodies with the changes of both bodies of each pair."""
    return old.at[pairs.first].add(change[:, 0]).at[pairs.second].add(change[:, 1])


def _alone(pairs: ClusterPairs, inverse: Array, state: ClusterState) -> Flags:
    """Return the contacts in which no free body has another one."""
    closed = state.closed & pairs.used
    both = jnp.stack([closed, closed], axis=1).astype(int)
    single = (inverse == 0) | (_added(pairs, jnp.zeros(inverse.shape, int), both) <= 1)
    return closed & single[pairs.first] & single[pairs.second]


def _pressing(pairs: ClusterPairs, along: Vectors, pull: Array, drive: Drive | None) -> PerContact:
    """Return bounds on the accelerations in m/s² that press bodies together, whose velocities
    `along` each other turn the normals of hollow ones.
    """
    first, second = pairs.first, pairs.second
    turning = jnp.sum(jnp.square(along), axis=1) * jnp.maximum(-1 / pairs.distance, 0)
    press = turning + lengths(pull[first] - pull[second])
    if drive is None:
        return press
    strong = lengths(drive.strength)
    for user, slot in drive.own:
        strong = strong.at[slot].add(user.bound, mode="drop")
    return press + strong[first] + strong[second]


def impulses(
    setting: tuple[SceneArrays, tuple[Array, Array], ClusterPairs],
    contact: Contact,
    moved_by: tuple[Float[Array, " S"], Float[Array, "S D"], Drive | None],
    state: ClusterState,
    decided: tuple[Flags, Number, Flag],
) -> tuple[ClusterState, Number, tuple[Flags, Flags] | None, Callable[[ClusterEnd], ClusterEnd]]:
    """Start a call with contacts of two bodies whose friction is the impulse of a law's formula.
    As in isolated impacts it acts in halves, at the touch and at the opening; in between nothing
    rubs. Return the state after the first halves, and the longest end of the call in s. Then follow
    these contacts, the others that begin, and a function that adds the second halves to the end.

    The `setting` are the scene, the bodies of pairs, and these. `moved_by` holds 1/m, gravity and
    drive, and what is `decided` are the pairs at rest, the end of the call, and whether it goes to
    the end. A contact has an impulse if its bodies touch nothing else, and touched faster than
    forces could press them together within a part of the impact.
    """
    (model, bodies, pairs), (inverse, pull, drive) = setting, moved_by
    (rests, until, to_the_end), rubbing = decided, state.rubbing
    if rubbing is None or is_followed(model):
        return state, until, None, lambda end: end
    first, second, mass = pairs.first, pairs.second, contact.mass

    def each(of: Callable[..., Any], *columns: Any) -> Any:
        return jax.vmap(lambda *row: of(model, *row))(*bodies, *columns)

    def points(state: ClusterState) -> tuple:
        depth = jnp.where(state.closed, state.indentation, 0)
        return contact_points(*setting, state, depth)

    def rubbed(state: ClusterState, at: tuple, impulse: Vectors) -> tuple:
        """Return a state after friction impulses on the first bodies, the energies they take, and
        the work of bodies in prescribed motion.
        """
        normal, _, slip, moves, arms = at
        moved, turned = jax.vmap(Arms.kick)(arms, normal, impulse)
        drives = jnp.where(arms.inverse_mass[:, 1:] > 0, 0, moves)
        drives = drives - jnp.where(arms.inverse_mass[:, :1] > 0, 0, state.velocity[first])
        assert state.rubbing is not None
        rubbing = state.rubbing._replace(spin=_added(pairs, state.rubbing.spin, turned))
        state = state._replace(velocity=_added(pairs, state.velocity, moved), rubbing=rubbing)
        return state, jax.vmap(Arms.lost)(arms, slip, impulse), jnp.sum(impulse * drives)

    normal, relative, slip, _, arms = at = points(state)
    single, half = _alone(pairs, inverse, state), rubbing.slides == HALF
    speed = jnp.maximum(jnp.where(single, state.latched, 1), least_speed(model))
    pace = pace_of_contact(contact, speed)
    closing = -jnp.sum(relative * normal, axis=1)
    begins = state.closed & pairs.used & ~rests & (state.since == state.time)
    press = _pressing(pairs, in_plane(relative, normal), pull, drive)
    touches = begins & single & ~half & each(has_impulse) & (press * pace < _PRESSED * closing)
    acts, mu = touches | (single & half), each(coefficient_of)
    most = jnp.where(touches, 2 * mu * mass * closing, 0)
    before = jax.vmap(coulomb_impulse)(arms, slip, most) / 2
    began, *given = rubbed(state, at, before)
    before = jnp.where(touches[:, None], before, in_plane(rubbing.spring, normal))
    pressed = jnp.sum(rubbing.spring * normal, axis=1)
    lasts = jnp.where(acts, state.since + _LASTS * pace, jnp.inf)
    still = without_halves(began.rubbing)
    # An impulse of the last call may have changed the speed of a touch.
    fastest = jnp.maximum(closing, least_speed(model))
    latched = jnp.where(begins, fastest, state.latched)
    still = still._replace(slides=jnp.where(acts, 1, still.slides))
    began = began._replace(latched=latched, rubbing=still)

    def completed(end: ClusterEnd) -> ClusterEnd:
        """Add second halves. Contacts that last, are at rest, or whose bodies touch others, get a
        spring. They are at its start as after a whole impact with the normal impulse so far.
        """
        state, rubbing, lasted = end.state, end.state.rubbing, end.state.time - end.state.since
        normal, relative, slip, _, arms = at = points(state)
        assert rubbing is not None and end.rubbed is not None
        # Gravity and one contact move a body that is free.
        gained = state.velocity - began.velocity - pull * (state.time - began.time)
        gained = ratio(gained, inverse[:, None])
        gained = jnp.where((inverse > 0)[first][:, None], gained[first], gained[second])
        push, turned = pressed + lengths(gained), in_plane(before, normal)
        turned = turned * ratio(lengths(before), lengths(turned))[:, None]
        stops = to_the_end | (end.status == AT_REST) | (end.status == PAUSED)
        stops = stops | (lasted >= 0.99 * (lasts - state.since))
        ends = acts & (~_alone(pairs, inverse, state) | stops)
        opens, mobility = ~state.closed, arms.tangential[:, None]
        slip = jnp.where(ends[:, None], slip - mobility * turned, 0)
        speed = jnp.maximum(jnp.where(ends, state.latched, 1), least_speed(model))
        e = jnp.where(ends, push / (mass * speed) - 1, 0)
        whole, _, known = each(friction_impulse, arms, slip, speed, e)
        whole = jnp.where(known[:, None], whole, jnp.nan)
        # The law of an impact may not hold for one that lasts.
        by_law = opens | (known & (e >= 0) & (e <= 1))
        coulomb = jax.vmap(coulomb_impulse)(arms, slip, mu * push)
        whole = jnp.where(by_law[:, None], whole, coulomb)
        state, taken, work = rubbed(state, at, jnp.where(ends[:, None], whole - turned, 0))
        left = slip + mobility * whole
        slides = lengths(left) > 8 * jnp.finfo(speed.dtype).eps * lengths(slip)
        # In sliding only the direction of the spring counts; its force here is above all limits.
        force = jnp.where(slides, mu * mass * speed * _LASTS / pace, 0)
        spring = -ratio(force, lengths(left))[:, None] * left
        spring = jnp.where(ends[:, None], spring, turned + push[:, None] * normal)
        slides = jnp.where(ends & ~opens, slides.astype(speed.dtype), HALF)
        # The error of the frozen normal, see `HalfImpulses`.
        turn = jnp.where(pairs.flat, 0, lasted / jnp.abs(pairs.distance))
        doubt = lengths(whole) * jnp.sum(arms.inverse_mass, axis=1) * turn
        doubt = doubt * jnp.hypot(speed, lengths(in_plane(relative, normal)))
        taken = given[0] + taken
        friction = Rubbing(
            state.rubbing.spin,
            jnp.where(acts[:, None], spring, rubbing.spring),
            jnp.where(acts, slides, rubbing.slides),
            rubbing.taken + taken,
        )
        return end._replace(
            state=state._replace(rubbing=friction),
            work=end.work + given[1] + work,
            error=end.error + jax.lax.stop_gradient(jnp.sum(jnp.where(ends, doubt, 0))),
            rubbed=end.rubbed + jnp.sum(taken),
        )

    until = jnp.minimum(until, jnp.min(lasts))
    return began, until, (acts, begins & ~acts), completed
