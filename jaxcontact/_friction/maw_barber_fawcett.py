"""Spheres whose surfaces stick and slip in parts, and the curve of Maw, Barber and Fawcett: the
scaled rebound ψ2(ψ1; χ, α), for n = 3/2.

A row of springs stands for the contact. Spring q < √x carries t with t' = ψ while it sticks and |t|
≤ (x - q²)(1 + αx'), and ψ' = -3χ ∫ t dq. With x'' = -x^1.5 (1 + αx') this gives the friction of
Coulomb while all springs slip.

The curve has pieces in ψ1, between which a higher derivative jumps or is unbounded:

- up to `split` springs slip forward at the end, after they slipped backward; with χ ≤ `TURNING` or
  strong damping this piece is like the next one, and that one empty,
- up to `centre` no spring slips at the centre during compression,
- up to `touch` = 1 + α springs stick when they touch,
- up to `middle` all springs slide during a part of compression only, if α = 0,
- up to `full` some spring sticks at some time,
- beyond, ψ2 = ψ1 - 2χ(1+e).

`centre` is smaller than `touch` only for α > `onset`(χ), where it leaves `touch` quadratically.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._entry import (
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    as_parameter,
    optional_parameter,
    parameter,
    refuses_unknown,
    require_broadcast,
)
from .._forms import restitution_of
from .._functions import chebyshev, contraction, nonzero
from .base import AbstractFriction, Lane, NormalPath, Tangential, TangentialOutcome
from .spring_slider import hertzian, spring_of, springs_along

CHI = (0.8, 1.8)
"""The table's range of χ without damping. Solid spheres of like materials have 1.167 (ν = 1/2) to
1.75 (ν = 0)."""

CHI_DAMPED = (1.0, 1.75)
"""The table's range of χ with damping."""

TURNING = 1.5
"""χ above which some springs slip forward at the end, for small ψ1."""

ALPHA = 1.433
"""Largest α of the table (e = 0.49995)."""

MIDDLE = 0.5
"""Where the piece from `touch` to `full` is divided. Without damping this is at 2χ, where the
sliding from touch stops at the turn."""

DEGREES = (24, 20, 24, 18)
"""Coefficients in s of each piece: without damping to `split`, `centre`, `middle` and `full`, with
damping to `centre`, `touch`, `middle` and `full`."""

ORDERS = (18, 14, 10, 16)
"""Polynomials in χ without and with damping, and in α for weak and for strong damping."""

FILE = "maw_barber_fawcett.json"
"""The table, written by `python -m tests.maw_barber_fawcett_table`."""

_CHUNK = 1024
"""Lanes with their own χ and α that are solved together, so that their products of polynomials stay
in the cache."""


def in_table(chi: Lane, alpha: Lane) -> Bool[Array, "..."]:
    """Return whether the table holds χ and α."""
    damped = (chi >= CHI_DAMPED[0]) & (chi <= CHI_DAMPED[1]) & (alpha >= 0) & (alpha <= ALPHA)
    return damped | ((chi >= CHI[0]) & (chi <= CHI[1]) & (alpha == 0))


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


class _ReboundCurve(NamedTuple):
    """The pieces of ψ2(ψ1) at χ and α: where they end, ψ2 at their starts, and the loss of sliding.

    `rows` holds the coefficients of one degree for the five pieces, (degrees, 5, ...).
    """

    ends: tuple[Lane, Lane, Lane, Lane, Lane]
    starts: tuple[Lane, Lane]
    loss: Lane
    rows: Float[Array, "degrees 5 ..."]


def mbf_curve(psi1: Lane, chi: Lane, alpha: Lane) -> Lane:
    """Return ψ2 for ψ1 ≥ 0 and χ, α in the table, of shapes that broadcast.

    Arguments are not checked. A χ and an α of one number each are contracted once for all ψ1.
    """
    shape = np.broadcast_shapes(np.shape(chi), np.shape(alpha))
    shared = np.prod(shape, dtype=int) == 1
    whole = np.broadcast_shapes(np.shape(psi1), shape)
    dtype = jnp.result_type(psi1, chi, alpha)
    if 0 in whole:
        return jnp.zeros(whole, dtype)
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


