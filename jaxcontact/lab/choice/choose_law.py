"""The choice of the kind of law that describes restitution over closing speed."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, Unpack

import numpy as np
from jaxtyping import ArrayLike, Float

from ... import Contact, Fit
from ...extend import (
    CLEAR_AICC,
    MEASURED_RESTITUTION,
    POSITIVE,
    Candidate,
    SearchKeywords,
    as_weights,
    column,
    compared,
    counted,
    for_each,
    groups_of,
    listed,
    require_contact,
    require_flag,
    side_by_side,
    stages_of,
    takes,
)
from ..design import minimax, shared_out
from ..pairs.outliers import Outliers, find_outliers
from ..pairs.pairs import LEAST_PAIRS, Pairs, pairs_of, standardised
from .certainty import Certainty, Curve, Line, curve_of, line_of
from .equivalent_e import Grid, asked_of, delivered_by_laws
from .kind import Kind, is_identifiable, padded
from .kinds import kinds_of
from .law_choice import LawChoice, LawFit
from .table import ChoiceTable, columns_of, errors_of

_CLOSER = 0.5
"""Ratio of the scatters about a law and about a trend below which the trend misses the curve."""

_PLACES = 40
"""Candidate speeds of the measurement."""

_WANTED = 40.0
"""λ at which the wrong law is detected in all but one of ten thousand tables."""

_MANY = 2_000
"""Readings beyond which shared errors dominate, such as a scale that reads 1 % too high."""

_SHOWN = 12
"""Parts into which the readings are divided, to find the speeds that need them."""


@takes(SearchKeywords)
def choose_law(
    contact: Contact,
    velocity: ArrayLike,
    e: ArrayLike,
    *,
    laws: str = "all",
    duration: ArrayLike | None = None,
    max_force: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    sigma_duration: ArrayLike | None = None,
    sigma_max_force: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    mark_outliers: bool = True,
    progress: bool | Callable[[str], None] | None = None,
    **how: Unpack[SearchKeywords],
) -> LawChoice:
    """Fit every kind of law to restitution over closing speed, and choose one.

    Laws of one kind have the same form of e(v):

    - a constant e, which most laws deliver (each for a different parameter e);
    - a constant c, with α = c v/K (also Marhefka and Orin's law, with a = c/K);
    - c as a power of v;
    - 1 - b v^p;
    - e (1 - v_c/v) of bodies with a film of liquid;
    - for n = 3/2, Kuwabara and Kono's law, Thornton's elastic-plastic spheres, the same with
      Hunt and Crossley's damping ("viscoplastic"), and spheres that adhere ("jkr").

    Others are compared with a constant e if `laws` names them. "bridges" is min(1, a v^-p), which
    few tables separate from the curve of plastic spheres. For n = 3/2 these are also
    "linear_dashpot" and "step_damping".

    One fit for each kind minimises Σ ((ln e_k - ln e(v_k))/σ_k)². It is the same calibration that
    `jaxcontact calibrate` and `calibrate` make of the table. Logarithms of measured contact times
    and peak forces are fitted together with ln e, and then the stiffness is fitted too. They are
    computed from the force of each law. For 1 - b v^p, a v^-p, wet bodies and a constant e, that is
    the Hunt-Crossley member that delivers the same e.

    Arguments: mass and stiffness of the `contact` are taken as known (e(v) determines only c/K and
    A (K/m)^(2/5)). Closing speeds `velocity` in m/s and restitutions `e` in (0, 1.2] (noise may
    raise a measured one above 1), both (points,). `laws`: "all" or the name of one law, as in
    `calibrate`. `duration` in s and `max_force` in N (points,), NaN if not measured.

    `sigma`: standard deviations of e; with it, `sigma_duration` and `sigma_max_force` relative to
    their column. `weights`: relative weights of e instead (by default, the scatter about a trend).
    `groups` (points,): the trial of each point, by default one for each. With at least 8 trials,
    standard errors and the comparison allow for correlation within a trial. `mark_outliers`:
    whether points more than 6 robust standard deviations off are left out. They are off every law
    that describes the data; without such a law, off a trend. `progress` as in `calibrate`. Other
    keywords go to `fit` (`optimizer`, `starts`, ...), for all kinds.

    The held-out error leaves out four bands of speed in turn; `compare_fits(choice.fits,
    groups=...)` leaves out other groups. The choice is `sure` of a law that describes the data:
    every law that does not contain it is excluded (p < 0.01). No law that contains it is clearly
    better (p < 0.05). No free smooth curve has an AICc lower than that of all laws by 2.

    Returns a `LawChoice`, which prints as a table with a verdict and which `jc.plot.choice` draws.
    Raises ValueError for columns that do not match or are out of range, for fewer than 4 points,
    and as `fit` and `compare_fits` do.

    Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    require_contact(contact)
    kinds = kinds_of(laws, contact.exponent)
    mark_outliers = require_flag("mark_outliers", mark_outliers)
    v = column(velocity, "velocity", POSITIVE)
    measured = column(e, "e", MEASURED_RESTITUTION, ("velocity", v))
    own = None if sigma is None else for_each(sigma, "sigma", len(v))
    known = own if own is not None and np.isfinite(own).all() else None
    pairs = pairs_of(v, measured, known)
    pairs.needs_enough()
    word = "row"
    if groups is not None:
        word = "trial"
        pairs = dataclasses.replace(pairs, cluster=groups_of(groups, len(v)))
    outliers = find_outliers(pairs)
    marked = outliers.flagged & mark_outliers
    pairs.where(~marked).needs_enough(marked=int(marked.sum()))
    errors = errors_of(pairs, outliers, ~marked)
    if own is not None:
        sigma_log = errors.sigma if known is not None else own / measured
        errors = errors._replace(sigma=sigma_log, absolute=True)
    elif weights is not None:
        with np.errstate(divide="ignore"):
            relative = for_each(as_weights(weights), "weights", len(v), zero=True)
            errors = errors._replace(sigma=relative**-0.5 / measured)
    others = columns_of(
        {"duration": (duration, sigma_duration), "max_force": (max_force, sigma_max_force)},
        ("velocity", v),
        sigma,
        weights,
    )
    errors = errors._replace(others=others)
    table = ChoiceTable(pairs, ~marked, errors, contact, options=how, group=word)
    chosen = functools.partial(choose, kinds=kinds, progress=stages_of(progress))
    return about_the_law(table, outliers, chosen)[0] if mark_outliers else chosen(table)


def about_the_law(
    table: ChoiceTable, outliers: Outliers, chosen: Callable[[ChoiceTable], Any]
) -> tuple[Any, Outliers]:
    """Return the `chosen` fits without the pairs off every law that describes the rest, and these.

    The first fits leave out the `outliers`, which are off a trend, and the next ones those off the
    laws fitted before, until the pairs stay the same. If the best law is no better than the trend,
    or the pairs do not settle, the same begins with all pairs. If that fails, the trend counts.
    """
    start, found, seen = chosen(table), outliers, set[bytes]()
    now = start
    while True:
        seen.add(found.flagged.tobytes())
        flagged = found.flagged & False
        if off := _off_laws(table.pairs, now, found):
            flagged = np.all([one.flagged for one in off], axis=0)
            if np.array_equal(flagged, found.flagged):
                return now, dataclasses.replace(off[0], flagged=flagged).told(table.pairs)
        if flagged.tobytes() in seen:
            flagged = flagged & False
        if flagged.tobytes() in seen or np.sum(~flagged) < LEAST_PAIRS:
            return start, outliers
        now = chosen(dataclasses.replace(table, use=~flagged))
        found = dataclasses.replace(outliers, flagged=flagged)


def _off_laws(pairs: Pairs, now: Any, found: Outliers) -> list[Outliers]:
    """Return the pairs off the best law, and off each other law that describes the data."""
    good = {
        kind: found.off_law(pairs, kind, *fit.predict_with_error())
        for kind, fit in now.fits.items()
        if kind == now.best or (fit.converged and fit.adequate and is_identifiable(fit))
    }
    own = good.pop(now.best, None)
    if own is None or not (
        now.fits[now.best].adequate or own.scatter(pairs) < _CLOSER * found.scatter(pairs)
    ):
        return []
    return [own, *good.values()]


def choose(
    table: ChoiceTable, *, kinds: tuple[Kind, ...], progress: Callable[[str], None]
) -> LawChoice:
    """Choose among `kinds` on the pairs of a table; of too few pairs, the first, a constant e."""
    forces, count = bool(table.errors.others), len(table.velocity)
    if count < LEAST_PAIRS:
        # Few impacts have the errors of their readings.
        table = dataclasses.replace(table, errors=table.errors._replace(absolute=True))
    if count < LEAST_PAIRS and (not forces or count == 1):
        return only_constant(table, kinds[0])
    return _compared(table, kinds, progress)


def _compared(
    table: ChoiceTable, every: tuple[Kind, ...], progress: Callable[[str], None]
) -> LawChoice:
    kinds = tuple(filter(table.determines, every))
    if len(kinds) < 2:
        names, pairs = [kind.name for kind in every], table.pairs
        raise pairs.fault(
            f"{len(table.velocity)} usable {pairs.words[1]}{pairs.owner} are too few to compare "
            f"{listed(names)}; add rows"
        )
    fits, laws, grid = _fits_of(table, kinds, progress)
    first, x = fits[kinds[0].name], np.asarray(table.data["x"])
    certainty = Certainty(fits, kinds)
    reduced = certainty.reduced
    laws = tuple(dataclasses.replace(law, reduced_to=reduced.get(law.kind, "")) for law in laws)
    said = {law.kind: law.said for law in laws}
    free = curve_of(fits.values(), x)
    # Certainty needs fits of all laws, and data that no other curve may describe better.
    left_out = [kind.name for kind in every if kind not in kinds]
    lowest = min((one.criteria[1] for one in fits.values() if one.converged), default=0.0)
    beyond = free.aicc is not None and lowest - free.aicc > CLEAR_AICC
    standing = None if left_out or beyond else certainty.sure
    comparison = compared(
        fits,
        table.bands(first),
        parameters=said.__getitem__,
        left_out="speeds",
        group=table.group,
        among=None if standing is None else {standing.kind, *standing.containing},
        unnamed=reduced,
    )
    best = comparison.best
    rivals = [name for name in comparison.undecided(first) if name not in {best, *reduced}]
    if standing is not None:
        rivals = [name for name in rivals if name in standing.containing]
    verdict = comparison.verdict
    verdict += certainty.sentence(best, standing, {best, *rivals}, beyond)
    if left_out:
        verdict += f" More points are needed to compare {listed(left_out)}."
    v, open_laws = table.velocity, ()
    if best is not None and standing is None:
        # The laws that are not ruled out.
        open_laws = tuple(n for n in certainty.standing(best).rivals if fits[n].converged)
    return _choice(
        table,
        kinds,
        (fits, laws, grid),
        candidates=comparison.candidates,
        best=best,
        sure=standing is not None,
        verdict=verdict,
        free=free,
        next_measurement=what_settles(fits, best, rivals, (float(v.min()), float(v.max()))),
        rivals=open_laws,
    )


_UNKNOWN = "the error of a single pair is unknown"


def only_constant(table: ChoiceTable, kind: Kind) -> LawChoice:
    """Fit a constant e, the mean of the few pairs of a table; with forces, the stiffness too."""
    pairs, v = table.pairs, table.velocity
    if not table.errors.others:
        table = with_known_errors(table)
    fits, (law,), grid = _fits_of(table, (kind,), lambda text: None)
    found, words = fits[kind.name], pairs.words
    if not table.errors.absolute and len(v) == 1:
        lacking = [dataclasses.replace(one, lacking=_UNKNOWN) for one in law.estimates]
        law = dataclasses.replace(law, estimates=tuple(lacking))
    k = len(found.names)
    bic = 2 * found.loss + k * math.log((1 + len(table.errors.others.values)) * len(v))
    criteria = kind.name, k, found.loss, 2 * found.loss + 2 * k, bic, None, None
    level, told = math.log(law.constant.value), found.adequacy
    choice = _choice(
        table,
        (kind,),
        (fits, (law,), grid),
        candidates=(Candidate(*criteria, found.converged, told.adequate, told.p),),
        best=kind.name if found.converged else None,
        sure=False,
        verdict=f"Use {kind.name}: {law.said}. {counted(len(v), words)} cannot distinguish laws.",
        free=Curve((level,), float(v.min()), float(v.max()), None, better=False),
        next_measurement=f"a choice among laws needs at least {LEAST_PAIRS} {words[1]}, over the "
        f"range of speeds in your simulation; {pairs.rule}",
    )
    return choice if len(v) > 1 else dataclasses.replace(choice, line=Line(level, 0.0, None))


def with_known_errors(table: ChoiceTable) -> ChoiceTable:
    """Return a table of few pairs with the known errors of their readings, for a mean e.

    Errors stay relative, of independent pairs, if they are unknown or the pairs differ by more.
    """
    pairs, use, whole = table.pairs, table.use, table.pairs.covariance
    errors = table.errors._replace(correlation=None, absolute=False)
    if whole is not None:
        size, correlation = standardised(whole)
        own, y = whole[np.ix_(use, use)], np.log(pairs.restitution[use])
        inverse = np.linalg.pinv(own)
        left = y - (inverse @ y).sum() / inverse.sum()
        if left @ inverse @ left <= len(y) - 1 + 1e-9:
            errors = errors._replace(sigma=size, correlation=correlation, absolute=True)
    known = frozenset[str]()
    return dataclasses.replace(table, errors=errors, known=known, options={"groups": None})


Fitted = tuple[dict[str, Fit], tuple[LawFit, ...], Grid]


def _choice(
    table: ChoiceTable, kinds: tuple[Kind, ...], fitted: Fitted, **compared: Any
) -> LawChoice:
    """Return the choice of a table, with the comparison of the fits."""
    fits, laws, grid = fitted
    constant = laws[0].constant
    return LawChoice(
        count=len(table.velocity),
        laws=laws,
        line=line_of(fits[kinds[0].name], np.asarray(table.data["x"])),
        asked=asked_of(constant.value, constant.standard_error, grid),
        fits=fits,
        _kinds=kinds,
        contact=table.contact,
        reference=table.reference,
        marked=~table.use,
        **compared,
    )


def _fits_of(
    table: ChoiceTable, kinds: tuple[Kind, ...], progress: Callable[[str], None]
) -> Fitted:
    """Fit all kinds; return the fits, the same in words, and the e of laws of constant e."""

    def fitted(kind: Kind) -> tuple[Fit, LawFit]:
        found = table.fit(kind)
        return found, table.law_fit(kind, found)

    # The restitution delivered by laws of constant e is compiled in parallel with the fits.
    jobs: list[Any] = [functools.partial(fitted, kind) for kind in kinds]
    outcomes: Any = side_by_side([*jobs, delivered_by_laws])
    found: list[tuple[Fit, LawFit]] = []
    for kind in kinds:
        progress(f"fitting {kind.name}")
        found.append(next(outcomes))
    fits = {kind.name: one for kind, (one, _) in zip(kinds, found, strict=True)}
    return fits, tuple(law for _, law in found), next(outcomes)


def what_settles(
    fits: dict[str, Fit], best: str | None, rivals: list[str], ends: tuple[float, float]
) -> str:
    """Return where and how often to measure e to separate the best law from its nearest rival.

    Minimax: the law with more parameters is taken as right. The other law is refitted to minimise
    its maximum deviation; the speeds are those where it occurs. Returns "" if the choice is clear,
    or if the best law does not describe the data.
    """
    if best is None or not rivals or fits[best].adequate is False:
        return ""
    # With equal numbers of parameters, the best is taken as right.
    right, other = sorted((best, rivals[0]), key=lambda name: -len(fits[name].names))
    low, high = ends
    between = f"to distinguish {best} from {rivals[0]}"
    if not high > low:
        return f"{between}, measure e at speeds other than {low:.3g} m/s"
    speeds = np.geomspace(low, high, _PLACES)
    distance, share = _least_distance(fits[right], fits[other], speeds)
    # The noise of e, which is the first column.
    noise = float(np.nanmedian(fits[right].scatter[: len(fits[right].problem.x)]))
    count = math.inf if distance == 0 else math.ceil(_WANTED * (noise / distance) ** 2)
    if count > _MANY:
        most = f"{100 * distance:.1g} % of e at most"
        return (
            f"{between}, measure e at speeds outside {low:.3g} to {high:.3g} m/s: inside, the "
            f"difference of {most} is hidden by the scatter of single readings"
        )
    places = speeds[shared_out(share, _SHOWN) > 0]
    at = " and ".join(f"{v:.3g}" for v in places)
    count = float(f"{max(count, len(places) + 1):.2g}")
    return (
        f"{between}, measure e equally often at {at} m/s: about {count:g} independent readings "
        f"with this scatter rule out {other} if {right} is right"
    )


def _least_distance(
    right: Fit, other: Fit, speeds: Float[np.ndarray, " m"]
) -> tuple[float, Float[np.ndarray, " m"]]:
    """Return the minimax difference of ln e, linear in parameters, and shares of the readings."""
    at = padded(speeds, speeds[0])
    truth = right.linearised(at)[0][: len(speeds)]
    curve, slopes = (part[: len(speeds)] for part in other.linearised(at))
    # Scale parameters of different units by their effect, for the linear programme.
    size = np.abs(slopes).max(axis=0)
    _, distance, share = minimax(curve - truth, slopes / np.where(size > 0, size, 1))
    return distance, share / share.sum() if share.sum() > 0 else share
