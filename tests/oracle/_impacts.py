"""Forty-digit impacts of the scaled problem ``x'' = -f(x, x')``, ``x(0) = 0``, ``x'(0) = 1``.

They are derived from the energy integral or the equation of motion alone. Nothing of ``jaxcontact``
is imported. Instead of rearrangements against cancellation the oracle carries more digits.

A ``str`` argument is the decimal number it spells, a ``float`` the exact binary number.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cache, wraps

from mpmath import mp, mpf

from tests.oracle._taylor import BITS, ORDER, Phase, Trace, shoot

Number = str | int | float | mpf

# Digits of results, and digits of arguments in the cache. The results must remain accurate to 25
# digits after two divisions by the 1e-9 of `derivative`.
DIGITS = 50
ARGUMENT_DIGITS = 80


@dataclass(frozen=True)
class Impact:
    """One impact in scaled units; ``energy_loss`` is ``1 - e**2``, in units of the initial kinetic
    energy.

    ``settled`` marks a contact under gravity that turned a second time before it separated. Its
    ``e`` is 0, ``energy_loss`` 1 and ``duration`` the time of that turn.
    """

    e: mpf
    duration: mpf
    compression_time: mpf
    max_indentation: mpf
    max_force: mpf
    energy_loss: mpf
    settled: bool = False


FIELDS = tuple(f.name for f in fields(Impact) if f.name != "settled")


def number(x: Number) -> mpf:
    """A number with ``ARGUMENT_DIGITS`` digits."""
    with mp.workdps(ARGUMENT_DIGITS):
        return mpf(x)


def by_digits(function: Callable[..., Impact]) -> Callable[..., Impact]:
    """Keep what a function returns, by the digits of its numbers."""
    kept = cache(function)

    def key(x: Number) -> Number:
        if isinstance(x, bool) or (isinstance(x, str) and x.isalpha()):
            return x
        with mp.workdps(ARGUMENT_DIGITS):
            return mp.nstr(mpf(x), ARGUMENT_DIGITS)

    return wraps(function)(lambda *args, **options: kept(*map(key, args), **options))


# --- Hunt and Crossley's family: the energy integral ----------------------------------------------


@by_digits
def hunt_crossley(alpha: Number, n: Number) -> Impact:
    """``f = x**n (1 + alpha v)``, from the energy integral, for -1 < alpha <= 2e6 and n >= 1."""
    # Two powers of alpha cancel in the energy integral; for large alpha one cancels in 1 + alpha -
    # ln(1 + alpha).
    size = abs(number(alpha))
    guard = 0 if size == 0 else int(3 * abs(mp.log10(size))) + 10
    with mp.workdps(DIGITS + 20 + guard):
        alpha, n = mpf(alpha), mpf(n)

        def gained(v: mpf) -> mpf:
            """The integral of u du/(1 + alpha u) from v to 1, the spring's x**(n+1)/(n+1)."""
            if alpha == 0:
                return (1 - v * v) / 2
            return (1 - v) / alpha - mp.log((1 + alpha) / (1 + alpha * v)) / alpha**2

        def indentation(v: mpf) -> mpf:
            return mp.power((n + 1) * gained(v), 1 / (n + 1))

        # The logarithm of 1 + alpha v at separation; its exponential has 870 000 zeros after the
        # point at alpha = 2e6.
        log_end = _log_at_separation(alpha)
        e = mpf(1) if alpha == 0 else -mp.expm1(log_end) / alpha

        # d ln f/dv = 0 wherever alpha x**(n+1) = n v.
        if alpha == 0:
            v_peak = mpf(0)
        else:
            bracket = (mpf(0), mpf(1)) if alpha > 0 else (-e, mpf(0))
            v_peak = _root(lambda v: alpha * (n + 1) * gained(v) - n * v, *bracket)
        max_force = mp.power(indentation(v_peak), n) * (1 + alpha * v_peak)

        compression = _time(alpha, n, mpf(1) if alpha == 0 else mp.log1p(alpha) / alpha)
        restitution = _time(alpha, n, -mpf(1) if alpha == 0 else log_end / alpha)
        return Impact(
            e=e, duration=compression + restitution, compression_time=compression,
            max_indentation=indentation(mpf(0)), max_force=max_force, energy_loss=1 - e * e,
        )  # fmt: skip


