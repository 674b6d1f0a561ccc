"""Generate the Chebyshev series of viscoelastic spheres.

``python -m tests.oracle.viscoelastic_series`` takes fifteen minutes on one core.

``x'' = -(x**1.5 + 1.5 a x**0.5 x')`` depends on one number, ``a``. Factors from its limits turn
every outcome into a bounded or slowly growing function of ``s = ln(1 + a)``:

- with tension ``e = C a**-5`` up to ``exp(-1.6 a**(5/3))``, since the creep back is independent of
  the impact;
- for strong damping the turn is at ``x = a**(-2/3)``; its time and the end without tension are
  ``a**(-2/3)`` times a linear function of ``ln a``, up to ``a**(-5/3) ln a``;
- with tension the end is at ``a`` times such a function; the least force, at the start of the
  creep, is ``-a**(-8/3)`` times a bounded one.

The series end at a = 1e14, where these limits hold to the last digit of double precision.

Without tension the contact ends where ``w**2 = -1.5 a v`` (``x = w**2``), at the first of two roots
``w = +-sqrt(-1.5 a v)`` of the same analytic motion. The mean of both roots is analytic in a, and
half their difference is ``a**(5/2)`` times an analytic function: two series. Likewise the force has
two extrema of equal size and opposite sign near ``w = +-sqrt(a e/2)``. Half their difference is
``a**(3/2)`` times an analytic function.
"""

import itertools
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mpmath
from mpmath import mp, mpf

from tests.oracle._taylor import Phase, Trace, shoot

FILE = Path(__file__).parents[2] / "jaxcontact" / "_laws" / "viscoelastic_series.json"
Function = Callable[[mpf], mpf]
DIGITS = 40

# Ends of the pieces in s = ln(1 + a). Half powers of a are separated in the first.
BREAKS = ("0", "0.75", "1.3", "2", "4", "9", "32.25")
NODES = 38
# Coefficients below this fraction of the largest one change no digit of double precision.
CUT = mpf("1e-18")
STRONG = mpf(8)  # from here on the creep back is universal to more than thirty digits
# Points at which the series are compared with the impact; none is a node.
CHECKED = "-0.99 -0.6 -0.2 0.3 0.7 0.98".split()


def _force(a: mpf) -> tuple[mpf, list]:
    """1.5 a, and the force w**3 + 1.5 a w v."""
    c = mpf(3) / 2 * a
    return c, [(mpf(1), 3, 0), (c, 1, 1)]


def _shoot(a: mpf, *stops: dict) -> Trace:
    _, force = _force(a)
    bits = 220 + int(5 * mp.log(1 + a, 2))
    return shoot(2, [Phase(force, stop) for stop in stops], order=40, bits=bits)


def _is_out(w: mpf | int = 0) -> list:
    return [(mpf(1), 1, 0), (-mpf(w), 0, 0)]


def _pushes(a: mpf, sign: int = 1) -> list:
    return [(mpf(sign), 2, 0), (sign * _force(a)[0], 0, 1)]


_TURNS = [(mpf(1), 0, 1)]


@cache
def clamped(a: mpf) -> Trace:
    """The motion until the force vanishes."""
    return _shoot(a, {"end": _pushes(a)})


@cache
def beyond(a: mpf) -> Trace:
    """The motion continued to the other root, at w < 0."""
    return _shoot(a, {"next": _is_out()}, {"end": _pushes(a, -1)})


@cache
def least(a: mpf) -> mpf:
    """The least force until x = 0 with tension."""
    if a < STRONG:
        return _shoot(a, {"end": _is_out()}).min_force
    # The creep is independent of the turn after a tenth of the way to this place.
    return _shoot(a, {"next": _TURNS}, {"end": _is_out(_forgets(a))}).min_force


@cache
def _creep() -> list[mpf]:
    """v_k of the slow motion v = sum v_k w**(2-k) at a = 1, an asymptotic series for large w.

    From ``v dv/dw = -2 w**4 - 3 w**2 v``.
    """
    v = [mpf(-2) / 3]
    for k in range(1, 60):
        v.append(-sum(v[i] * (2 - (k - 1 - i)) * v[k - 1 - i] for i in range(k)) / 3)
    return v


