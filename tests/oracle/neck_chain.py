"""Balls in a line with necks of Johnson, Kendall and Roberts, from event to event.

The force is that of the contact radius a, as published: a neck forms at δ = 0 and snaps where
dδ/da = 0.
"""

from typing import NamedTuple

import numpy as np

from tests.oracle._chain import Link
from tests.oracle._chain import follow as _follow

LOSS = 7.09219597186  # the energy lost by a neck, in units of (w⁵ R⁴/E*²)^(1/3)


class Neck(NamedTuple):
    """A contact with the work of adhesion w, the radius R and the modulus E*."""

    work: float
    radius: float
    modulus: float

    @property
    def pull_off(self):
        return 1.5 * np.pi * self.work * self.radius

    @property
    def stiffness(self):
        return 4 / 3 * self.modulus * np.sqrt(self.radius)

    @property
    def lost(self):
        return LOSS * np.cbrt(self.work**5 * self.radius**4 / self.modulus**2)

    @property
    def snap(self):
        """The δ at which the neck snaps."""
        return -0.75 * np.cbrt(np.pi**2 * self.work**2 * self.radius / self.modulus**2)

    def force(self, depth):
        # δ = a²/R - √(2πw a/E*) is a quartic in √a.
        pull = np.sqrt(2 * np.pi * self.work / self.modulus)
        roots = np.roots([1 / self.radius, 0, 0, -pull, -max(depth, self.snap * (1 - 1e-14))])
        a = max(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real) ** 2
        adhesion = np.sqrt(8 * np.pi * self.work * self.modulus * a**3)
        return 4 * self.modulus * a**3 / (3 * self.radius) - adhesion


class _Link(Link):
    def __init__(self, neck):
        self.neck = neck

    def force(self, depth, rate):
        return self.neck.force(depth)

    def gaps(self, depth, rate):
        return [depth - self.neck.snap if self.closed else -depth]


def follow(necks, *given):
    """Follow balls, as `_chain.follow`."""
    return _follow([_Link(neck) for neck in necks], *given, steps=100, atol=1e-15)
