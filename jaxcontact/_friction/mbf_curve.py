"""The scaled rebound ψ2(ψ1; χ, α) of Maw, Barber and Fawcett, for n = 3/2.

A row of springs stands for the contact. Spring q < √x carries t with t' = ψ while it sticks and |t|
≤ (x - q²)(1 + αx'), and ψ' = -3χ ∫ t dq. With x'' = -x^1.5 (1 + αx') this gives the friction of
Coulomb while all springs slip.

The curve has pieces in ψ1. Between them its second derivative jumps or is unbounded:

- up to `centre` no spring slips at the centre during compression,
- up to `touch` = 1 + α springs stick when they touch,
- up to `full` some spring sticks at some time,
- beyond, ψ2 = ψ1 - 2χ(1+e).

`centre` is smaller than `touch` only for α > `onset`(χ), where it leaves `touch` quadratically.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float

from .._forms import Lane, restitution_of
from .._functions import chebyshev, contraction

CHI = (1.0, 1.75)
"""The table's range of χ. Solid spheres of like materials have 1.167 (ν = 1/2) to 1.75 (ν = 0)."""

ALPHA = 1.433
"""Largest α of the table (e = 0.49995)."""

MIDDLE = 0.4
"""Where the piece from `touch` to `full` is divided. Both of its ends are singular."""

DEGREES = (24, 20, 20, 18)
"""Coefficients in s of each piece."""

ORDERS = (18, 10, 16)
"""Polynomials in χ, and in α for weak and for strong damping."""

FILE = "maw_barber_fawcett.json"
"""The table, written by `python -m tests.maw_barber_fawcett_table`."""

_CHUNK = 1024
"""Lanes with their own χ and α that are solved together, so that their products of polynomials stay
in the cache."""


def in_table(chi: Lane, alpha: Lane) -> Bool[Array, "..."]:
    """Return whether the table holds χ and α."""
    return (chi >= CHI[0]) & (chi <= CHI[1]) & (alpha >= 0) & (alpha <= ALPHA)


def onset(chi: Any) -> Any:
    """Return the α above which the centre can slip although springs stick when they touch.

    Just after touch, limit over movement at the centre is (1+α)/ψ1 times 1 + (8χ - 4 - 18α)/35
    t^2.5. It falls first if α > (8χ - 4)/18.
    """
    return (8 * chi - 4) / 18


def full_sliding(chi: Lane, alpha: Lane) -> Lane:
    """Return the ψ1 from which all springs slip during the whole impact.

    The limit of spring q changes by (1+αv)(v - α x^1.5 (x - q²)) ≤ v(1+αv), with equality at the
    edge. They all slip while ψ ≥ v(1+αv), with ψ = ψ1 - 2χ(1-v). The difference is concave in v, so
    the ends v = 1 and v = -e decide: ψ1 ≥ max(1 + α, 2χ(1+e) - e(1-αe)).
    """
    e = restitution_of(alpha)
    return jnp.maximum(1 + alpha, 2 * chi * (1 + e) - e * (1 - alpha * e))


_Flags = tuple[Bool[Array, "..."], ...]


class _Curve(NamedTuple):
    """The pieces of ψ2(ψ1) at χ and α: where they end, ψ2 at their starts, and the loss of sliding.

    `rows` holds the coefficients of one degree for the four pieces, (degrees, 4, ...).
    """

    ends: tuple[Lane, Lane, Lane, Lane]
    starts: tuple[Lane, Lane]
    loss: Lane
    rows: Float[Array, "degrees 4 ..."]


def mbf_curve(psi1: Lane, chi: Lane, alpha: Lane) -> Lane:
    """Return ψ2 for ψ1 ≥ 0, χ in `CHI` and α in [0, `ALPHA`], of shapes that broadcast.

    Arguments are not checked. A χ and an α of one number each are contracted once for all ψ1.
    """
    shape = np.broadcast_shapes(np.shape(chi), np.shape(alpha))
    shared = np.prod(shape, dtype=int) == 1
    whole = np.broadcast_shapes(np.shape(psi1), shape)
    dtype = jnp.result_type(psi1, chi, alpha)
    # A shape of ones would keep the contraction of one lane from being a constant of a loop.
    inner = () if shared else (1,) * (len(whole) - len(shape)) + shape
    chi, alpha = (_of_shape(x, inner, dtype) for x in (chi, alpha))
    psi1 = jnp.asarray(psi1, dtype)
    psi1 = psi1.reshape((1,) * (len(whole) - psi1.ndim) + psi1.shape)
    if chi.size <= _CHUNK:
        return _rebound(psi1, _curve(chi, alpha))
    lanes = tuple(jnp.broadcast_to(x, whole).ravel() for x in (psi1, chi, alpha))
    return jax.lax.map(lambda x: _rebound(x[0], _curve(*x[1:])), lanes, batch_size=_CHUNK).reshape(
        whole
    )


def _of_shape(x: Lane, shape: tuple[int, ...], dtype: Any) -> Lane:
    x = jnp.asarray(x, dtype)
    if x.size == 1:
        return jnp.broadcast_to(x.reshape(()), shape)
    return jnp.broadcast_to(x.reshape((1,) * (len(shape) - x.ndim) + x.shape), shape)


