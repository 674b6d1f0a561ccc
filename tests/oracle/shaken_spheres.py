"""A ball among fixed spheres and in shells with a prescribed motion.

Solved by sampling, and by Newton's equation.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


class Mover(NamedTuple):
    """Its centre (..., D) and velocity at any times, and the `distance` from the ball's centre at a
    touch: R + r outside of a sphere, -(R - r) in a shell.
    """

    place: Callable
    velocity: Callable
    distance: float

    def gap(self, t, x):
        length = np.sqrt(np.sum((x - self.place(t)) ** 2, axis=-1))
        return np.sign(self.distance) * length - self.distance

    def normal(self, t, x):
        """From the mover to the ball's centre; in a shell the other way."""
        away = x - self.place(t)
        return np.sign(self.distance) * away / np.linalg.norm(away)


def sine(centre, amplitude, frequency, phase, distance):
    """One that goes as A sin(2π f t + φ) about its centre."""
    rate, amplitude = 2 * np.pi * frequency, np.asarray(amplitude, float)

    def place(t):
        return np.asarray(centre) + np.sin(rate * np.asarray(t) + phase)[..., None] * amplitude

    def velocity(t):
        return rate * np.cos(rate * np.asarray(t) + phase)[..., None] * amplitude

    return Mover(place, velocity, distance)


def circling(centre, radius, frequency, distance):
    """One whose centre goes around a circle, from the rightmost point of it."""
    rate = 2 * np.pi * frequency

    def turned(t, phase):
        angle = rate * np.asarray(t) + phase
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def place(t):
        return np.asarray(centre) + turned(t, 0.0)

    return Mover(place, lambda t: rate * turned(t, np.pi / 2), distance)


class Bounces(NamedTuple):
    """Touches (time, closing speed, mover), the end, and what the movers did, with a mass of 1."""

    touches: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    work: float


def bounces(movers, x, v, gravity, e, duration, samples=20_001):
    """Impacts out of time, each touch by sampling and Brent."""
    t, x, v, g = 0.0, np.array(x, float), np.array(v, float), np.asarray(gravity, float)
    touches, work = [], 0.0
    while True:

        def at(s, t=t, x=x, v=v):
            passed = (np.asarray(s) - t)[..., None]
            return x + (v + g / 2 * passed) * passed

        first, hit = np.inf, None
        grid = np.linspace(t, duration, samples)[1:]
        for k, mover in enumerate(movers):
            gaps = mover.gap(grid, at(grid))
            where = np.flatnonzero((gaps[1:] <= 0) & (gaps[:-1] > 0))
            if where.size:
                ends = grid[where[0]], grid[where[0] + 1]
                s = brentq(lambda s, m=mover: m.gap(s, at(s)), *ends, xtol=1e-16, rtol=1e-15)
                first, hit = min((first, hit), (s, k), key=lambda one: one[0])
        if hit is None:
            left = duration - t
            return Bounces(np.array(touches), at(duration), v + g * left, work)
        x, v, t = at(first), v + g * (first - t), first
        normal, moving = movers[hit].normal(t, x), movers[hit].velocity(t)
        closing = -normal @ (v - moving)
        touches.append((t, closing, hit))
        work += (1 + e) * closing * (normal @ moving)
        v = v + (1 + e) * closing * normal


def pressed(movers, x, v, gravity, stiffness, alpha, duration, times=(), most=2e-5, peak=False):
    """A soft ball of mass 1 with F = K δ^(3/2) (1 + α δ'/v0), v0 at touch, restarted at touches and
    openings; its state (2 D) at `times` and at the end. In a contact no step is longer than `most`.
    `peak`: v0 is the largest closing speed, for one mover that stands.
    """
    t, y, g = 0.0, np.concatenate([x, v]).astype(float), np.asarray(gravity, float)
    dim, speeds, found, rising = len(g), {}, [], set()
    wanted = [*times, duration]

    def slope(t, y):
        push = g.copy()
        for k, speed in speeds.items():
            normal = movers[k].normal(t, y[:dim])
            depth = max(-movers[k].gap(t, y[:dim]), 0.0)
            rate = -normal @ (y[dim:] - movers[k].velocity(t))
            ratio = 1 if k in rising else rate / speed
            force = stiffness * depth**1.5 * (1 + alpha * ratio)
            push = push + max(force, 0.0) * normal
        return np.concatenate([y[dim:], push])

    while wanted:

        def gap_of(k):
            def gap(time, state):
                return movers[k].gap(time, state[:dim])

            gap.terminal, gap.direction = True, 1 if k in speeds else -1
            return gap

        def faster(time, state):
            normal, away = movers[0].normal(time, state[:dim]), state[:dim] - movers[0].place(time)
            across = state[dim:] - (normal @ state[dim:]) * normal
            bends = across @ across / np.sign(movers[0].distance) / np.linalg.norm(away)
            return -normal @ slope(time, state)[dim:] - bends

        faster.terminal, faster.direction = True, -1
        solved = solve_ivp(
            slope, (t, wanted[0]), y, "DOP853",
            events=[*map(gap_of, range(len(movers))), *[faster] * len(rising)],
            rtol=1e-12, atol=1e-16, max_step=most if speeds else 10 * most,
        )  # fmt: skip
        t, y = solved.t[-1], solved.y[:, -1]
        if solved.status == 0:
            found.append(y)
            wanted.pop(0)
            continue
        k = next(k for k, when in enumerate(solved.t_events) if when.size)
        if k in speeds:
            del speeds[k]
            continue
        rising = {k} if peak and k < len(movers) else set()
        k = min(k, len(movers) - 1)
        normal = movers[k].normal(t, y[:dim])
        speeds[k] = -normal @ (y[dim:] - movers[k].velocity(t))
    return np.array(found)
