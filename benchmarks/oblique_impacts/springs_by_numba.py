"""The row of springs of Maw, Barber and Fawcett's contact, integrated in numba.

All lanes share χ and an elastic normal motion, whose indentation is given at equal steps of time.
The steps are of second order in the slip, the springs at midpoints of the width.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from scipy.integrate import solve_ivp


def normal_motion(steps: int) -> tuple[float, np.ndarray]:
    """Return a step of time, and x of x'' = -x^1.5, x' = 1 at the ends of the steps."""
    end, one = (1.25) ** 0.4, {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
    # With x = w² and dt = w ds the motion is polynomial at touch.
    go = solve_ivp(
        lambda s, y: (y[1] / 2, -(y[0] ** 4), y[0]), (0, 9), (0, 1, 0),
        events=_turned, dense_output=True, **one,
    )  # fmt: skip
    half = go.y_events[0][0][2]
    time = np.linspace(0, half, steps // 2 + 1)
    # Newton's method for s at each time.
    s = np.interp(time, go.y[2], go.t)
    for _ in range(20):
        w, _, t = go.sol(s)
        s = np.clip(s - (t - time) / np.maximum(w, 1e-3), 0, go.t_events[0][0])
    w = go.sol(s)[0]
    w[0], w[-1] = 0, end**0.5
    return time[1], np.concatenate([w**2, w[-2::-1] ** 2])


def _turned(s: float, y: np.ndarray) -> float:
    return y[1]


_turned.terminal = True


@numba.njit(parallel=True, fastmath=True, error_model="numpy")
def _rebounds(psis, chi, h, depth, squares, width, counts):
    out = np.empty_like(psis)
    for lane in numba.prange(len(psis)):
        taus = np.zeros(len(squares))
        psi = psis[lane]
        for i in range(1, len(depth) - 1):
            x, moved, before, n = depth[i], h * psi, counts[i - 1], counts[i]
            total = 0.0
            for j in range(min(before, n)):
                most = x - squares[j]
                taus[j] = min(max(taus[j] + moved, -most), most)
                total += taus[j]
            for j in range(before, n):
                # A spring that touches within the step moves only in the rest of it.
                most = x - squares[j]
                part = most / (x - depth[i - 1])
                taus[j] = min(max(part * moved, -most), most)
                total += taus[j]
            psi -= 2 * chi * h * 1.5 * width * total
        out[lane] = psi
    return out


def call_of(chi: float, springs: int, steps: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return ψ1 → ψ2 of many lanes, with this many springs and steps."""
    h, depth = normal_motion(steps)
    width = np.sqrt(depth.max()) / springs
    squares = (width * (np.arange(springs) + 0.5)) ** 2
    counts = np.searchsorted(squares, depth)
    return lambda psis: _rebounds(psis, chi, h, depth, squares, width, counts)


def extrapolated(chi: float, springs: int, steps: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return ψ1 → ψ2 by Richardson's extrapolation of one and of twice as many springs."""
    coarse, fine = call_of(chi, springs, steps), call_of(chi, 2 * springs, 2 * steps)
    return lambda psis: (4 * fine(psis) - coarse(psis)) / 3