def _rebound(psi: Lane, curve: _Curve) -> Lane:
    centre, touch, middle, full = curve.ends
    passed = (psi >= centre, psi >= touch, psi >= middle)
    # A piece of length zero is never chosen.
    to_touch = jnp.maximum(touch - centre, jnp.finfo(psi.dtype).tiny)
    start = _chosen(passed, (0 * centre, centre, touch, full))
    length = _chosen(passed, (centre, to_touch, middle - touch, middle - full))
    part = jnp.clip((psi - start) / length, 0, 1)
    inside = part > 0
    # √part has no derivative at 0, where it is multiplied by part.
    root = jnp.where(inside, jnp.sqrt(jnp.where(inside, part, 1)), 0)
    s = _chosen(passed, (part, root, root, root))
    factor = _chosen(passed, (psi, part, part, part * root))
    slid = psi - curve.loss
    base = _chosen(passed, (jnp.zeros_like(psi), *curve.starts, slid))
    return jnp.where(psi >= full, slid, base + factor * _series(curve.rows, passed, 2 * s - 1))


def _chosen(passed: _Flags, values: Sequence[Any]) -> Any:
    """Return the value of the piece; comparisons vectorise, unlike fetching by index."""
    result = values[0]
    for flag, value in zip(passed, values[1:], strict=True):
        result = jnp.where(flag, value, result)
    return result


@jax.custom_jvp
def _series(rows: Lane, passed: _Flags, x: Lane) -> Lane:
    """Return the Chebyshev series of the piece at x in [-1, 1].

    Its derivative by x is another such series. Differentiating Clenshaw's recurrence takes three
    times as long.
    """
    return chebyshev([_chosen(passed, row) for row in rows], x)


@functools.partial(_series.defjvp, symbolic_zeros=True)
def _series_jvp(primals: tuple, tangents: tuple) -> tuple[Lane, Lane]:
    rows, passed, x = primals
    rows_change, _, x_change = tangents
    change = jnp.zeros_like(x)
    if not isinstance(x_change, SymbolicZero):
        slopes = contraction(jnp.asarray(_derivative(len(rows)), rows.dtype), rows)
        change = change + _series(slopes, passed, x) * x_change
    if not isinstance(rows_change, SymbolicZero):
        change = change + chebyshev([_chosen(passed, row) for row in rows_change], x)
    return _series(rows, passed, x), change


@functools.cache
def _derivative(count: int) -> np.ndarray:
    """Return the matrix that turns `count` Chebyshev coefficients into those of the derivative."""
    return np.polynomial.chebyshev.chebder(np.eye(count))


def _curve(chi: Lane, alpha: Lane) -> _Curve:
    numbers = _contracted(chi, alpha)
    rows = numbers[:-1].reshape(-1, 4, *chi.shape)
    e = restitution_of(alpha)
    touch = 1 + alpha
    full = full_sliding(chi, alpha)
    centre = touch - numbers[-1]
    middle = touch + MIDDLE * (full - touch)
    at_end = rows.sum(axis=0)
    at_centre = centre * at_end[0]
    return _Curve(
        ends=(centre, touch, middle, full),
        starts=(at_centre, at_centre + at_end[1]),
        loss=2 * chi * (1 + e),
        rows=rows,
    )


def _contracted(chi: Lane, alpha: Lane) -> Float[Array, "numbers ..."]:
    table = _table()
    start = onset(chi)
    weak = alpha <= start
    # Each lane is in one of two ranges of α; the coordinate of the other one is not used.
    little = jnp.where(weak, alpha / start, 1)
    much = jnp.where(weak, 0, (alpha - start) / (ALPHA - start))
    none = jnp.zeros_like(chi)
    in_chi = _polynomials(ORDERS[0], (2 * chi - CHI[0] - CHI[1]) / (CHI[1] - CHI[0]), none + 1)
    in_alpha = jnp.concatenate(
        [
            jnp.where(weak, 1, none)[None],
            _polynomials(ORDERS[1], 2 * little - 1, jnp.where(weak, little, 0)),
            _polynomials(ORDERS[2], 2 * much - 1, jnp.where(weak, none, 1)),
        ]
    )
    products = in_chi[table.in_chi] * in_alpha[table.in_alpha]
    numbers = contraction(jnp.asarray(table.numbers.T, chi.dtype), products)
    return jnp.concatenate([numbers[:-1], numbers[-1:] * (much * much)[None]])


def _polynomials(count: int, x: Lane, factor: Lane) -> Float[Array, "count ..."]:
    """Return the Chebyshev polynomials times a factor, along the first axis."""
    known = [factor, factor * x]
    while len(known) < count:
        known.append(2 * x * known[-1] - known[-2])
    return jnp.stack(known[:count])


class _Table(NamedTuple):
    """Coefficients by products of a polynomial in χ with one in α, and by degree in s and piece.

    The last column holds (`touch` - `centre`)/σ². The functions of α are 1 without damping, σ T_j
    for weak damping and T_j for strong damping, where σ from 0 to 1 is the place in the range.
    """

    in_chi: np.ndarray
    in_alpha: np.ndarray
    numbers: np.ndarray


@functools.cache
def _table() -> _Table:
    stored = json.loads(files("jaxcontact._friction").joinpath(FILE).read_text())
    numbers = np.array(stored["numbers"], float) * stored["unit"]
    *pieces, centre = np.split(numbers, np.cumsum(DEGREES), axis=1)
    rows = [np.pad(piece, [(0, 0), (0, max(DEGREES) - piece.shape[1])]) for piece in pieces]
    columns = np.stack(rows, axis=-1).reshape(len(numbers), -1)
    return _Table(
        np.array(stored["in_chi"]),
        np.array(stored["in_alpha"]),
        np.concatenate([columns, centre], axis=1),
    )
