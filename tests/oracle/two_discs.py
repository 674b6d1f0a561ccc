"""Two discs, or one on a wall, whose friction is regularised: DOP853, restarted at each event.

Nothing of ``jaxcontact`` is imported.
"""

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle.stored import stored

MU, V_D, STIFFNESS = 0.2, 0.02, 1e8

E = 0.6
ALPHA = 1.5 * (1 - E) / E
"""The damping factor of Hu and Guo."""


def rates(y, spheres, wall, v0):
    """Newton's equations of two spheres in the plane, or of one on a wall at y = 0."""
    (m, n), (r, s) = spheres
    x, v, w = y[:4].reshape(2, 2), y[4:8].reshape(2, 2), y[8:]
    apart = x[0] * [0, 1] if wall else x[0] - x[1]
    length = np.hypot(*apart)
    normal, distance = apart / length, r if wall else r + s
    relative = v[0] - (0 if wall else v[1])
    force = STIFFNESS * max(distance - length, 0) ** 1.5
    force *= max(1 - ALPHA * (relative @ normal) / v0, 0)
    # On a wall the arm is the radius; between spheres both add up to the distance.
    arms = np.array([r, 0.0] if wall else [r, s]) - (0 if wall else (distance - length) / 2)
    tangent = np.array([-normal[1], normal[0]])
    slip = relative @ tangent - arms @ w
    rub = -MU * force * np.clip(slip / V_D, -1, 1)
    push = force * normal + rub * tangent
    inertia = 0.4 * np.array([m * r**2, n * s**2])
    second = np.zeros(2) if wall else -push / n
    return np.concatenate([v.ravel(), push / m, second, -arms * rub / inertia])


@stored()
def integrated(spheres, x, v, w, duration, wall):
    """The state of the run, restarted at each touch and at each end of a contact."""
    y = np.concatenate([np.ravel(x), np.ravel(v), w])
    r, s = spheres[1]

    def gap(t, y):
        if wall:
            return y[1] - r
        return np.hypot(*(y[:2] - y[2:4])) - r - s

    gap.terminal = True
    t, inside = 0.0, False
    while t < duration:
        gap.direction = 1 if inside else -1
        away = y[0:2] * [0, 1] if wall else y[:2] - y[2:4]
        closes = -(y[4:6] - (0 if wall else y[6:8])) @ away / np.hypot(*away)
        if inside:

            def right(t, y, closes=closes):
                return rates(y, spheres, wall, closes)
        else:

            def right(t, y):
                return np.concatenate([y[4:8], np.zeros(6)])

        # The slope of friction jumps where sliding ends.
        step = 2e-5 if inside else 0.01
        out = solve_ivp(
            right, (t, duration), y, method="DOP853", rtol=1e-12, atol=1e-14, events=gap,
            max_step=step,
        )  # fmt: skip
        t, y = out.t[-1], out.y[:, -1]
        if out.status == 1:
            inside = not inside
    return y[4:8].reshape(2, 2), y[8:]