def _log_at_separation(alpha: mpf) -> mpf:
    """u = ln(1 - alpha e), the root of alpha (1 + e) = ln((1 + alpha)/(1 - alpha e)) off v = 1."""
    if alpha == 0:
        return mpf(0)
    start = mp.log1p(alpha)

    def balance(u: mpf) -> mpf:
        return alpha - mp.expm1(u) - start + u

    # exp(u) - u has the same value at both ends of the motion and is steeper to the right of its
    # minimum at u = 0.
    if alpha > 0:
        return _root(balance, -(1 + alpha), -start / 2)
    return _root(balance, -start / 2, -start)


def _root(f: Callable[[mpf], mpf], a: mpf, b: mpf) -> mpf:
    """A bracketed root: bisection first, secants for the rest, a sign change at the end."""
    fa, fb = f(a), f(b)
    if fa == 0:
        return a
    if fb == 0:
        return b
    if (fa > 0) == (fb > 0):
        raise ValueError("the bracket holds no sign change")
    for _ in range(20):
        m = (a + b) / 2
        fm = f(m)
        if (fm > 0) == (fa > 0):
            a, fa = m, fm
        else:
            b, fb = m, fm
    x = mp.findroot(f, (a, b), solver="secant", tol=mp.eps**2, maxsteps=60, verify=False)
    # Certificate: the function changes sign within the last tenth of the digits carried.
    slack = abs(x) * mp.power(10, -(DIGITS + 5))
    if (f(x - slack) > 0) == (f(x + slack) > 0):
        raise ArithmeticError("the root could not be certified")
    return x


def _time(alpha: mpf, n: mpf, end: mpf) -> mpf:
    """The time between the turn and the end at which ln(1 + alpha v)/alpha = end, as a positive
    number.

    With y = ln(1 + alpha v)/alpha, dt = -dy/x**n and x**(n+1)/(n+1) = (exp(alpha Y) - exp(alpha
    y))/alpha**2 - (Y - y)/alpha, Y being the value at the end. There x vanishes like a root of the
    distance, which the substitution distance = s**(n+1) removes; the layer exp(alpha y) near the
    turn is met by cutting where it has decayed by powers.
    """
    length, sign = abs(end), mp.sign(end)
    at_end = mp.exp(alpha * end)

    def speed(distance: mpf) -> mpf:
        """x**-n at a distance from the end."""
        if alpha == 0:
            taken = distance * (length - distance / 2)
        else:
            step = sign * alpha * distance
            taken = (-at_end * mp.expm1(-step) - step) / alpha**2
        return mp.power((n + 1) * taken, -n / (n + 1))

    cuts = [length]
    if alpha > 0:
        layers = [mpf(2) ** i for i in range(2, 8)] if sign < 0 else [mp.log1p(alpha) / 2]
        cuts += [
            length - layer / alpha
            for layer in layers
            if layer < mpf("0.6") * alpha * length and alpha > 1
        ]
    cuts = sorted(cuts)
    total, error = mp.quad(
        lambda s: (n + 1) * mp.power(s, n) * speed(mp.power(s, n + 1)),
        [mpf(0), mp.power(cuts[0], 1 / (n + 1))],
        error=True,
        maxdegree=10,
    )
    for a, b in itertools.pairwise(cuts):
        part, slip = mp.quad(speed, [a, b], error=True, maxdegree=10)
        total, error = total + part, error + slip
    if error > total * mp.power(10, -DIGITS):
        raise ArithmeticError(
            f"quadrature stopped at a relative error of {mp.nstr(error / total, 3)}"
        )
    return total


