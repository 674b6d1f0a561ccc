"""A calibration as plain data, which is saved and from which reports are made; e at speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from ... import AbstractLaw, Contact, Drag, Fit
from ..choice.held_out import HeldOut
from ..choice.kind import delivered, padded
from ..choice.law_choice import ChoiceData, LawFit, kind_asked
from ..pairs.pairs import LEAST_PAIRS, Noise


@dataclasses.dataclass(frozen=True)
class AtSpeed:
    """The mean e of the law at a closing speed in m/s, with its 95 % interval from `low` to `high`.

    The interval is that of the fitted curve (`Fit.confidence_band`) and assumes that the law is
    right. It is None if the data do not determine it. `measured` is True if the speed lies between
    those of the kept pairs. `least` and `most` are the extremes of e over all laws that are not
    ruled out, including this law.
    """

    velocity: float
    restitution: float
    low: float | None
    high: float | None
    measured: bool
    least: float
    most: float

    @property
    def known(self) -> bool:
        """True if the interval is known."""
        return self.low is not None

    @property
    def half(self) -> float:
        """Half the width of the interval; 0 if it is unknown."""
        return 0.0 if self.low is None or self.high is None else (self.high - self.low) / 2


def at_speeds(
    fit: Fit, others: Iterable[Fit], kept: np.ndarray, asked: Sequence[float]
) -> tuple[AtSpeed, ...]:
    """Return e at the slowest and the fastest `kept` speed (m/s), and at those `asked`."""
    ends = float(kept.min()), float(kept.max())
    speeds = np.array([*ends, *asked])
    curves = np.array([delivered(one, speeds)[0] for one in (fit, *others) if one.converged])
    band = fit.confidence_band(padded(speeds, ends[0]))
    low, high = np.exp(np.asarray(band)[:, : len(speeds)])
    # Identical readings do not determine their error.
    known = np.isfinite(low) & np.isfinite(high) & (high > low) & (len(fit.at_bound) == 0)
    return tuple(
        AtSpeed(
            velocity=float(speeds[i]),
            restitution=float(curves[0, i]),
            low=float(low[i]) if known[i] else None,
            # No law delivers more than 1.
            high=min(float(high[i]), 1.0) if known[i] else None,
            measured=ends[0] <= speeds[i] <= ends[1],
            least=float(curves[:, i].min()),
            most=float(curves[:, i].max()),
        )
        for i in range(len(speeds))
    )


_UNITS = {"mass": "kg", "stiffness": "N/m^(3/2)"}


@dataclasses.dataclass(frozen=True)
class RecordingSummary:
    """Origin of the pairs: source, layout, ball, number of pairs, and trials.

    `notes` say how the source was read: recognised headings and converted units.
    """

    source: str
    layout: str
    ball: str
    pairs: int
    unpaired: int
    trials: tuple[str, ...]
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class PairSummary:
    """One pair: rows, speed in m/s, e, deviation from law or trend in robust standard deviations.

    `error` is the standard error of e from the known errors of its readings, None if those are
    unknown.
    """

    rows: tuple[int, ...]
    velocity: float
    restitution: float
    deviation: float
    marked: bool
    may_be: str | None
    error: float | None = None


@dataclasses.dataclass(frozen=True)
class ImpactSummary:
    """One impact in an instrument record: `number`, `time` of touch in s, fitted quantities.

    Each has its standard error: closing speed in m/s, e, contact time in s, largest force in N,
    stiffness in N/m^n. `adequate`: whether the fit describes the readings; None if undecided.
    """

    number: int
    time: float
    velocity: float
    velocity_error: float
    restitution: float
    restitution_error: float
    duration: float
    duration_error: float
    max_force: float
    max_force_error: float
    stiffness: float
    stiffness_error: float
    adequate: bool | None
    notes: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class SpeedBand:
    """Medians of the kept pairs in a band of speed, and e of each fit at the median speed."""

    velocity: float
    pairs: int
    restitution: float
    fits: dict[str, float]


@dataclasses.dataclass(frozen=True)
class SummaryData:
    """Results of a calibration as plain data; `save` writes it and `load_calibration` reads it.

    `law` has the fitted parameters (None if no fit converged). With `contact`, `impact(law,
    contact, v)` gives the fitted e. `given` names the contact numbers that were given ("mass",
    "stiffness"); the others are 1. `standard_errors` are those of the law's parameters, None if not
    identifiable. `requested` is the argument `laws`, `gravity` is in m/s², and `drag` is None if it
    was not removed. `noise` is that of the weights. `threshold` and `trend` are those of the
    outlier rule. `pairs` holds all pairs. `choice` compares the laws without the marked pairs,
    `with_marked` with them. `by_speed` holds medians, `versions` the packages, and `impacts` the
    impacts in an instrument record. `at` is e of the law at the slowest and the fastest measured
    speed and at those requested. `scatter` is the median standard deviation of ln e of a pair about
    the best law, or about the trend if no law describes the data. It is None for fewer than four
    pairs. `check` is the law fitted to three of four trials beside the others, None if there are
    too few. `stiffness_error` is the standard error of K in N/m^n if it was fitted.
    """

    law: AbstractLaw | None
    contact: Contact
    given: tuple[str, ...]
    standard_errors: dict[str, float | None]
    requested: str
    recording: RecordingSummary
    gravity: float
    drag: Drag | None
    noise: Noise
    threshold: float
    trend: str
    pairs: tuple[PairSummary, ...]
    choice: ChoiceData
    with_marked: ChoiceData
    by_speed: tuple[SpeedBand, ...]
    versions: dict[str, str | None]
    impacts: tuple[ImpactSummary, ...] = ()
    at: tuple[AtSpeed, ...] = ()
    scatter: float | None = None
    check: HeldOut | None = None
    stiffness_error: float | None = None

    @property
    def converged(self) -> bool:
        """True if every fit converged."""
        return all(f.converged for c in (self.choice, self.with_marked) for f in c.laws)

    @property
    def chosen(self) -> LawFit | None:
        """The fit of the law asked for, or of the best one; None if it did not converge."""
        kind = kind_asked(self.choice, self.requested)
        return None if kind is None or self.law is None else self.choice.law_fit(kind)

    @property
    def few(self) -> bool:
        """True if there are fewer pairs than a law needs."""
        return self.choice.count < LEAST_PAIRS

    @property
    def only_mean(self) -> bool:
        """True if only the mean e of a few pairs was fitted."""
        return self.few and len(self.choice.laws) == 1


def contact_note(given: tuple[str, ...]) -> str:
    """Return which contact numbers were not given and are 1."""
    missing = [name for name in ("mass", "stiffness") if name not in given]
    if len(missing) == 1:
        return f"{missing[0]} not given: 1 {_UNITS[missing[0]]} is a placeholder"
    units = " and ".join(f"1 {_UNITS[name]}" for name in missing)
    return f"{' and '.join(missing)} not given: {units} are placeholders"
