"""Balls in a line whose contacts remember their largest indentation, from event to event.

The memory is the largest δ since touch: the force is that of loading until δ' = 0, and elastic from
there until δ exceeds the memory.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.oracle._chain import Link
from tests.oracle._chain import follow as _follow


class Plastic(NamedTuple):
    """The force of loading at δ, the one of unloading from m at δ, and the damping in s/m."""

    load: Callable[[float], float]
    unload: Callable[[float, float], float]
    damping: float = 0.0

    def force(self, depth, rate, memory, loads):
        if depth <= 0:
            return 0.0
        force = self.load(depth) if loads else self.unload(depth, memory)
        return max(force * (1 + self.damping * rate), 0.0)


def thornton(mass, stiffness, yield_speed, c=0.0):
    """Hertz's force, its tangent from yield on, and unloading of the same contact area."""
    first = (1.25 * mass * yield_speed**2 / stiffness) ** 0.4

    def load(depth):
        if depth <= first:
            return stiffness * depth**1.5
        return stiffness * (first**1.5 + 1.5 * np.sqrt(first) * (depth - first))

    def unload(depth, memory):
        most = load(memory)
        # The radius of the flatter sphere over that of the sphere.
        flatter = stiffness * memory**1.5 / most
        end = memory - memory / flatter
        return stiffness * np.sqrt(flatter) * max(depth - end, 0.0) ** 1.5

    return Plastic(load, unload, c / stiffness)


def walton_braun(stiffness, ratio, slope):
    """A spring, and a stiffer one on the way back."""

    def unload(depth, memory):
        stiffer = ratio * stiffness + slope * stiffness * memory
        return max(stiffness * memory + stiffer * (depth - memory), 0.0)

    return Plastic(lambda depth: stiffness * depth, unload)


class _Link(Link):
    def __init__(self, plastic):
        self.plastic, self.loads, self.memory, self.reloads = plastic, True, 0.0, 0

    def force(self, depth, rate):
        return self.plastic.force(depth, rate, self.memory, self.loads)

    def gaps(self, depth, rate):
        turns = rate if self.closed else 1.0
        return [*super().gaps(depth, rate), turns if self.loads else self.memory - depth]

    def change(self, event, depth):
        if event:
            self.reloads += not self.loads
            self.memory, self.loads = depth if self.loads else 0.0, not self.loads
        elif self.closed:
            self.memory, self.loads = 0.0, True


class Followed(NamedTuple):
    """Velocities at the end, and per contact: openings, largest forces, and reloads."""

    velocity: np.ndarray
    opening: np.ndarray
    strongest: np.ndarray
    reloads: np.ndarray


def follow(contacts, *given):
    """Follow balls, as `_chain.follow`."""
    links = [_Link(one) for one in contacts]
    found = _follow(links, *given)
    opening = [(x[1::2] or [np.nan])[-1] for x in found.moments]
    reloads = np.array([one.reloads for one in links])
    return Followed(found.velocity, np.array(opening), found.strongest, reloads)
