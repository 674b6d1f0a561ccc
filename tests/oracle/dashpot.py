"""One impact with a dashpot given by its coefficient: DOP853, with steps to each event.

Nothing of ``jaxcontact`` is imported.
"""

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle import bouncing_ball
from tests.oracle.stored import stored

MASS, STIFFNESS, SPEED = 1.0, 1e8, 3.0


def manual_step(x, d, c_max):
    """STEP(x, 0, 0, d, c_max) by the manual's cubic."""
    if x <= 0:
        return 0.0
    return c_max if x >= d else c_max * (x / d) ** 2 * (3 - 2 * x / d)


@stored()
def truth(c, d, speed):
    """e, the least and the largest force. The damping is c in N s/m, or a step up to it at d.

    The clamped force is followed until δ = 0: where it has vanished the bodies fly apart. Steps
    begin and end where the force or its slope jumps.
    """
    length = (MASS * speed**2 / STIFFNESS) ** 0.4

    def force(x, v):
        damping = c if d is None else manual_step(x, d, c)
        return max(STIFFNESS * max(x, 0.0) ** 1.5 + damping * v, 0.0)

    def out(t, y):
        return y[0]

    out.terminal, out.direction = True, -1
    found = solve_ivp(
        lambda t, y: [y[1], -force(*y) / MASS],
        (0, 40 * length / speed),
        (0.0, speed),
        events=out,
        method="DOP853",
        rtol=1e-12,
        atol=1e-15,
        max_step=length / speed / 150,
        dense_output=True,
    )
    times = np.linspace(0, found.t[-1], 20001)
    forces = np.array([force(*y) for y in found.sol(times).T])
    return -found.y[1, -1] / speed, forces.min(), forces.max()


FINEST = 1e-3
"""What a force that comes back takes, at least, in units of X/v0."""


@stored()
def followed(c, d, n):
    """The duration, and the speed at δ = 0, by the force without its clamp."""
    length = (MASS * SPEED**2 / STIFFNESS) ** (1 / (n + 1))

    def force(x, v, v0):
        return STIFFNESS * x**n + manual_step(x, d, c) * v

    unit = length / SPEED
    duration, _, speed = bouncing_ball.contact(force, MASS, 0.0, SPEED, unit, finest=FINEST)
    return np.array([duration, speed])
