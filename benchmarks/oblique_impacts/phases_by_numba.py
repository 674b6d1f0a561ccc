"""One spring and slider in numba, by hand: formulas in slip, Taylor series in stick.

The motion is x'' = -x^1.5 (1 + αx'), ψ' = -2χφ, |φ| ≤ F. In w = √x and dt = w ds it is polynomial:
w' = v/2, v' = -w⁴(1 + αv), ψ' = -2χwφ, and φ' = 1.5w²ψ in stick (the form "force"). Series of order
`ORDER` give each step of stick; the end of stick is a root of their polynomials. In slip ψ is
linear in v, and the end of slip is a root of one function of v. The code is for α ≤ 0.3, where that
root is unique.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np

ORDER = 16
_fast = numba.njit(error_model="numpy")
_PHASES, _STEPS = 12, 200
PARTS = (0.5, 1.0)
"""The parts of a step at which the end of stick is looked for."""


@_fast
def _energy(v, alpha):
    """∫ v/(1 + αv) dv."""
    y = alpha * v
    if abs(y) > 1e-2:
        return (y - math.log1p(y)) / alpha**2
    total = 0.0
    for k in range(9, 1, -1):
        total = 1 / k - y * total
    return total * v * v


@_fast
def _rebound(alpha):
    """The e of the normal motion."""
    v, start = -1.0, _energy(1.0, alpha)
    for _ in range(30):
        step = (_energy(v, alpha) - start) * (1 + alpha * v) / v
        v -= step
        if abs(step) < 1e-15:
            break
    return -v


@_fast
def _pull(v, alpha, start):
    """The slip ψ up to which slip goes on, and its slope in v."""
    w5 = 2.5 * (start - _energy(v, alpha))
    pull = (1 + alpha * v) * (v - 2 / 3 * alpha * w5)
    return pull, 1 + 11 / 3 * alpha * v - 2 / 3 * alpha * alpha * w5


@_fast
def _slip_end(v0, psi0, chi, alpha, e, start):
    """The v at which slip ends; -e where it lasts. `psi0` has the sign of slip in it."""
    v = -e
    for _ in range(60):
        pull, slope = _pull(v, alpha, start)
        over = psi0 - 2 * chi * (v0 - v) - pull
        if over >= 0:
            break
        step = over / (2 * chi - slope)
        v -= step
        # The function is concave: Newton's method from below is monotone.
        if abs(step) < 1e-15 or v >= v0:
            break
    return min(v, v0)


@_fast
def _at(c, s):
    total = c[ORDER]
    for k in range(ORDER - 1, -1, -1):
        total = total * s + c[k]
    return total


@_fast
def _room(c, s, alpha):
    """The limit of the force less its amount, and the force."""
    w, v, z = _at(c[0], s), _at(c[1], s), _at(c[3], s)
    return w * w * w * (1 + alpha * v) - abs(z), z


@_fast
def _series(c, squares, fourths, chi, alpha):
    """Fill in the coefficients of w, v, ψ and z from their first ones."""
    w, v, psi, z = c[0], c[1], c[2], c[3]
    for k in range(ORDER):
        square = fourth = pull = held = load = 0.0
        for j in range(k + 1):
            square += w[j] * w[k - j]
        squares[k] = square
        for j in range(k + 1):
            fourth += squares[j] * squares[k - j]
        fourths[k] = fourth
        for j in range(k + 1):
            pull += fourths[j] * v[k - j]
            load += squares[j] * psi[k - j]
            held += w[j] * z[k - j]
        a = 1.0 / (k + 1)
        w[k + 1] = 0.5 * a * v[k]
        v[k + 1] = -a * (fourth + alpha * pull)
        psi[k + 1] = -2 * chi * a * held
        z[k + 1] = 1.5 * a * load


@_fast
def _root(c, low, above, high, below, alpha):
    """The s in (low, high) at which the room falls to zero, by the Illinois method."""
    last = 0
    for _ in range(60):
        s = high - below * (high - low) / (below - above)
        value, _ = _room(c, s, alpha)
        if value < 0:
            high, below = s, value
            above = above / 2 if last < 0 else above
            last = -1
        else:
            low, above = s, value
            below = below / 2 if last > 0 else below
            last = 1
        if high - low < 1e-15 or abs(value) < 1e-16:
            break
    return s


@_fast
def _stick(c, squares, fourths, chi, alpha, tolerance):
    """Follow stick from c[:, 0]; return the sign of the slip after it, 0 if there is none."""
    fresh = True
    for _ in range(_STEPS):
        _series(c, squares, fourths, chi, alpha)
        largest = 1e-30
        for k in range(4):
            largest = max(largest, abs(c[k][ORDER]))
        end = (tolerance / largest) ** (1 / ORDER)
        # At the start of stick the room is zero, and grows.
        low = 1e-3 * end if fresh else 0.0
        for part in PARTS:
            high = part * end
            after, z = _room(c, high, alpha)
            if after < 0:
                room, _ = _room(c, low, alpha)
                s = _root(c, low, max(room, 1e-300), high, after, alpha)
                for k in range(4):
                    c[k][0] = _at(c[k], s)
                return 1 if z > 0 else -1
            low = high
        for k in range(4):
            c[k][0] = _at(c[k], end)
        fresh = False
    return 0


@_fast
def _impact(psi, chi, alpha, tolerance, work):
    c, squares, fourths = work[:4], work[4], work[5]
    e, start = _rebound(alpha), _energy(1.0, alpha)
    v, sign = 1.0, 1
    slides = psi > _pull(1.0, alpha, start)[0]
    touching = not slides
    for _ in range(_PHASES):
        if slides:
            end = _slip_end(v, sign * psi, chi, alpha, e, start)
            psi -= 2 * chi * sign * (v - end)
            v = end
            if v <= -e:
                return psi
        w = (2.5 * max(start - _energy(v, alpha), 0.0)) ** 0.2
        force = 0.0 if touching else sign * w**3 * (1 + alpha * v)
        c[0][0], c[1][0], c[2][0], c[3][0] = w, v, psi, force
        sign = _stick(c, squares, fourths, chi, alpha, tolerance)
        if sign == 0:
            return math.nan
        v, psi, slides, touching = c[1][0], c[2][0], True, False
    return math.nan


@numba.njit(parallel=True, error_model="numpy")
def _impacts(psis, chis, alphas, tolerance):
    out = np.empty_like(psis)
    blocks = 256
    for block in numba.prange(blocks):
        work = np.empty((6, ORDER + 1))
        for lane in range(block * len(psis) // blocks, (block + 1) * len(psis) // blocks):
            out[lane] = _impact(psis[lane], chis[lane], alphas[lane], tolerance, work)
    return out


def call_of(tolerance: float) -> Callable[..., np.ndarray]:
    """Return (ψ1, χ, α) → ψ2 of many lanes, all arrays of one length."""
    return lambda psis, chis, alphas: _impacts(psis, chis, alphas, tolerance)
