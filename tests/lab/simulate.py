"""Recordings with a known truth: a ball that bounces with a given e(v), timed by noisy triggers.

Beside it e(v) by a method independent of the library.
"""

import numpy as np
from scipy.optimize import brentq

GRAVITY = 9.81


def trials(law, seed, count=20, *, jitter=5e-4, scatter=0.004):
    """Intervals in s of trials of twelve flights in vacuum, the first one from 1.5 to 3 m/s.

    `law` is e(v), `jitter` the standard deviation of a trigger time in s, `scatter` that of ln e at
    a bounce.
    """
    rng, found = np.random.default_rng(seed), []
    for speed in np.linspace(1.5, 3, count):
        flights = []
        for _ in range(12):
            flights.append(2 * speed / GRAVITY)
            speed *= law(speed) * np.exp(scatter * rng.standard_normal())
        triggers = np.cumsum([0.0, *flights]) + jitter * rng.standard_normal(13)
        found.append(np.diff(triggers))
    return found


def as_csv(trials):
    """The intervals of several trials as the text of a CSV file."""
    lines = ["ball,drop_height_m,trial,bounce,interval_s"]
    for number, intervals in enumerate(trials, 1):
        lines += [f"sim,1,{number},{k},{t:.12g}" for k, t in enumerate(intervals, 1)]
    return "\n".join(lines) + "\n"


def recording(law, seed, **noise):
    """Twenty such trials as CSV."""
    return as_csv(trials(law, seed, **noise))


def delivered(alpha):
    """e of a damping factor: the root of α(1+e) = ln[(1+α)/(1-αe)]."""
    if alpha == 0:
        return 1.0

    def balance(e):
        return alpha * (1 + e) - np.log1p(alpha) + np.log1p(-alpha * e)

    # e = 0 is always a root; the other lies above it and below 1/α, where the logarithm ends.
    return brentq(balance, 1e-6, min(1, 1 / alpha) * (1 - 1e-15), xtol=1e-15)


def constant_damping(b):
    """e(v) of F = K δⁿ (1 + b δ'), whose damping factor is b v."""
    return lambda v: delivered(b * v)
