"""A ball on a table with a prescribed motion: by sampling, and by Newton's equation."""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcontact as jc

GRAVITY = 9.81
FREQUENCY = 50.0
RATE = 2 * math.pi * FREQUENCY
RADIUS, MASS, STIFFNESS = 0.01, 0.03, 1e8


def over(motion, height, law):
    """A ball over a table that moves."""
    return jc.Scene(
        bodies=[
            jc.Sphere(RADIUS, MASS, position=[height + RADIUS]),
            jc.Plane([0.0], [1.0], motion=motion),
        ],
        law=law,
        stiffness=STIFFNESS,
        gravity=[-GRAVITY],
    )


def sine(amplitude, phase):
    """The place of a table and its velocity, at any times."""
    return (
        lambda t: amplitude * np.sin(RATE * t + phase),
        lambda t: amplitude * RATE * np.cos(RATE * t + phase),
    )


def bounces(table, height, e, duration):
    """Touches (time, closing speed) of a ball on a table, and its end, by sampling and Brent."""
    place, speed = table
    t, z, v, touches = 0.0, height, 0.0, []
    while True:

        def gap(s, t=t, z=z, v=v):
            fall = z + v * (s - t) - GRAVITY / 2 * (s - t) ** 2
            return fall - place(s)

        grid = np.linspace(t, duration, 200_001)[1:]
        gaps = gap(grid)
        where = np.flatnonzero((gaps[1:] <= 0) & (gaps[:-1] > 0))
        if where.size == 0:
            left = duration - t
            return np.array(touches), z + v * left - GRAVITY / 2 * left**2, v - GRAVITY * left
        s = brentq(gap, grid[where[0]], grid[where[0] + 1], xtol=1e-16, rtol=1e-15)
        moves, ball = speed(s), v - GRAVITY * (s - t)
        touches.append((s, moves - ball))
        z, v, t = place(s), moves + e * (moves - ball), s


def pressed(table, height, duration, alpha, rtol=1e-12):
    """A soft ball on a table that shakes: Newton's equation, restarted at touches and openings."""
    t, y, in_contact, speed = 0.0, np.array([height, 0.0]), False, 1.0
    place, moving = table

    def force(t, y):
        if not in_contact:
            return 0.0
        depth, rate = place(t) - y[0], moving(t) - y[1]
        return max(STIFFNESS * max(depth, 0.0) ** 1.5 * (1 + alpha * rate / speed), 0.0)

    def gap(t, y):
        return y[0] - place(t)

    gap.terminal = True
    while t < duration:
        gap.direction = 1 if in_contact else -1
        found = solve_ivp(
            lambda t, y: [y[1], force(t, y) / MASS - GRAVITY],
            (t, duration), y, "DOP853", events=gap, rtol=rtol, atol=1e-16,
            max_step=1e-5 if in_contact else 1e-4,
        )  # fmt: skip
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1:
            in_contact = not in_contact
            if in_contact:
                speed = moving(t) - y[1]
    return y
