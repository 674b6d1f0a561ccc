"""The change of a free impact by a weak push: a power series with coefficients in α alone.

    x'' = Γ - c/(1-κx)³ - xⁿ (1 + α x'),   x(0) = 0,  x'(0) = 1,   θ' = 1/(1-κx)²,

with a constant push Γ and the angular momentum c of two passing bodies; κ is the ratio of the unit
of length to their distance. The outcome is analytic in γ = Γ-c, c and κ. The coefficients come from
a table for each exponent; the highest order there estimates the truncation error.

In the plane of w (x = w^k) and v the angle runs from 0 to π for any push. The orders of the power
series are therefore integrated over it side by side, without an event, at Chebyshev nodes in
ln(1+α).

Source of the equation: Landau & Lifshitz, Mechanics, section 14. The first order of e agrees with
de/dΓ = (1-αe)/e α ∫ x/(1+αu)² du over the speed u from 1 to -e, by parts from the energy integral.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import operator
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._functions import chebyshev_polynomials, small_product
from ..base import Lane
from ..scale import Change

_ACCURACY = 1e-9
"""Relative accuracy of the coefficients: 24 nodes leave 1e-10."""

_SAFETY = 2.0
"""Factor on the first omitted order, in place of the sum of all omitted orders."""

_DECAY = 0.25
"""Largest ratio of two orders at which the series is trusted."""


def weak_push(
    alpha: Lane, n: float, order: int, push: Lane, swirl: Lane, ratio: Lane
) -> tuple[Change, Change] | None:
    """Return the change of a free impact and a bound on each error, infinite if unknown.

    `order` is the k of x = w^k. Returns None if x^n is not a polynomial in w.
    """
    if order * n != int(order * n):
        return None
    table = table_of(n, order)
    dtype = alpha.dtype
    small = jnp.minimum(alpha, MOST_DAMPING)
    place = 2 * jnp.log1p(small) / math.log1p(MOST_DAMPING) - 1
    coefficients = jnp.asarray(table.coefficients, dtype)
    rows = small_product(chebyshev_polynomials(len(coefficients), place), coefficients)
    # Elastic bodies separate at their closing speed under any conservative force.
    loses = (small / (1 + small))[..., None]
    rows = rows * jnp.where(table.output == 0, loses, 1)
    terms = rows * _monomials((push - swirl, swirl, ratio), table.powers)
    degree = table.powers.sum(axis=1)
    members = len(Change._fields)
    which = table.output[:, None] == np.arange(members)

    def sums(terms: Lane, *chosen: np.ndarray) -> list[Lane]:
        """Return the sums of the chosen terms, each for all members of a change."""
        columns = np.concatenate([which & rows[:, None] for rows in chosen], axis=1)
        found = small_product(terms, jnp.asarray(columns, dtype))
        return jnp.split(found, len(chosen), axis=-1)

    (change,) = sums(terms, degree <= ORDER)
    sizes = jnp.abs(jax.lax.stop_gradient(terms))
    first, before, last = sums(sizes, degree == 1, degree == ORDER, degree == ORDER + 1)
    decays = jnp.sum(last, axis=-1) <= _DECAY * jnp.sum(before, axis=-1)
    good = ((alpha <= MOST_DAMPING) & decays)[..., None]
    doubt = jnp.where(good, _SAFETY * last + _ACCURACY * first, jnp.inf)
    return (
        Change(*(change[..., k] for k in range(members))),
        Change(*(doubt[..., k] for k in range(members))),
    )


def _monomials(numbers: tuple[Lane, ...], powers: np.ndarray) -> Lane:
    """Return the products (..., R) of the powers (R, 3) of numbers."""
    factors = [
        jnp.where(power > least, number[..., None], 1)
        for number, power in zip(numbers, powers.T, strict=True)
        for least in range(power.max())
    ]
    return functools.reduce(operator.mul, factors)


Powers = tuple[int, ...]
Series = np.ndarray
"""Coefficients (monomials, lanes)."""


class Truncated:
    """Arithmetic of series with the given monomials, each a tuple of powers.

    Terms of a product beyond these monomials are dropped, so the set must contain every divisor
    that occurs. Constants are series; `constant` creates them.
    """

    def __init__(self, monomials: Sequence[Powers]):
        self.monomials = sorted(monomials, key=lambda powers: (sum(powers), powers))
        self.place = {powers: k for k, powers in enumerate(self.monomials)}
        self.degree = np.array([sum(powers) for powers in self.monomials])
        pairs = [
            (self.place[one], self.place[other], self.place[both])
            for one, other in itertools.product(self.monomials, repeat=2)
            if (both := tuple(np.add(one, other))) in self.place
        ]
        self._left, self._right, where = np.array(pairs).T
        self._sums = np.zeros((len(self.monomials), len(pairs)))
        self._sums[where, np.arange(len(pairs))] = 1

    def constant(self, values: np.ndarray) -> Series:
        series = np.zeros((len(self.monomials), *values.shape))
        series[0] = values
        return series

    def variable(self, powers: Powers, like: Series) -> Series:
        """Return the monomial with these powers."""
        series = np.zeros_like(like)
        series[self.place[powers]] = 1
        return series

    def times(self, *factors: Series) -> Series:
        product = factors[0]
        for factor in factors[1:]:
            product = self._sums @ (product[self._left] * factor[self._right])
        return product

    def power(self, series: Series, exponent: int) -> Series:
        if exponent == 0:
            return self.constant(np.ones(series.shape[1:]))
        return self.times(*[series] * exponent)

    def inverse(self, series: Series) -> Series:
        """Return 1/series by Newton's method; each step doubles the number of correct degrees."""
        found, right = self.constant(1 / series[0]), 0
        while right < self.degree[-1]:
            left = -self.times(series, found)
            left[0] += 2
            found, right = self.times(found, left), 2 * right + 1
        return found

    def sine_and_cosine(self, angle: np.ndarray, more: Series) -> tuple[Series, Series]:
        """Return sine and cosine of an angle plus a series without constant term."""
        term = self.constant(np.ones_like(angle))
        sine, cosine = np.sin(angle), np.cos(angle)
        sums = np.zeros_like(term), np.zeros_like(term)
        for k in range(self.degree[-1] + 1):
            slopes = (sine, cosine, -sine, -cosine)
            sums = sums[0] + slopes[k % 4] * term, sums[1] + slopes[(k + 1) % 4] * term
            term = self.times(term, more) / (k + 1)
        return sums


