"""Elementary functions without cancellation, with correct derivatives at removable singularities.

A closed form that loses all digits where its argument vanishes is replaced by a power series there.
Both branches receive a safe argument, because a NaN in the unused branch would spoil the derivative
of the other one.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, ArrayLike, Float

from .._entry import as_parameter, is_plain


def power(x: ArrayLike, exponent: ArrayLike) -> Float[Array, "..."]:
    """Return `x^exponent` for x ≥ 0 and zero for x < 0, with a finite derivative everywhere.

    At x = 0 the derivative is the one from the right if that is finite: 0 for an exponent above 1,
    and 1 for an exponent of 1. For an exponent between 0 and 1 it is infinite and is defined to be
    0. A Python or NumPy exponent that is a multiple of 1/4 is computed from products and square
    roots, several times faster than a general power. Raises ValueError for anything that is not a
    number.
    """
    x, given = as_parameter(x, "x"), as_parameter(exponent, "exponent")
    if not is_plain(exponent):
        exponent = given
    else:
        exponent = float(exponent)
        if exponent == 0:
            return jnp.where(x >= 0, jnp.ones_like(x), 0)
        quarters = 4 * exponent
        if quarters == int(quarters) and 0 < quarters <= 64:
            return _quarter_power(x, int(quarters))
    positive = x > 0
    # The inner `where` keeps log(0) out of the unused branch and thus out of its tangent. As for a
    # concrete exponent, x^0 is 1 and x^1 is x, including its slope at zero.
    edge = jnp.where(exponent == 1, x, jnp.where(exponent == 0, 1, 0))
    inside = jnp.power(jnp.where(positive, x, 1), exponent)
    return jnp.where(positive, inside, jnp.where(x == 0, edge, 0))


def _quarter_power(x: Float[Array, "..."], quarters: int) -> Float[Array, "..."]:
    whole, rest = divmod(quarters, 4)
    if rest == 0:
        return jnp.where(x >= 0, x, 0) ** whole
    positive = x > 0
    safe = jnp.where(positive, x, 1)
    root = jnp.sqrt(safe)
    fraction = {1: jnp.sqrt(root), 2: root, 3: root * jnp.sqrt(root)}[rest]
    return jnp.where(positive, fraction * safe**whole if whole else fraction, 0)


# Each series is cut where its first omitted term is below half an ulp of float64 at the switch.
_PSI_SERIES = tuple(1 / math.factorial(k + 2) for k in range(18))
_ATANH_SERIES = tuple(1 / (2 * k + 3) for k in range(16))
_ARC_SERIES = tuple(
    math.gamma(k + 1) * math.gamma(1.5) / math.gamma(k + 1.5) / 2**k for k in range(24)
)
# Series of ln Γ(x+½)/Γ(x) - ½ ln w in powers of 1/w², w = x - ¼: -2 B_(k+1)(¾)/(k(k+1)), k = 2, 4,
# ... For w > 8 the first omitted term changes the ratio by 5e-17.
_GAMMA_SERIES = (
    *(1 / 64, -5 / 2048, 61 / 49152, -1385 / 1048576, 50521 / 20971520),
    *(-2702765 / 402653184, 199360981 / 7516192768, -19391512145 / 137438953472),
)
_GAMMA_SHIFT = 8
_SINC_SERIES = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(10))


def kappa_and_psi(z: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return κ(z) = (e^z - 1)/z and ψ(z) = (e^z - 1 - z)/z², with κ(0) = 1 and ψ(0) = 1/2."""
    small = jnp.abs(z) < 1
    z_series = jnp.where(small, z, 0)
    z_closed = jnp.where(small, 1, z)
    series, closed = horner(_PSI_SERIES, z_series), jnp.expm1(z_closed) / z_closed
    kappa = jnp.where(small, 1 + z_series * series, closed)
    # Divide twice: z² would overflow, in the derivative even earlier.
    return kappa, jnp.where(small, series, (closed - 1) / z_closed)


