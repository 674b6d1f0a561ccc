"""Recordings with a known truth: a ball that bounces with a given e(v), timed by noisy triggers."""

import math
from collections.abc import Callable

import numpy as np

HEADER = "ball,drop_height_m,trial,bounce,interval_s"
GRAVITY = 9.81


def trial(
    law: Callable[[float], float],
    speed: float,
    bounces: int,
    rng: np.random.Generator,
    *,
    jitter: float = 0.0,
    scatter: float = 0.0,
) -> np.ndarray:
    """Intervals in s of one trial whose first flight starts at `speed` m/s, in vacuum.

    `jitter` is the standard deviation of a trigger time in s, `scatter` that of ln e at a bounce.
    """
    flights = []
    for _ in range(bounces):
        flights.append(2 * speed / GRAVITY)
        speed *= law(speed) * np.exp(scatter * rng.standard_normal())
    triggers = np.concatenate([[0.0], np.cumsum(flights)])
    return np.diff(triggers + jitter * rng.standard_normal(bounces + 1))


def as_csv(trials: list[np.ndarray], ball: str = "sim") -> str:
    """The intervals of several trials as the text of a CSV file."""
    lines = [HEADER]
    for number, intervals in enumerate(trials, 1):
        lines += [f"{ball},1,{number},{k},{t:.12g}" for k, t in enumerate(intervals, 1)]
    return "\n".join(lines) + "\n"


def recording(
    law: Callable[[float], float],
    seed: int,
    *,
    trials: int = 20,
    bounces: int = 12,
    jitter: float = 5e-4,
    scatter: float = 0.004,
    fastest: float = 3.0,
) -> str:
    """A CSV of several trials with first flights between half of `fastest` and `fastest` m/s."""
    rng = np.random.default_rng(seed)
    speeds = np.linspace(fastest / 2, fastest, trials)
    return as_csv([trial(law, v, bounces, rng, jitter=jitter, scatter=scatter) for v in speeds])


def time_to_rest(height, restitution, drag, gravity=9.81):
    """The time in s from a drop until the flights are over, one flight after the other.

    `restitution` is a function of the speed in m/s; flights in air by the closed forms of v' =
    -g (1 + b v|v|), written down here once more.
    """
    b = 0.0 if drag is None else drag.terminal_speed(gravity) ** -2

    def fall(h):
        if not b:
            return math.sqrt(2 * h / gravity), math.sqrt(2 * gravity * h)
        time = math.acosh(math.exp(gravity * b * h)) / (gravity * math.sqrt(b))
        return time, math.sqrt(-math.expm1(-2 * gravity * b * h) / b)

    total, speed = fall(height)
    first = speed
    while speed > 1e-12 * first:
        launch = restitution(speed) * speed
        s = math.sqrt(b) * launch
        up = math.atan(s) / (gravity * math.sqrt(b)) if b else launch / gravity
        top = math.log1p(s * s) / (2 * gravity * b) if b else launch**2 / (2 * gravity)
        down, speed = fall(top)
        total += up + down
    return total
