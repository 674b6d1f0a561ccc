"""The stored curve of Maw, Barber and Fawcett: `python -m tests.maw_barber_fawcett_table` makes it.

Rows of springs are integrated with numba over the angle of (w, v) (x = w²), with two numbers of
springs, and extrapolated. The curves are then fitted piece by piece, see
`jaxcontact/_friction/mbf_curve.py`. It takes some six minutes on one core.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
from scipy.optimize import brentq

from jaxcontact._friction.mbf_curve import ALPHA, CHI, DEGREES, FILE, MIDDLE, ORDERS, onset

PATH = Path(__file__).parents[1] / "jaxcontact" / "_friction" / FILE

SPRINGS, SPRINGS_ELASTIC = 2000, 12000
"""Errors are 2e-7 with damping and 2e-9 without."""

IN_CHI, IN_SIGMA = 20, 18
"""Chebyshev nodes in χ and in σ."""

IN_CHI_DAMPED = 14
"""Polynomials in χ with damping."""

LEAST = 3e-8
"""Products of polynomials that change no ψ2 by more are left out."""

UNIT = 1e-10
"""Coefficients are stored as multiples of this."""


@numba.njit
def slopes(angle: float, r: float, alpha: float):
    """Return dr/dφ and dt/dφ for w = r sin φ, v = r cos φ."""
    w, v = r * math.sin(angle), r * math.cos(angle)
    pull = w**4 * (1 + alpha * v)
    turn = (v * v / 2 + w * pull) / (r * r)
    return (w * v / 2 - v * pull) / r / turn, w / turn


@numba.njit
def normal_motion(alpha: float, springs: int):
    """Return w, v, t and dt/dφ at equal steps in φ, by RK4."""
    h = math.pi / 2 / springs
    rows = np.empty((4, 2 * springs + 1))
    r, t = 1.0, 0.0
    for i in range(2 * springs + 1):
        angle = i * h
        k1, d1 = slopes(angle, r, alpha)
        rows[:, i] = r * math.sin(angle), r * math.cos(angle), t, d1
        k2, d2 = slopes(angle + h / 2, r + h / 2 * k1, alpha)
        k3, d3 = slopes(angle + h / 2, r + h / 2 * k2, alpha)
        k4, d4 = slopes(angle + h, r + h * k3, alpha)
        r += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        t += h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    rows[0, 2 * springs] = 0
    return rows


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


@numba.njit
def impacts(psi, chi: float, alpha: float, springs: int):
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
    return brentq(lambda e: energy(-e) - energy(1), 1e-3, most, xtol=1e-15)


def centre_slips(chi: float, alpha: float) -> float:
    """Return the least ψ1 at which the spring at the centre slips during compression."""
    motion, psi = normal_motion(alpha, SPRINGS), 0.5
    for _ in range(12):
        psi *= impact(psi, chi, alpha, motion)[1]
    return psi


def nodes(count: int) -> np.ndarray:
    return np.cos((np.arange(count) + 0.5) * np.pi / count)


def polynomials(x: np.ndarray, count: int) -> np.ndarray:
    return np.cos(np.outer(np.arccos(np.clip(x, -1, 1)), np.arange(count)))


def pieces(chi: float, alpha: float, centre: float, springs: int) -> np.ndarray:
    """Return the coefficients of the four pieces at one χ and α, one after the other."""
    touch, e = 1 + alpha, restitution(alpha)
    full = 2 * chi * (1 + e) - e * (1 - alpha * e)
    middle = touch + MIDDLE * (full - touch)
    found = [np.zeros(count) for count in DEGREES]

    def fit(
        piece: int,
        psi_of: Callable[[np.ndarray], np.ndarray],
        base_of: Callable[[np.ndarray], np.ndarray],
        factor_of: Callable[[np.ndarray], np.ndarray],
    ) -> float:
        x = nodes(2 * DEGREES[piece])
        psi, factor = psi_of((1 + x) / 2), factor_of((1 + x) / 2)
        value = rebound(psi, chi, alpha, springs) - base_of(psi)
        basis = polynomials(x, DEGREES[piece]) * factor[:, None]
        found[piece] = np.linalg.lstsq(basis, value, rcond=None)[0]
        return found[piece].sum()

    base = centre * fit(0, lambda s: centre * s, lambda psi: 0 * psi, lambda s: centre * s)
    if centre < touch:
        to_touch = touch - centre
        base += fit(1, lambda s: centre + to_touch * s**2, lambda _: base, lambda s: s**2)
    to_middle = middle - touch
    fit(2, lambda s: touch + to_middle * s**2, lambda _: base, lambda s: s**2)
    back = full - middle
    fit(3, lambda s: full - back * s**2, lambda psi: psi - 2 * chi * (1 + e), lambda s: s**3)
    return np.concatenate(found)


def in_chi(values: np.ndarray, count: int) -> np.ndarray:
    """Return coefficients in χ of values at the nodes, along the first axis."""
    x = nodes(len(values))
    flat = np.linalg.lstsq(polynomials(x, len(x)), values.reshape(len(x), -1), rcond=None)[0]
    return flat.reshape(values.shape)[:count]


def in_sigma(values: np.ndarray, count: int, power: int) -> np.ndarray:
    """Return coefficients of σ^power T_j(2σ-1) along the first axis."""
    x = nodes(len(values))
    basis = polynomials(x, count) * ((1 + x[:, None]) / 2) ** power
    flat = np.linalg.lstsq(basis, values.reshape(len(x), -1), rcond=None)[0]
    return flat.reshape(count, *values.shape[1:])


def coefficients() -> list[np.ndarray]:
    """Return arrays (χ, α, s) without damping, with weak and with strong damping.

    The last number along s is (`touch` - `centre`)/σ².
    """
    chis = CHI[0] + (CHI[1] - CHI[0]) * (1 + nodes(IN_CHI)) / 2
    sigmas = (1 + nodes(IN_SIGMA)) / 2
    elastic = in_chi(np.array([pieces(c, 0.0, 1.0, SPRINGS_ELASTIC) for c in chis]), ORDERS[0])
    smooth = polynomials(nodes(IN_CHI), ORDERS[0]) @ elastic
    weak, strong = [], []
    for k, chi in enumerate(chis):
        start = onset(chi)
        rows = np.array([pieces(chi, x * start, 1 + x * start, SPRINGS) for x in sigmas])
        weak.append(in_sigma(rows - smooth[k], ORDERS[1], 1))
        alphas = start + (ALPHA - start) * sigmas
        slips = np.array([centre_slips(chi, a) for a in alphas])
        rows = np.array([pieces(chi, a, c, SPRINGS) for a, c in zip(alphas, slips, strict=True)])
        length = in_sigma((1 + alphas - slips)[:, None], ORDERS[2], 2)
        strong.append(np.column_stack([in_sigma(rows, ORDERS[2], 0), length]))
    return [
        np.pad(elastic[:, None], [(0, 0), (0, 0), (0, 1)]),
        np.pad(in_chi(np.array(weak), IN_CHI_DAMPED), [(0, 0), (0, 0), (0, 1)]),
        in_chi(np.array(strong), IN_CHI_DAMPED),
    ]


def largest_change(rows: np.ndarray) -> np.ndarray:
    """Return bounds of what rows of coefficients contribute to ψ2."""
    s = np.linspace(0, 1, 101)
    *parts, centre = np.split(rows, np.cumsum(DEGREES), axis=1)
    factors = (1 + ALPHA) * s, s**2, s**2, s**3
    changes = [
        part @ polynomials(2 * s - 1, part.shape[1]).T * factor
        for part, factor in zip(parts, factors, strict=True)
    ]
    return np.abs(np.concatenate([*changes, centre], axis=1)).max(axis=1)


def contents(arrays: list[np.ndarray]) -> dict[str, object]:
    """Return the entries of the file: products of polynomials, and their coefficients."""
    joined = np.zeros((ORDERS[0], 1 + sum(ORDERS[1:]), sum(DEGREES) + 1))
    place = 0
    for array in arrays:
        joined[: len(array), place : place + array.shape[1]] = array
        place += array.shape[1]
    rows = joined.reshape(-1, joined.shape[-1])
    kept = np.flatnonzero(largest_change(rows) > LEAST)
    kept = np.union1d(kept, np.arange(0, len(rows), joined.shape[1]))
    whole = np.round(rows[kept] / UNIT).astype(int)
    # Fewer digits suffice with damping, where the springs leave 1e-7.
    damped = kept % joined.shape[1] > 0
    whole[damped] = np.round(whole[damped], -2)
    return {
        "unit": UNIT,
        "in_chi": (kept // joined.shape[1]).tolist(),
        "in_alpha": (kept % joined.shape[1]).tolist(),
        "numbers": whole.tolist(),
    }


if __name__ == "__main__":
    PATH.write_text(json.dumps(contents(coefficients()), separators=(",", ":")) + "\n")
