"""Simulated instrument records with impacts: the truths of benchmarks/records.py.

The simulation is independent of the library. SciPy integrates each impact, m δ'' = -K δ^(3/2) (1 +
a δ'), with a constant a (constant damping) or a = α/v₀ (constant e), and readings are added by
hand.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81


class Truth(NamedTuple):
    """What was simulated: readings (n,) in N or m/s² at a `rate` in Hz, the `quantity`; the mass in
    kg, the stiffness in N/m^(3/2), a law's `kind`; of each impact time in s, closing speed in m/s,
    e, and the largest force over the noise of one reading; and what else was done, in words.
    """

    rate: float
    reading: np.ndarray
    quantity: str
    mass: float
    stiffness: float
    kind: str
    time: np.ndarray
    velocity: np.ndarray
    e: np.ndarray
    height: np.ndarray
    words: dict[str, float | bool]


def impact(mass: float, stiffness: float, a: float, speed: float) -> tuple[np.ndarray, ...]:
    """Times (m,) and forces (m,) of one impact, and the speed after it."""
    scale = (mass * speed**2 / stiffness) ** 0.4
    unit = scale / speed

    def rate(_: float, state: np.ndarray) -> list[float]:
        # In units of the speed, and of the indentation of an elastic collision.
        return [state[1], -(max(state[0], 0.0) ** 1.5) * (1 + a * speed * state[1])]

    def apart(_: float, state: np.ndarray) -> float:
        return state[0]

    apart.terminal, apart.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
    found = solve_ivp(
        *(rate, (0, 60), [0.0, 1.0]),
        **{"method": "DOP853", "rtol": 1e-10, "atol": 1e-13},
        events=apart,
        dense_output=True,
        first_step=1e-3,
    )
    t = np.linspace(0, found.t[-1], 4000)
    depth, velocity = found.sol(t)
    force = np.maximum(depth, 0) ** 1.5 * (1 + a * speed * velocity)
    return t * unit, np.maximum(force, 0) * stiffness * scale**1.5, -found.y[1, -1] * speed


def draw(random: np.random.Generator, *, impacts: bool = True) -> Truth:
    """One record: bounces that follow each other, or impacts at times of their own."""
    mass = 10 ** random.uniform(-2.3, 0)
    speed = random.uniform(1.0, 5.0)
    count = int(random.integers(1, 9))
    duration = 10 ** random.uniform(-3.7, -2.3)
    stiffness = mass * (2.94 / duration) ** 2.5 / (1.25 * speed**0.5)
    per = 10 ** random.uniform(np.log10(20), np.log10(500))
    rate = float(np.clip(per / duration, 2e3, 2e5))
    noise = 10 ** random.uniform(np.log10(0.002), np.log10(0.05))
    kind = str(random.choice(["constant e", "constant c"]))
    first = random.uniform(0.5, 0.95)
    alpha = 1.5 * (1 - first) / first
    quantity = str(random.choice(["force", "acceleration"]))
    bounces = bool(random.random() < 0.7)
    pieces, speeds, ratios, times = [], [], [], []
    at = random.uniform(3, 20) * duration
    for _ in range(count):
        a = alpha / speed if kind == "constant e" else alpha / (speeds[0] if speeds else speed)
        time, force, after = impact(mass, stiffness, a, speed)
        if bounces and 2 * after / GRAVITY < 4 * time[-1]:
            break
        pieces.append((at, time, force))
        times.append(at)
        speeds.append(speed)
        ratios.append(after / speed)
        # Long flights are shortened: they are empty, and the record would have millions of
        # readings.
        flight = 2 * after / GRAVITY if bounces else np.inf
        at += time[-1] + min(flight, random.uniform(10, 60) * duration)
        speed = after if bounces else speed * random.uniform(0.6, 1.1)
    end = at + random.uniform(6, 30) * duration
    clock = np.arange(int(end * rate)) / rate
    contact = np.zeros(clock.size)
    for start, time, force in pieces if impacts else []:
        contact += np.interp(clock - start, time, force, left=0, right=0)
    top = max(float(force.max()) for _, _, force in pieces)
    lies = bool(random.random() < 0.3) and quantity == "force"
    if lies:
        contact[clock > end - 3 * duration] += mass * GRAVITY
    hum = float(random.choice([0.0, random.uniform(0, 3) * noise]))
    sigma = noise * top
    reading = contact + hum * top * np.sin(2 * np.pi * 50 * clock + random.uniform(0, 6))
    reading += random.uniform(-1, 1) * top + sigma * random.normal(size=clock.size)
    # The largest impact is clipped at 70 to 95 % of its height.
    clipped = bool(random.random() < 0.15)
    if clipped:
        limit = float(np.median(reading)) + random.uniform(0.7, 0.95) * top
        reading = np.minimum(reading, limit)
    if quantity == "acceleration":
        reading = reading / mass
    turned = bool(random.random() < 0.5) and not clipped
    height = np.array([float(force.max()) for _, _, force in pieces]) / sigma
    words = {
        "noise": noise,
        "per contact": float(rate * duration),
        "hum": hum,
        "clipped": clipped,
        "lies": lies,
        "bounces": bounces,
    }
    return Truth(
        *(rate, -reading if turned else reading, quantity, mass, stiffness, kind),
        *map(np.array, (times, speeds, ratios)),
        *(height, words),
    )
