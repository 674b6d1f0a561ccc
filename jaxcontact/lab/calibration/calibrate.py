"""Calibration: the constant e or the speed-dependent law that a recording of bounces supports."""

from __future__ import annotations

import dataclasses
import functools
import importlib.metadata
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from ... import Contact, Drag
from ...extend import (
    POSITIVE,
    STANDARD_GRAVITY,
    Flight,
    as_numbers,
    column,
    describe,
    require_kind,
    require_number,
    stages_of,
)
from ..choice.choose_law import about_the_law, choose
from ..choice.held_out import held_out
from ..choice.kind import Kind
from ..choice.kinds import kinds_of
from ..choice.law_choice import LawChoice, kind_asked
from ..choice.table import ChoiceTable, errors_of
from ..pairs.outliers import THRESHOLD, Outliers, find_outliers
from ..pairs.pairs import LEAST_PAIRS
from ..recordings import RecordedPairs, Recording, make_pairs
from ..records.impacts import (
    ImpactFit,
    errors_of_impacts,
    exponent_of,
    fitted_impacts,
    require_mass,
    summaries,
)
from .summary import CalibrationSummary
from .summary_data import PairSummary, RecordingSummary, SpeedBand, at_speeds

_SPEED_BANDS = 5
_PACKAGES = ("jaxcontact", "jax", "diffrax", "numpy")


@dataclasses.dataclass(frozen=True, repr=False, kw_only=True)
class Calibration(CalibrationSummary):
    """Result of `calibrate`; prints its verdict, and `report()` gives the full text.

    It has the plain data of a `CalibrationSummary`, which `save` writes. In addition:
    `recorded_pairs`, the pairs (speed, e) of the recording as arrays; `outliers`, which marks pairs
    by the robust rule; and `impact_fits`, those of the impacts in an instrument record. `choice`
    holds the laws fitted without the marked pairs, `with_marked` those fitted with them, and both
    hold their fits.
    """

    choice: LawChoice
    with_marked: LawChoice
    recorded_pairs: RecordedPairs
    outliers: Outliers
    impact_fits: tuple[ImpactFit, ...] = ()


def calibrate(
    recording: Recording,
    *,
    laws: str = "all",
    drag: Drag | None = None,
    mass: float | None = None,
    stiffness: float | None = None,
    exponent: float | None = None,
    gravity: float = STANDARD_GRAVITY,
    at: ArrayLike | Sequence[float] = (),
    progress: bool | Callable[[str], None] | None = None,
) -> Calibration:
    """Fit a constant e and speed-dependent laws to a recording of bounces, and compare them.

    Minimises Σ ((ln e_k - ln e(v_k))/σ_k)² over the parameters of each kind of law (see
    `choose_law`). Pairs marked by a robust rule (spurious and missed triggers) are left out. The
    same fits are repeated with them. σ_k combines the scatter of the bounce with the reading error
    of that interval or height. Both are estimated from the pairs, and their common scale is fitted.
    Standard errors and comparisons allow for correlation within a trial.

    Arguments: `recording`, see `read_recording`. `laws`: "all"; or the name of a speed-dependent
    law, which is compared with a constant e; or the name of a law with parameter e, which then
    delivers the constant e. `drag` corrects the flights for air drag. `mass` in kg and `stiffness`
    in N/m^(3/2) of the contact determine c and A. `exponent` n is that of the force in a record, by
    default 3/2 (spheres). `gravity` is in m/s². `at`: closing speeds in m/s at which e is reported,
    besides the slowest and the fastest measured one. `progress`: None shows the stages on stderr
    after a second, in a terminal or notebook. True always shows them, False never. A function is
    called with each.

    Impacts in a record of force, acceleration or indentation are fitted one by one, with time of
    touch and zero level: F = K δ^n (1 + α δ'/v₀). With the `mass` this gives speed, e and K of each
    (m v₀ T = ∫ F (T - t) dt). Laws, and with them the stiffness, are then fitted to all e and
    largest forces. With fewer than four pairs, the result is the e of each pair and the constant e
    that is their mean.

    Returns a `Calibration`. Computes in double precision regardless of the JAX setting. Raises
    ValueError for a recording without a pair and for arguments out of range.

    Source: Burnham & Anderson (2002), doi 10.1007/b97636; the laws have their own sources.
    """
    require_kind("recording", recording, Recording, "a `Recording` (see `read_recording`)")
    n = exponent_of(recording, exponent)
    asked_at = column(np.atleast_1d(as_numbers(at, "at")), "at", POSITIVE, least=0).tolist()
    kinds = kinds_of(laws, n)
    numbers = {"mass": mass, "stiffness": stiffness}
    given = tuple(name for name, value in numbers.items() if value is not None)
    for name in given:
        numbers[name] = require_number(name, numbers[name], POSITIVE)
    flight = Flight(gravity, drag)
    tell = stages_of(progress)
    with jax.enable_x64(True):
        contact = Contact(*(1.0 if x is None else x for x in numbers.values()), exponent=n)
        impacts = None
        if recording.layout.fitted:
            require_mass(recording, numbers["mass"], numbers["stiffness"])
            impacts = fitted_impacts(recording, contact, flight, tell)
            pairs, contact, given = impacts.pairs, impacts.contact, ("mass", "stiffness")
        else:
            pairs = make_pairs(recording, flight)
            pairs.needs_enough(least=1)
        if len(pairs) >= LEAST_PAIRS:
            tell(f"searching {len(pairs)} pairs for spurious and missed triggers")
        outliers = find_outliers(pairs)
        keep = ~outliers.flagged
        if impacts is None:
            errors, options = errors_of(pairs, outliers, keep), {}
        else:  # impacts of one record are independent: their errors are those of their readings
            errors, options = errors_of_impacts(impacts, keep), {"groups": None}
        word = pairs.layout.cluster_words[0]
        table = ChoiceTable(pairs, keep, errors, contact, frozenset(given), options, word)
        chosen = functools.partial(choose, kinds=kinds, progress=tell)
        choice, outliers = about_the_law(table, outliers, chosen)
        keep, with_marked = ~outliers.flagged, choice
        if not keep.all():
            every = dataclasses.replace(table, use=np.ones_like(keep))
            with_marked = chosen(every)
    kept_pairs = pairs.where(keep)
    kind = kind_asked(choice, laws)
    found: dict[str, Any] = {"law": None, "contact": contact, "standard_errors": {}}
    if kind is not None and choice.fits[kind].converged:
        of_kind = next(one for one in kinds if one.name == kind)
        found = _law_of(choice, of_kind, dataclasses.replace(table, use=keep), asked_at)
    scatter = float(np.median(errors.sigma[keep])) if keep.sum() >= LEAST_PAIRS else None
    if scatter is not None and outliers.about and not (errors.absolute or errors.others):
        # The weights have the scatter about the trend.
        scatter *= math.sqrt(choice.law_fit(outliers.about).reduced_chi2)
    fits = () if impacts is None else impacts.fits
    return Calibration(
        **found,
        given=given,
        requested=laws,
        recording=_recording(recording, pairs, () if impacts is None else impacts.notes),
        gravity=flight.gravity,
        drag=drag,
        noise=errors.noise,
        threshold=THRESHOLD,
        trend=outliers.about or outliers.trend.kind,
        pairs=_pairs(pairs, outliers),
        choice=choice,
        with_marked=with_marked,
        by_speed=_by_speed(kept_pairs, choice),
        impacts=summaries(fits),
        scatter=scatter,
        versions={name: _version(name) for name in _PACKAGES},
        recorded_pairs=pairs,
        outliers=outliers,
        impact_fits=fits,
    )


