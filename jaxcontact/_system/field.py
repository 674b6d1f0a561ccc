"""The equations of a mechanism as a field of coupled contacts, in its units."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .._coupled.clock import ContactClock
from .._coupled.energies import in_contact, stored_energy
from .._coupled.field import TIME, AbstractCoupledField, Grip, Look, LoopRules, Settled, W
from .._coupled.interpolation import EndOfStep, parts_of_step, quintic, vertex
from .._coupled.modes import SLOWEST, Flags, Modes, Number, PerContact
from .._coupled.springs import (
    SMALL,
    SpringMotion,
    Vectors,
    changing,
    friction_of,
    settled_springs,
    slides_at_touch,
    spring_motion,
    tangential_stiffness,
)
from .._laws import adhesion_below, energies_of, force_of_closed, pressing, shrunk_memory
from .mechanics import SLIDES_ON, Friction, Mechanics, Opening, SystemMotion, Vector
from .problem import Scales

_DOUBT = 0.25
"""The part of the difference between quintic and cubic that the quintic is trusted to."""

_LEAST_PART = 1e-6
"""The shortest part of a step that is tried in place of it."""


@dataclasses.dataclass(frozen=True)
class SystemField(AbstractCoupledField):
    """The equations of a mechanism. A state holds q and v, the losses of all gaps, then the work,
    the time and w. `start` in s is the time at which the solve starts. Users' functions receive no
    time later than `last`, at which they may jump.
    """

    mechanics: Mechanics
    contact: Contact
    scales: Scales
    rules: LoopRules
    until: Number
    used: Flags
    start: Number
    last: Number
    ends: PerContact | None

    def pack(
        self, q: Vector, v: Vector, lost: PerContact, rest: list, springs: Array | None = None
    ) -> Float[Array, " numbers"]:
        """Return the state vector of scaled numbers; `rest` holds the work, the time and w."""
        forces = [] if springs is None else [springs.reshape(-1)]
        return jnp.concatenate([q, v, *forces, lost, jnp.stack(rest)])

    def springs(self, y: Array) -> Vectors | None:
        """Return the forces of tangential springs, or the states of friction, if there are any."""
        if not self.mechanics.system.states:
            return None
        first = self.scales.position.shape[0] + self.scales.velocity.shape[0]
        return y[first : -3 - self.used.shape[0]].reshape(self.used.shape[0], -1)

    def _motion(
        self,
        y: Array,
        at: tuple[Number, Vector, Vector],
        opening: Opening,
        force: PerContact,
        modes: Modes,
    ) -> SystemMotion:
        """Return the motion in SI units."""
        units, springs = self.scales.contact, self.springs(y)
        normal = units.force * force
        if springs is None:
            return self.mechanics.motion(*at, opening, normal, modes.slide)
        if not self.rules.sticks:
            friction = self._own(springs, at, normal, modes)[0]
            return self.mechanics.motion(*at, opening, normal, springs=friction)
        slip, slides = self._slip(at), modes.slide == 1
        reach = self._reach(-opening.gap / units.length, -opening.rate / units.speed)
        friction = friction_of(springs, slip, self.mechanics.limit(force), slides, reach)
        friction = jnp.where(modes.closed[:, None], units.force * friction, 0)
        return self.mechanics.motion(*at, opening, normal, springs=friction)

    def _own(
        self, states: Vectors, at: tuple[Number, Vector, Vector], normal: PerContact, modes: Modes
    ) -> tuple[Vectors, Vectors]:
        """Return the friction forces in N of a law with states, and their rates in units."""
        slip, law = self.mechanics.slip(*at), self._friction
        arguments = normal, slip, (self.unit_of_states * states).reshape(slip.shape)
        forces, rates = (part.reshape(states.shape) for part in law.force_and_rate(*arguments))
        rates = self.scales.contact.time / self.unit_of_states * rates
        closed = modes.closed[:, None]
        return jnp.where(closed, forces, 0), jnp.where(closed, rates, 0)

    def renewed(self, y: Array, touches: Flags) -> Array:
        states = self.springs(y)
        if states is None or self.rules.sticks:
            return y
        return self._with_springs(y, jnp.where(touches[:, None], 0, states))

    def _with_springs(self, y: Array, springs: Vectors) -> Array:
        first = self.scales.position.shape[0] + self.scales.velocity.shape[0]
        return jnp.concatenate([y[:first], springs.reshape(-1), y[first + springs.size :]])

    @property
    def unit_of_states(self) -> Number:
        """The unit of the states of friction: that of force for springs."""
        return self.scales.contact.force if self.rules.sticks else self._friction.unit

    @property
    def _friction(self) -> Any:
        """The law of friction, with what its `kind` demands."""
        return self.mechanics.system.friction

    def _slip(self, at: tuple[Number, Vector, Vector]) -> Vectors:
        """Return slip speeds (m, d) in units of the solve."""
        slip = self.mechanics.slip(*at) / self.scales.contact.speed
        return slip.reshape(self.used.shape[0], -1)

    def _spring_motion(
        self,
        springs: Vectors,
        at: tuple[Number, Vector, Vector],
        looks: tuple[PerContact, PerContact, PerContact],
        force: PerContact,
        modes: Modes,
    ) -> SpringMotion:
        """Return the motion of springs from depths, their rates and their second rates."""
        units, (depth, rate, second) = self.scales.contact, looks
        mechanics = self.mechanics
        stiffness = tangential_stiffness(mechanics.spring[1], self.contact, units.length * depth)
        stiffness = jnp.where(modes.closed, stiffness * (units.length / units.force), 0)
        grows = mechanics.limit(self.force_slope(modes, (depth, rate), (rate, second)))
        limit, slides = (mechanics.limit(force), grows), modes.slide == 1
        reach = self._reach(depth, rate)
        return spring_motion(springs, self._slip(at), stiffness, limit, slides, reach)

    def _reach(self, depth: PerContact, rate: PerContact) -> PerContact:
        """Return μ/(n κ) (δ + |δ'|); see `spring_motion`."""
        mu, kappa = self.mechanics.spring
        return mu / (self.contact.exponent * kappa) * changing(depth, rate)

    def _second(self, at: tuple[Number, Vector, Vector], motion: SystemMotion) -> PerContact:
        """Return the second rates of depths in units of the solve."""
        units = self.scales.contact
        second = self.mechanics.second(*at, motion.acceleration)
        return -second * (units.time / units.speed)

    def moment(self, y: Array) -> tuple[Number, Vector, Vector]:
        """Return time, position and velocity in SI units."""
        nq, nv = self.scales.position.shape[0], self.scales.velocity.shape[0]
        time = self.start + self.scales.contact.time * y[TIME]
        # Time stands still beyond the end, but its derivative is needed up to there.
        time = jnp.where(time > self.last, self.last + (time - jax.lax.stop_gradient(time)), time)
        return time, self.scales.position * y[:nq], self.scales.velocity * y[nq : nq + nv]

    def lost(self, y: Array) -> PerContact:
        return y[-3 - self.used.shape[0] : -3]

    def with_lost(self, y: Array, lost: PerContact) -> Array:
        return jnp.concatenate([y[: -3 - self.used.shape[0]], lost, y[-3:]])

    def _along(
        self, gap: PerContact, opening: PerContact, y: Array, clock: ContactClock
    ) -> tuple[PerContact, PerContact]:
        """Return indentations and their rates in units of the solve."""
        units = self.scales.contact
        depth = jnp.where(clock.leaving, self.left_of(y[W]), -gap / units.length)
        return depth, -opening / units.speed

    def approach(self, y: Array, clock: ContactClock) -> tuple[PerContact, PerContact]:
        gap, rate = self.mechanics.gaps(*self.moment(y))
        return self._along(gap, rate, y, clock)

    def _at(self, depth: PerContact, rate: PerContact, modes: Modes) -> tuple[Any, ...]:
        """Return the law and its arguments in SI units."""
        units, law = self.scales.contact, self.mechanics.system.law
        speed = jnp.where(modes.rising, jnp.maximum(rate, 0), modes.latched)
        speed = jnp.maximum(speed, SLOWEST)
        if not law.damped:
            rate = jnp.zeros_like(rate)
        contact = eqx.tree_at(lambda c: c.mass, self.contact, modes.mass)
        arguments = (units.length * in_contact(depth, self.ends), units.speed * rate, contact)
        memory = modes.memory
        deepest = None if memory is None else units.length * memory
        return law, *arguments, units.speed * speed, deepest

    def whole_force(self, depth: PerContact, rate: PerContact, modes: Modes) -> PerContact:
        force = force_of_closed(*self._at(depth, rate, modes)) / self.scales.contact.force
        return jnp.where(modes.closed, force, 0)

    def pressing(self, depth: PerContact, rate: PerContact, modes: Modes) -> PerContact:
        return pressing(*self._at(depth, rate, modes))

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        at, units, pace = self.moment(y), self.scales.contact, 2 * y[W]
        opening = self.mechanics.opening(*at)
        depth, rate = self._along(opening.gap, opening.rate, y, clock)
        force = self.force(depth, rate, modes)
        motion = self._motion(y, at, opening, force, modes)
        q = self.mechanics.rate(*at) / self.scales.position
        v = motion.acceleration / self.scales.velocity
        lost, rest = self.power(force, depth, rate, modes), motion.power / units.energy
        moving = units.time * jnp.concatenate([q, v])
        supplied = [units.time * rest, jnp.ones_like(rest)]
        springs, bends = self.springs(y), []
        if springs is not None and not self.rules.sticks:
            bends = [self._own(springs, at, units.force * force, modes)[1].reshape(-1)]
        elif springs is not None:
            looks = depth, rate, self._second(at, motion)
            bends = [self._spring_motion(springs, at, looks, force, modes).rate.reshape(-1)]
        slopes = jnp.concatenate([moving, *bends, lost, jnp.stack(supplied)])
        return jnp.concatenate([pace * slopes, clock.rate(rate)[None]])

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        at = self.moment(y)
        opening = self.mechanics.opening(*at)
        depth, rate = self._along(opening.gap, opening.rate, y, clock)
        force = self.force(depth, rate, modes)
        motion = self._motion(y, at, opening, force, modes)
        press = self.pressing(depth, rate, modes) if self.rules.fades else None
        look = Look(depth, rate, self._second(at, motion), force, press=press)
        springs = self.springs(y)
        if springs is not None and self.rules.sticks:
            hold = self._spring_motion(springs, at, look[:3], force, modes).hold
            return look._replace(grip=Grip(hold, -jnp.ones_like(hold), hold))
        if motion.friction is None:
            return look
        return look._replace(grip=self._grip(motion.friction, force, modes))

    def _grip(self, friction: Friction, force: PerContact, modes: Modes) -> Grip:
        """Return what is left of the limit of friction, or of the slip speed."""
        units, slide = self.scales.contact, modes.slide
        assert slide is not None
        held = friction.force / units.force
        reserve = self.mechanics.limit(force) - jnp.abs(held)
        sticks, slip = slide == 0, friction.slip / units.speed
        rate = slide * friction.slip_rate * (units.time / units.speed)
        return Grip(jnp.where(sticks, reserve, slide * slip), rate, held)

    def settled(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, friction: PerContact
    ) -> Settled:
        at, units, mechanics = self.moment(y), self.scales.contact, self.mechanics
        before, springs = modes.slide, self.springs(y)
        assert before is not None
        if springs is not None:
            return self._settled_springs(y, modes, touches, changes, springs)
        sticks = before == 0
        slide = jnp.where(changes, jnp.where(sticks, -jnp.sign(friction), 0), before)
        slide = jnp.where(touches, mechanics.slide(*at), slide)
        slide = jnp.where(modes.closed, slide, SLIDES_ON)
        opening = mechanics.opening(*at)
        force = self.force(-opening.gap / units.length, -opening.rate / units.speed, modes)
        # At touch there is no force yet: a small one shows which part of it holds.
        finest = jnp.finfo(y.dtype).eps
        force = units.force * jnp.where(touches, jnp.maximum(force, math.sqrt(finest)), force)
        slide, redundant = mechanics.settled(*at, opening, force, slide)
        changed = modes.closed & (slide != before) | touches
        return Settled(y, modes._replace(slide=slide), changed, redundant)

    def _settled_springs(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, springs: Vectors
    ) -> Settled:
        """Return the state after events of contacts with tangential springs."""
        at, units, before = self.moment(y), self.scales.contact, modes.slide
        assert before is not None
        mu, kappa = self.mechanics.spring
        gap, opening = self.mechanics.gaps(*at)
        depth, rate, slip = -gap / units.length, -opening / units.speed, self._slip(at)
        limit = self.mechanics.limit(self.force(depth, rate, modes))
        small = jnp.full_like(depth, SMALL)
        stiff = self.contact.stiffness * (units.length * small) ** self.contact.exponent
        hardening = units.force * self.force(small, rate, modes) / stiff
        slips = slides_at_touch(kappa, slip, rate, mu, hardening)
        events, reach = (touches, changes, slips), self._reach(depth, rate)
        springs, slide = settled_springs(springs, slip, limit, before, events, reach)
        changed = modes.closed & (slide != before) | touches
        y = self._with_springs(y, springs)
        return Settled(y, modes._replace(slide=slide), changed, jnp.asarray(False))

    def painleve(self, y: Array, modes: Modes) -> Number:
        """Return the least part of the contact force that opens a sliding contact; see
        `Mechanics.painleve`.
        """
        assert modes.slide is not None
        parts = self.mechanics.painleve(*self.moment(y), modes.slide)
        return jnp.min(jnp.where(modes.closed, parts, jnp.inf))

    def allowed(self, before: Array, after: Array, tolerance: Number, finest: float) -> Array:
        # Speeds count relative to the larger of the energies at the start of the solve and now,
        # positions relative to what the bodies travel within the step.
        nq, nv = self.scales.position.shape[0], self.scales.velocity.shape[0]
        kinetic = (jnp.sum(jnp.square(y[nq : nq + nv])) for y in (before, after))
        energy = jnp.maximum(jnp.maximum(*kinetic), 1)
        speed, lasts = jnp.sqrt(energy), jnp.maximum(after[TIME] - before[TIME], 1)
        gaps = self.used.shape[0]
        parts = [speed * lasts, speed, energy, energy, lasts, jnp.ones_like(speed)]
        counts = [nq, nv, gaps, 1, 1, 1]
        if self.mechanics.system.states:
            parts.insert(2, energy)
            counts.insert(2, after.shape[0] - nq - nv - gaps - 3)
        scale = jnp.concatenate([jnp.full(k, part) for k, part in zip(counts, parts, strict=True)])
        # Positions are sums of many small changes, whose errors are those of the changes.
        rounding = jnp.concatenate([jnp.ones(nq), jnp.full(after.shape[0] - nq, 20.0)])
        return tolerance * scale + rounding.astype(scale.dtype) * finest * jnp.abs(after)

    def noise(self, y: Array, finest: float) -> Number:
        # Gaps are differences of lengths, which grow with the positions.
        scales = self.scales
        lengths = jnp.abs(y[: scales.reach.shape[0]]) @ scales.reach
        return jax.lax.stop_gradient(finest * (scales.gap + lengths))

    def at_touch(self, y: Array, touches: Flags, modes: Modes) -> Modes:
        assert modes.mass is not None
        mass = self.mechanics.effective_mass(*self.moment(y))
        return modes._replace(mass=jnp.where(touches, mass, modes.mass))

    def hidden(
        self, lasts: Number, before: Look, after: Look, modes: Modes, leaving: Flags, noise: Number
    ) -> tuple[Flags, Number]:
        # A gap may turn anywhere within a step. The quintic through the ends shows where. The part
        # up to there is tried next, so that the step ends where the doubt is largest.
        sign = jnp.where(modes.closed, -1, 1).astype(after.depth.dtype)
        if self.ends is not None:
            before, after = (
                look._replace(depth=jnp.where(modes.closed, self.height(look.depth), look.depth))
                for look in (before, after)
            )
        left, right = (EndOfStep(*(sign * x for x in look[:3])) for look in (before, after))
        # Just after an event its gap is zero up to rounding, on either side.
        left = left._replace(value=jnp.minimum(left.value, 0))
        curve, u = quintic(lasts, left, right), parts_of_step(after.depth.dtype)

        def doubt(u: Array) -> Array:
            return _DOUBT * jnp.abs(curve.more(u))

        inside = curve.value(u)
        samples = inside + doubt(u)
        summit = _summit(jnp.concatenate([left.value[None], samples, right.value[None]]))
        early, late = _turn(left, lasts, 1), _turn(right, lasts, -1)
        parts = jnp.stack([summit.part, early, 1 + late])
        # Their places are better known than their values.
        peaks = curve.value(parts) + doubt(parts)
        highest = jnp.argmax(peaks, axis=0)
        # A gap that only closes is met at the end of the step.
        turned = right.rate < 0
        turns = turned | ((jnp.max(inside, axis=0) > right.value) & (right.value < 0))
        hidden = turns & (jnp.max(peaks, axis=0) > 16 * noise) & ~leaving
        part = jnp.take_along_axis(parts, highest[None], axis=0)[0]
        shorter = jnp.min(jnp.where(hidden, part, 1))
        return hidden, jnp.clip(shorter, _LEAST_PART, 0.9)

    def strongest(
        self, lasts: Number, start: tuple[Look, Look], end: tuple[Look, Look], modes: Modes
    ) -> PerContact:
        # Forces are those of the law along the quintics of the indentations.
        looks, lasts = (start[0], end[0]), jnp.where(lasts > 0, lasts, 1)
        curve = quintic(lasts, *(EndOfStep(*look[:3]) for look in looks))
        inside = curve.value_and_rate(parts_of_step(lasts.dtype))
        force = jax.vmap(lambda depth, rate: self.force(depth, rate, modes))(*inside)
        ends = (jnp.where(modes.closed, look.force, 0)[None] for look in looks)
        force = jnp.concatenate([next(ends), force, next(ends)])
        return _summit(force).value

    def deepest(self, lasts: Number, before: Look, after: Look) -> PerContact:
        """Return the largest indentation of each contact within a step."""
        curve = quintic(lasts, *(EndOfStep(*look[:3]) for look in (before, after)))
        inside = curve.value(parts_of_step(lasts.dtype))
        return _summit(jnp.concatenate([before.depth[None], inside, after.depth[None]])).value

    def stored(self, y: Array, modes: Modes) -> PerContact:
        """Return the elastic energy of every contact in units of the solve."""
        gap, _ = self.mechanics.gaps(*self.moment(y))
        return self._stored(-gap, modes)

    def _stored(self, depth: PerContact, modes: Modes) -> PerContact:
        """Return the elastic energy of closed contacts with these indentations in m."""
        units, law = self.scales.contact, self.mechanics.system.law
        depth = jnp.where(modes.closed, depth, 0)
        contact = eqx.tree_at(lambda c: c.mass, self.contact, modes.mass)
        speed = units.speed * jnp.maximum(modes.latched, SLOWEST)
        deepest = None if modes.deepest is None else units.length * modes.deepest
        return stored_energy(law, contact, depth, speed, deepest) / units.energy

    def least(self, deepest: PerContact) -> PerContact:
        unit = self.scales.contact.length
        return adhesion_below(self.mechanics.system.law, unit * deepest) / unit

    def shrunk(self, depth: PerContact) -> PerContact:
        unit = self.scales.contact.length
        return shrunk_memory(self.mechanics.system.law, unit * depth) / unit

    def torn(self, modes: Modes) -> PerContact:
        assert self.ends is not None
        return self._stored(self.scales.contact.length * self.ends, modes)

    def kept(self, deepest: PerContact, modes: Modes) -> PerContact:
        units, speed = self.scales.contact, jnp.maximum(modes.latched, SLOWEST)
        contact = eqx.tree_at(lambda c: c.mass, self.contact, modes.mass)
        largest = units.length * jnp.maximum(deepest, 0)
        law = self.mechanics.system.law
        return energies_of(law, largest, contact, units.speed * speed, largest)[1] / units.energy

    def energy(self, y: Array, modes: Modes) -> Number:
        """Return kinetic and stored energy with the losses of the present contacts."""
        kinetic = self.mechanics.kinetic(*self.moment(y)) / self.scales.contact.energy
        return kinetic + jnp.sum(self.stored(y, modes)) + jnp.sum(self.lost(y))

    def turnover(self, y: Array, modes: Modes) -> Number:
        """Return the sum of all energies without their signs, and those of necks at their ends."""
        kinetic = self.mechanics.kinetic(*self.moment(y)) / self.scales.contact.energy
        contacts = jnp.abs(self.stored(y, modes)) + jnp.abs(self.lost(y))
        if self.ends is not None:
            contacts = contacts + self.torn(modes)
        return kinetic + jnp.sum(contacts)


class _Summit(NamedTuple):
    """A maximum: the part of the step from its start to it, and its value."""

    part: Array
    value: Array


def _turn(end: EndOfStep, lasts: Number, inwards: int) -> PerContact:
    """Return the part of the step from an end to the maximum that its two derivatives predict,
    later for `inwards` = 1 and earlier for -1. It is 0 if that is farther than an eighth.
    """
    bends = end.second < 0
    away = jnp.where(bends, -end.rate / jnp.where(bends, end.second, -1), jnp.inf)
    near = bends & (inwards * away > 0) & (jnp.abs(away) < lasts / 8)
    return jnp.where(near, away / lasts, 0)


def _summit(samples: Float[Array, "points contacts"]) -> _Summit:
    """Return the maxima of equally spaced samples from end to end of a step, by parabolas."""
    count = samples.shape[0]
    top = jnp.clip(jnp.argmax(samples, axis=0), 1, count - 2)
    rows = top[None] + jnp.arange(-1, 2)[:, None]
    below, at, above = jnp.take_along_axis(samples, rows, axis=0)
    offset = vertex(below, at, above)
    value = jnp.maximum(at + offset * (above - below) / 4, jnp.maximum(below, above))
    return _Summit((top.astype(offset.dtype) + offset) / (count - 1), value)
