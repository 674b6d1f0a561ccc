"""A calibration as plain data: what is printed, and what is saved."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from .._contact import Contact
from .._flight import Drag
from .._laws import AbstractLaw
from .._measurements._noise import Noise
from ._choice import ChoiceData
from ._kinds import kind_of_law, law_in

_SPEEDS = 17
"""Of an export, over the measured range."""


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
    """One pair: its rows, speed in m/s and e, how many robust standard deviations off the trend."""

    rows: tuple[int, ...]
    velocity: float
    restitution: float
    deviation: float
    marked: bool
    may_be: str | None


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
class CalibrationSummary:
    """What a calibration found, as plain data; `save` writes it and `load_calibration` reads it.

    `law` with the fitted parameters (None where no fit converged) and `contact`:
    `impact(law, contact, v)` gives the fitted e. `given` names what of the contact was given
    ("mass", "stiffness"); the rest is 1. `standard_errors` of the law's parameters, None where they
    are not identifiable. `requested` is the `law` that was asked for; `gravity` in m/s²; `drag`,
    None if it was left in; `noise`, the scatter of ln e; `threshold` of the outlier rule and its
    `trend`; all `pairs`; the `choice` among laws without marked pairs, and `with_marked` with them;
    medians `by_speed`; `versions` of the packages; the `impacts` in the record of an instrument.
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

    @property
    def converged(self) -> bool:
        """Whether every fit converged."""
        return all(f.converged for c in (self.choice, self.with_marked) for f in c.laws)

    def __export__(
        self, contact: Contact | None
    ) -> tuple[AbstractLaw, Contact, Float[np.ndarray, " n"]]:
        """The law, the contact, and closing speeds in m/s over the measured range, for `export`.

        With another `contact` the law is the one with the same e(v). Raises ValueError where no fit
        converged, and where mass or stiffness is not known.
        """
        if self.law is None:
            raise ValueError("Argument `law` must have a fit that converged, but none did.")
        kind = kind_of_law(self.law)
        missing = [name for name in ("mass", "stiffness") if name not in self.given]
        if contact is None and missing:
            words = " and ".join(f"`{name}`" for name in missing)
            raise ValueError(
                f"Argument `contact` is needed: this calibration does not know {words}. It leaves "
                f"open {kind.unidentified}. Give `contact=Contact(mass, stiffness)`, or calibrate "
                f"with {words}."
            )
        law = self.law if contact is None else law_in(self.law, self.contact, contact)
        kept = [pair.velocity for pair in self.pairs if not pair.marked]
        speeds = np.geomspace(min(kept), max(kept), _SPEEDS)
        return law, self.contact if contact is None else contact, speeds

    def __repr__(self) -> str:
        r, marked = self.recording, sum(pair.marked for pair in self.pairs)
        ball = f", ball {r.ball}" if r.ball else ""
        unit = "" if len(self.given) == 2 else f" ({contact_note(self.given)})"
        return "\n".join(
            [
                f"Calibration of {r.source}{ball}: {r.pairs} pairs, {marked} marked as outliers",
                f"  law      {self.law}",
                f"  contact  {self.contact}{unit}",
                *("  " + line for line in self.choice.table().splitlines()),
                f"  {self.choice.verdict}",
            ]
        )


def contact_note(given: tuple[str, ...]) -> str:
    """Which numbers of the contact were not given, and are 1."""
    missing = [name for name in ("mass", "stiffness") if name not in given]
    verb = "was" if len(missing) == 1 else "were"
    return f"{' and '.join(missing)} {verb} not given: 1 kg and 1 N/m^(3/2) stand for them"