ORDER = 3
"""Highest order that is summed; the table contains one more."""

MOST_DAMPING = 5.0
"""Largest α of the table (e = 0.197). Above it the orders grow fast with α."""

_NODES = 24

FILE = "tables.json"
"""Tables of the most common exponents, written by `python -m tests.weak_push_tables`."""


class Table(NamedTuple):
    """Rows (R,) of Chebyshev coefficients in ln(1+α).

    `output` is the place of each row in `Change`, `powers` (R, 3) its powers of γ, c and κ. The
    change of e is divided by α/(1+α).
    """

    coefficients: np.ndarray
    output: np.ndarray
    powers: np.ndarray


@functools.lru_cache
def table_of(n: float, order: int) -> Table:
    """Return the coefficients for an exponent and the k of x = w^k.

    Tables of usual exponents are read from a file; others are computed once in half a second.
    """
    stored = json.loads(files("jaxcontact._forms.weak_push").joinpath(FILE).read_text()).get(
        name_of(n, order)
    )
    return computed(n, order) if stored is None else Table(*map(np.array, stored))


def name_of(n: float, order: int) -> str:
    """Return the name of a table in `FILE`."""
    return f"n={n:g} k={order}"


def computed(n: float, order: int) -> Table:
    """Return the table by integration."""
    nodes = np.cos((np.arange(_NODES) + 0.5) * np.pi / _NODES)
    alpha = np.expm1(np.log1p(MOST_DAMPING) * (1 + nodes) / 2)
    fit = 2 / _NODES * np.cos(np.outer(np.arange(_NODES), np.arccos(nodes)))
    fit[0] /= 2
    motion = _Motion(alpha, n, order)
    rows, output, powers = [], [], []
    for name, factor, values in motion.outcome():
        if name == "restitution":
            values = values * (1 + alpha) / alpha
        for monomial, row in zip(motion.series.monomials, values, strict=True):
            total = tuple(int(power) for power in np.add(monomial, factor))
            if 0 < sum(total) <= ORDER + 1:
                rows.append(fit @ row)
                output.append(Change._fields.index(name))
                powers.append(total)
    return Table(np.array(rows).T, np.array(output), np.array(powers))


class _Now(NamedTuple):
    """A state: w in its unit, v, x = w^k, dt/dτ, the force, and -dv/dτ."""

    w: Series
    v: Series
    x: Series
    inner: Series
    force: Series
    pull: Series


