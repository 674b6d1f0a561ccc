"""A calibration as plain data: what is saved, and what its texts are made of."""

from __future__ import annotations

import dataclasses

from ..._calibration.choice.law_choice import ChoiceData, LawFit
from ..._calibration.pairs.noise import Noise
from ..._calibration.pairs.pairs import LEAST_PAIRS
from ..._contact import Contact
from ..._flight import Drag
from ..._laws import AbstractLaw
from .at_speed import AtSpeed

_UNITS = {"mass": "kg", "stiffness": "N/m^(3/2)"}


@dataclasses.dataclass(frozen=True)
class RecordingSummary:
    """Where the pairs come from: source, layout and ball; how many pairs, of which trials.

    `notes` say how the source was read: headings that were understood, units converted.
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
    """One pair: its rows, speed in m/s and e, how many robust standard deviations off the trend.

    `error` is the standard error of e by the known errors of its readings, None without them.
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
    """One impact in the record of an instrument: its `number` and `time` of touch in s, and what a
    fit of its readings found, each with its standard error: closing speed in m/s, e, contact time
    in s, largest force in N, stiffness in N/m^n. `adequate`: whether that fit describes them.
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
    """What a calibration found, as plain data; `save` writes it and `load_calibration` reads it.

    `law` with the fitted parameters (None where no fit converged) and `contact`:
    `impact(law, contact, v)` gives the fitted e. `given` names what of the contact was given
    ("mass", "stiffness"); the rest is 1. `standard_errors` of the law's parameters, None where they
    are not identifiable. `requested` is the `law` that was asked for; `gravity` in m/s²; `drag`,
    None if it was left in; `noise`, the scatter of ln e; `threshold` of the outlier rule and its
    `trend`; all `pairs`; the `choice` among laws without marked pairs, and `with_marked` with them;
    medians `by_speed`; `versions` of the packages; the `impacts` in the record of an instrument.
    `at`: e of the law at the slowest and the fastest speed measured, and at those asked for.
    `scatter`: the usual standard deviation of ln e of a pair about the trend, None for one pair.
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

    @property
    def converged(self) -> bool:
        """Whether every fit converged."""
        return all(f.converged for c in (self.choice, self.with_marked) for f in c.laws)

    @property
    def chosen(self) -> LawFit | None:
        """The fit of the law asked for, or of the best one; None if it did not converge."""
        by_law = {one.law: one.kind for one in self.choice.laws}
        kind = by_law.get(self.requested, self.choice.best)
        return None if kind is None or self.law is None else self.choice.law_fit(kind)

    @property
    def few(self) -> bool:
        """Whether there are fewer pairs than a law takes."""
        return self.choice.count < LEAST_PAIRS

    @property
    def only_mean(self) -> bool:
        """Whether nothing was fitted but the mean e of few pairs."""
        return self.few and len(self.choice.laws) == 1


def contact_note(given: tuple[str, ...]) -> str:
    """Which numbers of the contact were not given, and are 1."""
    missing = [name for name in ("mass", "stiffness") if name not in given]
    if len(missing) == 1:
        return f"{missing[0]} was not given: 1 {_UNITS[missing[0]]} stands for it"
    units = " and ".join(f"1 {_UNITS[name]}" for name in missing)
    return f"{' and '.join(missing)} were not given: {units} stand for them"