# --- Everything else: the equation of motion ------------------------------------------------------


def _exponents(n: mpf, *powers: Callable[[Fraction], Fraction]) -> tuple[int, Fraction]:
    """The smallest q with which x = w**q makes all powers of x whole ones of w; n as a fraction."""
    fraction = Fraction(mp.nstr(n, 20)).limit_denominator(1000)
    if abs(mpf(fraction.numerator) / fraction.denominator - n) > mp.power(10, -40):
        raise ValueError(f"exponent {mp.nstr(n, 10)} is not a fraction of small whole numbers")
    q = 1
    while any((power(fraction) * q).denominator != 1 for power in powers):
        q += 1
    return q, fraction


def _impact(trace: Trace) -> Impact:
    settled = trace.stopped == "settled"
    e = mpf(0) if settled else -trace.velocity
    if trace.compression_time is None or trace.max_indentation is None:
        raise RuntimeError("the motion ended before it turned")
    return Impact(
        e=e, duration=trace.duration, compression_time=trace.compression_time,
        max_indentation=trace.max_indentation, max_force=trace.max_force, energy_loss=1 - e * e,
        settled=settled,
    )  # fmt: skip


_SEPARATION = {"separation": [(mpf(1), 1, 0)]}
_UNTIL_TURN = {"next": [(mpf(1), 0, 1)]}


@by_digits
def oscillator(
    zeta: Number, n: Number, ending: str = "tension", *, order: int = ORDER, bits: int = BITS
) -> Impact:
    """``f = x**n + 2 zeta sqrt((n+1)/2) x**((n-1)/2) v``: Kelvin-Voigt at n = 1, Tsuji and
    Antypov-Elliott at n = 3/2.

    ``ending``: "tension", until x = 0 (zeta < 1); "clamped", until f = 0; "approach", damped while
    v > 0 only.
    """
    with mp.workprec(bits + 40):
        zeta = mpf(zeta)
        if ending == "tension" and zeta >= 1:
            raise ValueError("an overdamped oscillator does not return to x = 0")
        q, n = _exponents(mpf(n), lambda n: n, lambda n: (n - 1) / 2)
        c = 2 * zeta * mp.sqrt(mpf(n.numerator + n.denominator) / (2 * n.denominator))
        spring = (mpf(1), int(n * q), 0)
        damper = (c, int((n - 1) / 2 * q), 1)
        if ending == "approach":
            phases = [Phase([spring, damper], _UNTIL_TURN), Phase([spring], _SEPARATION)]
        elif ending == "clamped":
            # f = x**((n-1)/2) (x**((n+1)/2) + c v)
            vanishes = {"clamp": [(mpf(1), int((n + 1) / 2 * q), 0), (c, 0, 1)]}
            phases = [Phase([spring, damper], _SEPARATION | vanishes)]
        elif ending == "tension":
            phases = [Phase([spring, damper], _SEPARATION)]
        else:
            raise ValueError(f"no ending named {ending!r}")
        return _impact(shoot(q, phases, order=order, bits=bits))


@by_digits
def kuwabara_kono(
    a: Number, n: Number = "1.5", tension: bool = True, *, order: int = ORDER, bits: int = BITS
) -> Impact:
    """``f = x**n + n a x**(n-1) v``; without tension the contact ends when f = 0."""
    with mp.workprec(bits + 40):
        q, n = _exponents(mpf(n), lambda n: n)
        c = mpf(a) * n.numerator / n.denominator
        force = [(mpf(1), int(n * q), 0), (c, int((n - 1) * q), 1)]
        stops = dict(_SEPARATION)
        if not tension:
            stops["clamp"] = [(mpf(1), q, 0), (c, 0, 1)]  # f = x**(n-1) (x + n a v)
        return _impact(shoot(q, [Phase(force, stops)], order=order, bits=bits))


