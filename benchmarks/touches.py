"""Does a mechanism miss a touch? 10,000 random double pendula: `python -m benchmarks touches`.

Each pendulum swings from random angles for 2 s. Its wall stands at the farthest place that a mass
reaches in this time, but for a random depth of 1e-9 to 1e-2 m: two thirds of the walls are touched,
one third is missed by as much. SciPy's DOP853 in steps of at most 1 ms, without contacts, is the
reference. The result lists by tolerance how many touches were missed, and how deep, how many were
invented, and the smallest closing speed of a touch that was seen. `--pendula` sets their number.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from scipy.integrate import solve_ivp

import jaxcontact as jc
from benchmarks.study import Study

DURATION, STEP = 2.0, 1e-3
TOLERANCES = 1e-6, 1e-9, 1e-12
SHALLOW = 1e-9
"""The least depth in m that must be seen."""
BATCH = 1000
"""Pendula of one solve."""


def right(t: float, y: np.ndarray) -> np.ndarray:
    """Return the rates of all pendula, whose angles and speeds follow each other in y."""
    q1, q2, v1, v2 = y.reshape(4, -1)
    cos, sin = np.cos(q1 - q2), np.sin(q1 - q2)
    f1 = -sin * v2**2 - 2 * 9.81 * np.sin(q1)
    f2 = sin * v1**2 - 9.81 * np.sin(q2)
    below = 2 - cos**2
    return np.concatenate([v1, v2, (f1 - cos * f2) / below, (2 * f2 - cos * f1) / below])


def places(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x of both masses, (2, pendula), and their speeds."""
    q1, q2, v1, v2 = y.reshape(4, -1)
    x = np.cumsum([np.sin(q1), np.sin(q2)], axis=0)
    return x, np.cumsum([np.cos(q1) * v1, np.cos(q2) * v2], axis=0)


class Reference:
    """The free motion of a batch, in cubic pieces of 1 ms between SciPy's states."""

    def __init__(self, angles: np.ndarray):
        start = np.concatenate([*angles.T, np.zeros(2 * len(angles))])
        times = np.linspace(0, DURATION, round(DURATION / STEP) + 1)
        accuracy = {"rtol": 1e-13, "atol": 1e-13, "max_step": STEP}
        states = solve_ivp(right, (0, DURATION), start, "DOP853", times, **accuracy).y.T
        each = [places(y) for y in states]
        self.times = times
        self.x, self.v = (np.array([pair[k] for pair in each]) for k in (0, 1))

    def turns(self) -> np.ndarray:
        """Return the least x of both masses in every piece, (pieces, 2, pendula)."""
        h, x, v = STEP, self.x, self.v
        change = (x[1:] - x[:-1]) / h
        # x' is a parabola in the time s of a piece, from 0 to 1.
        a, b, c = 3 * (v[1:] + v[:-1] - 2 * change), 6 * change - 4 * v[:-1] - 2 * v[1:], v[:-1]
        inside = (v[:-1] < 0) & (v[1:] > 0)
        root = np.sqrt(np.where(inside, b**2 - 4 * a * c, 1.0))
        s = np.where(inside, -2 * c / np.where(inside, b - root, 1.0), 0.0)
        other = np.where(inside, -2 * c / np.where(inside, b + root, 1.0), 0.0)
        s = np.where((s > 0) & (s < 1), s, other)
        least = x[:-1] + h * (c * s + b * s**2 / 2 + a * s**3 / 3)
        return np.where(inside, least, np.minimum(x[:-1], x[1:]))


@functools.cache
def first_touch(rtol: float) -> Callable[..., Any]:
    """Return whether a pendulum has a contact in our run, its time and its closing speed."""

    def first(both: jax.Array, wall: jax.Array) -> tuple[jax.Array, ...]:
        system, start = jc.systems.double_pendulum(wall=wall, angles=both)
        how = {"rtol": rtol, "max_impacts": 1, "throw": False}
        table = jc.simulate(system, DURATION, **start, **how).contacts
        return table.valid[0], table.time[0], table.closing_speed[0]

    return jax.jit(jax.vmap(first))


def batch(
    random: np.random.Generator, size: int, tolerances: Sequence[float] = TOLERANCES
) -> list[dict[str, Any]]:
    """Return the outcome at each tolerance for `size` pendula."""
    angles = random.uniform(-0.25, 2.5, (size, 2))
    known = Reference(angles)
    turns = known.turns()
    started = known.x[0].min(axis=0)
    deepest = turns.min(axis=(0, 1))
    swings = deepest < started - 2e-2
    depth = 10 ** random.uniform(np.log10(SHALLOW), -2, size)
    depth *= np.where(np.arange(size) % 3 == 2, -1, 1)
    walls = deepest + depth
    # The piece of the first touch, and the touch in it by its cubic.
    beyond = (turns < walls).any(axis=1)
    first = beyond.argmax(axis=0)
    rows = []
    for rtol in tolerances:
        # All batches have one size, so that they share a program.
        found = first_touch(rtol)(angles, np.where(swings, walls, -9.0))
        seen, time, speed = (np.asarray(x)[swings] for x in found)
        due = depth[swings] > 0
        late = np.abs(time - known.times[first[swings]] - STEP / 2) > STEP
        missed = due & (~seen | late)
        rows.append(
            {
                "rtol": rtol,
                "touched": int(due.sum()),
                "missed": int(missed.sum()),
                "deepest_missed": float(depth[swings][missed].max(initial=0.0)),
                "free": int((~due).sum()),
                "invented": int((~due & seen).sum()),
                "slowest": float(speed[due & seen].min(initial=np.inf)),
            }
        )
    return rows


def measure(known: list | None, pendula: int) -> list[dict[str, Any]]:
    random = np.random.default_rng(0)
    found = [batch(random, BATCH) for _ in range(max(pendula // BATCH, 1))]
    rows = []
    for of_rtol in zip(*found, strict=True):
        counts = ("touched", "missed", "free", "invented")
        row = {name: sum(x[name] for x in of_rtol) for name in counts}
        row["deepest_missed_m"] = max(x["deepest_missed"] for x in of_rtol)
        row["slowest_seen_m_per_s"] = min(x["slowest"] for x in of_rtol)
        rows.append({"rtol": of_rtol[0]["rtol"]} | row)
        print(rows[-1], flush=True)
    return rows


OPTIONS = {"--pendula": {"type": int, "default": 10_000}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
