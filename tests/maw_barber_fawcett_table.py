"""The stored curve of Maw, Barber and Fawcett: `python -m tests.maw_barber_fawcett_table` makes it.

Without damping the curves are those of `elastic_rebound.py`. With damping, rows of springs are
integrated with numba over the angle of (w, v) (x = w²), with two numbers of springs, and
extrapolated. What weak damping changes is the difference of two such rows, so that their error
vanishes with α. The curves are then fitted piece by piece, see
`jaxcontact/_friction/maw_barber_fawcett.py`. It takes some three minutes on one core.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.polynomial.chebyshev import chebpts1 as nodes
from numpy.polynomial.chebyshev import chebvander
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from jaxcontact._friction.maw_barber_fawcett import (
    ALPHA,
    CHI,
    CHI_DAMPED,
    DEGREES,
    FILE,
    MIDDLE,
    ORDERS,
    TURNING,
    onset,
)

from .elastic_rebound import forward_ends, rebounds

PATH = Path(__file__).parents[1] / "jaxcontact" / "_friction" / FILE

SPRINGS = 2000  # the error is 2e-7
IN_CHI, IN_CHI_DAMPED, IN_SIGMA = 24, 16, 18
"""Chebyshev nodes in χ without and with damping, and in σ."""

LEAST = 5e-8  # with damping, products of polynomials that change no ψ2 by more are left out
UNIT = 1e-10  # coefficients are stored as multiples of this


def normal_motion(alpha: float, springs: int) -> np.ndarray:
    """Return w, v, t and dt/dφ at equal steps in φ, where w = r sin φ and v = r cos φ."""

    def rates(angle: Any, state: Any) -> tuple[Any, Any]:
        w, v = state[0] * np.sin(angle), state[0] * np.cos(angle)
        pull = w**4 * (1 + alpha * v)
        turn = (v * v / 2 + w * pull) / state[0] ** 2
        return (w * v / 2 - v * pull) / state[0] / turn, w / turn

    angles = np.linspace(0, math.pi, 2 * springs + 1)
    path = solve_ivp(rates, (0, math.pi), (1, 0), "DOP853", angles, rtol=1e-13, atol=1e-14).y
    w = path[0] * np.sin(angles)
    w[-1] = 0
    return np.stack([w, path[0] * np.cos(angles), path[1], rates(angles, path)[1]])


@numba.njit(fastmath=True)
def traction(t, q2, weight, count: int, by: float, x: float, damping: float):
    """Move the springs in contact by `by`, limit their forces, and return their weighted sum."""
    total = 0.0
    for j in range(count):
        most = (x - q2[j]) * damping
        t[j] = min(max(t[j] + by, -most), most)
        total += t[j] * weight[j]
    return total


@numba.njit
def impact(psi: float, chi: float, alpha: float, motion):
    """Return ψ at the end and the least ratio of the limit to the movement U of the centre.

    Leapfrog. A spring stands at each w of the compression.
    """
    w, v, time, pace = motion
    springs = (len(w) - 1) // 2
    kick = 1.5 * chi * math.pi / 2 / springs
    q = w[: springs + 1].copy()
    q2, t = q * q, np.zeros(springs + 1)
    weight = np.empty(springs + 1)
    weight[0], weight[springs] = (q[1] - q[0]) / 2, (q[springs] - q[springs - 1]) / 2
    weight[1:-1] = (q[2:] - q[:-2]) / 2
    total, count, moved = 0.0, 1, 0.0
    one, two, least = np.inf, np.inf, 0.0
    for i in range(1, 2 * springs + 1):
        psi -= kick * pace[i - 1] * total
        by = psi * (time[i] - time[i - 1])
        moved += by
        if i <= springs:
            count = i + 1
        while count > 0 and q[count - 1] > w[i]:
            count -= 1
        total = 0.0
        if count > 0:
            total = traction(t, q2, weight, count, by, w[i] ** 2, 1 + alpha * v[i])
            # The last spring stands for half the distance to its neighbour, and to the edge.
            last = w[i] - (q[count - 2] if count > 1 else 0.0)
            total += t[count - 1] * (last / 2 - weight[count - 1])
        psi -= kick * pace[i] * total
        if moved > 0 and least == 0:
            now = w[i] ** 2 * (1 + alpha * v[i]) / moved
            if i > 9 and one < now and one < two:
                least = one - (now - two) ** 2 / 8 / ((now - one) + (two - one))
            one, two = now, one
    return psi, least


def impacts(psi: np.ndarray, chi: float, alpha: float, springs: int) -> np.ndarray:
    motion = normal_motion(alpha, springs)
    result = np.empty_like(psi)
    for k in range(len(psi)):
        result[k] = impact(psi[k], chi, alpha, motion)[0]
    return result


def rebound(psi: np.ndarray, chi: float, alpha: float, springs: int) -> np.ndarray:
    """Return ψ2, extrapolated from two numbers of springs."""
    fine, coarse = (impacts(psi, chi, alpha, n) for n in (springs, springs // 2))
    return (4 * fine - coarse) / 3


def restitution(alpha: float) -> float:
    if alpha == 0:
        return 1.0

    def energy(v: float) -> float:
        return v / alpha - math.log1p(alpha * v) / alpha**2

    most = min(1, 1 / alpha) * (1 - 1e-12)
    found: Any = brentq(lambda e: energy(-e) - energy(1), 1e-3, most, xtol=1e-15)
    return float(found)


def centre_slips(chi: float, alpha: float) -> float:
    """Return the least ψ1 at which the spring at the centre slips during compression."""
    motion, psi = normal_motion(alpha, SPRINGS), 0.5
    for _ in range(12):
        psi *= impact(psi, chi, alpha, motion)[1]
    return psi


Function = Callable[[np.ndarray], np.ndarray]


def places(count: int) -> np.ndarray:
    """Return the s in [0, 1] at which a piece of some coefficients is fitted."""
    return (1 + nodes(3 * count // 2)) / 2


def fit(count: int, values: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Return coefficients c, with values = factor(s) Σ c_k T_k(2s - 1) at the places of s."""
    matrix = chebvander(2 * places(count) - 1, count - 1) * factor[:, None]
    return np.linalg.lstsq(matrix, values, rcond=None)[0]


