"""Tests whether a model describes its data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float

from ..data import FitData
from ..search.minimum import basis_of
from ..search.verdict import LEAST_GROUPS
from .residual_order import DRAWS, Column, Statistics, chance, share_left

LEVEL = 0.05
"""Rate at which right models are called inadequate."""

_EXACT = 1e-6
"""Size of residuals relative to the data's scatter below which they are not measurement noise.

They then follow rounding, or the accuracy of a solver.
"""

_SAME = 1e-12
"""Relative scatter of the data that is rounding."""

_WITHIN = 0.2
"""Fraction of the slowest misfits within trials that is required to project out shifts of trials.

Six trials through all x, of two points each, leave 0.21 to 0.33 of the misfit of laws with two
parameters and a level. Six adjacent trials leave 0.15 of the misfit of a line.
"""

_FOLLOWED = 1e-3
"""Fraction of the variance of a trial that the fit must leave to determine its size."""


@dataclasses.dataclass(frozen=True)
class Adequacy:
    """The probability of residuals like these if the model is right.

    `chi2_per_dof` is Σz²/(n-k) of residuals over their known noise, or over that of repeated
    points; `chi2_p` is its probability. Both are None if that noise is unknown. `structure_p` is
    the probability that noise alone follows the order of the points as much, by simulation through
    the fit; None with too few points. `p` combines the two by Fisher's sum of logarithms. `along`
    is the variable that orders the points. `adequate`: p ≥ 0.05; None if undecided, for the
    `reason`.
    """

    adequate: bool | None = None
    p: float | None = None
    chi2_per_dof: float | None = None
    chi2_p: float | None = None
    structure_p: float | None = None
    along: str = "their order"
    reason: str = ""

    def __str__(self) -> str:
        if self.adequate is None:
            return f"the model could not be tested: {self.reason}"
        verb = "describes" if self.adequate else "does not describe"
        return f"the model {verb} the data: {self.grounds}"

    @property
    def grounds(self) -> str:
        """The tests in words."""
        if self.reason:
            return self.reason
        parts = []
        if self.chi2_per_dof is not None:
            chance = "" if self.chi2_p is None else f", {shown(self.chi2_p)}"
            parts.append(f"χ²/dof = {self.chi2_per_dof:.3g}{chance}")
        if self.structure_p is not None:
            follow = f"residuals follow {self.along}"
            if self.structure_p >= LEVEL:
                follow = f"residuals do not follow {self.along}"
            parts.append(f"{follow}, {shown(self.structure_p)}")
        return "; ".join(parts)


def shown(p: float) -> str:
    """Return a probability as text; as a bound if simulation or rounding limits it."""
    if p == 0:
        return "p < 1e-300"
    return f"p < {2 / (DRAWS + 1):.0e}" if p == 1 / (DRAWS + 1) else f"p = {p:.2g}"


def adequacy_of(fit: FitData) -> Adequacy:
    """Test whether the model of a fit describes its data.

    Points are ordered by `x` if it has one number for each, otherwise as given. Noise is simulated
    as normal. If points of a trial may be correlated, the null distribution comes from flipping the
    sign of each trial's residuals. With Huber's loss, which is for noise that is not normal, the
    sign of each point is flipped. With fewer than 8 trials there are too few signs. Then a shift of
    each trial is projected out together with the model, and the rest is simulated as normal.
    Adjacent trials are undecided, because a shift cannot be separated from a misfit.

    Source: Davidson & Flachaire (2008), doi 10.1016/j.jeconom.2008.08.003, for drawn signs; Fisher
    (1932) for the combination.
    """
    columns, along = _columns(fit)
    if not fit.converged:
        return Adequacy(along=along, reason="the fit did not converge")
    if fit.dof < 1:
        return Adequacy(along=along, reason="no degree of freedom is left")
    limit = float(fit.problem.limit)
    z, squares = np.clip(fit.z, -limit, limit), np.isinf(limit)
    if _is_exact(fit, z):
        reason = "the residuals are below one part in a million"
        return Adequacy(True, along=along, reason=reason)
    model, left = basis_of(fit._jacobian[fit._used]), z
    trial = fit._trials if fit.has_trials else None
    many = trial if trial is not None and trial.max() + 1 >= LEAST_GROUPS else None
    told = many is not None or squares
    if trial is not None and many is None and told:
        # The part common to all trials; shifts of each trial would hide it in any order of them.
        same, shifted = (
            basis_of(np.concatenate([model, _shifts(fit, one)], axis=1))
            for one in (np.zeros_like(trial), trial)
        )
        told = share_left(columns, same, shifted) >= _WITHIN
        model, left = shifted, z - shifted @ (shifted.T @ z)
    statistics = Statistics(columns, model, fit._factor[fit._used])
    ratio, chi2_p, structure_p = None, None, None
    if squares:
        ratio, chi2_p = _scatter(fit, z, statistics, alone=trial is None and fit._shared is None)
    elif trial is None:
        trial = many = np.arange(len(z))
        told = True
    if statistics and told:
        noise = _noise(left, columns, fit) if many is None else _signs(z, many, model)
        structure_p = chance(statistics, left, model, noise)
    # Scale-free statistics are independent of χ² (Basu); those of repeated points are not.
    independent = [structure_p, chi2_p if fit._absolute or structure_p is None else None]
    p = _combine([one for one in independent if one is not None])
    reason = "" if p is not None else _lacking(fit.dof, in_trials=trial is not None)
    adequate = None if p is None else p >= LEVEL
    return Adequacy(adequate, p, ratio, chi2_p, structure_p, along, reason)


def _lacking(dof: int, *, in_trials: bool) -> str:
    """Return why nothing could be tested."""
    if in_trials:
        return "too few trials, or too little overlap of their x"
    few = f"{dof} degrees of freedom" if dof > 1 else "one degree of freedom"
    return f"{few}, and the noise is unknown"


def _scatter(
    fit: FitData, z: Float[np.ndarray, " n"], statistics: Statistics, *, alone: bool
) -> tuple[float | None, float | None]:
    """Return the scatter beside known noise or repeated points, and its probability.

    Only points that are `alone`, without correlation, have a known distribution.
    """
    ratio = float(z @ z) / fit.dof if fit._absolute else 0.0
    if not fit._absolute and statistics.repeated and alone:
        ratio = float(statistics.lack_of_fit(z[None, :])[0])
    if not alone or (ratio == 0 and not fit._absolute):
        return (ratio if fit._absolute else None), None
    # SciPy takes half a second to load, so it is imported only if needed.
    from scipy.special import fdtrc, gammaincc

    if fit._absolute:
        return ratio, float(gammaincc(fit.dof / 2, ratio * fit.dof / 2))
    return ratio, float(fdtrc(fit.dof - statistics.pure, statistics.pure, ratio))


def _columns(fit: FitData) -> tuple[list[Column], str]:
    """Return the used points of each column in the order of its variable, and its name."""
    used = fit._used
    number = np.cumsum(used) - 1
    numbers = [
        np.asarray(x)
        for x in jax.tree.leaves(fit.problem.x)
        if np.ndim(x) == 1 and np.issubdtype(np.asarray(x).dtype, np.floating)
    ]
    columns, along = [], "their order"
    for c in range(len(fit.problem.shapes)):
        here = np.flatnonzero(fit.problem.columns == c)
        inside = np.flatnonzero(used[here])
        place = next((x for x in numbers if x.size == here.size), None)
        if place is None:
            place = np.arange(here.size, dtype=float)
        else:
            along = "x"
        if len(inside):
            order = inside[np.argsort(place[inside], kind="stable")]
            places = np.unique(place[order], return_index=True)[1]
            columns.append(Column(number[here[order]], places))
    return columns, along


def _is_exact(fit: FitData, z: np.ndarray) -> bool:
    # Columns have their own units.
    y, w, column = fit.data[fit._used], fit._factor[fit._used], fit.problem.columns[fit._used]
    parts = [(y[column == c], w[column == c]) for c in np.unique(column)]
    spread, size = (
        math.hypot(*(np.linalg.norm((y - off * y.mean()) * w) for y, w in parts)) for off in (1, 0)
    )
    # Data that are constant to rounding have no scatter.
    scale = spread if spread > _SAME * size else size
    return bool(np.linalg.norm(z) <= _EXACT * scale)


def _shifts(fit: FitData, trial: np.ndarray) -> Float[np.ndarray, "n trials*columns"]:
    """Return the change of z by a shift of all points of a trial, in one column of the data."""
    used, whitener = fit._used, fit.problem.whitener
    column = fit.problem.columns[used]
    kind = np.unique(np.stack([column, trial]), axis=1, return_inverse=True)[1].ravel()
    shifts = np.zeros((used.size, kind.max() + 1))
    shifts[np.flatnonzero(used), kind] = fit._factor[used]
    return (shifts if whitener is None else np.asarray(whitener) @ shifts)[used]


def _noise(
    z: np.ndarray, columns: list[Column], fit: FitData
) -> Callable[[int], Float[np.ndarray, "draws n"]]:
    """Return a sampler of normal noise.

    If its size is unknown, each column takes it from differences of neighbours: the fit carries the
    noise of a column to others, where it is smooth.
    """
    random, size = np.random.default_rng(0), np.ones_like(z)
    if fit._shared is not None:
        size, root = np.sqrt(fit._shared.own), fit._shared.root
        return lambda draws: (
            size * random.normal(size=(draws, len(z)))
            + random.normal(size=(draws, root.shape[1])) @ root.T
        )
    if not fit._absolute and len(columns) > 1:
        for column in columns:
            steps = np.diff(z[column.order])
            size[column.order] = np.sqrt(np.mean(steps**2) / 2) if steps.size else 1
    return lambda draws: size * random.normal(size=(draws, len(z)))


def _signs(
    z: np.ndarray, trial: np.ndarray, model: Float[np.ndarray, "n k"]
) -> Callable[[int], Float[np.ndarray, "draws n"]]:
    """Return a sampler of residuals with a random sign for each trial.

    The fit absorbs part of a trial by its block H_gg of the hat matrix; (I - H_gg)^(-1/2) restores
    it.
    """
    random, count = np.random.default_rng(0), int(trial.max()) + 1
    whole = z.copy()
    for g in range(count):
        rows = trial == g
        u, s, _ = np.linalg.svd(model[rows], full_matrices=False)
        freed = 1 / np.sqrt(np.maximum(1 - s**2, _FOLLOWED)) - 1
        whole[rows] += u @ (freed * (u.T @ z[rows]))
    return lambda draws: whole * (random.integers(0, 2, size=(draws, count)) * 2 - 1)[:, trial]


def _combine(p: list[float]) -> float | None:
    """Return Fisher's combination of independent probabilities."""
    if not p:
        return None
    if len(p) == 1 or 0 in p:
        return min(p)
    half = -sum(math.log(one) for one in p)
    return math.exp(-half) * sum(half**k / math.factorial(k) for k in range(len(p)))
