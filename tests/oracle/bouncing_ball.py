"""A ball that falls on a contact under its weight: Newton's equation, piece by piece, by SciPy.

m δ'' = m g - F, with F = max(0, F(δ, δ', v0)) for a contact without tension. A piece ends at four
events: the force vanishes or returns, the ball is back at δ = 0, its closing speed is largest, or
it turns inwards again. At the last event its energy no longer suffices to leave, and it rests.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-12


class Touch(NamedTuple):
    """The fields of `jaxcontact.Bounce` of a touch after which the ball leaves."""

    time: float
    duration: float
    return_time: float
    impact_velocity: float
    restitution: float
    height: float


def touches(force, *, mass, gravity, height, unit, most=40, tension=False, peak=False):
    """The touches until rest, and the time of the one that ends the run; None if it is not seen.

    `force(depth, rate, v0)` in N; `unit`, the duration of a contact about, in s. `peak`: v0 is the
    largest closing speed since touch.
    """
    speed, rows = np.sqrt(2 * gravity * height), []
    time = speed / gravity
    while len(rows) < most:
        left = contact(force, mass, gravity, speed, unit, tension, peak)
        if left is None:
            return rows, time
        duration, back, e = left[0], left[1], left[2] / speed
        rows.append(Touch(time, duration, back, speed, e, left[2] ** 2 / (2 * gravity)))
        speed = left[2]
        time += back + 2 * speed / gravity
    return rows, None


def contact(force, mass, gravity, speed, unit, tension=False, peak=False, finest=0.02):
    """When the force vanishes, and when and how fast the ball is back at δ = 0; None at rest.

    `finest`: no step of the way out is longer, in units of `unit`. What begins and ends within one
    is not seen; on the way in a force does not vanish.
    """
    t, y, v0, ended = 0.0, np.array([0.0, speed]), speed, None
    kind = "rises" if peak else "in"
    while True:

        def pushed(y, kind=kind, v0=v0):
            depth = max(y[0], 0.0)
            return force(depth, y[1], max(y[1], 1e-300) if kind == "rises" else v0)

        def rate(t, y, kind=kind, pushed=pushed):
            return [y[1], gravity - (0 if kind == "free" else pushed(y) / mass)]

        events = {
            "peak": (lambda t, y, f=pushed: gravity - f(y) / mass, -1, kind == "rises"),
            "turn": (lambda t, y: y[1], -1, kind == "in"),
            "gone": (lambda t, y, f=pushed: f(y), -1, kind == "out" and not tension),
            "again": (lambda t, y, f=pushed: f(y), 1, kind == "free"),
            "back": (lambda t, y: y[0], -1, kind in ("out", "free")),
            "rest": (lambda t, y: y[1], 1, kind in ("out", "free")),
        }
        names = [name for name, (_, _, wanted) in events.items() if wanted]
        functions = []
        for name in names:
            gap, direction, _ = events[name]
            # A piece starts at an event of the previous one.
            gap = _later(gap, t, 1e-9 * unit, -direction)
            gap.terminal, gap.direction = True, direction
            functions.append(gap)
        piece = solve_ivp(
            rate, (t, t + 1e4 * unit), y, "DOP853", events=functions, rtol=RTOL,
            atol=1e-15 * np.array([speed * unit, speed]),
            max_step=(finest if kind in ("out", "free") else max(finest, 0.02)) * unit,
        )  # fmt: skip
        t, y = piece.t[-1], piece.y[:, -1]
        (what,) = (name for name, at in zip(names, piece.t_events, strict=True) if at.size)
        if what == "rest":
            return None
        if what == "back":
            return (t if kind == "out" else ended), t, -y[1]
        if what == "gone":
            ended = t
        if what == "peak":
            v0 = y[1]
        kind = {"peak": "in", "turn": "out", "gone": "free", "again": "out"}[what]


def _later(gap, start, wait, before):
    return lambda t, y: gap(t, y) if t > start + wait else float(before)