def psi(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return ψ(z) = (e^z - 1 - z)/z², with ψ(0) = 1/2."""
    return kappa_and_psi(z)[1]


def kappa(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return κ(z) = (e^z - 1)/z, with κ(0) = 1."""
    return kappa_and_psi(z)[0]


def nonzero(tangent: Any) -> bool:
    """Return whether a tangent of a rule with symbolic zeros is not one of them."""
    return not isinstance(tangent, SymbolicZero)


@jax.custom_jvp
def speed_of(y: Float[Array, "..."], alpha: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return (e^(αy) - 1)/α, the speed of y = ln(1 + αv)/α; y itself at α = 0.

    Every stage of every step evaluates it. A choice between a series and the closed form would
    prevent vectorisation and take twice the time. α = 0 is therefore replaced by a number so small
    that the quotient is y to the last digit. XLA turns 1/v² of a constant α into a quotient of
    squares, which are still normal numbers.
    """
    least = jnp.maximum(alpha, float(jnp.finfo(alpha.dtype).tiny) ** 0.25)
    return jnp.expm1(least * y) / least


@functools.partial(speed_of.defjvp, symbolic_zeros=True)
def _speed_of_jvp(primals: tuple, tangents: tuple) -> tuple:
    y, alpha = primals
    change = [
        slope() * tangent
        for slope, tangent in zip(
            # κ'(z) = κ(z) - ψ(z)
            (
                lambda: jnp.exp(alpha * y),
                lambda: jnp.square(y) * operator.sub(*kappa_and_psi(alpha * y)),
            ),
            tangents,
            strict=True,
        )
        if nonzero(tangent)
    ]
    return speed_of(y, alpha), functools.reduce(operator.add, change)


def log1p_over(u: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return ln(1 + u)/u for u > -1, with the value 1 at u = 0."""
    small = jnp.abs(u) < 0.5
    u_series = jnp.where(small, u, 0)
    u_closed = jnp.where(small, 1, u)
    series = 1 - u_series * log_remainder(u_series)
    return jnp.where(small, series, jnp.log1p(u_closed) / u_closed)


def log_remainder(u: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return L(u) = (u - ln(1 + u))/u² for u > -1, with L(0) = 1/2."""
    small = jnp.abs(u) < 0.5
    u_series = jnp.where(small, u, 0)
    u_closed = jnp.where(small, 1, u)
    # ln(1+u) = 2 atanh(q): its series in q² converges three times faster than the one in u.
    q = u_series / (2 + u_series)
    series = (1 - q) * (1 - q * (1 - q) * horner(_ATANH_SERIES, jnp.square(q))) / 2
    closed = (1 - jnp.log1p(u_closed) / u_closed) / u_closed
    return jnp.where(small, series, closed)


def log_remainder_over(u: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return M(u) = (u²/2 - u + ln(1 + u))/u³ for |u| < 1/2, with M(0) = 1/3."""
    q = u / (2 + u)
    return (1 + jnp.square(1 - q) * horner(_ATANH_SERIES, jnp.square(q))) / (2 * (2 + u))


def half_gamma_ratio(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return Γ(x + 1/2)/Γ(x) for x > 0, without the difference of two large logarithms."""
    steps = [(x + k) / (x + k + 0.5) for k in range(_GAMMA_SHIFT)]
    w = x + (_GAMMA_SHIFT - 0.25)
    inverse = jnp.square(1 / w)
    far = jnp.sqrt(w) * jnp.exp(inverse * horner(_GAMMA_SERIES, inverse))
    return far * functools.reduce(operator.mul, steps)


def arc_over_sine(cosine: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return C(ζ) = arccos(ζ)/√(1-ζ²) for ζ > -1, continued to arcosh(ζ)/√(ζ²-1) for ζ > 1."""
    near = jnp.abs(cosine - 1) < 0.3
    below = cosine < 1
    c_near = jnp.where(near, cosine, 1)
    c_below = jnp.where(near | ~below, 0, cosine)
    c_above = jnp.where(near | below, 2, cosine)
    # arccos(1-y)/√(y(2-y)) is a hypergeometric series in y/2, analytic through y = 0.
    series = horner(_ARC_SERIES, 1 - c_near)
    angle = jnp.arccos(c_below) / jnp.sqrt((1 - c_below) * (1 + c_below))
    sine = jnp.sqrt((c_above - 1) * (c_above + 1))
    area = jnp.log(c_above + sine) / sine
    return jnp.where(near, series, jnp.where(below, angle, area))


def sinc_root(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return sin(√x)/√x for x > 0, continued to sinh(√-x)/√-x for x < 0; 1 at x = 0."""
    near = jnp.abs(x) < 1
    root = jnp.sqrt(jnp.where(near, 1, jnp.abs(x)))
    far = jnp.where(x > 0, jnp.sin(root), jnp.sinh(jnp.where(x > 0, 0, root))) / root
    return jnp.where(near, horner(_SINC_SERIES, jnp.where(near, x, 0)), far)


def horner(coefficients: Sequence[float], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the polynomial `sum_k coefficients[k] x^k`."""
    result = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        result = result * x + coefficient
    return result


def chebyshev(
    coefficients: Sequence[Any] | Float[Array, " degree_plus_1"], x: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return the series `sum_k coefficients[k] T_k(x)` for x in [-1, 1], by Clenshaw's recurrence.

    cos(k arccos x) would have no derivative at the ends of the interval.
    """
    last, before = jnp.zeros_like(x), jnp.zeros_like(x)
    for k in range(len(coefficients) - 1, 0, -1):
        last, before = coefficients[k] + 2 * x * last - before, last
    return coefficients[0] + x * last - before


def chebyshev_by_piece(
    ends: Sequence[float], rows: Sequence[Sequence[float]], x: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return Chebyshev series on the intervals between `ends`, extended by the last one's tangent.

    A row holds the coefficients of one degree, one per interval. The interval is selected by
    comparisons, which vectorise; fetching coefficients by index takes several times longer.
    """
    passed = [x >= end for end in ends[1:-1]]

    def chosen(values: Sequence[float]) -> Any:
        found: Any = values[0]
        for flag, value in zip(passed, values[1:], strict=True):
            found = jnp.where(flag, value, found)
        return found

    pieces = list(itertools.pairwise(ends))
    middle = chosen([(low + high) / 2 for low, high in pieces])
    stretches = [2 / (high - low) for low, high in pieces]
    inside = jnp.minimum((x - middle) * chosen(stretches), 1)
    slope = stretches[-1] * sum(k * k * row[-1] for k, row in enumerate(rows))
    beyond = jnp.maximum(x - ends[-1], 0)
    return chebyshev([chosen(row) for row in rows], inside) + slope * beyond
