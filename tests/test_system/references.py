"""What runs of mechanisms are compared with: SciPy restarted at events."""

import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

DIFFERENCES = 2e-6
"""Differences of a run at rtol 1e-11 are right to about this, relative to the largest."""


def derivative(function, at, along):
    """Return the derivative of a function that is written with analytic operations."""
    step = 1e-30
    moved = [x + 1j * step * d for x, d in zip(at, along, strict=True)]
    return np.imag(function(*moved)) / step


def unit(t, q, args):
    """A mass of 1 kg for each number."""
    return jnp.eye(q.shape[0], dtype=q.dtype)


def free_fall(t, q, v, args):
    return jnp.full_like(v, -9.81)


def plane(t, q, args):
    """The gap of a body whose second number is its height."""
    return q[1:2]


def restarted(
    mass, force, gap, start, duration, stiffness, alpha, *,
    slip=None, mu=0.0, touching=False, bristles=None,
):  # fmt: skip
    """Return touches (gap, time, speed), phases (time, what) of gap 0, and the end, by DOP853
    restarted at each event, with v0 at touch.

    The functions take numbers that may be complex. A phase is 0 in stick, or the sign of the slip.
    `bristles` of the normal force, the slip speed and a state, 0 at the touch of gap 0, returns the
    friction and the rate of the state; there are no phases then.
    """
    n, t, y = len(start[0]), 0.0, np.concatenate([*start, [0.0] * (bristles is not None)])
    basis, still, count = np.eye(n), np.zeros(n), len(gap(0.0, start[0]))
    closed, speed = np.zeros(count, bool), np.ones(count)
    touches, phases = [], []

    def forces(t, y):
        """Return all forces but friction, those of the contacts, and the closing speeds."""
        q, v = y[:n], y[n : 2 * n]
        normal = np.array([derivative(gap, (t, q), (0.0, e)) for e in basis])
        closing = -derivative(gap, (t, q), (1.0, v))
        elastic = stiffness * np.maximum(-gap(t, q), 0) ** 1.5
        pressed = np.where(closed, elastic * (1 + alpha * closing / speed), 0)
        return force(t, q, v) + normal @ pressed, pressed, closing

    def tangent(t, y):
        at = t, y[:n], y[n : 2 * n]
        return np.array([derivative(slip, at, (0.0, still, e)) for e in basis])

    def held(t, y):
        """Return the friction with which the slip speed does not change."""
        inverse, along = np.linalg.inv(mass(t, y[:n])), tangent(t, y)
        moves = 1.0, y[n:], inverse @ forces(t, y)[0]
        return -derivative(slip, (t, y[:n], y[n:]), moves) / (along @ inverse @ along)

    def right(t, y):
        (drive, pressed, _), bends = forces(t, y), np.zeros(len(y) - 2 * n)
        if bristles and closed[0]:
            rubs, bends[0] = bristles(pressed[0], slip(t, y[:n], y[n : 2 * n]), y[-1])
            drive = drive + tangent(t, y) * rubs
        elif slip and closed[0]:
            sign = phases[-1][1]
            drive = drive + tangent(t, y) * (-sign * mu * pressed[0] if sign else held(t, y))
        return np.concatenate([y[n : 2 * n], np.linalg.solve(mass(t, y[:n]), drive), bends])

    def event_of(k):
        def meets(t, y):
            return gap(t, y[:n])[k]

        meets.terminal, meets.direction = True, 1 if closed[k] else -1
        return meets

    def changes(t, y):
        if not closed[0]:
            return 1.0
        sign = phases[-1][1]
        return sign * slip(t, y[:n], y[n:]) if sign else mu * forces(t, y)[1][0] - abs(held(t, y))

    changes.terminal, changes.direction = True, -1

    def touch(k):
        closed[k], speed[k] = True, forces(t, y)[2][k]
        touches.append((k, t, speed[k]))
        y[2 * n :] = 0.0
        if slip:
            phases.append((t, np.sign(slip(t, y[:n], y[n:]))))

    if touching:
        touch(0)
    how = {"rtol": 1e-12, "atol": 1e-14, "max_step": min(5e-3, duration / 20)}
    while t < duration:
        phased = slip is not None and bristles is None
        events = [event_of(k) for k in range(count)] + [changes] * phased
        # The first step that SciPy tries may be absurdly long.
        with np.errstate(all="ignore"):
            end = solve_ivp(right, (t, duration), y, "DOP853", events=events, **how)
        t, y = end.t[-1], end.y[:, -1]
        met = [k for k in range(count) if len(end.t_events[k])]
        for k in met:
            if closed[k]:
                closed[k] = False
            else:
                touch(k)
        if not met and t < duration:
            hold = held(t, y)
            # After a change the event function is 0 up to rounding, on either side.
            slides = phases[-1][1] == 0 or abs(hold) > mu * forces(t, y)[1][0]
            phases.append((t, -np.sign(hold) if slides else 0))
    return touches, phases, y