def between(count: int, rebound_of: Function, low: float, high: float) -> np.ndarray:
    """Return the coefficients of ψ2/ψ1 between two ψ1."""
    psi = low + (high - low) * places(count)
    return fit(count, rebound_of(psi), psi)


def beyond(count: int, rebound_of: Function, low: float, high: float, at_low: float) -> np.ndarray:
    """Return the coefficients of what ψ2 changes by from a ψ1 on, ψ1 = low + (high - low) s²."""
    square = places(count) ** 2
    return fit(count, rebound_of(low + (high - low) * square) - at_low, square)


def to_full(
    rebound_of: Function, touch: float, full: float, at_touch: float, loss: float
) -> list[np.ndarray]:
    """Return the coefficients of the pieces from `touch` to `full`."""
    middle = touch + MIDDLE * (full - touch)
    s = places(DEGREES[3])
    psi = full - (full - middle) * s**2
    last = fit(DEGREES[3], rebound_of(psi) - (psi - loss), s**3)
    return [beyond(DEGREES[2], rebound_of, touch, middle, at_touch), last]


def damped_pieces(chi: float, alpha: float, centre: float) -> np.ndarray:
    """Return the coefficients of the four pieces at one χ and α, one after the other."""

    def rebound_of(psi: np.ndarray) -> np.ndarray:
        return rebound(psi, chi, alpha, SPRINGS)

    touch, e = 1 + alpha, restitution(alpha)
    full = 2 * chi * (1 + e) - e * (1 - alpha * e)
    first = between(DEGREES[0], rebound_of, 0.0, centre)
    second, at_touch = np.zeros(DEGREES[1]), centre * first.sum()
    if centre < touch:
        second = beyond(DEGREES[1], rebound_of, centre, touch, at_touch)
        at_touch += second.sum()
    rest = to_full(rebound_of, touch, full, at_touch, 2 * chi * (1 + e))
    return np.concatenate([first, second, *rest])


