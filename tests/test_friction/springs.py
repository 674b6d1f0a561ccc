"""Rows of springs by another scheme than the table's: midpoints in q, Heun's steps in time."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle.stored import stored


def end_of_contact(_, y):
    return y[0]


end_of_contact.terminal = True
end_of_contact.direction = -1


@stored()
def rebound(psi1, chi, alpha, springs):
    """ψ2 of several ψ1 at one χ and α.

    Of first order, since a spring that touches within a step moves by the whole step.
    """

    def slope(_, y):
        return [y[1], -(max(y[0], 0) ** 1.5) * (1 + alpha * y[1])]

    motion = solve_ivp(
        slope, (0, 20), [0, 1.0], "DOP853", rtol=1e-12, atol=1e-13, dense_output=True,
        events=end_of_contact,
    )  # fmt: skip
    # Steps are shorter where springs touch and part fast.
    time = motion.t_events[0][0] * np.sin(np.linspace(0, np.pi / 2, 2 * springs + 1)) ** 2
    x, v = motion.sol(time)
    x = np.maximum(x, 0)
    width = np.sqrt(x.max()) / springs
    q2 = (width * (np.arange(springs) + 0.5)) ** 2
    psi, t, total = np.array(psi1, float), np.zeros((len(psi1), springs)), 0.0
    for k in range(2 * springs):
        step = time[k + 1] - time[k]
        most = np.maximum(x[k + 1] - q2, 0) * (1 + alpha * v[k + 1])
        later = psi - 3 * chi * total * step
        # The forces at the end of the step, with the movement of a trapezoid, twice.
        for _ in range(2):
            moved = np.clip(t + (step * (psi + later) / 2)[:, None], -most, most)
            new = width * moved.sum(axis=1)
            later = psi - 1.5 * chi * step * (total + new)
        psi, t, total = later, moved, new
    return psi