def _rebound(psi: Lane, curve: _ReboundCurve) -> Lane:
    split, centre, touch, middle, full = curve.ends
    passed = (psi >= split, psi >= centre, psi >= touch, psi >= middle)
    none, least = jnp.zeros_like(centre), jnp.finfo(psi.dtype).tiny
    start = _chosen(passed, (none, split, centre, touch, full))
    # Pieces of length zero are never chosen.
    lengths = split, centre - split, touch - centre
    positive = [jnp.maximum(length, least) for length in lengths]
    length = _chosen(passed, (*positive, middle - touch, middle - full))
    part = jnp.clip((psi - start) / length, 0, 1)
    inside = part > 0
    # √part has no derivative at 0, where it is multiplied by part.
    root = jnp.where(inside, jnp.sqrt(jnp.where(inside, part, 1)), 0)
    passed_centre = passed[1:]
    s = _chosen(passed_centre, (part, root, root, root))
    factor = _chosen(passed_centre, (psi, part, part, part * root))
    slid = psi - curve.loss
    base = _chosen(passed_centre, (jnp.zeros_like(psi), *curve.starts, slid))
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
    if nonzero(x_change):
        slopes = contraction(jnp.asarray(_derivative(len(rows)), rows.dtype), rows)
        change = change + _series(slopes, passed, x) * x_change
    if nonzero(rows_change):
        change = change + chebyshev([_chosen(passed, row) for row in rows_change], x)
    return _series(rows, passed, x), change


@functools.cache
def _derivative(count: int) -> np.ndarray:
    """Return the matrix that turns `count` Chebyshev coefficients into those of the derivative."""
    return np.polynomial.chebyshev.chebder(np.eye(count))


def _curve(chi: Lane, alpha: Lane) -> _ReboundCurve:
    weak = alpha <= onset(chi)
    elastic, turn = _without_damping(chi, weak)
    damped, length = _with_damping(chi, alpha, weak)
    e = restitution_of(alpha)
    touch = 1 + alpha
    full = full_sliding(chi, alpha)
    centre = touch - length
    rows = jnp.stack(
        [
            elastic[:, 0] + _within(damped[:, 0], 0 * turn, turn),
            elastic[:, 1] + _within(damped[:, 0], turn, 0 * turn + 1),
            damped[:, 1],
            elastic[:, 2] + damped[:, 2],
            elastic[:, 3] + damped[:, 3],
        ],
        axis=1,
    )
    at_end = rows.sum(axis=0)
    at_centre = centre * at_end[1]
    return _ReboundCurve(
        ends=(turn * centre, centre, touch, touch + MIDDLE * (full - touch), full),
        starts=(at_centre, at_centre + at_end[2]),
        loss=2 * chi * (1 + e),
        rows=rows,
    )


def _without_damping(chi: Lane, weak: Lane) -> tuple[Float[Array, "degrees 4 ..."], Lane]:
    """Return the rows without damping, 0 where damping is not weak, and `split` over `centre`."""
    turns = chi > TURNING
    low, high = jnp.where(turns, TURNING, CHI[0]), jnp.where(turns, CHI[1], TURNING)
    place = (2 * chi - low - high) / (high - low)
    flags = (weak & ~turns, weak & turns)
    polynomials = jnp.concatenate(
        [_polynomials(ORDERS[0], place, flag.astype(chi.dtype)) for flag in flags]
    )
    numbers = contraction(jnp.asarray(_table().elastic.T, chi.dtype), polynomials)
    turn = jnp.where(weak & turns, jnp.clip(numbers[-1], 0, 1), 1)
    return numbers[:-1].reshape(-1, 4, *chi.shape), turn


def _with_damping(chi: Lane, alpha: Lane, weak: Lane) -> tuple[Float[Array, "degrees 4 ..."], Lane]:
    """Return what weak damping adds to the rows, or the rows of strong damping, and a length.

    It is that of the piece from `centre` to `touch`.
    """
    table = _table()
    start = onset(chi)
    # Each lane is in one of two ranges of α; the coordinate of the other one is not used.
    little = jnp.where(weak, alpha / start, 1)
    much = jnp.where(weak, 0, (alpha - start) / (ALPHA - start))
    none = jnp.zeros_like(chi)
    low, high = CHI_DAMPED
    place = jnp.clip((2 * chi - low - high) / (high - low), -1, 1)
    in_chi = _polynomials(ORDERS[1], place, none + 1)
    in_alpha = jnp.concatenate(
        [
            _polynomials(ORDERS[2], 2 * little - 1, jnp.where(weak, little, 0)),
            _polynomials(ORDERS[3], 2 * much - 1, jnp.where(weak, none, 1)),
        ]
    )
    products = in_chi[table.in_chi] * in_alpha[table.in_alpha]
    numbers = contraction(jnp.asarray(table.damped.T, chi.dtype), products)
    return numbers[:-1].reshape(-1, 4, *chi.shape), numbers[-1] * much * much