def elastic_pieces(chi: float) -> np.ndarray:
    """Return the coefficients of the four pieces without damping, and where the first one ends."""

    def rebound_of(psi: np.ndarray) -> np.ndarray:
        return rebounds(psi, chi)

    split = forward_ends(chi) if chi > TURNING else 1.0
    first = between(DEGREES[0], rebound_of, 0.0, split)
    second = np.zeros(DEGREES[1])
    if split < 1:
        second = between(DEGREES[1], rebound_of, split, 1.0)
    else:
        second[0] = first.sum()
    rest = to_full(rebound_of, 1.0, 4 * chi - 1, second.sum(), 4 * chi)
    return np.concatenate([first, second, *rest, [split]])


def along(values: np.ndarray, count: int, power: int = 0) -> np.ndarray:
    """Return coefficients of σ^power T_j(2σ-1) of values at the nodes, along the first axis."""
    x = nodes(len(values))
    basis = chebvander(x, count - 1) * ((1 + x[:, None]) / 2) ** power
    flat = np.linalg.lstsq(basis, values.reshape(len(x), -1), rcond=None)[0]
    return flat.reshape(count, *values.shape[1:])


def chis_between(low: float, high: float, count: int) -> np.ndarray:
    return low + (high - low) * (1 + nodes(count)) / 2


def elastic_table() -> np.ndarray:
    """Return coefficients (χ, s) below and above `TURNING`, one after the other."""
    parts = []
    for low, high in ((CHI[0], TURNING), (TURNING, CHI[1])):
        curves = [elastic_pieces(chi) for chi in chis_between(low, high, IN_CHI)]
        parts.append(along(np.array(curves), ORDERS[0]))
    return np.concatenate(parts)


def damped_table() -> np.ndarray:
    """Return coefficients (χ, α, s) of what weak damping adds, then of strong damping.

    The last number along s is (`touch` - `centre`)/σ².
    """
    sigmas = (1 + nodes(IN_SIGMA)) / 2
    curves = []
    for chi in chis_between(*CHI_DAMPED, IN_CHI_DAMPED):
        start = onset(chi)
        elastic = damped_pieces(chi, 0.0, 1.0)
        rows = np.array([damped_pieces(chi, x * start, 1 + x * start) for x in sigmas])
        weak = np.pad(along(rows - elastic, ORDERS[2], 1), [(0, 0), (0, 1)])
        alphas = start + (ALPHA - start) * sigmas
        slips = np.array([centre_slips(chi, a) for a in alphas])
        rows = np.array([damped_pieces(chi, a, c) for a, c in zip(alphas, slips, strict=True)])
        length = along((1 + alphas - slips)[:, None], ORDERS[3], 2)
        strong = np.column_stack([along(rows, ORDERS[3]), length])
        curves.append(np.concatenate([weak, strong]))
    return along(np.array(curves), ORDERS[1])


def largest_change(rows: np.ndarray) -> np.ndarray:
    """Return bounds of what rows of coefficients contribute to ψ2."""
    s = np.linspace(0, 1, 101)
    *parts, centre = np.split(rows, np.cumsum(DEGREES), axis=1)
    factors = (1 + ALPHA) * s, s**2, s**2, s**3
    changes = [
        part @ chebvander(2 * s - 1, part.shape[1] - 1).T * factor
        for part, factor in zip(parts, factors, strict=True)
    ]
    return np.abs(np.concatenate([*changes, centre], axis=1)).max(axis=1)


def contents() -> dict[str, object]:
    """Return the entries of the file: products of polynomials, and their coefficients."""
    elastic, damped = elastic_table(), damped_table()
    rows = damped.reshape(-1, damped.shape[-1])
    kept = np.flatnonzero(largest_change(rows) > LEAST)
    # Fewer digits suffice with damping, where the springs leave 2e-7.
    fewer = 100 * np.round(rows[kept] / UNIT / 100)
    return {
        "unit": UNIT,
        "elastic": np.round(elastic / UNIT).astype(int).tolist(),
        "in_chi": (kept // damped.shape[1]).tolist(),
        "in_alpha": (kept % damped.shape[1]).tolist(),
        "damped": fewer.astype(int).tolist(),
    }


if __name__ == "__main__":
    PATH.write_text(json.dumps(contents(), separators=(",", ":")) + "\n")
