"""The equations of a mechanism as a field of coupled contacts, in its units."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.clock import ContactClock
from .._coupled.field import TIME, AbstractCoupledField, Grip, Look, Settled, W
from .._coupled.interpolation import EndOfStep, parts_of_step, quintic, vertex
from .._coupled.modes import Flags, Modes, Number, PerContact
from .._coupled.springs import Springs, Vectors
from .mechanics import SLIDES_ON, Friction, Mechanics, Opening, SystemMotion, Vector
from .problem import Scales

_DOUBT = 0.25
"""The part of the difference between quintic and cubic that the quintic is trusted to."""

_LEAST_PART = 1e-6
"""The shortest part of a step that is tried in place of it."""


@dataclasses.dataclass(frozen=True)
class SystemField(AbstractCoupledField):
    """The equations of a mechanism. A state holds q and v, the forces of springs or the states of
    friction, and the losses of all gaps; then the work, the time and w. `start` in s is the time at
    which the solve starts. Users' functions receive no time later than `last`, at which they may
    jump.
    """

    mechanics: Mechanics
    scales: Scales
    start: Number
    last: Number

    def within(self, scales: Scales) -> SystemField:
        """Return the field in other units with the same time."""
        contacts = self.contacts.within(scales.contact)
        return dataclasses.replace(self, scales=scales, contacts=contacts)

    def states(self, y: Array) -> Vectors | None:
        """Return the forces of tangential springs, or the states of friction, if there are any."""
        return self.parts.part(y, "spring") if self.parts.has("spring") else None

    def _motion(
        self,
        y: Array,
        at: tuple[Number, Vector, Vector],
        opening: Opening,
        force: PerContact,
        modes: Modes,
    ) -> SystemMotion:
        """Return the motion in SI units."""
        units, states = self.units, self.states(y)
        normal = units.force * force
        if states is None:
            return self.mechanics.motion(*at, opening, normal, modes.slide)
        if self.rules.sticks:
            along = self._scaled(opening.gap, opening.rate)
            friction = self._springs.friction(states, self._slip(at), force, along, modes)
            friction = units.force * friction
        else:
            friction = self._own(states, at, normal, modes)[0]
        return self.mechanics.motion(*at, opening, normal, springs=friction)

    @property
    def _springs(self) -> Springs:
        return Springs(self.contacts, *self.mechanics.spring)

    def _own(
        self, states: Vectors, at: tuple[Number, Vector, Vector], normal: PerContact, modes: Modes
    ) -> tuple[Vectors, Vectors]:
        """Return the friction forces in N of a law with states, and their rates in units."""
        slip, law = self.mechanics.slip(*at), self._friction
        arguments = normal, slip, (self.unit_of_states * states).reshape(slip.shape)
        forces, rates = (part.reshape(states.shape) for part in law.force_and_rate(*arguments))
        rates = self.units.time / self.unit_of_states * rates
        closed = modes.closed[:, None]
        return jnp.where(closed, forces, 0), jnp.where(closed, rates, 0)

    def renewed(self, y: Array, touches: Flags) -> Array:
        states = self.states(y)
        if states is None or self.rules.sticks:
            return y
        return self.parts.with_part(y, "spring", jnp.where(touches[:, None], 0, states))

    @property
    def unit_of_states(self) -> Number:
        """The unit of the states of friction: that of force for springs."""
        return self.units.force if self.rules.sticks else self._friction.unit

    @property
    def _friction(self) -> Any:
        """The law of friction, with what its `kind` demands."""
        return self.mechanics.system.friction

    def _slip(self, at: tuple[Number, Vector, Vector]) -> Vectors:
        """Return slip speeds (m, d) in units of the solve."""
        slip = self.mechanics.slip(*at) / self.units.speed
        return slip.reshape(self.contacts.count, -1)

    def _second(self, at: tuple[Number, Vector, Vector], motion: SystemMotion) -> PerContact:
        """Return the second rates of depths in units of the solve."""
        units = self.units
        second = self.mechanics.second(*at, motion.acceleration)
        return -second * (units.time / units.speed)

    def moment(self, y: Array) -> tuple[Number, Vector, Vector]:
        """Return time, position and velocity in SI units."""
        time = self.start + self.units.time * y[TIME]
        # Time stands still beyond the end, but its derivative is needed up to there.
        time = jnp.where(time > self.last, self.last + (time - jax.lax.stop_gradient(time)), time)
        q, v = (self.parts.part(y, name) for name in ("position", "velocity"))
        return time, self.scales.position * q, self.scales.velocity * v

    def _scaled(self, gap: PerContact, rate: PerContact) -> tuple[PerContact, PerContact]:
        """Return indentations and their rates in units of the solve."""
        return -gap / self.units.length, -rate / self.units.speed

    def indentations(self, y: Array) -> tuple[PerContact, PerContact]:
        return self._scaled(*self.mechanics.gaps(*self.moment(y)))

    def energy_and_depths(self, y: Array) -> tuple[Number, PerContact]:
        at = self.moment(y)
        depth, _ = self._scaled(*self.mechanics.gaps(*at))
        return self.mechanics.kinetic(*at) / self.units.energy, depth

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        at, units, pace, contacts = self.moment(y), self.units, 2 * y[W], self.contacts
        opening = self.mechanics.opening(*at)
        depth, rate = self._scaled(opening.gap, opening.rate)
        depth = self.by_clock(depth, y, clock)
        force = contacts.force(depth, rate, modes)
        motion = self._motion(y, at, opening, force, modes)
        states = bends = self.states(y)
        if states is not None and self.rules.sticks:
            along = depth, rate, self._second(at, motion)
            bends = self._springs.motion(states, self._slip(at), force, along, modes).rate
        elif states is not None:
            bends = self._own(states, at, units.force * force, modes)[1]
        slopes = self.parts.pack(
            [units.time * (motion.power / units.energy), jnp.ones_like(pace)],
            position=units.time * (self.mechanics.rate(*at) / self.scales.position),
            velocity=units.time * (motion.acceleration / self.scales.velocity),
            spring=bends,
            lost=contacts.power(force, depth, rate, modes),
        )
        return jnp.concatenate([pace * slopes, clock.rate(rate)[None]])

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        at = self.moment(y)
        opening = self.mechanics.opening(*at)
        depth, rate = self._scaled(opening.gap, opening.rate)
        depth = self.by_clock(depth, y, clock)
        force = self.contacts.force(depth, rate, modes)
        motion = self._motion(y, at, opening, force, modes)
        press = self.contacts.pressing(depth, rate, modes) if self.law.fades else None
        look = Look(depth, rate, self._second(at, motion), force, press=press)
        states = self.states(y)
        if states is not None and self.rules.sticks:
            hold = self._springs.motion(states, self._slip(at), force, look[:3], modes).hold
            return look._replace(grip=Grip(hold, -jnp.ones_like(hold), hold))
        if motion.friction is None:
            return look
        return look._replace(grip=self._grip(motion.friction, force, modes))

    def _grip(self, friction: Friction, force: PerContact, modes: Modes) -> Grip:
        """Return what is left of the limit of friction, or of the slip speed."""
        units, slide = self.units, modes.slide
        assert slide is not None
        held = friction.force / units.force
        reserve = self.mechanics.limit(force) - jnp.abs(held)
        sticks, slip = slide == 0, friction.slip / units.speed
        rate = slide * friction.slip_rate * (units.time / units.speed)
        return Grip(jnp.where(sticks, reserve, slide * slip), rate, held)

    def settled(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, friction: PerContact
    ) -> Settled:
        at, units, mechanics = self.moment(y), self.units, self.mechanics
        before, states = modes.slide, self.states(y)
        assert before is not None
        if states is not None:
            along = self.indentations(y)
            events = modes, touches, changes
            states, modes = self._springs.settled(states, self._slip(at), along, *events)
            y = self.parts.with_part(y, "spring", states)
            return Settled(y, modes, jnp.asarray(False))
        sticks = before == 0
        slide = jnp.where(changes, jnp.where(sticks, -jnp.sign(friction), 0), before)
        slide = jnp.where(touches, mechanics.slide(*at), slide)
        slide = jnp.where(modes.closed, slide, SLIDES_ON)
        opening = mechanics.opening(*at)
        force = self.contacts.force(*self._scaled(opening.gap, opening.rate), modes)
        # At touch there is no force yet: a small one shows which part of it holds.
        finest = jnp.finfo(y.dtype).eps
        force = units.force * jnp.where(touches, jnp.maximum(force, math.sqrt(finest)), force)
        slide, redundant = mechanics.settled(*at, opening, force, slide)
        return Settled(y, modes._replace(slide=slide), redundant)

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
        kinetic = (jnp.sum(jnp.square(self.parts.part(y, "velocity"))) for y in (before, after))
        energy = jnp.maximum(jnp.maximum(*kinetic), 1)
        speed, lasts = jnp.sqrt(energy), jnp.maximum(after[TIME] - before[TIME], 1)
        sizes = {"position": speed * lasts, "velocity": speed, "spring": energy, "lost": energy}
        each = {name: jnp.full(shape, sizes[name]) for name, shape in self.parts.shapes}
        scale = self.parts.pack([energy, lasts, jnp.ones_like(speed)], **each)
        # Positions are sums of many small changes, whose errors are those of the changes.
        nq = self.scales.position.shape[0]
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
        if self.contacts.ends is not None:
            heights = (self.contacts.height(look.depth) for look in (before, after))
            before, after = (
                look._replace(depth=jnp.where(modes.closed, next(heights), look.depth))
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
        top, _ = _summit(jnp.concatenate([left.value[None], samples, right.value[None]]))
        early, late = _turn(left, lasts, 1), _turn(right, lasts, -1)
        parts = jnp.stack([top, early, 1 + late])
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

    def deepest(self, lasts: Number, before: Look, after: Look) -> PerContact:
        """Return the largest indentation of each contact within a step."""
        curve = quintic(lasts, *(EndOfStep(*look[:3]) for look in (before, after)))
        inside = curve.value(parts_of_step(lasts.dtype))
        return _summit(jnp.concatenate([before.depth[None], inside, after.depth[None]]))[1]


def _turn(end: EndOfStep, lasts: Number, inwards: int) -> PerContact:
    """Return the part of the step from an end to the maximum that its two derivatives predict,
    later for `inwards` = 1 and earlier for -1. It is 0 if that is farther than an eighth.
    """
    bends = end.second < 0
    away = jnp.where(bends, -end.rate / jnp.where(bends, end.second, -1), jnp.inf)
    near = bends & (inwards * away > 0) & (jnp.abs(away) < lasts / 8)
    return jnp.where(near, away / lasts, 0)


def _summit(samples: Float[Array, "points contacts"]) -> tuple[Array, Array]:
    """Return the maxima of equally spaced samples from end to end of a step, by parabolas: the part
    of the step up to them, and their values.
    """
    count = samples.shape[0]
    top = jnp.clip(jnp.argmax(samples, axis=0), 1, count - 2)
    rows = top[None] + jnp.arange(-1, 2)[:, None]
    below, at, above = jnp.take_along_axis(samples, rows, axis=0)
    offset = vertex(below, at, above)
    value = jnp.maximum(at + offset * (above - below) / 4, jnp.maximum(below, above))
    return (top.astype(offset.dtype) + offset) / (count - 1), value
