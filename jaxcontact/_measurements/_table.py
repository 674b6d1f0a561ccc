"""A table of restitution over approach speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from .._flight import Flight
from ._layout import Layout, Paired, Record, span
from ._rows import Row


@dataclasses.dataclass(frozen=True)
class Point(Record):
    """A restitution measured at a known approach speed in m/s."""

    velocity: float
    restitution: float


class Table(Layout[Point]):
    """Rows of approach speed and restitution, taken as they are; a column `ball` is optional."""

    name = "table"
    columns = ("velocity", "restitution")
    measured = columns
    optional = ("ball",)
    reading_error = None
    uses_flight = False
    made_of = "rows of speed and restitution"
    pair_words = ("pair of speed and restitution", "pairs of speed and restitution")
    cluster_words = ("row", "rows")
    pair_rule = "each row is a pair"
    errors_words = "by row (sandwich), which allows for scatter that differs from row to row"

    def read(self, rows: Sequence[Row]) -> list[Point]:
        return [
            Point(
                ball=row.text("ball", ""),
                row=row.number,
                velocity=row.positive("velocity"),
                restitution=row.positive("restitution"),
            )
            for row in rows
        ]

    def facts(self, records: Sequence[Point]) -> Mapping[str, str]:
        return {
            "speeds": span([record.velocity for record in records], "m/s"),
            "restitutions": span([record.restitution for record in records]),
        }

    def pair(self, records: Sequence[Point], flight: Flight) -> Paired[Point]:
        return Paired(
            velocity=np.array([record.velocity for record in records]),
            restitution=np.array([record.restitution for record in records]),
            reading_factor=np.zeros(len(records)),
            clusters=[f"row {record.row}" for record in records],
            records=[(record,) for record in records],
        )

    def guess(
        self, records: Sequence[tuple[Point, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """Nothing: a ratio alone does not say what went wrong."""
        return {}
