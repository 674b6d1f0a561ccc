"""Pairs (approach speed, restitution) from recordings, with how strongly a reading error enters."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._flight import Flight, Floats
from ._fault import RecordingError
from ._layout import Layout, Record
from ._recording import Recording

Ints = NDArray[np.int64]

LEAST_PAIRS = 4
"""One parameter of the law, two of the noise, and one left over to judge the fit by."""

_NEEDED = (
    "is needed",
    "are needed (one parameter of the law, two of the noise, one to judge the fit by)",
)


@dataclasses.dataclass(frozen=True)
class Pairs:
    """n measured pairs; every array has the shape (n,).

    `velocity` is the approach speed in m/s and `restitution` the measured e. `first_row` and
    `second_row` are the rows of `source` that a pair was made of (equal where it was made of one).
    `reading_factor` says how a reading error enters: an error of standard deviation σ (in
    `layout.reading_error.unit`) gives ln e the variance σ² · `reading_factor`. `cluster` numbers
    the group of pairs that share errors, whose names are `cluster_names`. `records` are those of
    each pair; `unpaired` counts the records that make no pair. Where the errors of the readings are
    known, `covariance` (n, n) is that of ln e by them, and `reading` is their usual size;
    `absolute`, whether that is all of the noise, as where a file gives standard deviations.
    """

    source: str
    layout: Layout[Any]
    ball: str
    velocity: Floats
    restitution: Floats
    reading_factor: Floats
    first_row: Ints
    second_row: Ints
    cluster: Ints
    cluster_names: tuple[str, ...]
    records: tuple[tuple[Record, ...], ...]
    flight: Flight
    unpaired: int
    covariance: Floats | None = None
    reading: float = 0.0
    absolute: bool = False

    def __len__(self) -> int:
        return len(self.velocity)

    def where(self, keep: NDArray[np.bool_]) -> Pairs:
        """The pairs for which `keep` (n,) is true."""
        kept = {name: x[keep] for name, x in vars(self).items() if isinstance(x, np.ndarray)}
        if self.covariance is not None:
            kept["covariance"] = self.covariance[np.ix_(keep, keep)]
        records = tuple(itertools.compress(self.records, keep))
        return dataclasses.replace(self, records=records, **kept)

    def needs_enough(self, marked: int = 0, least: int = LEAST_PAIRS) -> None:
        """Raise RecordingError for fewer pairs than `least`; `marked` ones were left out before."""
        count = len(self)
        if count >= least:
            return
        what = self.layout.pair_words[count != 1] + (f" of {self.ball}" if self.ball else "")
        left_out = f"; {marked} more lie off the trend and are left out" if marked else ""
        raise RecordingError(
            f"{count} usable {what}, but at least {least} {_NEEDED[least > 1]}{left_out}; "
            f"{self.layout.pair_rule}; add rows",
            self.source,
            int(self.second_row.max()) if count else None,
            self.layout.columns[-1],
        )


def make_pairs(recording: Recording, flight: Flight) -> Pairs:
    """The pairs in a recording: e = launch speed/landing speed at approach speed = landing speed.

    Speeds follow from the readings by `flight`, unless the layout gives them.
    """
    made = recording.layout.pair(recording.records, flight)
    order = {name: number for number, name in enumerate(dict.fromkeys(made.clusters))}
    return Pairs(
        source=recording.source,
        layout=recording.layout,
        ball=recording.ball,
        velocity=made.velocity,
        restitution=made.restitution,
        reading_factor=made.reading_factor,
        first_row=np.array([records[0].row for records in made.records], np.int64),
        second_row=np.array([records[-1].row for records in made.records], np.int64),
        cluster=np.array([order[name] for name in made.clusters], np.int64),
        cluster_names=tuple(order),
        records=tuple(made.records),
        flight=flight,
        unpaired=made.unpaired,
        covariance=made.covariance,
        reading=made.reading,
        absolute=made.absolute,
    )
