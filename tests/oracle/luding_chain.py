"""Balls in a line with Luding's contacts, from event to event.

The force loads along K δ. From its largest indentation m it follows κK (δ - m + m/κ), and -ηK δ
from where the two meet. A contact that closes again from there has a smaller m, of which that place
is the meeting point.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from tests.oracle._chain import Link
from tests.oracle._chain import follow as _follow

LOADS, UNLOADS, ADHERES = range(3)


class Powder(NamedTuple):
    """K, κ = `ratio` + `slope` m, and η."""

    stiffness: float
    ratio: float
    slope: float
    adhesion: float

    def factor(self, memory):
        return self.ratio + self.slope * memory

    def meeting(self, memory):
        factor = self.factor(memory)
        return memory * (factor - 1) / (factor + self.adhesion)

    def shrunk(self, depth, memory):
        return brentq(lambda m: self.meeting(m) - depth, depth, memory, xtol=1e-18, rtol=1e-14)

    def force(self, depth, memory, phase):
        if phase == LOADS:
            return self.stiffness * depth
        if phase == ADHERES:
            return -self.stiffness * self.adhesion * depth
        return self.stiffness * (memory - self.factor(memory) * (memory - depth))


class _Link(Link):
    def __init__(self, powder):
        self.powder, self.phase, self.memory = powder, LOADS, 0.0
        self.shrunk = 0

    def force(self, depth, rate):
        return self.powder.force(depth, self.memory, self.phase)

    def gaps(self, depth, rate):
        """Opens or closes; turns, reloads or turns back; begins to adhere."""
        turns = adheres = 1.0
        if self.closed and self.phase == UNLOADS:
            turns, adheres = self.memory - depth, depth - self.powder.meeting(self.memory)
        elif self.closed:
            turns = rate if self.phase == LOADS else -rate
        return [*super().gaps(depth, rate), turns, adheres]

    def change(self, event, depth):
        if event == 0:
            self.phase, self.memory = LOADS, 0.0
        elif event == 2:
            self.phase = ADHERES
        elif self.phase == LOADS:
            self.phase, self.memory = UNLOADS, depth
        elif self.phase == UNLOADS:
            self.phase, self.memory = LOADS, 0.0
        else:
            self.phase, self.memory = UNLOADS, self.powder.shrunk(depth, self.memory)
            self.shrunk += 1


class Followed(NamedTuple):
    """Positions and velocities at the end, and the numbers of openings and of shrunk memories."""

    position: np.ndarray
    velocity: np.ndarray
    openings: int
    shrunk: int


def follow(powders, *given):
    """Follow balls, as `_chain.follow`."""
    links = [_Link(one) for one in powders]
    found = _follow(links, *given)
    openings = sum(len(x) // 2 for x in found.moments)
    return Followed(found.position, found.velocity, openings, sum(one.shrunk for one in links))
