"""A ball on a table with a prescribed motion: by sampling, and by Newton's equation."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import jaxcontact as jc
from tests.oracle import shaken_spheres

GRAVITY = 9.81
FREQUENCY = 50.0
RATE = 2 * math.pi * FREQUENCY
RADIUS, MASS, STIFFNESS = 0.01, 0.03, 1e8


def over(motion, height, law):
    """A ball over a table that moves."""
    return jc.Scene(
        bodies=[
            jc.Sphere(RADIUS, MASS, position=[height + RADIUS]),
            jc.Plane([0.0], [1.0], motion=motion),
        ],
        law=law,
        stiffness=STIFFNESS,
        gravity=[-GRAVITY],
    )


def sine(amplitude, phase):
    """The place of a table and its velocity, at any times."""
    return (
        lambda t: amplitude * np.sin(RATE * t + phase),
        lambda t: amplitude * RATE * np.cos(RATE * t + phase),
    )


class _Table(NamedTuple):
    """Like a `Mover` of the spheres."""

    place: Callable
    speed: Callable

    def gap(self, t, x):
        return x[..., 0] - self.place(t)

    def normal(self, t, x):
        return np.ones(1)

    def velocity(self, t):
        return np.array([self.speed(t)])


def bounces(table, height, e, duration):
    """Touches (time, closing speed) of a ball on a table, and its end, by sampling and Brent."""
    start = [height], [0.0], [-GRAVITY]
    found = shaken_spheres.bounces([_Table(*table)], *start, e, duration, samples=200_001)
    return found.touches[:, :2], found.position[0], found.velocity[0]