class _Motion:
    """Impacts for several α as power series in γ, c and κ.

    A state is (r, t, ∫x dt, ∫x² dt, ...) at an angle φ: w = r sin φ, v = r cos φ.
    """

    def __init__(self, alpha: np.ndarray, n: float, order: int):
        top = ORDER + 1
        everything = itertools.product(range(top + 1), repeat=3)
        # c occurs only with κ, since its remaining part is in γ.
        known = [p for p in everything if sum(p) <= top and (p[2] >= p[1] > 0 or p[1:] == (0, 0))]
        self.series = series = Truncated(known)
        self.alpha, self.n, self.k, self.top = alpha, n, order, top
        # The unit of w that makes the motion over the angle smoothest, among a few tried.
        self.unit = (1 + alpha) ** 0.6
        self.one = series.constant(np.ones_like(alpha))
        self.gamma = series.variable((1, 0, 0), self.one)
        # -c/(1-κx)³ = -c - 3 c κ x - 6 c κ² x² - ...
        self.swirls = [
            (m + 1) * (m + 2) / 2 * series.variable((0, 1, m), self.one) for m in range(1, top)
        ]

    def at(self, sine: Series, cosine: Series, radius: Series) -> _Now:
        times, power = self.series.times, self.series.power
        w, v = times(radius, sine), times(radius, cosine)
        inner = power(self.unit * w, self.k - 1)
        x = times(inner, self.unit * w)
        damping = self.one + self.alpha * v
        force = times(power(self.unit * w, int(self.k * self.n)), damping)
        pull, path = force - self.gamma, self.one
        for swirl in self.swirls:
            path = times(path, x)
            pull = pull + times(swirl, path)
        return _Now(w, v, x, inner, force, times(inner, pull))

    def rate(self, sine: Series, cosine: Series, state: Series) -> Series:
        """Return the derivative of a state by φ, as tan φ = w/v."""
        series, times = self.series, self.series.times
        now, radius, width = self.at(sine, cosine, state[0]), state[0], self.k * self.unit
        turns = times(now.v, now.v) / width + times(now.w, now.pull)
        slow = times(radius, series.inverse(turns))
        path = times(now.inner, radius, slow)
        slopes = [times(now.v, now.w / width - now.pull, slow), path]
        for _ in range(self.top):
            path = times(path, now.x)
            slopes.append(path)
        return np.stack(slopes)

    def along(self, state: Series, start: np.ndarray, end: np.ndarray) -> Series:
        """Return the state at the angle `end`."""
        # Imported here, so that importing the package does not load it.
        from scipy.integrate import solve_ivp

        def slope(part: float, numbers: np.ndarray) -> np.ndarray:
            angle = start + part * (end - start)
            sine, cosine = (self.series.constant(f(angle)) for f in (np.sin, np.cos))
            return ((end - start) * self.rate(sine, cosine, numbers.reshape(state.shape))).ravel()

        how = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "t_eval": [1.0]}
        return solve_ivp(slope, (0.0, 1.0), state.ravel(), **how).y[:, -1].reshape(state.shape)

    def moved(self, state: Series, angle: np.ndarray, by: Series) -> _Now:
        """Return the state after a step of order 4, exact up to the fourth power of `by`."""
        shares = [self.series.sine_and_cosine(angle, share * by) for share in (0.0, 0.5, 1.0)]

        def further(share: float, slope: Series) -> Series:
            return state + np.stack([share * self.series.times(by, change) for change in slope])

        first = self.rate(*shares[0], state)
        second = self.rate(*shares[1], further(0.5, first))
        third = self.rate(*shares[1], further(0.5, second))
        last = self.rate(*shares[2], further(1.0, third))
        mean = (first + 2 * second + 2 * third + last) / 6
        return self.at(*shares[2], further(1.0, mean)[0])

    def strongest(self, state: Series, angle: np.ndarray) -> Series:
        """Return the largest force, from the state where it is largest in a free impact."""

        def falls(by: Series) -> Series:
            """Return n x'(1+αx') + α x x'', which vanishes at the largest force."""
            now = self.moved(state, angle, by)
            factor = self.one + self.alpha * now.v
            power = self.alpha * self.unit * self.series.times(now.w, now.pull)
            return self.n * self.series.times(now.v, factor) - power

        tiny = self.series.constant(np.full_like(angle, 1e-4))
        slope = (falls(tiny)[0] - falls(-tiny)[0]) / 2e-4
        later = np.zeros_like(self.one)
        # Each pass makes one more order correct; of the force, which is stationary, two.
        for _ in range(2):
            later[1:] -= (falls(later) / slope)[1:]
        return self.moved(state, angle, later).force

    def outcome(self) -> list[tuple[str, Powers, Series]]:
        """Return members of `Change`, the powers of a factor, and the series it multiplies."""
        begin = np.stack([self.one, *[np.zeros_like(self.one)] * (self.top + 1)])
        peak, turn = self.angle_of_peak(), np.full_like(self.alpha, np.pi / 2)
        strongest = self.along(begin, np.zeros_like(turn), peak)
        deepest = self.along(strongest, peak, turn)
        end = self.along(deepest, turn, 2 * turn)
        alone = (0, 0, 0)
        # 1/(1-κx)² = 1 + 2 κ x + 3 κ² x² + ...
        turning = [("turning", (0, 0, m), (m + 1) * end[1 + m]) for m in range(1, self.top + 1)]
        return [
            ("restitution", alone, end[0]),
            ("duration", alone, end[1]),
            *turning,
            ("max_indentation", alone, self.series.power(self.unit * deepest[0], self.k)),
            ("max_force", alone, self.strongest(strongest, peak)),
        ]

    def angle_of_peak(self) -> np.ndarray:
        """Return the angle of the largest force of a free impact: (n+1) α H = n v, H the stored
        energy.
        """
        alpha, n = self.alpha, self.n

        def stored(v: np.ndarray) -> np.ndarray:
            part = (1 - v) / (1 + alpha * v)
            u = alpha * part
            return part * (v + part * (u - np.log1p(u)) / u**2)

        low, high = np.zeros_like(alpha), np.ones_like(alpha) - 1e-9
        for _ in range(60):
            middle = (low + high) / 2
            before = (n + 1) * alpha * stored(middle) > n * middle
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        w = ((n + 1) * stored(low)) ** (1 / (self.k * (n + 1)))
        return np.arctan2(w / self.unit, low)
