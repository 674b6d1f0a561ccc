"""How a weak push changes a free impact: a power series whose coefficients depend on α alone.

    x'' = Γ - c/(1-κx)³ - xⁿ (1 + α x'),   x(0) = 0,  x'(0) = 1,   θ' = 1/(1-κx)²,

with a constant push Γ and the angular momentum of two bodies that pass each other, c, at the ratio
κ of the unit of length to their distance. The outcome is analytic in γ = Γ-c, c and κ. In the plane
of w, x = w^k, and v the angle runs from 0 to π whatever they are, so that the orders can be
integrated over it side by side, without an event. This is done once for an exponent, at Chebyshev
nodes in ln(1+α), up to order `_ORDER` + 1; the last order estimates what is left out.

Source of the equation: Landau & Lifshitz, Mechanics, section 14. The first order of e agrees with
de/dΓ = (1-αe)/e α ∫ x/(1+αu)² du over the speed u from 1 to -e, by parts from the energy integral.
"""

from __future__ import annotations

import functools
import itertools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._elementary import chebyshev, contraction
from ._base import Lane
from ._scale import Change
from ._truncated import Powers, Series, Truncated

_ORDER = 3
"""Up to which the series is summed."""

_MOST_DAMPING = 5.0
"""The α up to which there is a table: e = 0.197. Beyond, the orders grow fast with α."""

_NODES = 24
_ACCURACY = 1e-9
"""Of the coefficients, relative: 24 nodes leave 1e-10."""

_SAFETY = 2.0
"""Of the first order left out, in place of the sum of all orders left out."""

_DECAY = 0.25
"""The ratio of two orders up to which the series is trusted."""


class Table(NamedTuple):
    """Rows (R,) of Chebyshev coefficients in ln(1+α): of which `output`, times which powers."""

    coefficients: np.ndarray
    output: np.ndarray
    powers: list[Powers]


def weak_push(
    alpha: Lane, n: float, order: int, push: Lane, swirl: Lane, ratio: Lane
) -> tuple[Change, Change] | None:
    """The change of a free impact, and a bound on the error of each; infinite where not known.

    `order` is the k of x = w^k. None for exponents that it does not make a polynomial.
    """
    if order * n != int(order * n):
        return None
    table = table_of(n, order)
    dtype = alpha.dtype
    small = jnp.minimum(alpha, _MOST_DAMPING)
    place = 2 * jnp.log1p(small) / math.log1p(_MOST_DAMPING) - 1
    rows = chebyshev(jnp.asarray(table.coefficients, dtype), place[..., None])
    # Elastic bodies part as fast as they met, whatever holds them or drives them apart.
    loses = (small / (1 + small))[..., None]
    rows = rows * jnp.where(table.output == 0, loses, 1)
    numbers = (push - swirl, swirl, ratio)
    terms = rows * jnp.stack([_monomial(numbers, powers) for powers in table.powers], axis=-1)
    degree = np.array([sum(powers) for powers in table.powers])
    outputs = np.arange(len(Change._fields))[:, None]

    def total(terms: Lane, chosen: np.ndarray) -> Lane:
        which = jnp.asarray((table.output == outputs) & chosen, dtype)
        return jnp.moveaxis(contraction(terms, which.T), -1, 0)

    change = total(terms, degree <= _ORDER)
    sizes = jnp.abs(jax.lax.stop_gradient(terms))
    sums = [total(sizes, degree == d) for d in range(1, _ORDER + 2)]
    last, before = jnp.sum(sums[-1], axis=0), jnp.sum(sums[-2], axis=0)
    good = (alpha <= _MOST_DAMPING) & (last <= _DECAY * before)
    doubt = jnp.where(good, _SAFETY * sums[-1] + _ACCURACY * sums[0], jnp.inf)
    return Change(*change), Change(*doubt)


def _monomial(numbers: tuple[Lane, ...], powers: Powers) -> Lane:
    result = jnp.ones_like(numbers[0])
    for number, power in zip(numbers, powers, strict=True):
        result = result * number**power if power else result
    return result


@functools.lru_cache
def table_of(n: float, order: int) -> Table:
    """The coefficients for an exponent: half a second, once."""
    nodes = np.cos((np.arange(_NODES) + 0.5) * np.pi / _NODES)
    alpha = np.expm1(np.log1p(_MOST_DAMPING) * (1 + nodes) / 2)
    fit = 2 / _NODES * np.cos(np.outer(np.arange(_NODES), np.arccos(nodes)))
    fit[0] /= 2
    rows, output, powers = [], [], []
    for number, factor, monomials, values in _outcome(alpha, n, order):
        if number == 0:
            values = values * (1 + alpha) / alpha
        for monomial, row in zip(monomials, values, strict=True):
            total = tuple(int(power) for power in np.add(monomial, factor))
            if 0 < sum(total) <= _ORDER + 1:
                rows.append(fit @ row)
                output.append(number)
                powers.append(total)
    return Table(np.array(rows).T, np.array(output), powers)


