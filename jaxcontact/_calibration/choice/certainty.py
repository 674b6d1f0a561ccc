"""Certainty of the choice of a kind of law."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, gammaincc

from ..._fit import SAME, Fit, FitData, criteria, has_trials
from ..._text.words import listed
from .kind import AbstractKind

EXCLUDED = 0.01
"""p below which a law is excluded; a right law is excluded by a wrong one at most this often."""

BETTER = 0.05
"""p below which a law is clearly better than its special case, or a free curve than a law."""


class Squares(NamedTuple):
    """The sum of squares of a fit: ½ Σ z², the whitened residuals z, and degrees of freedom."""

    loss: float
    z: np.ndarray
    dof: int


@dataclasses.dataclass(frozen=True)
class Standing:
    """The certainty of choosing `kind`: whether it is `sure`, and the laws `containing` it.

    The choice of X is sure if every law that does not contain X is excluded, no law that contains X
    is clearly better, and X describes the data.
    """

    sure: bool
    kind: str
    containing: frozenset[str]
    rivals: tuple[str, ...]
    """Laws that prevent certainty: not excluded, or clearly better."""


def standing_of(fits: Mapping[str, Fit], kinds: Sequence[AbstractKind], kind: str) -> Standing:
    """Return the standing of one kind among all that were fitted."""
    by_name = {one.name: one for one in kinds}
    own, found, reduced = by_name[kind], fits[kind], reduced_of(fits, kinds)
    containing = frozenset(name for name, one in by_name.items() if one.contains(own))
    rivals = [
        name
        for name, other in by_name.items()
        if name != kind and name not in reduced and _keeps_open(found, own, fits[name], other)
    ]
    good = found.converged and found.adequate is True and len(fits) > 1
    return Standing(good and not rivals, kind, containing, tuple(rivals))


def reduced_of(fits: Mapping[str, FitData], kinds: Sequence[AbstractKind]) -> dict[str, str]:
    """Return the laws whose fit is no better than that of a special case, and the latter.

    These fits have no more identifiable parameters than the special case.
    """
    converged = [kind for kind in kinds if fits[kind.name].converged]
    return {
        kind.name: other.name
        for kind in converged
        for other in converged
        if kind.contains(other) and _same(fits[kind.name], fits[other.name])
    }


def _same(fit: FitData, special: FitData) -> bool:
    (k, aicc, _), (least, lower, _) = criteria(fit), criteria(special)
    return k <= least and aicc > lower - SAME


def sure_of(fits: Mapping[str, Fit], kinds: Sequence[AbstractKind]) -> Standing | None:
    """Return the one law that is sure, or None."""
    found = (standing_of(fits, kinds, kind.name) for kind in kinds)
    return next((one for one in found if one.sure), None)


def rivals_of(
    fits: Mapping[str, Fit], kinds: Sequence[AbstractKind], best: str | None, sure: Standing | None
) -> tuple[str, ...]:
    """Return the converged laws other than the best that are not ruled out."""
    if best is None or sure is not None:
        return ()
    return tuple(n for n in standing_of(fits, kinds, best).rivals if fits[n].converged)


def _keeps_open(found: FitData, own: AbstractKind, fit: FitData, other: AbstractKind) -> bool:
    """Return whether another law, which may contain this one, prevents certainty."""
    if not (found.converged and fit.converged):
        return True
    more = len(fit.names) - len(found.names)
    if other.contains(own):
        return excess_p(fit, found, more) < BETTER
    # A law that does not contain the other can approach it along one more direction.
    numbers = max(-more, 0) + (0 if own.contains(other) else 1)
    return excess_p(found, fit, numbers) >= EXCLUDED


def excess_p(better: FitData | Squares, worse: FitData, numbers: int) -> float:
    """Return the probability of so much larger a sum of squares if `numbers` parameters are idle.

    F = (Σz'² - Σz²)/numbers/s², with s² of the better fit, or 1 if the noise is known. If points of
    a trial may be correlated, the result is the larger of this and the probability by trial. The
    latter uses the noise along the difference d = z' - z of the two curves, Σ_g (Σ_i d_i z_i)²/Σ d²
    over the trials g.
    """
    gain = 2 * (worse.loss - better.loss)
    if gain <= 0 or better.dof < 1:
        return 1.0
    if better.loss == 0:
        return 0.0
    if worse._absolute:
        p = float(gammaincc(numbers / 2, gain / 2))
    else:
        p = float(fdtrc(numbers, better.dof, gain / numbers / (2 * better.loss / better.dof)))
    return max(p, _by_trial(better, worse, gain, numbers))


def _by_trial(better: FitData | Squares, worse: FitData, gain: float, numbers: int) -> float:
    """Return the probability by trial; 0 if every point is its own trial."""
    if not has_trials(worse):
        return 0.0
    assert worse.groups is not None  # for the type checker
    used = np.asarray(worse.problem.factor) > 0
    trial = np.unique(worse.groups[used], return_inverse=True)[1]
    count = int(trial.max()) + 1
    if count < 2:
        return 1.0
    z, difference = better.z, worse.z - better.z
    along = np.bincount(trial, weights=difference * z)
    noise = float(along @ along) * count / (count - 1) / float(difference @ difference)
    return float(fdtrc(numbers, count - 1, gain / numbers / noise)) if noise > 0 else 0.0


def sure_sentence(
    fits: Mapping[str, Fit],
    kinds: Sequence[AbstractKind],
    best: str | None,
    sure: Standing | None,
    said: Collection[str | None],
    *,
    beyond: bool,
) -> str:
    """Return whether the choice of `best` is sure, as a sentence that follows the verdict.

    `said` are the laws that the verdict already calls indistinguishable from it. `beyond`: whether
    a free curve may describe the data better than any law.
    """
    if sure is not None and len(fits) == 2:
        (other,) = fits.keys() - {sure.kind}
        how = f"excluded (p < {EXCLUDED:g})"
        if other in sure.containing:
            how = f"not clearly better (p ≥ {BETTER:g})"
        return f" The choice is sure between the two: {other} is {how}."
    if sure is not None:
        but = " that does not contain it" if sure.containing else ""
        return f" The choice is sure: every other law{but} is excluded (p < {EXCLUDED:g} each)."
    if best is None or fits[best].adequate is False:
        return ""
    standing = standing_of(fits, kinds, best)
    rest = [name for name in standing.rivals if name not in said]
    if rest:
        verb = "is" if len(rest) == 1 else "are"
        return f" The choice is not sure: {listed(rest)} {verb} not ruled out."
    if standing.rivals:
        return ""
    if fits[best].adequate is None:
        return " The choice is not sure: the fit could not be tested."
    if beyond:
        return " The choice is not sure: a free smooth curve has an AICc lower by more than 2."
    return ""
