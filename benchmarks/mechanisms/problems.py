"""Mechanisms of the package, and their equations in NumPy for peers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import jaxcontact as jc


class Problem(NamedTuple):
    """A mechanism of the package, the time it runs, and its equations in NumPy.

    `equations(t, q, v)` returns M, Q, gaps, their gradients and their rates ∂g/∂t.
    """

    system: jc.System
    start: dict[str, Any]
    duration: float
    stiffness: float
    alpha: float
    equations: Callable[..., tuple[np.ndarray, ...]]


def pendulum(t, q, v):
    cos, sin = math.cos(q[0] - q[1]), math.sin(q[0] - q[1])
    mass = np.array([[2.0, cos], [cos, 1.0]])
    force = np.array(
        [-sin * v[1] ** 2 - 19.62 * math.sin(q[0]), sin * v[0] ** 2 - 9.81 * math.sin(q[1])]
    )
    x = math.sin(q[0])
    gap = np.array([x + 0.3, x + math.sin(q[1]) + 0.3])
    gradient = np.array([[math.cos(q[0]), 0.0], [math.cos(q[0]), math.cos(q[1])]])
    return mass, force, gap, gradient, np.zeros(2)


SPEED = 523.5987755982989


def crank(t, q, v):
    turn = SPEED * t
    mass = np.array([[2.5e-4 + 0.21 * 0.12**2 / 4, 0.0], [0.0, 0.14]])
    force = np.array([0.21 * 0.05 * 0.12 / 2 * SPEED**2 * math.sin(turn - q[0]), 0.0])
    x = q[1] - 0.05 * math.cos(turn) - 0.12 * math.cos(q[0])
    y = -0.05 * math.sin(turn) - 0.12 * math.sin(q[0])
    r = math.hypot(x, y) or 1e-300
    gradient = -np.array([[(x * 0.12 * math.sin(q[0]) - y * 0.12 * math.cos(q[0])) / r, x / r]])
    rate = -np.array([(x * 0.05 * SPEED * math.sin(turn) - y * 0.05 * SPEED * math.cos(turn)) / r])
    return mass, force, np.array([0.5e-3 - r]), gradient, rate


def problems() -> dict[str, Problem]:
    system, start = jc.systems.double_pendulum()
    joint, stretched = jc.systems.slider_crank()
    alpha = [1.5 * (1 - e) / e for e in (0.7, 0.9)]
    return {
        "double pendulum": Problem(system, start, 5.6, 1e7, alpha[0], pendulum),
        "slider-crank": Problem(joint, stretched, 1.25e-3, 6.6101984e10, alpha[1], crank),
    }
