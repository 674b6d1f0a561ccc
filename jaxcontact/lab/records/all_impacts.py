"""All impacts in a record, as pairs of speed and e with their largest forces, and their notes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ... import Contact
from ...extend import EXPONENT, STANDARD_GRAVITY, Flight, rendered, require_number
from ..calibration.summary_data import ImpactSummary
from ..choice.outcomes import Columns
from ..choice.table import PairErrors
from ..pairs.pairs import LEAST_PAIRS, Noise, scatter_beside
from ..recordings import RecordedImpact, RecordedPairs, Recording, RecordingError
from .one_impact import ImpactFit, fitted_impact, with_free_exponent

_AT_REST = 10
"""Least number of readings, and of standard errors, for the weight of a resting body."""

_FAR = 3.0
"""Standard errors beyond which the fitted exponent contradicts the given one."""

_NUMBERS = "velocity", "restitution", "duration", "max_force", "stiffness"


class Fitted(NamedTuple):
    """Results of the impacts in a record.

    The pairs, the largest forces, the covariance (n, 2, 2) of ln e and of the logarithm of the
    force, the fits, and the notes.
    """

    pairs: RecordedPairs
    fits: tuple[ImpactFit, ...]
    force: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n 2 2"]
    contact: Contact
    notes: tuple[str, ...]


def fitted_impacts(
    recording: Recording, contact: Contact, flight: Flight, tell: Callable[[str], None]
) -> Fitted:
    """Fit each impact of a recording with the mass and exponent of `contact`.

    Raises RecordingError if no impact can be fitted.
    """
    good: list[ImpactFit] = []
    bad: list[str] = []
    records: list[RecordedImpact] = list(recording.records)  # pyright: ignore[reportAssignmentType]
    for one in records:
        tell(f"fitting impact {one.number} of {len(records)}")
        made = fitted_impact(one, contact)
        if isinstance(made, str):
            bad.append(f"at {one.trace.time[round(one.touch)]:.4g} s {made}")
        else:
            good.append(made)
    if not good:
        raise RecordingError(f"no impact could be fitted: {'; '.join(bad)}", recording.source)
    notes = []
    if bad:
        notes.append(f"impacts that could not be fitted, not used: {len(bad)} ({'; '.join(bad)})")
    notes += _exponent(max(good, key=lambda one: one.max_force.value), contact)
    notes += _shape(good) + _flights(good, flight)
    pairs = _pairs(recording, good, flight, len(bad))
    force = np.array([one.max_force.value for one in good])
    covariance = np.array([one.covariance for one in good])
    stiffness = float(np.median([one.stiffness.value for one in good]))
    contact = Contact(contact.mass, stiffness, contact.exponent)
    return Fitted(pairs, tuple(good), force, covariance, contact, tuple(notes))


def errors_of_impacts(found: Fitted, keep: np.ndarray) -> PairErrors:
    """Return the errors of ln e and ln(force) about trends of the impacts `keep`.

    Each may scatter from impact to impact about a power of the speed, in addition to the reading
    errors.
    """
    values = np.log(np.stack([found.pairs.restitution, found.force]))
    variance = np.diagonal(found.covariance, axis1=1, axis2=2).T
    scatter = [0.0, 0.0]
    if (count := int(keep.sum())) >= LEAST_PAIRS:
        trend = np.stack([np.ones(count), np.log(found.pairs.velocity[keep])], axis=1)
        scatter = [
            scatter_beside(y[keep], trend, np.diag(own[keep]))
            for y, own in zip(values, variance, strict=True)
        ]
    size = np.sqrt(variance + np.square(scatter)[:, None])
    n = size.shape[1]
    whole, rows = np.eye(2 * n), np.arange(n)
    whole[rows, n + rows] = whole[n + rows, rows] = found.covariance[:, 0, 1] / size.prod(axis=0)
    columns = Columns({"max_force": values[1]}, {"max_force": size[1]})
    noise = Noise(scatter[0], found.pairs.reading)
    return PairErrors(noise, size[0], correlation=whole, others=columns)


def summaries(fits: Iterable[ImpactFit]) -> tuple[ImpactSummary, ...]:
    """Return the impacts as plain data."""
    return tuple(
        ImpactSummary(
            number=one.impact.number,
            time=one.touch,
            adequate=one.adequate,
            notes=one.fit.notes,
            **{name: getattr(one, name).value for name in _NUMBERS},
            **{f"{name}_error": getattr(one, name).error for name in _NUMBERS},
        )
        for one in fits
    )


def exponent_of(recording: Recording, exponent: float | None) -> float:
    """Return the exponent n of the contact; raise ValueError if the recording does not use it."""
    if exponent is None:
        return 1.5
    if not recording.layout.fitted:
        raise ValueError(
            "Argument `exponent` must be None where e is measured and no force, but is "
            f"{rendered(exponent)}."
        )
    return require_number("exponent", exponent, EXPONENT)


def require_mass(recording: Recording, mass: float | None, stiffness: float | None) -> None:
    """Raise ValueError for a record without a mass, and for a given stiffness, which is fitted."""
    if stiffness is not None:
        raise ValueError(
            "Argument `stiffness` must be None for a record, which determines it, but is "
            f"{rendered(stiffness)}."
        )
    if mass is None:
        raise ValueError(
            f"Argument `mass` is needed for a record of {recording.layout.name}. Speeds, e and K "
            "follow from it only with the mass in kg (the effective mass if both bodies move)."
            f"{_weight(recording)}"
        )


def _weight(recording: Recording) -> str:
    """Return a note on the weight of a body resting on the force plate at the end, or ""."""
    impacts: list[RecordedImpact] = list(recording.records)  # pyright: ignore[reportAssignmentType]
    first, trace = impacts[0], impacts[0].trace
    if trace.quantity != "force":
        return ""
    after = trace.value[math.ceil(impacts[-1].end) :]
    end = after[-max(after.size // 10, 1) :]
    before = trace.value[max(first.start - first.time.size // 3, 0) : first.start]
    if end.size < _AT_REST or before.size < _AT_REST:
        return ""
    error = trace.noise * math.sqrt(1 / end.size + 1 / before.size)
    weight = float(end.mean() - before.mean())
    if weight < _AT_REST * error:
        return ""
    return (
        f" At the end the plate carries {weight:.3g} N more than at the start: if the body lies "
        f"on it, its mass is {weight / STANDARD_GRAVITY:.3g} kg."
    )


def _exponent(one: ImpactFit, contact: Contact) -> list[str]:
    """Return what the clearest record implies for the exponent."""
    other = with_free_exponent(one)
    error = other.standard_errors.get("contact.exponent", math.nan)
    if not other.converged or not math.isfinite(error):
        return ["the clearest record does not determine the exponent n"]
    value, given = float(other.params.contact.exponent), float(contact.exponent)
    said = f"the shape of the clearest record has n = {value:.3f} ± {error:.3f}"
    if abs(value - given) <= _FAR * error:
        return [f"{said}, which agrees with the n = {given:g} of the fits"]
    return [
        f"{said}, NOT the n = {given:g} of the fits: K, speeds and e may be wrong; try --exponent "
        f"{value:.2f} (in Python exponent)"
    ]


def _shape(good: list[ImpactFit]) -> list[str]:
    """Return whether the fitted force law has the shape of the records."""
    wrong = [one.impact.number for one in good if one.adequate is False]
    told = sum(one.adequate is True for one in good)
    force = "the force K δ^n (1 + α δ'/v₀)"
    if wrong:
        which = ", ".join(map(str, wrong))
        return [
            f"{force} does not describe the record of impact {which} within its noise: errors of "
            "speed, e and K are too small there"
        ]
    if told < len(good):
        return [
            f"{force} describes {told} of these {len(good)} records; the others could not be tested"
        ]
    return [f"{force} describes all {told} of these records"]


def _flights(good: list[ImpactFit], flight: Flight) -> list[str]:
    """Return how flight times between consecutive impacts compare with the fitted speeds."""
    ratios = []
    for one, two in itertools.pairwise(good):
        if two.impact.number != one.impact.number + 1:
            continue
        pause = two.touch - one.touch - one.duration.value
        leaves = one.velocity.value * one.restitution.value
        ratios.append(flight.gravity * pause / (leaves + two.velocity.value))
    if not ratios or max(ratios) > 2 or min(ratios) < 0.5 or np.ptp(ratios) > 0.1:
        return []
    off = 100 * (float(np.median(ratios)) - 1)
    if good[0].impact.trace.quantity == "force":
        what = "smaller" if off > 0 else "larger"
        guess = f"; they would agree with a {what} mass" if abs(off) > 3 else ""
    else:
        guess = ""
    return [
        f"flights between impacts give speeds {abs(off):.1f} % "
        f"{'above' if off > 0 else 'below'} those of the records{guess}"
    ]


def _pairs(
    recording: Recording, good: list[ImpactFit], flight: Flight, unfitted: int
) -> RecordedPairs:
    rows = np.array([one.impact.row for one in good], np.int64)
    e = np.array([one.restitution.value for one in good])
    variance = np.array([one.covariance[0, 0] for one in good])
    return RecordedPairs(
        source=recording.source,
        layout=recording.layout,
        ball=recording.ball,
        velocity=np.array([one.velocity.value for one in good]),
        restitution=e,
        reading_factor=np.zeros(len(good)),
        first_row=rows,
        second_row=rows,
        cluster=np.arange(len(good)),
        cluster_names=tuple(f"impact {one.impact.number}" for one in good),
        records=tuple((one.impact,) for one in good),
        flight=flight,
        unpaired=0,
        covariance=np.diag(variance),
        reading=float(np.sqrt(np.mean(variance))),
    )