def _outcome(
    alpha: np.ndarray, n: float, order: int
) -> list[tuple[int, Powers, list[Powers], Series]]:
    """The outcome of an impact as series: the place of it in `Change`, powers of another factor,
    and monomials with their coefficients at every α.
    """
    # Without loading it at import.
    from scipy.integrate import solve_ivp

    top, k = _ORDER + 1, order
    everything = itertools.product(range(top + 1), repeat=3)
    # c comes with κ, as what is left of it is in γ.
    known = [p for p in everything if sum(p) <= top and (p[2] >= p[1] > 0 or p[1:] == (0, 0))]
    series = Truncated(known)
    times, power = series.times, series.power
    # The unit of w that makes the motion over the angle smoothest, among a few that were tried.
    unit = (1 + alpha) ** 0.6
    one = series.constant(np.ones_like(alpha))
    gamma = series.variable((1, 0, 0), one)
    # -c/(1-κx)³ = -c - 3 c κ x - 6 c κ² x² - ...
    swirls = [(m + 1) * (m + 2) / 2 * series.variable((0, 1, m), one) for m in range(1, _ORDER + 1)]

    class Now(NamedTuple):
        w: Series
        v: Series
        inner: Series
        x: Series
        force: Series
        pull: Series

    def at(sine: Series, cosine: Series, radius: Series) -> Now:
        w, v = times(radius, sine), times(radius, cosine)
        inner = power(unit * w, k - 1)
        x = times(inner, unit * w)
        force = times(power(unit * w, int(k * n)), one + alpha * v)
        pull, path = force - gamma, one
        for swirl in swirls:
            path = times(path, x)
            pull = pull + times(swirl, path)
        return Now(w, v, inner, x, force, times(inner, pull))

    def rate(sine: Series, cosine: Series, state: Series) -> Series:
        """d(r, t, ∫x dt, ∫x² dt, ...)/dφ, as tan φ = w/v."""
        radius = state[0]
        now = at(sine, cosine, radius)
        turns = times(now.v, now.v) / (k * unit) + times(now.w, now.pull)
        slow = times(radius, series.inverse(turns))
        grows = times(now.v, now.w / (k * unit) - now.pull)
        path = times(now.inner, radius, slow)
        slopes = [times(grows, slow), path]
        for _ in range(top):
            path = times(path, now.x)
            slopes.append(path)
        return np.stack(slopes)

    def along(state: Series, start: np.ndarray, end: np.ndarray) -> Series:
        def flat(part: float, numbers: np.ndarray) -> np.ndarray:
            angle = start + part * (end - start)
            sine, cosine = series.constant(np.sin(angle)), series.constant(np.cos(angle))
            return ((end - start) * rate(sine, cosine, numbers.reshape(state.shape))).ravel()

        how = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "t_eval": [1.0]}
        return solve_ivp(flat, (0.0, 1.0), state.ravel(), **how).y[:, -1].reshape(state.shape)

    def moved(state: Series, angle: np.ndarray, by: Series) -> Now:
        """A step of order 4, which is exact up to the fourth power of `by`."""
        ends = [series.sine_and_cosine(angle, share * by) for share in (0.0, 0.5, 1.0)]

        def further(share: float, slope: Series) -> Series:
            return state + np.stack([share * times(by, change) for change in slope])

        first = rate(*ends[0], state)
        second = rate(*ends[1], further(0.5, first))
        third = rate(*ends[1], further(0.5, second))
        last = rate(*ends[2], further(1.0, third))
        mean = (first + 2 * second + 2 * third + last) / 6
        return at(*ends[2], further(1.0, mean)[0])

    def falls(now: Now) -> Series:
        """What vanishes where the force is largest: n x'(1+αx') + α x x''."""
        return n * times(now.v, one + alpha * now.v) - alpha * times(now.w, now.pull) * unit

    begin = np.stack([one, *[np.zeros_like(one)] * (top + 1)])
    peak, turn = _angle_of_peak(alpha, n, k, unit), np.full_like(alpha, np.pi / 2)
    strongest = along(begin, np.zeros_like(alpha), peak)
    deepest = along(strongest, peak, turn)
    end = along(deepest, turn, 2 * turn)
    tiny = series.constant(np.full_like(alpha, 1e-4))
    sides = [falls(moved(strongest, peak, sign * tiny))[0] for sign in (1, -1)]
    slope = (sides[0] - sides[1]) / 2e-4
    later = np.zeros_like(one)
    # Each of them makes one more order right; of the force, which is stationary, two.
    for _ in range(2):
        change = falls(moved(strongest, peak, later)) / slope
        later[1:] -= change[1:]
    force = moved(strongest, peak, later).force
    found = [(0, (0, 0, 0), end[0]), (1, (0, 0, 0), end[1])]
    # 1/(1-κx)² = 1 + 2 κ x + 3 κ² x² + ...
    found += [(2, (0, 0, m), (m + 1) * end[1 + m]) for m in range(1, top + 1)]
    found += [(3, (0, 0, 0), power(unit * deepest[0], k)), (4, (0, 0, 0), force)]
    return [(number, factor, series.monomials, values) for number, factor, values in found]


def _angle_of_peak(alpha: np.ndarray, n: float, k: int, unit: np.ndarray) -> np.ndarray:
    """Where the force of a free impact is largest: (n+1) α H = n v, H the energy stored."""

    def stored(v: np.ndarray) -> np.ndarray:
        part = (1 - v) / (1 + alpha * v)
        u = alpha * part
        return part * (v + part * (u - np.log1p(u)) / u**2)

    low, high = np.zeros_like(alpha), np.ones_like(alpha) - 1e-9
    for _ in range(60):
        middle = (low + high) / 2
        before = (n + 1) * alpha * stored(middle) > n * middle
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    w = ((n + 1) * stored(low)) ** (1 / (k * (n + 1)))
    return np.arctan2(w / unit, low)
