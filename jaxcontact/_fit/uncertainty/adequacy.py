"""Whether a model describes its data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float

from ..data import FitData
from ..search.laplace import LEAST_GROUPS, basis_of
from .residual_order import DRAWS, Column, Statistics, chance, share_left

LEVEL = 0.05
"""Of models that are right so many are called inadequate."""

_EXACT = 1e-6
"""Residuals that are smaller than this part of the data's scatter are no noise of a measurement:
what they follow is rounding, or the accuracy of a solver."""

_SAME = 1e-12
"""Scatter below this part of the data is rounding."""

_WITHIN = 0.2
"""Of the slowest misfits so much must be left within trials for shifts of them to be taken out: six
trials through all x, of two points each, leave 0.21 to 0.33 of what laws of two parameters and a
level do not describe, six that lie side by side 0.15 of what a line does not."""

_FOLLOWED = 1e-3
"""Of the variance of a trial the fit must leave so much for its size to be told."""


@dataclasses.dataclass(frozen=True)
class Adequacy:
    """How probable residuals like these are where the model is right.

    `chi2_per_dof` is Σz²/(n-k) of residuals over their known noise, or over that which repeated
    points tell; `chi2_p` its probability; None where neither is known. `structure_p`: that noise
    alone follows the order of the points as much, by simulation through the fit; None with too few
    points. `p` combines the two by Fisher's sum of logarithms. `along`: what the points were
    ordered by. `adequate`: p ≥ 0.05; None where it cannot be told, for the `reason`.
    """

    adequate: bool | None
    p: float | None
    chi2_per_dof: float | None
    chi2_p: float | None
    structure_p: float | None
    along: str
    reason: str = ""

    def __str__(self) -> str:
        if self.adequate is None:
            return f"whether the model describes the data cannot be told: {self.reason}"
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
    """A probability as text; one that simulation or rounding bounds, as a bound."""
    if p == 0:
        return "p < 1e-300"
    return f"p < {2 / (DRAWS + 1):.0e}" if p == 1 / (DRAWS + 1) else f"p = {p:.2g}"


def adequacy_of(fit: FitData) -> Adequacy:
    """Whether the model of a fit describes its data.

    Points are ordered by `x` where it has one number for each, else as they were given. Noise is
    simulated as normal; where points of one trial may be correlated, as the residuals with the sign
    of each trial drawn, and with Huber's loss, which is for noise that is not normal, with the
    sign of each point drawn. With fewer than 8 trials there are too few signs: then what shifts all
    points of a trial alike is taken out together with what the model describes, and the rest is
    simulated as normal, unless trials lie side by side, where nothing tells a shift from a misfit.
    Source: Davidson & Flachaire (2008), doi 10.1016/j.jeconom.2008.08.003, for drawn signs; Fisher
    (1932) for the combination.
    """
    columns, along = _columns(fit)
    unknown = Adequacy(None, None, None, None, None, along)
    if not fit.converged:
        return dataclasses.replace(unknown, reason="the fit did not converge")
    if fit.dof < 1:
        return dataclasses.replace(unknown, reason="no degree of freedom is left")
    problem = fit.problem
    factor = np.asarray(problem.factor)
    used = factor > 0
    threshold = np.inf if problem.threshold is None else float(problem.threshold)
    z = np.clip(fit.z, -threshold, threshold)
    if _is_exact(fit, z):
        reason = "it meets them to one part in a million"
        return dataclasses.replace(unknown, adequate=True, reason=reason)
    model, left, trial = basis_of(fit.jacobian[used]), z, _trials(fit, used)
    many = trial if trial is not None and trial.max() + 1 >= LEAST_GROUPS else None
    told = many is not None or problem.threshold is None
    if trial is not None and many is None and told:
        # What is the same for all trials, a shift of each would hide in any order of them.
        same, shifted = (
            basis_of(np.concatenate([model, _shifts(fit, used, one)], axis=1))
            for one in (np.zeros_like(trial), trial)
        )
        told = share_left(columns, same, shifted) >= _WITHIN
        model, left = shifted, z - shifted @ (shifted.T @ z)
    statistics = Statistics(columns, model, factor[used])
    ratio, chi2_p = None, None
    if fit.absolute and problem.threshold is None:
        ratio = float(z @ z) / fit.dof
        # Correlated points have no χ² distribution.
        alone = trial is None and fit.shared is None
        chi2_p = _above_chi2(fit.dof, ratio * fit.dof) if alone else None
    elif statistics.repeated and problem.threshold is None and trial is None and fit.shared is None:
        ratio = float(statistics.lack_of_fit(z[None, :])[0]) or None
        if ratio is not None:
            chi2_p = _above_f(fit.dof - statistics.pure, statistics.pure, ratio)
    structure_p = None
    if trial is None and problem.threshold is not None:
        trial = many = np.arange(len(z))
        told = True
    if statistics and told:
        noise = _noise(left, columns, fit) if many is None else _signs(z, many, model)
        structure_p = chance(statistics, left, model, noise)
    # Statistics without a size are independent of χ² (Basu), those of repeated points are not.
    independent = [structure_p, chi2_p if fit.absolute or structure_p is None else None]
    p = _combined([one for one in independent if one is not None])
    if p is None:
        few = f"{fit.dof} degrees of freedom" if fit.dof > 1 else "one degree of freedom"
        why = f"{few}, and the noise is not known"
        if trial is not None:
            why = "too few trials, or too little that they share of x"
        return dataclasses.replace(unknown, chi2_per_dof=ratio, reason=why)
    return Adequacy(p >= LEVEL, p, ratio, chi2_p, structure_p, along)


def _columns(fit: FitData) -> tuple[list[Column], str]:
    """The used points of each column of the data in the order of its variable, and its name."""
    used = np.asarray(fit.problem.factor) > 0
    number = np.cumsum(used) - 1
    numbers = [
        np.asarray(x)
        for x in jax.tree.leaves(fit.problem.x)
        if np.ndim(x) == 1 and np.issubdtype(np.asarray(x).dtype, np.floating)
    ]
    columns, at, along = [], 0, "their order"
    for shape in fit.problem.shapes:
        size = math.prod(shape)
        inside = np.flatnonzero(used[at : at + size])
        place = next((x for x in numbers if x.size == size), None)
        if place is None:
            place = np.arange(size, dtype=float)
        else:
            along = "x"
        if len(inside):
            order = inside[np.argsort(place[inside], kind="stable")]
            level = np.unique(place[order], return_inverse=True)[1]
            columns.append(Column(number[at + order], level))
        at += size
    return columns, along


def _is_exact(fit: FitData, z: np.ndarray) -> bool:
    factor = np.asarray(fit.problem.factor)
    # Columns have units of their own.
    ends = np.cumsum([math.prod(shape) for shape in fit.problem.shapes])[:-1]
    parts = [
        (y[w > 0], w[w > 0])
        for y, w in zip(np.split(fit.data, ends), np.split(factor, ends), strict=True)
    ]
    parts = [(y, w) for y, w in parts if y.size]
    spread, size = (
        math.hypot(*(np.linalg.norm((y - off * y.mean()) * w) for y, w in parts)) for off in (1, 0)
    )
    # Data that are the same to rounding have no scatter of their own.
    scale = spread if spread > _SAME * size else size
    return bool(np.linalg.norm(z) <= _EXACT * scale)


def _trials(fit: FitData, used: np.ndarray) -> np.ndarray | None:
    """The number of the trial of each used point; None where every point is one of its own."""
    if fit.groups is None:
        return None
    trial = np.unique(fit.groups[used], return_inverse=True)[1]
    return trial if trial.max() + 1 < len(trial) else None


def _shifts(
    fit: FitData, used: np.ndarray, trial: np.ndarray
) -> Float[np.ndarray, "n trials*columns"]:
    """What a shift of all points of a trial, in one column of the data, changes of z."""
    factor, whitener = np.asarray(fit.problem.factor), fit.problem.whitener
    column = np.repeat(*np.transpose([(i, math.prod(s)) for i, s in enumerate(fit.problem.shapes)]))
    kind = np.unique(np.stack([column[used], trial]), axis=1, return_inverse=True)[1].ravel()
    shifts = np.zeros((used.size, kind.max() + 1))
    shifts[np.flatnonzero(used), kind] = factor[used]
    return (shifts if whitener is None else np.asarray(whitener) @ shifts)[used]


def _noise(
    z: np.ndarray, columns: list[Column], fit: FitData
) -> Callable[[int], Float[np.ndarray, "draws n"]]:
    """Normal noise; where its size is not known, in each column what neighbours differ by: the
    fit carries the noise of a column to others, where it is smooth.
    """
    random, size = np.random.default_rng(0), np.ones_like(z)
    if fit.shared is not None:
        size, root = np.sqrt(fit.shared.own), fit.shared.root
        return lambda draws: (
            size * random.normal(size=(draws, len(z)))
            + random.normal(size=(draws, root.shape[1])) @ root.T
        )
    if not fit.absolute and len(columns) > 1:
        for column in columns:
            steps = np.diff(z[column.order])
            size[column.order] = np.sqrt(np.mean(steps**2) / 2) if steps.size else 1
    return lambda draws: size * random.normal(size=(draws, len(z)))


def _signs(
    z: np.ndarray, trial: np.ndarray, model: Float[np.ndarray, "n k"]
) -> Callable[[int], Float[np.ndarray, "draws n"]]:
    """What is left, with a sign drawn for each trial.

    The fit follows a trial by its share H_gg of the hat matrix: (I - H_gg)^(-1/2) takes that back.
    """
    random, count = np.random.default_rng(0), int(trial.max()) + 1
    whole = z.copy()
    for g in range(count):
        rows = trial == g
        u, s, _ = np.linalg.svd(model[rows], full_matrices=False)
        freed = 1 / np.sqrt(np.maximum(1 - s**2, _FOLLOWED)) - 1
        whole[rows] += u @ (freed * (u.T @ z[rows]))
    return lambda draws: whole * (random.integers(0, 2, size=(draws, count)) * 2 - 1)[:, trial]


def _combined(p: list[float]) -> float | None:
    """Fisher's probability of independent ones: of -2 Σ ln p, a χ² with two degrees for each."""
    if not p:
        return None
    if len(p) == 1 or 0 in p:
        return min(p)
    half = -sum(math.log(one) for one in p)
    return math.exp(-half) * sum(half**k / math.factorial(k) for k in range(len(p)))


# SciPy takes half a second to load, so that only those wait for it who need it.
def _above_chi2(dof: int, chi2: float) -> float:
    from scipy.special import gammaincc

    return float(gammaincc(dof / 2, chi2 / 2))


def _above_f(upper: int, lower: int, ratio: float) -> float:
    from scipy.special import fdtrc

    return float(fdtrc(upper, lower, ratio))
