"""Types of numbers, units of a coupled solve, the modes of its contacts and the parts of its state,
and how it ends.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Number = Float[Array, ""]
Flag = Bool[Array, ""]
Index = Int[Array, ""]

PerContact = Float[Array, " contacts"]
Flags = Bool[Array, " contacts"]

APART, TIME_IS_UP, NOT_CONVERGED, CHANGED, AT_REST, PAUSED = range(6)
"""How a solve ends. APART: all contacts are open. TIME_IS_UP: `until` was reached. NOT_CONVERGED:
the numbers cannot be trusted. CHANGED: a contact began or ended, with `until_change`. AT_REST: each
touching body rests on one plane with zero normal velocity. PAUSED: the step limit was reached, for
example by a ball sliding in a shell; another call continues."""

REDUNDANT, NOT_FINITE, TOO_MANY_STEPS = 7, 8, 9
"""The ways in which only the solves of mechanisms end. REDUNDANT: friction forces of sticking
contacts are not unique. NOT_FINITE: no step, however short, has finite numbers. TOO_MANY_STEPS: the
limit of steps was reached. Scenes have a 6 of their own."""

SLOWEST = 1e-9
"""The least v0 in units of speed; v0 = 0 would have no damping."""


def least_v0(v0: str | float) -> float:
    """Return the least v0 in m/s, if it is given as a number; 0 for "peak" and "touch"."""
    return 0.0 if isinstance(v0, str) else v0


class Units(NamedTuple):
    """The units of length in m, speed in m/s and mass in kg, and derived ones."""

    length: Number
    speed: Number
    mass: Number

    @property
    def time(self) -> Number:
        """The unit of time in s."""
        return self.length / self.speed

    @property
    def force(self) -> Number:
        """The unit of force in N."""
        return self.mass * self.speed * (self.speed / self.length)

    @property
    def energy(self) -> Number:
        """The unit of energy in J."""
        return self.mass * self.speed * self.speed


class Modes(NamedTuple):
    """The modes between two events: the closed contacts, the source of their v0, and the effective
    masses that they began with, if these depend on the motion. `slide`: the signs of the slips, 0
    for contacts that stick, if contacts stick and slip. `deepest`: the largest indentations of
    contacts that unload, 0 for those that load, if forces depend on them. `adheres`: those of them
    that follow their adhesion, if a law forgets. `faded`: those whose force has vanished, if that
    may be before they open.
    """

    closed: Flags
    rising: Flags
    latched: PerContact
    mass: PerContact | None = None
    slide: PerContact | None = None
    deepest: PerContact | None = None
    adheres: Flags | None = None
    faded: Flags | None = None

    @property
    def memory(self) -> PerContact | None:
        """Return the largest indentations, negative where contacts follow their adhesion."""
        if self.deepest is None or self.adheres is None:
            return self.deepest
        return jnp.where(self.adheres, -self.deepest, self.deepest)

    @property
    def loads(self) -> Flags:
        """Return which contacts are at their largest indentation so far."""
        assert self.deepest is not None
        return self.deepest <= 0


class VectorLayout(NamedTuple):
    """The names and shapes of the parts of a state vector, which ends with the work, the time and
    w.
    """

    shapes: tuple[tuple[str, tuple[int, ...]], ...]

    def _place(self, name: str) -> tuple[int, int, tuple[int, ...]]:
        """Return where a part begins and ends, and its shape."""
        names = [other for other, _ in self.shapes]
        sizes = [math.prod(shape) for _, shape in self.shapes]
        k = names.index(name)
        return sum(sizes[:k]), sum(sizes[: k + 1]), self.shapes[k][1]

    def has(self, name: str) -> bool:
        return any(name == other for other, _ in self.shapes)

    def part(self, y: Array, name: str) -> Array:
        first, last, shape = self._place(name)
        return y[first:last].reshape(shape)

    def with_part(self, y: Array, name: str, value: Array) -> Float[Array, " numbers"]:
        """Return the vector with another part."""
        first, last, _ = self._place(name)
        return jnp.concatenate([y[:first], value.reshape(-1), y[last:]])

    def pack(self, rest: list[Number], **parts: Any) -> Float[Array, " numbers"]:
        """Return the vector of these parts; those that the layout lacks are left out."""
        named = [parts[name].reshape(-1) for name, _ in self.shapes]
        return jnp.concatenate([*named, *(number[None] for number in rest)])


def layout_of(**parts: Array | None) -> VectorLayout:
    """Return the layout of parts in this order; None is left out."""
    return VectorLayout(tuple((k, part.shape) for k, part in parts.items() if part is not None))
