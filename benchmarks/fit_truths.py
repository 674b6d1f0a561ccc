"""Simulated measurements with a known truth, for the studies of fits."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import jax
import numpy as np
from scipy.integrate import solve_ivp

import jaxcontact as jc

MASS, STIFFNESS, DAMPING, SPEED = 0.2, 5e7, 6e6, 1.5
TOUCH, FORCE_ZERO, DEPTH_ZERO = 3.1e-4, 12.0, 4e-6
TIME = np.linspace(0, 2.2e-3, 150)
NOISE = {"force": 0.03, "indentation": 0.002}
"""Relative to the largest reading."""

Simulate = Callable[[np.random.Generator], jc.Fit]


def force_of(depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    power = np.maximum(depth, 0) ** 1.5
    return STIFFNESS * power + DAMPING * power * speed


@functools.cache
def clean_record() -> dict[str, np.ndarray]:
    """Force and indentation at `TIME`, by SciPy, with free flight before and after."""

    def rate(t, y):
        return [y[1], -force_of(y[0], y[1]) / MASS]

    def apart(t, y):
        return y[0]

    apart.terminal, apart.direction = True, -1
    run = solve_ivp(
        rate, (0, 1), (0, SPEED), "DOP853", events=apart, dense_output=True, rtol=1e-12, atol=1e-14
    )
    end, last = run.t[-1], run.y[1, -1]
    since = TIME - TOUCH
    depth, speed = run.sol(np.clip(since, 0, end))
    inside = (since > 0) & (since < end)
    gap = np.where(since < end, SPEED * since, last * (since - end))
    force = np.where(inside, force_of(depth, speed), 0)
    return {
        "force": force + FORCE_ZERO,
        "indentation": np.where(inside, depth, gap) + DEPTH_ZERO,
    }


def records() -> Iterator[tuple[str, Simulate, dict[str, float]]]:
    """Kinds of records of one impact: a name, a simulated fit, and the truth."""
    truth = {"law.c": DAMPING, "contact.stiffness": STIFFNESS}
    truth |= {"velocity": SPEED, "start_time": TOUCH}
    offsets = {"force": FORCE_ZERO, "indentation": DEPTH_ZERO}
    for columns in (("force",), ("indentation",), ("force", "indentation")):
        for known in (False, True):
            name = f"{' and '.join(columns)}, noise {'known' if known else 'unknown'}"
            own = truth | {f"{c}_offset": offsets[c] for c in columns}
            yield name, functools.partial(record_fit, columns=columns, known=known), own


def record_fit(random: np.random.Generator, columns: tuple[str, ...], known: bool) -> jc.Fit:
    clean = clean_record()
    size = {c: NOISE[c] * np.ptp(clean[c][(TIME > TOUCH)]) for c in columns}
    if "indentation" in columns:
        # The flight before and after is part of the column, not of its largest indentation.
        size["indentation"] = NOISE["indentation"] * clean["indentation"].max()
    table = {c: clean[c] + size[c] * random.normal(size=TIME.size) for c in columns}
    sigma = {f"sigma_{c}": size[c] for c in columns} if known else {}
    law, contact = jc.ConstantDamping(c=3e6), jc.Contact(mass=MASS, stiffness=4e7)
    with jax.enable_x64(True):
        return jc.fit_record(TIME, law, contact, 1.2, **table, **sigma)
