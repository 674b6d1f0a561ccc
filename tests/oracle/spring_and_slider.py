"""One spring and slider by SciPy: every phase is integrated, and restarted at its event."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle.stored import stored


class Spring:
    """Limit and rates of the spring in dt = w dτ; its state is its force or its displacement."""

    def __init__(self, keeps_force, chi, alpha):
        self.keeps_force, self.chi, self.alpha = keeps_force, chi, alpha

    def limit(self, w, v):
        stiffening = 1 + self.alpha * v
        return w**3 * stiffening if self.keeps_force else w**2 * stiffening / 1.5

    def gain(self, w):
        return 1.5 * w**2 if self.keeps_force else w

    def growth(self, w, v):
        """Return the rate of the limit over the gain."""
        alpha, x = self.alpha, w**5
        if self.keeps_force:
            return (1 + alpha * v) * (v - alpha * x / 1.5)
        return (1 + alpha * v) * (v - alpha * x) / 1.5

    def force(self, w, z):
        return z if self.keeps_force else 1.5 * w * z


def _phase(spring, state, sign, turns):
    """Integrate one phase; `sign` is 0 in stick. Return its end and the event: 0, 1 or 2."""
    alpha = spring.alpha

    def rates(_, y):
        w, v, psi, z = y
        z = sign * spring.limit(w, v) if sign else z
        rise = sign * spring.growth(w, v) if sign else psi
        pull = -2 * spring.chi * w * spring.force(w, z)
        return [v / 2, -(w**4) * (1 + alpha * v), pull, spring.gain(w) * rise]

    def changes(_, y):
        w, v, psi, z = y
        if sign:
            return spring.growth(w, v) - sign * psi
        return abs(z) - spring.limit(w, v)

    events = [changes, lambda _, y: -y[0]] + [lambda _, y: -y[1]] * turns
    for event in events:
        event.terminal, event.direction = True, 1
    run = solve_ivp(
        rates, (0, 100), state, "DOP853", events=events, rtol=1e-13, atol=1e-15, max_step=0.08
    )
    return run.y[:, -1].copy(), next(k for k, t in enumerate(run.t_events) if len(t))


@stored()
def psi2(psi1, chi, alpha, form):
    """Return ψ at separation."""
    spring = Spring(form != "displacement", chi, alpha)
    sign = float(psi1 > spring.growth(0.0, 1.0))
    state = np.array([0.0, 1.0, psi1, 0.0])
    while True:
        turns = form == "rescaled" and spring.keeps_force
        state, event = _phase(spring, state, sign, turns)
        w, v, psi, z = state
        if event == 1:
            return float(psi)
        if event == 2:
            spring, state[3] = Spring(False, chi, alpha), z / (1.5 * w)
        else:
            limit = spring.limit(w, v)
            sign, state[3] = (0.0, sign * limit) if sign else (np.sign(z), np.sign(z) * limit)
