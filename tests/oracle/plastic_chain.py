"""Balls in a line whose contacts remember their largest indentation, by SciPy from event to event.

A contact k acts between balls k and k+1, with δ = -(gap + x_{k+1} - x_k). Its memory is the largest
δ since touch: the force is that of loading until δ' = 0, and elastic from there until δ exceeds the
memory. Each of these, every touch and every opening ends an integration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-12


class Plastic(NamedTuple):
    """The force of loading at δ, the one of unloading from m at δ, and the damping in s/m."""

    load: Callable[[float], float]
    unload: Callable[[float, float], float]
    damping: float = 0.0

    def force(self, depth: float, rate: float, memory: float, loads: bool) -> float:
        if depth <= 0:
            return 0.0
        force = self.load(depth) if loads else self.unload(depth, memory)
        return max(force * (1 + self.damping * rate), 0.0)


def thornton(mass: float, stiffness: float, yield_speed: float, c: float = 0.0) -> Plastic:
    """Hertz's force, its tangent from yield on, and unloading of the same contact area."""
    first = (1.25 * mass * yield_speed**2 / stiffness) ** 0.4

    def load(depth: float) -> float:
        if depth <= first:
            return stiffness * depth**1.5
        return stiffness * (first**1.5 + 1.5 * np.sqrt(first) * (depth - first))

    def unload(depth: float, memory: float) -> float:
        most = load(memory)
        # The radius of the flatter sphere over that of the sphere.
        flatter = stiffness * memory**1.5 / most
        end = memory - memory / flatter
        return stiffness * np.sqrt(flatter) * max(depth - end, 0.0) ** 1.5

    return Plastic(load, unload, c / stiffness)


def walton_braun(stiffness: float, ratio: float, slope: float) -> Plastic:
    """A spring, and a stiffer one on the way back."""

    def unload(depth: float, memory: float) -> float:
        stiffer = ratio * stiffness + slope * stiffness * memory
        return max(stiffness * memory + stiffer * (depth - memory), 0.0)

    return Plastic(lambda depth: stiffness * depth, unload)


class Followed(NamedTuple):
    """Velocities at the end, and per contact: touches, openings, largest forces, and reloads."""

    velocity: np.ndarray
    touch: np.ndarray
    opening: np.ndarray
    strongest: np.ndarray
    reloads: np.ndarray


def follow(
    contacts: Sequence[Plastic],
    mass: Sequence[float],
    gaps: Sequence[float],
    velocity: Sequence[float],
    duration: float,
    push: Callable[[float], Any] = lambda t: 0.0,
) -> Followed:
    """Follow balls from rest positions; `push` are their accelerations in m/s²."""
    masses, space, n = np.asarray(mass, float), np.asarray(gaps, float), len(mass)
    y, t = np.concatenate([np.zeros(n), np.asarray(velocity, float)]), 0.0
    closed, loads, memory = np.zeros(n - 1, bool), np.ones(n - 1, bool), np.zeros(n - 1)
    touch, opening = np.full((2, n - 1), np.nan)
    strongest, reloads = np.zeros(n - 1), np.zeros(n - 1, int)

    def depth(y: np.ndarray) -> np.ndarray:
        return y[: n - 1] - y[1:n] - space

    def rate(y: np.ndarray) -> np.ndarray:
        return y[n:-1] - y[n + 1 :]

    def forces(y: np.ndarray) -> np.ndarray:
        at = zip(contacts, depth(y), rate(y), memory, loads, strict=True)
        return np.where(closed, [one.force(*rest) for one, *rest in at], 0)

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        force = forces(y)
        pushed = np.append(0, force) - np.append(force, 0)
        return np.concatenate([y[n:], pushed / masses + push(t)])

    def event(function: Callable[[np.ndarray], float], direction: int) -> Any:
        def at(t: float, y: np.ndarray) -> float:
            return function(y)

        at.terminal, at.direction = True, direction
        return at

    while True:
        events = []
        for k in range(n - 1):
            events.append(event(lambda y, k=k: depth(y)[k], -1 if closed[k] else 1))
            if loads[k]:
                events.append(event(lambda y, k=k: rate(y)[k] if closed[k] else 1.0, -1))
            else:
                events.append(event(lambda y, k=k: depth(y)[k] - memory[k], 1))
        found = solve_ivp(
            motion, (t, duration), y, method="DOP853", rtol=RTOL, atol=1e-18, events=events,
            max_step=duration / 200,
        )  # fmt: skip
        for at in found.y.T:
            strongest = np.maximum(strongest, forces(at))
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return Followed(y[n:], touch, opening, strongest, reloads)
        for number, times in enumerate(found.t_events):
            k, turns = divmod(number, 2)
            if not len(times):
                continue
            if turns:
                reloads[k] += not loads[k]
                memory[k], loads[k] = depth(y)[k] if loads[k] else 0, not loads[k]
            else:
                closed[k] = not closed[k]
                if closed[k]:
                    touch[k], loads[k], memory[k] = t, True, 0
                else:
                    opening[k] = t
