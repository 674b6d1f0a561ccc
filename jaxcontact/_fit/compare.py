"""The choice among several fits to the same data."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Callable, Collection, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Bool

from .._entry import refusal, require_count
from .._program import in_double
from .._text.words import text_table
from .data import FitData
from .fit import Fit
from .problem.target import groups_of, whitener_of
from .search.minimum import SearchOptions, find, in_numpy
from .search.verdict import LEAST_GROUPS
from .uncertainty.adequacy import shown

CLEAR_AICC = 2.0
"""Difference of AICc below which two fits are equally good (Burnham & Anderson 2002)."""

SAME = 5e-3
"""Difference of criteria that is only rounding: both print alike, for the same curve."""

CLEAR_ADVANTAGE = 2.0
"""The same for the advantage summed over groups, in its standard errors."""

_DOUBTLESS = 10.0
"""Difference of AICc for each point of a group from which no scatter by group counts. Where a
single group tells two fits apart, its gain is the scatter, too.
"""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One fit among others: k identifiable parameters, and four measures; lower is better.

    `aicc` and `bic` are defined up to a common constant. `held_out` is the root mean square of the
    standardised residuals of points that were left out (plain residuals without `sigma`), None if a
    fit without them did not converge. `behind` is the advantage of the fit of lowest AICc over this
    one, summed over groups of points, in its standard errors (Vuong's test). It is None for that
    fit itself, and with fewer than 8 groups. `adequate`: whether the fit describes the data, and
    `p`, the probability of such residuals if it does (None if undecided).
    """

    name: str
    k: int
    loss: float
    aicc: float
    bic: float
    held_out: float | None
    behind: float | None
    converged: bool
    adequate: bool | None
    p: float | None


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Fits to the same data in the order of AICc; `best`, the name of the one to use, and why.

    `best` is the simplest of those that describe the data equally well. These have an AICc less
    than 2 above the lowest, or a disadvantage below two of its standard errors by group. In the
    latter case the AICc is less than 10 above, for each point of a group. Among equally simple ones
    it is the first of the given fits if that is among them, otherwise the one of lowest AICc. Fits
    that do not describe the data count only if all do not, and the verdict then says so. `best` is
    None if no fit converged.
    """

    candidates: tuple[Candidate, ...]
    best: str | None
    verdict: str

    def __repr__(self) -> str:
        return f"{self.table()}\n{self.verdict}"

    def table(self, parameters: Callable[[str], str] | None = None) -> str:
        """Return the candidates as a table, with their `parameters` in words if given."""
        found = self.candidates
        extra = ["parameters"] if parameters else []
        head = ("", "k", "loss", "ΔAICc", "ΔBIC", "held out", *extra)
        aicc, bic = (min(map(operator.attrgetter(of), found)) for of in ("aicc", "bic"))
        rows = [
            (
                c.name,
                str(c.k),
                f"{c.loss:.5g}",
                f"{c.aicc - aicc:.2f}",
                f"{c.bic - bic:.2f}",
                "-" if c.held_out is None else f"{c.held_out:.4g}",
                *([parameters(c.name)] if parameters else []),
            )
            for c in found
        ]
        lines = text_table(rows, header=head, align="<>>>>><")
        marks: dict[bool | None, str] = {False: "  *", True: "", None: ""}
        notes = [marks[c.adequate] if c.converged else "  not converged" for c in found]
        wrong = ["* does not describe the data"] if "  *" in notes else []
        lines = [line + note for line, note in zip(lines, ["", *notes], strict=True)]
        return "\n".join(lines + wrong)

    def undecided(self, fit: FitData) -> tuple[str, ...]:
        """Return the names of the fits that the data do not distinguish from that of lowest AICc.

        `fit` is any of them, whose groups are those of all.
        """
        return tuple(one.name for one in _undecided(self.candidates, fit))


def compare_fits(
    fits: Mapping[str, Fit], *, folds: int = 5, groups: ArrayLike | None = None, seed: int = 0
) -> Comparison:
    """Compare fits to the same data: AICc, BIC, and the error at points that were left out.

    With known noise AIC = 2 loss + 2k, without it n ln(2 loss/n) - Σ ln w + 2(k+1) for weights w.
    AICc adds the small-sample term; k counts the identifiable parameters. Cross-validation repeats
    each fit without one of `folds` parts, which are drawn from `seed`. With `groups` (points,), the
    parts consist of whole groups, such as the trials of an experiment. Points of one group are then
    never on both sides. If the fits have `groups`, a difference of AICc must be clear by group.

    Arguments: the `fits` by name, with the same data and weights. Returns a `Comparison`, which
    prints as a table with a verdict. Raises ValueError for fewer than two fits, fits to other data,
    robust fits that estimated their own scale, which cannot be compared, and correlations that
    differ.

    Source: Burnham & Anderson (2002), doi 10.1007/b97636; Vuong (1989), doi 10.2307/1912557.
    """
    folds = require_count("folds", folds, 2)
    seed = require_count("seed", seed, 0)
    _check(fits)
    used = next(iter(fits.values()))._used
    return compared(fits, _parts(used, folds, groups, seed))


def compared(
    fits: Mapping[str, Fit],
    parts: Bool[np.ndarray, "folds n"],
    *,
    parameters: Callable[[str], str] | None = None,
    left_out: str = "points",
    group: str = "group",
    among: Collection[str] | None = None,
    unnamed: Collection[str] = (),
) -> Comparison:
    """Compare fits by the points that `parts` leave out.

    `parameters` gives those of a fit in words, for the verdict. `left_out` and `group` are the
    verdict's words for the parts and the groups. `among` names the fits that describe the data
    equally well, by default the undecided ones. The verdict does not name the `unnamed`.
    """
    _check(fits)
    names = sorted(fits, key=lambda name: (not fits[name].converged, fits[name].criteria[1]))
    first = fits[names[0]]
    found = []
    for name in names:
        fit, told = fits[name], fits[name].adequacy
        behind = None if fit is first else advantage(first, fit)
        k, aicc, bic = fit.criteria
        measures = k, fit.loss, aicc, bic, _held_out(fit, parts), behind
        found.append(Candidate(name, *measures, fit.converged, told.adequate, told.p))
    named = [c for c in found if c.name not in unnamed]
    equal = _undecided(named, first)
    if among is not None:
        equal = [c for c in named if c.converged and c.name in among]
    return Comparison(
        tuple(found), *_verdict(named, equal, list(fits), parameters, left_out, group)
    )


def advantage(fit: FitData, other: FitData) -> float | None:
    """Return by how many standard errors, by group, a fit is better than another (Vuong's test).

    The advantage ½ (z'² - z²) of each point, in units of the mean square residual, is summed within
    each group. The result is the total over its standard error. It is None with fewer than
    `LEAST_GROUPS` groups, or if the two fits are the same.
    """
    place, scale = fit._trials, float(np.mean(fit.z**2) + np.mean(other.z**2)) / 2
    if place is None or place.max() + 1 < LEAST_GROUPS or not scale > 0:
        return None
    gain = np.bincount(place, weights=(other.z**2 - fit.z**2) / (2 * scale))
    spread = math.sqrt(len(gain) * float(np.var(gain, ddof=1)))
    return float(np.sum(gain)) / spread if spread > 0 else None


def _check(fits: Mapping[str, Fit]) -> None:
    held = fits.values() if isinstance(fits, Mapping) else [None]
    if not all(isinstance(one, Fit) for one in held):
        raise refusal("fits", "be a dict of fits", fits)
    if len(fits) < 2:
        raise ValueError(f"Argument `fits` must hold at least two fits, but holds {len(fits)}.")
    first = next(iter(fits.values())).problem
    for name, fit in fits.items():
        if not np.array_equal(np.asarray(fit.problem.whitener), np.asarray(first.whitener)):
            raise ValueError(
                "Argument `fits` must hold fits with the same `correlation`, but that of "
                f"{name!r} differs."
            )
        robust = fit.problem.threshold is not None and not fit._absolute
        pairs = (fit.problem.y, first.y), (fit.problem.factor, first.factor)
        if robust or not all(np.array_equal(*pair) for pair in pairs):
            why = "a scale of its own" if robust else "other data or weights"
            raise ValueError(
                f"Argument `fits` must hold fits to the same data, but {name!r} has {why}."
            )


def _parts(
    used: np.ndarray, folds: int, groups: ArrayLike | None, seed: int
) -> Bool[np.ndarray, "folds n"]:
    """Return which points each fold leaves out."""
    random = np.random.default_rng(seed)
    number = groups_of(np.arange(used.size) if groups is None else groups, used.size)
    assert number is not None  # for the type checker
    there = np.unique(number[used])
    if len(there) < folds:
        raise ValueError(
            f"Argument `folds` must be at most the {len(there)} groups of points, but is {folds}."
        )
    fold = np.full(number.max() + 1, -1)
    fold[random.permutation(there)] = np.arange(len(there)) % folds
    return (fold[number] == np.arange(folds)[:, None]) & used


def _held_out(fit: FitData, parts: Bool[np.ndarray, "folds n"]) -> float | None:
    """Return √(mean z²) of points, each by the fit without its part; None if one failed."""
    square, whole = 0.0, dataclasses.replace(in_numpy(fit.problem), whitener=None)
    correlation = None
    if fit.problem.whitener is not None:
        root = np.linalg.inv(np.asarray(fit.problem.whitener))
        correlation = root @ root.T
    with in_double():
        for out in parts:
            # Other weights share the compiled search of the fit itself.
            weights = np.where(out, 0, fit._factor)
            # Whiten the remaining points only: points without weight must not count as exact.
            rest = whitener_of(correlation, weights > 0)
            numbers = jax.device_put({"factor": weights, "whitener": rest})
            fewer = dataclasses.replace(fit.problem, **numbers)
            found = find(fewer, fit._theta, SearchOptions(jnp.asarray(fit._rtol)))
            if not np.all(found.still):
                return None
            z = whole.standardised(found.prediction, np)
            square += float(np.sum(z[out] ** 2))
    return math.sqrt(square / np.count_nonzero(parts))


def _undecided(found: Sequence[Candidate], fit: FitData) -> list[Candidate]:
    """Return the fits that the data do not distinguish from the one of lowest AICc.

    If none of these describes the data, they are chosen among the fits that may. Those must be
    closer to the data, or nearly as good. With few points AICc prefers fits of few parameters.
    """
    good = [c for c in found if c.converged]
    trials = fit._trials
    most = _DOUBTLESS * (1.0 if trials is None else len(trials) / (int(trials.max()) + 1))
    equal = [
        c
        for c in good
        if (further := c.aicc - good[0].aicc) < CLEAR_AICC
        or (c.behind is not None and c.behind < CLEAR_ADVANTAGE and further < most)
    ]
    may = [
        c
        for c in good
        if c.adequate is not False and (c.loss < good[0].loss or c.aicc - good[0].aicc < most)
    ]
    return _undecided(may, fit) if may and not set(may) & set(equal) else equal


def _verdict(
    found: list[Candidate],
    equal: list[Candidate],
    order: list[str],
    parameters: Callable[[str], str] | None,
    left_out: str,
    group: str,
) -> tuple[str | None, str]:
    """Return the fit to use, and why, in a few sentences."""
    good = [c for c in found if c.converged]
    if not good:
        return None, "No fit converged."
    first = good[0]
    least = {c.k: min(x.aicc for x in equal if x.k == c.k) + SAME for c in equal}
    best = min(
        equal,
        key=lambda c: (
            *(c.adequate is False, c.k, c.name != order[0]),
            *(c.aicc > least[c.k], order.index(c.name)),
        ),
    )
    values = f": {parameters(best.name)}" if parameters else ""
    if best.adequate is False:
        text = _none_describes(best, first, good, values)
    else:
        alone = len(equal) == 1 and best is first
        if best.adequate is None:
            how = "comes closest to the data" if alone else "comes as close to the data as any"
        else:
            how = f"describes the data {'best' if alone else 'as well as any'}"
        text = f"Use {best.name}, which {how}{values}."
        if first not in equal and first.p is not None and first.adequate is False:
            text += f" The lowest AICc is that of {first.name}, but it does not describe the data"
            text += f" ({shown(first.p)})."
            good = [c for c in good if c is not first]
    others = [_distance(c, first, group) for c in equal if c is not best]
    if others:
        text += f" The data do not distinguish it from {' or '.join(others)}."
    worse = [c for c in good if c not in equal]
    if worse:
        text += f" Next is {_distance(worse[0], first, group)}."
    return best.name, text + _other_measures(best, good, equal, left_out)


def _other_measures(
    best: Candidate, good: list[Candidate], equal: list[Candidate], left_out: str
) -> str:
    """Return what speaks for another fit: BIC, and the prediction of data that were left out."""
    text = ""
    brief = min(good, key=lambda c: c.bic)
    if best.bic - brief.bic > SAME:
        why = ""
        if brief.k < best.k and brief.aicc > best.aicc:
            why = ", which has a larger penalty for each parameter,"
        text += f" BIC{why} prefers {brief.name} by {best.bic - brief.bic:.1f}."
    judged = [(c.held_out, c) for c in good if c.held_out is not None]
    error, held = min(judged, key=operator.itemgetter(0), default=(0.0, best))
    # Errors that print alike count as equal.
    equally = [c for e, c in judged if f"{e:.4g}" == f"{error:.4g}"]
    if judged and set(equally).isdisjoint(equal):
        text += f" But {left_out} that were left out are predicted best by {held.name}."
    return text


def _none_describes(best: Candidate, first: Candidate, good: list[Candidate], values: str) -> str:
    """Return the sentence that the best fit does not describe the data, and which others may."""
    assert best.p is not None  # for the type checker
    them = " or ".join(c.name for c in good if c.adequate is not False)
    head = f"The best is {best.name}" if best is first else f"{best.name} comes as close as any"
    rest = f"; {them} may" if them else ", and no other fit does"
    return f"{head}{values}. But it does not describe the data ({shown(best.p)}){rest}."


def _distance(c: Candidate, first: Candidate, group: str) -> str:
    """Return a candidate and its distance from the one with the lowest AICc."""
    if c is first:
        return f"{c.name} (lowest AICc)"
    by_group = "" if c.behind is None else f"; by {group} {c.behind:.1f} standard errors"
    return f"{c.name} (AICc higher by {c.aicc - first.aicc:.1f}{by_group})"
