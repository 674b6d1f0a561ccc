"""Which of several fits to the same data to use."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ._found import find
from ._problem import Problem
from ._result import Fit
from ._solve import MOST_STEPS, PATIENCE

_AS_GOOD = 2.0
"""Below this difference of AICc two fits count as equally good (Burnham & Anderson 2002)."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One fit among others: k numbers, and three ways to judge it, the less the better.

    `aicc` and `bic` up to a constant that all share; `held_out`, the root mean square of the
    standardised residuals of points that were left out (plain residuals without `sigma`).
    """

    name: str
    k: int
    loss: float
    aicc: float
    bic: float
    held_out: float
    converged: bool


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Fits to the same data in the order of AICc, and what follows, in words."""

    candidates: tuple[Candidate, ...]
    verdict: str

    def __repr__(self) -> str:
        width = max(len(c.name) for c in self.candidates)
        best = min(c.aicc for c in self.candidates)
        bic = min(c.bic for c in self.candidates)
        lines = [f"{'':{width}}   k        loss    ΔAICc     ΔBIC  held-out rms"]
        for c in self.candidates:
            note = "" if c.converged else "  not converged"
            lines.append(
                f"{c.name:{width}}  {c.k:2d}  {c.loss:10.5g} {c.aicc - best:8.2f} "
                f"{c.bic - bic:8.2f}  {c.held_out:12.5g}{note}"
            )
        return "\n".join([*lines, self.verdict])


def compare_fits(
    fits: Mapping[str, Fit], *, folds: int = 5, groups: ArrayLike | None = None, seed: int = 0
) -> Comparison:
    """Compare fits to the same data: AICc, BIC, and the error at points that were left out.

    With known noise AIC = 2 loss + 2k, without it n ln(2 loss/n) + 2(k+1), and AICc adds the
    small-sample term; k counts what the data determine. Cross-validation fits again without one of
    `folds` parts, drawn from `seed` or, with `groups` (points,), made of whole groups (the trials
    of an experiment, say), so that points of one group never stand on both sides.

    Arguments: the `fits` by name, with the same data and weights. Returns a `Comparison`, which
    prints as a table with a verdict. Raises ValueError for fewer than two fits, fits to other data,
    and robust fits that found their own scale, which cannot be compared.
    Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    _check(fits, folds)
    first = next(iter(fits.values()))
    used = np.asarray(first.problem.factor) > 0
    parts = _parts(used, folds, groups, seed)
    found = [_candidate(name, fit, parts, int(used.sum())) for name, fit in fits.items()]
    found.sort(key=lambda c: (not c.converged, c.aicc))
    return Comparison(tuple(found), _verdict(found))


def _check(fits: Mapping[str, Fit], folds: int) -> None:
    if len(fits) < 2:
        raise ValueError(f"Argument `fits` must hold at least two fits, but holds {len(fits)}.")
    if not isinstance(folds, int) or folds < 2:
        raise ValueError(f"Argument `folds` must be at least 2, but is {folds!r}.")
    first = next(iter(fits.values()))
    for name, fit in fits.items():
        robust = fit.problem.threshold is not None and not fit.absolute
        same = np.array_equal(fit.problem.y, first.problem.y) and np.array_equal(
            fit.problem.factor, first.problem.factor
        )
        if robust or not same:
            why = "a scale of its own" if robust else "other data or weights"
            raise ValueError(
                f"Argument `fits` must hold fits to the same data, but {name!r} has {why}."
            )


def _parts(
    used: np.ndarray, folds: int, groups: ArrayLike | None, seed: int
) -> Bool[np.ndarray, "folds n"]:
    """Which points each fold leaves out."""
    random = np.random.default_rng(seed)
    names = np.arange(used.size) if groups is None else np.asarray(groups).ravel()
    if names.size != used.size:
        raise ValueError(
            f"Argument `groups` must have one name for each of the {used.size} points, but has "
            f"{names.size}."
        )
    _, number = np.unique(names, return_inverse=True)
    there = np.unique(number[used])
    if len(there) < folds:
        raise ValueError(
            f"Argument `folds` must be at most the {len(there)} groups of points, but is {folds}."
        )
    fold = np.full(number.max() + 1, -1)
    fold[random.permutation(there)] = np.arange(len(there)) % folds
    return (fold[number] == np.arange(folds)[:, None]) & used


def _candidate(name: str, fit: Fit, parts: np.ndarray, n: int) -> Candidate:
    k = n - fit.dof
    if fit.absolute:
        deviance, counted = 2 * fit.loss, k
    else:
        deviance, counted = n * math.log(max(2 * fit.loss / n, 1e-300)), k + 1
    small = 2 * counted * (counted + 1) / (n - counted - 1) if n > counted + 1 else math.inf
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        held_out = _held_out(fit, parts)
    return Candidate(
        name,
        k,
        fit.loss,
        deviance + 2 * counted + small,
        deviance + counted * math.log(n),
        math.sqrt(held_out / n),
        fit.converged,
    )


def _held_out(fit: Fit, parts: Bool[np.ndarray, "folds n"]) -> float:
    """Σ z² of the points that each fold leaves out, by the fit to the others; NaN without one."""
    square = 0.0
    for out in parts:
        # With other weights it is the same compiled search as that of the fit itself.
        weights = jnp.where(jnp.asarray(out), 0, fit.problem.factor)
        fewer = eqx.tree_at(lambda p: p.factor, fit.problem, weights)
        start, rtol = jnp.asarray(fit.theta), jnp.asarray(fit.rtol)
        found = find(fewer, start, rtol, None, MOST_STEPS, PATIENCE, None)
        if not np.all(found.still):
            return math.nan
        z = np.asarray(_standardised(fit.problem, found.theta))
        square += float(np.sum(z[out] ** 2))
    return square


@eqx.filter_jit
def _standardised(problem: Problem, theta: Float[Array, " k"]) -> Float[Array, " n"]:
    return problem.standardised(theta)


def _verdict(found: list[Candidate]) -> str:
    """What the numbers say, in a sentence or two."""
    best = found[0]
    if not best.converged:
        return "No fit converged."
    close = [c.name for c in found[1:] if c.converged and c.aicc - best.aicc < _AS_GOOD]
    if close:
        text = f"{best.name} describes the data best, and {' and '.join(close)} as well as it"
    else:
        text = f"{best.name} describes the data best"
    judged = [c for c in found if not math.isnan(c.held_out)]
    held = min(judged, key=lambda c: c.held_out, default=best)
    if held.name != best.name:
        text += f"; points left out are predicted best by {held.name}"
    return text + "."