def _shortest(terms: list[mpf]) -> mpf:
    """The sum of an asymptotic series up to its smallest term."""
    # By three neighbours, because one term may be small by chance at a change of sign.
    least = min(range(1, len(terms) - 1), key=lambda k: max(map(abs, terms[k - 1 : k + 2])))
    return mp.fsum(terms[: least + 1])


@cache
def _inverse_creep() -> list[mpf]:
    """u_k of 2w/|v| = 3/w sum u_k w**-k."""
    v = [x / _creep()[0] for x in _creep()]
    u = [mpf(1)]
    for k in range(1, len(v)):
        u.append(-mp.fsum(v[j] * u[k - j] for j in range(1, k + 1)))
    return u


def _creep_time(w: mpf) -> mpf:
    """The time of the slow motion from w to its end at a = 1, up to a constant."""
    u = _inverse_creep()
    return 3 * mp.log(w) + _shortest([-3 * u[k] / (k * w**k) for k in range(1, len(u))])


def _forgets(a: mpf) -> mpf:
    """The w at which the motion has forgotten how it turned."""
    w = mp.sqrt(_shoot(a, {"end": _TURNS}).max_indentation)
    return max(w / 2, w - 25 / a**2)


def _until_creeping(a: mpf) -> tuple[mpf, mpf]:
    """When the motion has forgotten how it turned, and w at that time in the units of a = 1."""
    stop = _forgets(a)
    found = _shoot(a, {"next": _TURNS}, {"end": _is_out(stop)})
    w = stop * a**2
    slow = _shortest([x * w ** (2 - k) for k, x in enumerate(_creep())])
    if abs(found.velocity * a**5 / slow - 1) > mpf("1e-25"):
        raise ArithmeticError(f"the motion has not come to the slow one at a = {mp.nstr(a, 5)}")
    return found.duration, w


@cache
def _universal() -> tuple[mpf, mpf]:
    """C of e = C a**-5, and the constant of the creep's time, from an impact with a = 12."""
    a = mpf(12)
    whole = _shoot(a, {"end": _is_out()})
    until, w = _until_creeping(a)
    return -whole.velocity * a**5, (whole.duration - until) / a - _creep_time(w)


@cache
def tension(a: mpf) -> tuple[mpf, mpf]:
    """Restitution and duration until x = 0."""
    if a < STRONG:
        found = _shoot(a, {"end": _is_out()})
        return -found.velocity, found.duration
    until, w = _until_creeping(a)
    factor, constant = _universal()
    return factor / a**5, until + a * (constant + _creep_time(w))


def _slowly(a: mpf) -> mpf:
    return (1 + a) ** (mpf(2) / 3)


def _decay(e: mpf, power: mpf, a: mpf) -> mpf:
    """q of e = (1 + a q)**-power."""
    return mp.expm1(-mp.log(e) / power) / a


def _is_weak(a: mpf) -> bool:
    return a < mp.expm1(mpf(BREAKS[1]))


def _common(first: Function, second: Function) -> Function:
    """What both roots have in common where half powers are split off, the first root elsewhere."""
    return lambda a: (first(a) + second(a)) / 2 if _is_weak(a) else first(a)


def _half(first: Function, second: Function, power: int) -> Function:
    """Half of the difference of both roots, over a**(power/2)."""
    return lambda a: (first(a) - second(a)) / 2 / mp.sqrt(a) ** power if _is_weak(a) else mpf(0)


# At the first root and at the other one.
_LEAST = (
    lambda a: -((1 + a) ** (mpf(8) / 3)) * least(a),
    lambda a: -((1 + a) ** (mpf(8) / 3)) * beyond(a).last_max_force,
)
_DECAY = (
    lambda a: _decay(-clamped(a).velocity, mpf(5) / 3, a),
    lambda a: _decay(-beyond(a).velocity, mpf(5) / 3, a),
)
_TIME = (lambda a: clamped(a).duration * _slowly(a), lambda a: beyond(a).duration * _slowly(a))
COLUMNS: dict[str, Function] = {
    "compression_time": lambda a: clamped(a).compression_time * _slowly(a),
    "max_indentation": lambda a: clamped(a).max_indentation * _slowly(a),
    "max_force": lambda a: clamped(a).max_force / _slowly(a),
    "decay": lambda a: _decay(tension(a)[0], mpf(5), a),
    "duration": lambda a: tension(a)[1] / (1 + a), "min_force": _common(*_LEAST),
    "min_force_half": _half(*_LEAST, 3), "clamped_decay": _common(*_DECAY),
    "clamped_decay_half": _half(*_DECAY, 3), "clamped_duration": _common(*_TIME),
    "clamped_duration_half": _half(*_TIME, 7),
}  # fmt: skip


