"""One spring and slider by general solvers: diffrax, and SciPy with events."""

from __future__ import annotations

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from ..until_event import ending, until
from .problems import Lanes


def by_diffrax(lanes: Lanes, rtol: float) -> Callable[[], jax.Array]:
    """Plain diffrax: the limit of friction is switched inside the right-hand side."""

    def right(s, y, args):
        (w, v, psi, phi), (chi, alpha) = y, args
        most = w**3 * (1 + alpha * v)
        slope = w * w * (1 + alpha * v) * (1.5 * v - alpha * w**5)
        grows, sign = 1.5 * w * w * psi, jnp.sign(phi)
        slips = (jnp.abs(phi) >= most) & (sign * grows > slope)
        rate = jnp.where(slips, sign * slope, grows)
        held = jnp.clip(phi, -jnp.abs(most), jnp.abs(most))
        return jnp.stack([v / 2, -(w**4) * (1 + alpha * v), -2 * chi * w * held, rate])

    def parts(t, y, args, **_):
        return y[0]

    def impact(psi, chi, alpha):
        start = jnp.stack([0 * psi, 1 + 0 * psi, psi, 0 * psi])
        how = {"args": (chi, alpha), "stop": 20.0, "first": 1e-3, "newton": 1e-12, "most": 4096}
        end = until(right, start, parts, rtol, **how)
        return end.ys[-1][2]

    program = jax.jit(jax.vmap(impact))
    given = [jnp.asarray(x) for x in (lanes.psi, lanes.chi, lanes.alpha)]
    return lambda: program(*given)


def _impact(psi: float, chi: float, alpha: float, rtol: float) -> float:
    """The motion in w = √x and dt = w ds, which is smooth at touch; its state is w, v, ψ, φ."""

    def force(y):
        return y[0] ** 3 * (1 + alpha * y[1])

    def pull(y, sign):
        return sign * y[2] - (1 + alpha * y[1]) * (y[1] - 2 / 3 * alpha * y[0] ** 5)

    parts = ending(lambda s, y: y[0])
    y, sign = np.array([0.0, 1.0, psi, 0.0]), 1.0
    slides = pull(y, sign) > 0
    for _ in range(12):

        def right(s, y, slides=slides, sign=sign):
            w, v, slip, phi = y
            phi = sign * force(y) if slides else phi
            grows = 0.0 if slides else 1.5 * w * w * slip
            return v / 2, -(w**4) * (1 + alpha * v), -2 * chi * w * phi, grows

        if slides:
            ends = ending(lambda s, y, sign=sign: pull(y, sign))
        else:
            ends = ending(lambda s, y: force(y) - abs(y[3]))
        go = solve_ivp(
            right, (0, 20), y, "DOP853", events=(parts, ends), rtol=rtol, atol=rtol * 1e-2
        )
        y = go.y[:, -1].copy()
        if len(go.t_events[0]) or y[0] < 1e-9:
            return y[2]
        y[3] = sign * force(y) if slides else y[3]
        sign, slides = (sign if slides else math.copysign(1.0, y[3])), not slides
    return math.nan


def by_scipy(lanes: Lanes, rtol: float) -> Callable[[], np.ndarray]:
    """SciPy with events: slip and stick by `solve_ivp`, restarted where one ends."""
    rows = list(zip(lanes.psi, lanes.chi, lanes.alpha, strict=True))
    return lambda: np.array([_impact(*row, rtol) for row in rows])
