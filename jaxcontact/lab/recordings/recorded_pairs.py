"""Pairs (approach speed, restitution) from recordings, with the records they were made of."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...extend import Flight
from ..layouts.layout import Layout, Record
from ..pairs.pairs import Ints, Pairs
from ..tables.sheet import RecordingError
from .recording import Recording


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordedPairs(Pairs):
    """Pairs of a recording.

    `first_row` and `second_row` are the rows of `source` from which a pair was made (equal for one
    row). Reading errors are in `layout.reading_error.unit`. `records` are those of each pair;
    `unpaired` counts the records that make no pair.
    """

    source: str
    layout: Layout[Any]
    ball: str
    first_row: Ints
    second_row: Ints
    records: tuple[tuple[Record, ...], ...]
    flight: Flight
    unpaired: int

    @property
    def words(self) -> tuple[str, str]:
        return self.layout.pair_words

    @property
    def owner(self) -> str:
        return f" of {self.ball}" if self.ball else ""

    @property
    def rule(self) -> str:
        return self.layout.pair_rule

    @property
    def from_flights(self) -> bool:
        return self.layout.uses_flight

    def guess(self, flagged: NDArray[np.bool_], e: float) -> Mapping[int, str]:
        return self.layout.guess(self.records, flagged, e)

    def where(self, keep: NDArray[np.bool_]) -> RecordedPairs:
        records = tuple(itertools.compress(self.records, keep))
        kept = super().where(keep)
        assert isinstance(kept, RecordedPairs)
        return dataclasses.replace(kept, records=records)

    def fault(self, problem: str) -> ValueError:
        last = int(self.second_row.max()) if len(self) else None
        return RecordingError(problem, self.source, last, self.layout.columns[-1])


def make_pairs(recording: Recording, flight: Flight) -> RecordedPairs:
    """Return the pairs in a recording: e = launch speed/landing speed, at the landing speed.

    Speeds follow from the readings by `flight`, unless the layout gives them.
    """
    made = recording.layout.pair(recording.records, flight)
    order = {name: number for number, name in enumerate(dict.fromkeys(made.clusters))}
    return RecordedPairs(
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