def _within(row: Lane, low: Lane, high: Lane) -> Lane:
    """Return the coefficients, between places `low` and `high` of [0, 1], of a series on [0, 1]."""
    count = len(row)
    angles = (np.arange(count) + 0.5) * np.pi / count
    nodes = jnp.asarray((1 + np.cos(angles)) / 2, row.dtype).reshape(-1, *(1,) * low.ndim)
    values = chebyshev(row[:, None], 2 * (low[None] + (high - low)[None] * nodes) - 1)
    transform = np.cos(np.outer(np.arange(count), angles)) * 2 / count
    transform[0] /= 2
    return contraction(jnp.asarray(transform, row.dtype), values)


def _polynomials(count: int, x: Lane, factor: Lane) -> Float[Array, "count ..."]:
    """Return the Chebyshev polynomials times a factor, along the first axis."""
    known = [factor, factor * x]
    while len(known) < count:
        known.append(2 * x * known[-1] - known[-2])
    return jnp.stack(known[:count])


class _Table(NamedTuple):
    """Coefficients by degree in s and piece, the last along the second axis.

    `elastic` has a row for each polynomial in χ below and above `TURNING`; the last column holds
    `split` over `centre`. `damped` has a row for each product of a polynomial in χ with one in α;
    the last column holds (`touch` - `centre`)/σ². The functions of α are σ T_j for weak damping,
    whose rows add to those without damping, and T_j for strong damping, where σ from 0 to 1 is the
    place in the range.
    """

    elastic: np.ndarray
    in_chi: np.ndarray
    in_alpha: np.ndarray
    damped: np.ndarray


@functools.cache
def _table() -> _Table:
    stored = json.loads(files("jaxcontact._friction").joinpath(FILE).read_text())
    elastic, damped = (
        _by_degree(np.array(stored[name], float) * stored["unit"]) for name in ("elastic", "damped")
    )
    # Indices of 64 bits fail without x64 in a process that had it before.
    in_chi, in_alpha = (np.array(stored[name], np.int32) for name in ("in_chi", "in_alpha"))
    return _Table(elastic, in_chi, in_alpha, damped)


def _by_degree(numbers: np.ndarray) -> np.ndarray:
    """Return columns that are ordered by degree, then by piece, with zeros in shorter pieces."""
    *pieces, last = np.split(numbers, np.cumsum(DEGREES), axis=1)
    rows = [np.pad(piece, [(0, 0), (0, max(DEGREES) - piece.shape[1])]) for piece in pieces]
    columns = np.stack(rows, axis=-1).reshape(len(numbers), -1)
    return np.concatenate([columns, last], axis=1)


class MawBarberFawcett(AbstractFriction):
    """The friction of elastic spheres, parts of whose contact stick while others slip.

    u' = (μ/κ) ψ2(ψ1, χ, α) with ψ1 = κ u0/(μ v0), χ = λκ/2, by the table of `tangential_rebound`,
    which tells its errors and range. Beyond the range only full sliding is known, and other lanes
    are flagged. Valid for Hertz contacts (n = 3/2) with a force K δⁿ (1 + α δ'/v0). For α > 0 the
    limit of friction within the contact is a choice of modelling.

    Arguments: the coefficient `mu` μ ≥ 0; `ratio` κ > 0, the tangential stiffness over the normal
    one, None for that of the contact's materials, `4G*/E*`. Leaves. Raises ValueError for a Python
    scalar out of range. Source: Maw, Barber & Fawcett (1976), doi 10.1016/0043-1648(76)90201-5.
    """

    substeps = 16
    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    ratio: Float[Array, "..."] | None = optional_parameter("ratio", POSITIVE, "-")

    @refuses_unknown
    def __init__(self, mu: ArrayLike, ratio: ArrayLike | None = None):
        self.mu, self.ratio = cast(Any, (mu, ratio))  # the fields have converters

    def uncovered(self, problem: Tangential) -> str | None:
        chi, alpha = spring_of(self, problem).chi, problem.alpha
        if alpha is None or bool(in_table(chi, alpha)):
            return None
        return (
            f"The table of `{type(self).__name__}` does not cover χ = λκ/2 = {float(chi):.4g} with "
            f"α = {float(alpha):.4g}. It covers χ from {CHI[0]} to {CHI[1]} for α = 0, and from "
            f"{CHI_DAMPED[0]:g} to {CHI_DAMPED[1]:g} for α up to {ALPHA:g} (e ≥ 0.5). "
            "`SpringSlider` takes any χ and α."
        )

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        slip, force = springs_along(spring_of(self, problem), path)
        return slip, self.mu * force

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        scaled, alpha = spring_of(self, problem), problem.alpha
        if alpha is None or not hertzian(problem):
            raise ValueError(
                "Argument `friction` must not be a `MawBarberFawcett` for a normal force other "
                "than K δ^1.5 (1 + α δ'/v0), for which its table is; `SpringSlider` takes any."
            )
        slid = scaled.free | (scaled.psi >= full_sliding(scaled.chi, alpha))
        inside = in_table(scaled.chi, alpha)
        # Full sliding is a formula for every χ and α; the table has a range.
        known = (jnp.where(inside, x, y) for x, y in ((scaled.chi, 1.2), (alpha, 0.0)))
        part = jnp.where(inside, scaled.slip(mbf_curve(scaled.psi, *known)), jnp.nan)
        return TangentialOutcome(
            slip=jnp.where(slid, problem.after_sliding(self.mu), part), slid=slid
        )