def _law_of(choice: LawChoice, kind: Kind, kept: ChoiceTable, asked_at: list[float]) -> Any:
    """Return the law of a kind as fields of a `Calibration`: its errors, e at speeds, its check."""
    fit, pairs, fitted = choice.fits[kind.name], kept.pairs, choice.law_fit(kind.name)
    check = None
    if kept.use.sum() >= LEAST_PAIRS:
        with jax.enable_x64(True):
            check = held_out(kept, kind, pairs.cluster_names)
    open_fits = [choice.fits[name] for name in choice.rivals]
    names = [name for name in describe(fitted.law).parameters if name in fit.standard_errors]
    errors = {name: fit.standard_errors[name] if fitted.identifiable else None for name in names}
    return {
        "law": choice.law(kind.name),
        "contact": choice.contact_of(kind.name),
        "standard_errors": errors,
        "at": at_speeds(fit, open_fits, kept.velocity, asked_at),
        "check": check,
        "stiffness_error": fit.standard_errors.get("stiffness"),
    }


def _recording(
    recording: Recording, pairs: RecordedPairs, notes: tuple[str, ...]
) -> RecordingSummary:
    return RecordingSummary(
        source=recording.source,
        layout=pairs.layout.name,
        ball=recording.ball,
        pairs=len(pairs),
        unpaired=pairs.unpaired,
        trials=tuple(pairs.cluster_names[k] for k in np.unique(pairs.cluster)),
        notes=(*recording.notes, *notes),
    )


def _pairs(pairs: RecordedPairs, outliers: Outliers) -> tuple[PairSummary, ...]:
    errors = None if pairs.covariance is None else np.sqrt(np.diag(pairs.covariance))
    return tuple(
        PairSummary(
            rows=tuple(sorted({int(pairs.first_row[k]), int(pairs.second_row[k])})),
            velocity=float(pairs.velocity[k]),
            restitution=float(pairs.restitution[k]),
            deviation=float(outliers.deviation[k]),
            marked=bool(outliers.flagged[k]),
            may_be=outliers.guess.get(k),
            error=None if errors is None else float(errors[k] * pairs.restitution[k]),
        )
        for k in range(len(pairs))
    )


def _by_speed(pairs: RecordedPairs, choice: LawChoice) -> tuple[SpeedBand, ...]:
    v, e = pairs.velocity, pairs.restitution
    if len(v) < 2 * _SPEED_BANDS or v.max() == v.min():
        return ()
    chunks = np.array_split(np.argsort(v, kind="stable"), _SPEED_BANDS)
    middle = np.array([np.median(v[chunk]) for chunk in chunks])
    curves = {kind: choice.curve(kind, middle)[0] for kind in choice.fits}
    return tuple(
        SpeedBand(
            velocity=float(middle[i]),
            pairs=len(chunk),
            restitution=float(np.median(e[chunk])),
            fits={kind: float(curve[i]) for kind, curve in curves.items()},
        )
        for i, chunk in enumerate(chunks)
    )


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None  # run from a source tree that was never installed