@dataclass(frozen=True)
class Piece:
    """One interval of s."""

    low: mpf
    high: mpf

    def place(self, x: mpf) -> mpf:
        """The a at x in [-1, 1]."""
        return mp.expm1((self.low + self.high) / 2 + x * (self.high - self.low) / 2)


def coefficients(of: Function, piece: Piece) -> list[mpf]:
    """The Chebyshev coefficients of a function of a on a piece."""
    nodes = NODES
    angles = [(k + mpf(1) / 2) * mp.pi / nodes for k in range(nodes)]
    values = [of(piece.place(mp.cos(t))) for t in angles]
    return [
        (1 if k == 0 else 2)
        * mp.fsum(v * mp.cos(k * t) for v, t in zip(values, angles, strict=True))
        / nodes
        for k in range(nodes)
    ]


def needed(series: list[mpf]) -> list[float]:
    """A series without its last coefficients, which change no digit, in double precision."""
    largest = max(map(abs, series))
    count = max((k + 1 for k, c in enumerate(series) if abs(c) > CUT * largest), default=0)
    return [float(c) for c in series[:count]]


def errors(of: Function, series: list[float], piece: Piece) -> tuple[mpf, mpf]:
    """The largest relative errors of a series as stored and of its slope, between the nodes."""
    if not series:
        return mpf(0), mpf(0)

    def sum_at(x: mpf) -> mpf:
        return mp.fsum(mpf(c) * mp.chebyt(k, x) for k, c in enumerate(series))

    worst, worst_slope, h = mpf(0), mpf(0), mpf("1e-10")
    for x in map(mpf, CHECKED):
        value = of(piece.place(x))
        worst = max(worst, abs(sum_at(x) / value - 1))
        want = (of(piece.place(x + h)) - of(piece.place(x - h))) / (2 * h)
        got = (sum_at(x + h) - sum_at(x - h)) / (2 * h)
        # If a function is almost constant, its slope is measured relative to the function.
        worst_slope = max(worst_slope, abs(got - want) / max(abs(want), abs(value)))
    return worst, worst_slope


def main() -> None:
    """Computes the series, certifies them and writes the file, one piece a line."""
    start = time.process_time()
    blocks, largest = [], {}
    with mp.workdps(DIGITS + 10):
        pieces = [Piece(mpf(low), mpf(high)) for low, high in itertools.pairwise(BREAKS)]
        for name, of in COLUMNS.items():
            rows = [needed(coefficients(of, piece)) for piece in pieces]
            found = [errors(of, row, piece) for row, piece in zip(rows, pieces, strict=True)]
            largest[name] = [float(mp.nstr(max(column), 2)) for column in zip(*found, strict=True)]
            lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
            blocks.append(f'"{name}":[\n{lines}\n]')
            print(f"{name}: {max(map(len, rows))} coefficients, errors {largest[name]}", flush=True)
    provenance = {
        "made_by": "python -m tests.oracle.viscoelastic_series",
        "variable": "s = ln(1 + a), mapped to [-1, 1] on each piece",
        "mpmath": mpmath.__version__,
        "digits": DIGITS,
        "largest relative errors of value and slope": largest,
    }
    ends = json.dumps([float(b) for b in BREAKS])
    comma = ",\n"
    FILE.write_text(
        f'{{"provenance":{json.dumps(provenance)},\n"ends":{ends},\n'
        f'"series":{{\n{comma.join(blocks)}\n}}}}\n'
    )
    print(f"{FILE.stat().st_size / 1000:.0f} kB, {time.process_time() - start:.0f} s")


if __name__ == "__main__":
    main()