@by_digits
def with_gravity(
    alpha: Number, n: Number, gamma: Number, *, order: int = ORDER, bits: int = BITS
) -> Impact:
    """``x'' = gamma - x**n max(0, 1 + alpha v)`` until x = 0 or, settled, the second turn; the
    force is the contact's.
    """
    with mp.workprec(bits + 40):
        alpha, gamma = mpf(alpha), mpf(gamma)
        q, n = _exponents(mpf(n), lambda n: n)
        power = int(n * q)
        force = [(mpf(1), power, 0), (alpha, power, 1)]
        # The clamp, 1 + alpha v = 0, is only crossed outwards, and once: beyond it v' = gamma < 0.
        rebound = _SEPARATION | {
            "settled": [(mpf(-1), 0, 1)],
            "next": [(mpf(1), 0, 0), (alpha, 0, 1)],
        }
        phases = [
            Phase(force, _UNTIL_TURN, gamma),
            Phase(force, rebound, gamma),
            Phase([(mpf(0), 0, 0)], _SEPARATION, gamma),
        ]
        return _impact(shoot(q, phases, order=order, bits=bits))


def hunt_crossley_by_motion(
    alpha: Number, n: Number, *, order: int = ORDER, bits: int = BITS
) -> Impact:
    """`hunt_crossley` a second time, from the equation of motion: the oracle's check upon itself
    (alpha up to 100).
    """
    with mp.workprec(bits + 40):
        q, fraction = _exponents(number(n), lambda n: n)
        power = int(fraction * q)
        force = [(mpf(1), power, 0), (number(alpha), power, 1)]
        return _impact(shoot(q, [Phase(force, _SEPARATION)], order=order, bits=bits))


# --- Derivatives ----------------------------------------------------------------------------------

# Step of the differences, as a fraction of max(1, |argument|). Richardson's extrapolation leaves an
# error of its fourth power, and `DIGITS` allows two divisions by it. At least twenty digits remain.
# Fifteen remain if the derivative is one-sided and the expansion continues in half powers
# (Kuwabara-Kono without tension at a = 0).
DIFFERENCE_STEP = "1e-9"
# If two steps disagree by more than this, the derivative does not exist (a kink).
KINK = 1e-13


def derivative(
    function: Callable[..., Impact],
    args: tuple,
    index: int,
    order: int = 1,
    *,
    forward: bool = False,
) -> dict[str, mpf | None]:
    """First or second derivative of each output by ``args[index]``; None where two step sizes
    disagree.

    ``forward`` takes the one-sided derivative, for arguments at the edge of their range.
    """
    with mp.workdps(ARGUMENT_DIGITS):
        centre = mpf(args[index])
        step = mpf(DIFFERENCE_STEP) * max(1, abs(centre))

        def at(offset: mpf) -> Impact:
            return function(*args[:index], centre + offset, *args[index + 1 :])

        def difference(h: mpf) -> dict[str, mpf]:
            if forward:
                weights = [(k, mpf(c) / 12 / h) for k, c in enumerate((-25, 48, -36, 16, -3))]
            elif order == 1:
                weights = [(-1, -1 / (2 * h)), (1, 1 / (2 * h))]
            else:
                weights = [(-1, 1 / h**2), (0, -2 / h**2), (1, 1 / h**2)]
            values = [(c, at(k * h)) for k, c in weights]
            return {f: mp.fsum(c * getattr(value, f) for c, value in values) for f in FIELDS}

        coarse, fine = difference(step), difference(step / 2)
        result: dict[str, mpf | None] = {}
        for f in FIELDS:
            tolerance = KINK * max(1, abs(fine[f])) if abs(centre) <= 1 else KINK * abs(fine[f])
            if abs(coarse[f] - fine[f]) > tolerance:
                result[f] = None
            else:
                result[f] = fine[f] if forward else (4 * fine[f] - coarse[f]) / 3
        return result
