"""The choice of the kind of law that describes restitution over closing speed."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple, Unpack

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ..._contact import Contact, require_contact
from ..._fit import Fit, Positive, compared, fit, groups_of, undecided
from ..._fit.keywords import SearchKeywords, takes
from ..._flight import Floats
from ..._parameter import POSITIVE, as_weights, require_flag
from ..._program import side_by_side
from ..._text.progress import stages_of
from ..pairs.columns import column, for_each
from ..pairs.noise import RELATIVE_FLOOR, Noise, estimate_noise, scatter_beside
from ..pairs.outliers import Outliers, find_outliers
from ..pairs.pairs import Pairs, pairs_of
from ..pairs.plausible import MEASURED_RESTITUTION
from .certainty import rivals_of, sure_of, sure_sentence
from .equivalent_e import asked_of, delivered_by_laws
from .kind import AbstractKind, LogRestitution, is_identifiable, padded
from .kinds import kinds_of
from .law_choice import LawChoice, LawFit
from .next_measurement import what_settles
from .outcomes import NONE, Columns, LogOutcomes, columns_of
from .trend import curve_of, line_of

_BANDS = 4
"""Bands of speed that are left out in turn; each holds at least one pair."""


@takes(SearchKeywords)
def choose_law(
    contact: Contact,
    velocity: ArrayLike,
    e: ArrayLike,
    *,
    law: str = "all",
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
    - for n = 3/2, Kuwabara and Kono's law, and Thornton's law of elastic-plastic spheres.

    Three more are compared with a constant e if `law` names them. "bridges" is min(1, a v^-p),
    which few tables separate from the curve of plastic spheres. "linear_dashpot" and "step_damping"
    need n = 3/2.

    One fit for each kind minimises Σ ((ln e_k - ln e(v_k))/σ_k)². It is the same calibration that
    `jaxcontact calibrate` and `calibrate` make of the table. Logarithms of measured contact times
    and peak forces are fitted together with ln e, and then the stiffness is fitted too. They are
    computed from the force of each law. For 1 - b v^p, a v^-p and a constant e, that is the
    Hunt-Crossley member that delivers the same e; for Thornton's spheres it is his force.

    Arguments: mass and stiffness of the `contact` are taken as known (e(v) determines only c/K and
    A (K/m)^(2/5)). Closing speeds `velocity` in m/s and restitutions `e` in (0, 1.2] (noise may
    raise a measured one above 1), both (points,). `law`: "all" or the name of one law, as in
    `calibrate`. `duration` in s and `max_force` in N (points,), NaN if not measured.

    `sigma`: standard deviations of e; with it, `sigma_duration` and `sigma_max_force` relative to
    their column. `weights`: relative weights of e instead (by default, the scatter about a trend).
    `groups` (points,): the trial of each point, by default one for each. With at least 8 trials,
    standard errors and the comparison allow for correlation within a trial. `mark_outliers`:
    whether points more than 6 robust standard deviations off the trend are left out. `progress` as
    in `calibrate`. Other keywords go to `fit` (`optimizer`, `starts`, ...), for all kinds.

    The held-out error leaves out four bands of speed in turn; `compare_fits(choice.fits,
    groups=...)` leaves out other groups. The choice is `sure` of a law under three conditions.
    Every law that does not contain it is excluded (p < 0.01). No law that contains it is clearly
    better (p < 0.05). It describes the data. A free smooth curve shows how much better any law
    could be.

    Returns a `LawChoice`, which prints as a table with a verdict and which `jc.plot.choice` draws.
    Raises ValueError for columns that do not match or are out of range, for fewer than 4 points,
    and as `fit` and `compare_fits` do.

    Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    require_contact(contact)
    kinds = kinds_of(law, contact.exponent)
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
    relative = weights_of(pairs, outliers, ~marked).weights
    others = columns_of(
        {"duration": (duration, sigma_duration), "max_force": (max_force, sigma_max_force)},
        ("velocity", v),
        sigma,
        weights,
    )
    options: dict[str, Any] = {**how}
    if own is not None:
        options["sigma"] = relative**-0.5 if known is not None else own / measured
    elif weights is not None:
        relative = for_each(as_weights(weights), "weights", len(v), zero=True) * measured**2
    table = pairs, ~marked, relative, kinds, contact
    return choose(*table, others=others, group=word, progress=stages_of(progress), **options)


class Weighed(NamedTuple):
    """The noise of ln e, the weights (n,) of all pairs, and the correlation (n, n) of their errors.

    The correlation is None for independent pairs.
    """

    noise: Noise
    weights: Floats
    correlation: Floats | None


def weights_of(pairs: Pairs, outliers: Outliers, keep: np.ndarray) -> Weighed:
    """Return the noise of ln e about the trend of the pairs `keep`, and the weights of all pairs.

    Known errors of the readings are used unchanged, with what pairs share of them. The scatter of
    the bounces is estimated in addition, unless the errors contain it.
    """
    good = pairs.where(keep)
    if pairs.absolute and pairs.covariance is not None:
        size = np.sqrt(np.diag(pairs.covariance))
        if not pairs.reading:  # to third order, σ/√(e e₀) of ln e is the σ of e
            size = size * np.sqrt(pairs.restitution / np.exp(outliers.trend(pairs.velocity)))
        usual = 0.0 if pairs.reading else float(np.median(size[keep]))
        correlation = pairs.covariance / np.outer(size, size)
        alone = not np.any(np.triu(correlation, 1))
        noise = Noise(usual, pairs.reading)
        return Weighed(noise, size**-2, None if alone else correlation)
    if pairs.covariance is not None and good.covariance is not None:
        trend = outliers.trend
        relative = scatter_beside(
            np.log(good.restitution), trend.columns(good.velocity), good.covariance
        )
        whole = pairs.covariance + max(relative, RELATIVE_FLOOR) ** 2 * np.eye(len(pairs))
        size = np.sqrt(np.diag(whole))
        return Weighed(Noise(relative, pairs.reading), size**-2, whole / np.outer(size, size))
    residual = np.log(good.restitution) - outliers.trend(good.velocity)
    noise = estimate_noise(residual, good.reading_factor, robust=False)
    return Weighed(noise, noise.sigma(pairs.reading_factor) ** -2, None)


def choose(
    pairs: Pairs,
    use: np.ndarray,
    weights: Floats,
    kinds: tuple[AbstractKind, ...],
    contact: Contact,
    *,
    others: Columns = NONE,
    correlation: Floats | None = None,
    known: frozenset[str] = frozenset({"mass", "stiffness"}),
    group: str = "trial",
    progress: Callable[[str], None],
    **how: Any,
) -> LawChoice:
    """Choose among `kinds` on the pairs where `use` (n,) is True, with relative `weights` (n,).

    `others` were measured with the pairs. `correlation` (n, n) is that of the errors of ln e; with
    `others` included it is (columns n, columns n).

    Each kind has one compiled search. Pairs without weight pad the data to a few lengths, and
    leaving pairs out (outliers, bands of speed) changes only weights.
    """
    v = pairs.velocity[use]
    # AICc is finite for n > k + 1 readings; unknown noise takes one more.
    readings = len(v) + sum(int(np.isfinite(one[use]).sum()) for one in others.sigma.values())
    free = readings - (1 if "sigma" in how else 2) - bool(others)
    every, kinds = kinds, tuple(kind for kind in kinds if len(kind.transforms) < free)
    data = padded_data(pairs, use, weights, others, correlation, how)

    def fitted(kind: AbstractKind) -> tuple[Fit, LawFit]:
        found = fit_kind(kind, pairs, use, contact, others, data)
        return found, law_fit(kind, found, pairs, use, contact, known)

    found: list[tuple[Fit, LawFit]] = []
    # The restitution delivered by laws of constant e is compiled in parallel with the fits.
    jobs: list[Any] = [functools.partial(fitted, kind) for kind in kinds]
    outcomes: Any = side_by_side([*jobs, delivered_by_laws])
    for kind in kinds:
        progress(f"fitting {kind.name}")
        found.append(next(outcomes))
    grid = next(outcomes)
    fits = {kind.name: one for kind, (one, _) in zip(kinds, found, strict=True)}
    laws = tuple(law for _, law in found)
    said = {law.kind: law.said for law in laws}
    bands = np.tile(_bands(pairs, use, len(data["x"])), 1 + len(others.values))
    bands &= np.asarray(fits[kinds[0].name].problem.factor) > 0
    # Certainty needs fits of all laws.
    standing = sure_of(fits, kinds) if kinds == every else None
    comparison = compared(
        fits,
        bands,
        parameters=said.__getitem__,
        left_out="speeds",
        group=group,
        among=None if standing is None else {standing.kind, *standing.containing},
    )
    constant = laws[0].constant
    some, x = fits[kinds[0].name], np.asarray(data["x"])
    free = curve_of(some, x)
    if others:  # its criterion is that of other data
        free = dataclasses.replace(free, aicc=None)
    rivals = [c.name for c in undecided(comparison.candidates) if c.name != comparison.best]
    if standing is not None:
        rivals = [name for name in rivals if name in standing.containing]
    ends = float(v.min()), float(v.max())
    return LawChoice(
        count=int(use.sum()),
        candidates=comparison.candidates,
        best=comparison.best,
        sure=standing is not None,
        verdict=comparison.verdict
        + sure_sentence(fits, kinds, comparison.best, standing, {comparison.best, *rivals}),
        laws=laws,
        line=line_of(some, x),
        free=free,
        asked=asked_of(constant.value, constant.standard_error, grid),
        next_measurement=what_settles(fits, comparison.best, rivals, ends),
        rivals=rivals_of(fits, kinds, comparison.best, standing),
        fits=fits,
        kinds=kinds,
        contact=contact,
        reference=reference_of(v),
        marked=~use,
    )


def _errors_by(found: Fit) -> str:
    if found.by_group:
        return "group"
    return "point" if found.problem.whitener is None else "readings"


def fit_kind(
    kind: AbstractKind,
    pairs: Pairs,
    use: np.ndarray,
    contact: Contact,
    others: Columns,
    data: dict[str, Any],
) -> Fit:
    """Fit a kind of law to `padded_data` of the pairs in `use`; with `others`, K too."""
    typical = min(max(float(np.median(pairs.restitution[use])), 0.05), 0.999)
    reference = reference_of(pairs.velocity[use])
    start, transforms = kind.start(typical, contact, reference), kind.transforms
    with jax.enable_x64(True):
        model: Any = LogRestitution(kind, contact, jnp.asarray(reference))
        if others:
            model = LogOutcomes(kind, contact, jnp.asarray(reference), tuple(others.values))
            start["stiffness"] = float(contact.stiffness)
            transforms["stiffness"] = Positive()
    return fit(model, start=start, transforms=transforms, throw=False, **data)


def reference_of(velocity: Floats) -> float:
    """Return the speed in m/s to which the c of a power law belongs."""
    return float(np.exp(np.mean(np.log(velocity))))


def padded_data(
    pairs: Pairs,
    use: np.ndarray,
    weights: Floats,
    others: Columns,
    correlation: Floats | None,
    how: dict[str, Any],
) -> dict[str, Any]:
    """Return the arguments of `fit`: ln e first, then the other measured columns."""
    sigma = how.pop("sigma", None)
    absolute = sigma is not None
    if sigma is None:
        with np.errstate(divide="ignore"):
            sigma = weights**-0.5
    sizes = [np.where(use, one, np.inf) for one in (sigma, *others.sigma.values())]
    if absolute:
        noise = {"sigma": tuple(padded(one, np.inf) for one in sizes)}
    else:
        noise = {"weights": tuple(padded(one**-2, 0.0) for one in sizes)}
    columns = np.log(pairs.restitution), *others.values.values()
    data: dict[str, Any] = {"data": tuple(padded(one, 0.0) for one in columns), **noise}
    if not others:
        data = {name: one for name, (one,) in data.items()}
    if correlation is not None:
        length, columns = len(padded(pairs.velocity, 0.0)), len(correlation) // len(pairs)
        whole = np.eye(length * columns)
        places = np.concatenate([k * length + np.arange(len(pairs)) for k in range(columns)])
        whole[np.ix_(places, places)] = correlation
        data["correlation"] = whole
    return {
        **data,
        "x": padded(pairs.velocity, float(np.median(pairs.velocity))),
        "groups": _groups(pairs, len(sizes)),
        **how,
    }


def _groups(pairs: Pairs, columns: int) -> np.ndarray:
    """Return the trial number of each padded point.

    Readings of one impact are independent; those of a trial may be correlated.
    """
    own = padded(pairs.cluster, -1)
    if len(np.unique(pairs.cluster)) < len(pairs):
        return np.tile(own, columns)
    return np.concatenate([own + k * (own.max() + 1) for k in range(columns)])


def _bands(pairs: Pairs, use: np.ndarray, length: int) -> np.ndarray:
    """Return which of the padded points each band of speed leaves out (bands, length)."""
    place = np.flatnonzero(use)
    order = place[np.argsort(pairs.velocity[use], kind="stable")]
    parts = np.zeros((min(_BANDS, len(place)), length), bool)
    for part, band in zip(parts, np.array_split(order, len(parts)), strict=True):
        part[band] = True
    return parts


def law_fit(
    kind: AbstractKind,
    found: Fit,
    pairs: Pairs,
    use: np.ndarray,
    contact: Contact,
    known: frozenset[str],
) -> LawFit:
    measured = pairs.restitution[use]
    at_pairs = measured * np.exp(found.residuals[: len(use)][use])
    return LawFit(
        kind=kind.name,
        law=kind.law,
        estimates=kind.estimates(found, contact, known, float(np.median(pairs.velocity[use]))),
        errors_by=_errors_by(found),
        identifiable=found.converged and is_identifiable(found),
        unidentified=kind.unidentified,
        rms=float(np.sqrt(np.mean((measured - at_pairs) ** 2))),
        reduced_chi2=2 * found.loss / max(found.dof, 1),
        adequate=found.adequate,
        grounds=found.adequacy.grounds,
        converged=found.converged,
        reason=found.reason,
        steps=found.steps,
    )
