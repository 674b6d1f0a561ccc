"""Balls in a line by SciPy, from each event of a contact to the next.

A contact k acts between balls k and k+1, with δ = -(gap + x_{k+1} - x_k).
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-12


class Link:
    """A contact in its state, with its `force(depth, rate)` while it is closed.

    An event is the fall through zero of a gap: the first closes or opens the contact, the others
    change its rule.
    """

    closed = False

    def gaps(self, depth, rate):
        return [depth if self.closed else -depth]

    def change(self, event, depth):
        """What follows from an event."""


class Chain(NamedTuple):
    """The state at the end; per contact its largest force, and the moments it closed or opened."""

    position: np.ndarray
    velocity: np.ndarray
    strongest: np.ndarray
    moments: list[list[float]]


def follow(links, mass, gaps, velocity, duration, push=lambda t: 0.0, steps=200, atol=1e-18):
    """Follow balls from positions 0 relative to their start; `push` are accelerations in m/s²."""
    masses, n = np.asarray(mass, float), len(mass)
    y, t = np.concatenate([np.zeros(n), np.asarray(velocity, float)]), 0.0
    strongest, moments = np.zeros(n - 1), [[] for _ in links]

    def at(y, k):
        """δ and δ' of a contact."""
        return y[k] - y[k + 1] - gaps[k], y[n + k] - y[n + k + 1]

    def forces(y):
        return [one.force(*at(y, k)) if one.closed else 0.0 for k, one in enumerate(links)]

    def motion(t, y):
        force = forces(y)
        pushed = np.append(0, force) - np.append(force, 0)
        return np.concatenate([y[n:], pushed / masses + push(t)])

    def gap_of(k, event):
        def gap(t, y):
            return links[k].gaps(*at(y, k))[event]

        gap.terminal, gap.direction = True, -1
        return gap

    events = [(k, e) for k, one in enumerate(links) for e in range(len(one.gaps(0.0, 0.0)))]
    while True:
        found = solve_ivp(
            motion, (t, duration), y, method="DOP853", rtol=RTOL, atol=atol,
            events=[gap_of(*event) for event in events], max_step=duration / steps,
        )  # fmt: skip
        strongest = np.max([strongest, *map(forces, found.y.T)], axis=0)
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return Chain(y[:n], y[n:], strongest, moments)
        for (k, event), times in zip(events, found.t_events, strict=True):
            if len(times):
                if event == 0:
                    links[k].closed = not links[k].closed
                    moments[k].append(t)
                links[k].change(event, at(y, k)[0])