_CHI = Range(*CHI, inside=1.2)
_ALPHA = Range(0.0, ALPHA, inside=0.0)


def tangential_rebound(psi1: ArrayLike, chi: ArrayLike, alpha: ArrayLike = 0.0) -> Lane:
    """Return the scaled rebound speed along the contact of spheres, by Maw, Barber and Fawcett.

    `ψ2 = ψ2(ψ1; χ, α)` with ψ = κu/μ, from springs q < √x with t' = ψ while they stick and |t| ≤ (x
    - q²)(1 + αx'), ψ' = -3χ ∫ t dq and x'' = -x^1.5 (1 + αx'). Gross slip has ψ2 = ψ1 - 2χ(1+e).

    Arguments: `psi1` ψ1 = κu0/μ, with the speed u0 along the contact over the normal speed, the
    ratio κ of tangential to normal stiffness, and the friction μ. `chi` χ = λκ/2 in [0.8, 1.8],
    with the ratio λ of the mass to the mass along the contact (7/2 for solid spheres). `alpha` the
    damping factor α in [0, 1.433], see `exact_damping_factor`; only for χ in [1, 1.75] may it be
    other than 0. They have any shapes that broadcast and no dimension. A single χ and α are much
    faster than one for each impact.

    Returns ψ2, odd in ψ1, of the common shape; NaN where χ or α is out of range. Its first
    derivatives are continuous, but for that error.

    Valid for Hertz contact with Hunt-Crossley damping, and a constant direction of slip.
    Interpolated from a table. At random places its error is at most 6e-9 without damping (1e-10 in
    the median). With damping it is 6e-8 in the median, 3e-6 at most for χ < 1.65 and 7e-6 beyond,
    and the derivative by ψ1 jumps by up to 2e-3 at ψ1 = 1 + α. Where χ is outside [1, 1.75], the
    derivative by α has no meaning. Raises ValueError for a Python scalar out of range and for
    shapes that do not broadcast. Source: doi 10.1016/0043-1648(76)90201-5.
    """
    psi1 = as_parameter(psi1, "psi1")
    chi, alpha = as_parameter(chi, "chi", _CHI), as_parameter(alpha, "alpha", _ALPHA)
    require_broadcast(psi1=psi1, chi=chi, alpha=alpha)
    return _odd_curve(psi1, chi, alpha)


@jax.jit
def _odd_curve(psi1: Lane, chi: Lane, alpha: Lane) -> Lane:
    rank = max(psi1.ndim, chi.ndim, alpha.ndim)
    psi1, chi, alpha = (x.reshape((1,) * (rank - x.ndim) + x.shape) for x in (psi1, chi, alpha))
    good = in_table(chi, alpha)
    chi, alpha = jnp.where(good, chi, _CHI.inside), jnp.where(good, alpha, _ALPHA.inside)
    backward = psi1 < 0
    # abs would have the derivative 0 at 0.
    psi2 = mbf_curve(jnp.where(backward, -psi1, psi1), chi, alpha)
    return jnp.where(good, jnp.where(backward, -psi2, psi2), jnp.nan)
