"""The motion between two events as a field in its clock's variable, with event gaps.

A state is one vector, which ends with the work, the time and w. Gaps fall through zero at events.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._laws import AbstractLaw
from .clock import ContactClock
from .contacts import ScaledContacts
from .energies import attracts
from .interpolation import EndOfStep, at_part, ceiling, highest
from .modes import Flag, Flags, Index, Modes, Number, PerContact, Units, VectorLayout

WORK, TIME, W = -3, -2, -1
"""The indices of work, time and w in the vector of a state."""

TOGETHER = 0.65
"""A power of rounding: the distance between simultaneous events, relative to the step."""


class Grip(NamedTuple):
    """The distance of each contact from a change between stick and slip, its rate, which counts by
    its sign, and the friction force. `hold` falls through zero where the contact changes.
    """

    hold: PerContact
    rate: PerContact
    friction: PerContact


class Look(NamedTuple):
    """The indentations at the end of a step, their first and second rates, and the forces; or the
    slopes of all four in s. `grip` is that of contacts that stick and slip. `press` falls through
    zero where a force vanishes that may do so before its contact opens. Parts that are not needed
    are None.
    """

    depth: Any
    rate: Any
    second: PerContact
    force: PerContact
    grip: Grip | None = None
    press: PerContact | None = None


class Settled(NamedTuple):
    """The state and the modes after changes between stick and slip, and whether friction forces of
    sticking contacts are not unique.
    """

    y: Array
    modes: Modes
    redundant: Flag


class GapConstants(NamedTuple):
    """The numbers in the gaps of events that have no slopes: the latched speeds, the largest
    indentations, those at which contacts end, and those below which they follow their adhesion.
    """

    latched: Any
    deepest: Any
    ends: Any
    least: Any


NO_SLOPES = GapConstants(0, 0, None, 0)


class LoopRules(NamedTuple):
    """The static rules of a coupled solve. `peak`: whether v0 follows its peak. `until_change` and
    `max_steps` determine its end. `flies`: whether it goes on without contacts. `sticks`: whether
    contacts stick and slip.
    """

    peak: bool
    until_change: bool
    max_steps: int
    flies: bool = False
    sticks: bool = False


@dataclasses.dataclass(frozen=True)
class AbstractCoupledField(abc.ABC):
    """The equations of contacts in units of the solve, for its state as a vector with these
    `parts`, up to the time `until`. Blank contacts are open and at rest.
    """

    contacts: ScaledContacts
    parts: VectorLayout
    rules: LoopRules
    until: Number

    @property
    def units(self) -> Units:
        return self.contacts.units

    @property
    def law(self) -> AbstractLaw:
        return self.contacts.law

    @property
    def events(self) -> list[str]:
        """The kinds of events of each contact, in the order of their gaps."""
        law, rules = self.law, self.rules
        happen = {"gap": True, "peak": rules.peak, "remembers": law.remembers}
        happen |= {"forgets": law.forgets, "fades": law.fades, "sticks": rules.sticks}
        return [kind for kind, may in happen.items() if may]

    def still(self) -> Self:
        """Return the field without derivatives."""
        numbers, static = eqx.partition(vars(self), eqx.is_array)
        return dataclasses.replace(self, **eqx.combine(jax.lax.stop_gradient(numbers), static))

    @abc.abstractmethod
    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        """Return d/ds of a state."""

    @abc.abstractmethod
    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        """Return the quantities of one state."""

    @abc.abstractmethod
    def indentations(self, y: Array) -> tuple[PerContact, PerContact]:
        """Return indentations and their rates."""

    @abc.abstractmethod
    def energy_and_depths(self, y: Array) -> tuple[Number, PerContact]:
        """Return the energy of the bodies, with that which friction has taken; and indentations."""

    def by_clock(self, depth: PerContact, y: Array, clock: ContactClock) -> PerContact:
        """Return the indentations; the leaving contact has that of the clock."""
        return jnp.where(clock.leaving, self.contacts.left_of(y[W]), depth)

    def approach(self, y: Array, clock: ContactClock) -> tuple[PerContact, PerContact]:
        """Return indentations and their rates. The leaving contact has the depth of the clock."""
        depth, rate = self.indentations(y)
        return self.by_clock(depth, y, clock), rate

    def lost(self, y: Array) -> PerContact:
        """Return the energy that each contact has lost since it began."""
        if not self.parts.has("lost"):
            return jnp.zeros(self.contacts.count, y.dtype)
        return self.parts.part(y, "lost")

    def with_lost(self, y: Array, lost: PerContact) -> Array:
        """Return the state with other losses."""
        return self.parts.with_part(y, "lost", lost) if self.parts.has("lost") else y

    def energies(self, y: Array, modes: Modes) -> tuple[Number, Number | None]:
        """Return the energy of bodies and contacts with the losses of the present contacts. If
        contacts attract, also the sum of all energies without their signs, and those of necks at
        their ends.
        """
        contacts, lost, (bodies, depth) = self.contacts, self.lost(y), self.energy_and_depths(y)
        stored = contacts.stored(depth, modes)
        energy = bodies + jnp.sum(stored) + jnp.sum(lost)
        if not attracts(self.law):
            return energy, None
        each = jnp.abs(stored) + jnp.abs(lost)
        if contacts.ends is not None:
            each = each + contacts.torn(modes)
        return energy, bodies + jnp.sum(each)

    def renewed(self, y: Array, touches: Flags) -> Array:
        """Return the state whose friction starts anew where contacts touch."""
        del touches
        return y

    def fixed(self, modes: Modes) -> GapConstants:
        """Return the numbers in the gaps of events that have no slopes."""
        deepest, least = modes.deepest, None
        if self.law.forgets and deepest is not None:
            least = self.contacts.least(deepest)
        return GapConstants(modes.latched, deepest, self.contacts.ends, least)

    def resting(self, y: Array, toward: Array, pace: Number, now: Look, modes: Modes) -> Index:
        """Return the status of a state at rest, -1 for any other. `toward` is the slope of the
        state in s, and `pace` that of time.
        """
        del y, toward, pace, now, modes
        return jnp.asarray(-1, jnp.int32)

    def allowed(self, before: Array, after: Array, tolerance: Number, finest: float) -> Array:
        """Return the allowed error of each number of the state in a step."""
        del before
        return tolerance + 20 * finest * jnp.abs(after)

    def noise(self, y: Array, finest: float) -> Number | float:
        """Return the rounding error of indentations in a state; `finest` is that of 1."""
        del y
        return finest

    def at_touch(self, y: Array, touches: Flags, modes: Modes) -> Modes:
        """Return the modes with all that contacts keep from their touch."""
        del y, touches
        return modes

    def settled(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, friction: PerContact
    ) -> Settled:
        """Return the state after events. Contacts that `changes` marks stop sliding, or begin to
        under the `friction` that held them. All others that stick are tested, too.
        """
        # Called only for fields whose modes hold grips, which define it.
        raise NotImplementedError

    def hidden(
        self, lasts: Number, before: Look, after: Look, modes: Modes, leaving: Flags, noise: Any
    ) -> tuple[Flags, Number]:
        """Return which contacts may begin, or end and begin again, within a step that `lasts`; and
        the part of the step to try instead. `noise` is the rounding error of indentations.

        This test is for gaps that curve upwards in flight, as those of spheres do. In a long step
        past a close approach the cubic through the ends is much too low, so the tangents decide.
        """
        peak, inside = ceiling(lasts, before.depth, before.rate, after.depth, after.rate)
        begins = ~modes.closed & inside & (peak > 0)
        # If a step ends between an opening and a touch, the rate at its end does not show that.
        gaps = (-self.contacts.height(look.depth) for look in (before, after))
        out, parts, *_ = highest(lasts, next(gaps), -before.rate, next(gaps), -after.rate)
        again = modes.closed & ~leaving & parts & (out > 16 * noise)
        return begins | again, jnp.full_like(lasts, 0.5)

    def with_peak(self, modes: Modes, now: Look, finest: float) -> Modes:
        """Return the modes where a solve begins or accelerations jump. v0 follows a closing speed
        that is the largest so far and increases.
        """
        largest = modes.closed & (now.rate >= modes.latched - 16 * finest)
        rising = self.contacts.refers_to_peak((modes.rising | largest) & (now.second > 0))
        falls = modes.rising & ~rising
        latched = jnp.where(falls, jnp.maximum(now.rate, 0), modes.latched)
        return modes._replace(rising=rising, latched=latched)

    def strongest(
        self, lasts: Number, start: tuple[Look, Look], end: tuple[Look, Look], modes: Modes
    ) -> PerContact:
        """Return the largest force of each contact within a step, from the quantities at its ends
        and their slopes in time.
        """
        (before, rising), (after, falling) = start, end
        # The cubic of the force shows where it is largest, and the law how large it is there.
        cubic = before.force, rising.force, after.force, falling.force
        _, inside, part, bend = highest(*jax.lax.stop_gradient((lasts, *cubic)))
        depth, rate, second = at_part(part, lasts, EndOfStep(*before[:3]), EndOfStep(*after[:3]))
        at, along = (depth, rate), (lasts * rate, lasts * second)
        near, slope = jax.jvp(lambda d, r: self.contacts.force(d, r, modes), at, along)
        # A parabola mends the part by a fifth of the step at most.
        summit = near + slope * jnp.clip(slope / (2 * bend), -0.2, 0.2) / 2
        return jnp.where(inside, summit, jnp.maximum(before.force, after.force))

    def look_along(
        self, y: Array, modes: Modes, clock: ContactClock, toward: Array
    ) -> tuple[Look, Look]:
        """Return the quantities of one state, and their slopes along `toward`."""
        if self.rules.peak or self.rules.sticks:
            return jax.jvp(lambda y: self.look(y, modes, clock), (y,), (toward,))
        # No event needs the slope of δ'' or of a grip.
        now, pace, contacts = self.look(y, modes, clock), 2 * y[W], self.contacts
        at, slopes = (now.depth, now.rate), (pace * now.rate, pace * now.second)
        force, press = contacts.force_slope(modes, at, slopes), None
        if self.law.fades:
            press = jax.jvp(lambda d, r: contacts.pressing(d, r, modes), at, slopes)[1]
        return now, Look(*slopes, jnp.zeros_like(force), force, press=press)

    def gaps(
        self,
        modes: Modes,
        clock: ContactClock,
        at: Look,
        w: Array,
        fixed: GapConstants,
        left: Array,
    ) -> Any:
        """Return the gaps that fall through zero at events, or their slopes if slopes are given,
        with `NO_SLOPES` for `fixed`.
        """
        latched, deepest, ends, least = fixed
        above = at.depth if ends is None else at.depth - ends
        gaps = [jnp.where(clock.leaving, w, jnp.where(modes.closed, above, -at.depth))]
        if self.rules.peak:
            gaps.append(jnp.where(modes.rising, at.second, latched - at.rate))
        if self.law.remembers:
            gaps.append(jnp.where(modes.loads, at.rate, deepest - at.depth))
        if modes.adheres is not None:
            back = jnp.where(modes.adheres, -at.rate, at.depth - least)
            gaps.append(jnp.where(modes.loads, at.rate, back))
        if modes.faded is not None and at.press is not None:
            gaps.append(jnp.where(modes.faded, -at.press, at.press))
        slips = [] if at.grip is None else [at.grip.hold]
        return jnp.concatenate([*gaps, *slips, left[None]])

    def has_passed(self, modes: Modes, at: Look, gaps: Array) -> Bool[Array, " events"]:
        """Return which gaps are negative because of an event, not because of rounding."""
        closed, last = modes.closed, jnp.ones(1, bool)
        passed = [jnp.where(closed, at.rate < 0, at.rate > 0)]
        if self.rules.peak:
            passed.append(closed & self.contacts.refers_to_peak(modes.rising | (at.second > 0)))
        if self.law.remembers:
            passed.append(closed & (modes.loads | (at.rate > 0)))
        if modes.adheres is not None:
            back = jnp.where(modes.adheres, at.rate > 0, at.rate < 0)
            passed.append(closed & ~modes.loads & back)
        if modes.faded is not None and at.press is not None:
            # A contact that creeps apart has a force of rounding only.
            sure = jnp.abs(at.press) > float(jnp.finfo(gaps.dtype).eps) ** TOGETHER
            passed.append(closed & sure)
        slips = [] if at.grip is None else [self._slips(modes, at.grip)]
        return (gaps < 0) & jnp.concatenate([*passed, *slips, last])

    def may_dip(self, modes: Modes) -> Bool[Array, " events"]:
        """Return which gaps a step tests for a fall through zero and back. Those of touches and
        openings have a test of their own, `hidden`.
        """
        closed, last = modes.closed, jnp.zeros(1, bool)
        kinds = {"gap": jnp.zeros_like(closed)}
        kinds["peak"] = self.contacts.refers_to_peak(closed & ~modes.rising)
        if modes.adheres is not None:
            kinds["forgets"] = closed & ~modes.loads
        return jnp.concatenate([*(kinds.get(kind, closed) for kind in self.events), last])

    def _slips(self, modes: Modes, grip: Grip) -> Flags:
        """Return which contacts may have changed between stick and slip."""
        # Where a contact opens, friction and its limit vanish together, up to rounding.
        limit = -(float(jnp.finfo(grip.hold.dtype).eps) ** TOGETHER)
        falls = jnp.where(modes.slide == 0, grip.hold < limit, grip.rate < 0)
        return modes.closed & falls
