"""Heights of a drop and of its first rebound: e = launch(h₁)/landing(h₀)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from .._flight import Flight, speed_after_drop, speed_to_reach
from ._layout import Layout, Paired, ReadingError, Record, span
from ._rows import Row


@dataclasses.dataclass(frozen=True)
class Rebound(Record):
    """Height in m of the first rebound after a drop from `drop_height` m."""

    drop_height: float
    trial: str
    height: float


class Heights(Layout[Rebound]):
    """Drop and rebound heights: in vacuum e = √(h₁/h₀) at approach speed √(2 g h₀)."""

    name = "heights"
    columns = ("ball", "drop_height_m", "trial", "rebound_height_m")
    measured = ("drop_height_m", "rebound_height_m")
    reading_error = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    made_of = "drop and rebound heights"
    pair_words = ("pair of heights", "pairs of heights")
    cluster_words = ("drop height", "drop heights")
    pair_rule = "each row is a pair"
    errors_words = "by drop height (cluster-robust sandwich): drops from one height share its error"

    def read(self, rows: Sequence[Row]) -> list[Rebound]:
        return [
            Rebound(
                ball=row.text("ball", ""),
                row=row.number,
                drop_height=row.positive("drop_height_m"),
                trial=row.text("trial", "1"),
                height=row.positive("rebound_height_m"),
            )
            for row in rows
        ]

    def facts(self, records: Sequence[Rebound]) -> Mapping[str, str]:
        dropped = [record.drop_height for record in records]
        return {
            "drop heights": f"{len(set(dropped))}, {span(dropped, 'm')}",
            "rebounds": span([record.height for record in records], "m"),
        }

    def pair(self, records: Sequence[Rebound], flight: Flight) -> Paired[Rebound]:
        dropped = np.array([record.drop_height for record in records])
        reached = np.array([record.height for record in records])
        landing, _ = flight.evaluate(speed_after_drop, dropped)
        launch, _ = flight.evaluate(speed_to_reach, reached)
        # As for intervals, the noise is that of the height that is expected.
        expected = dropped * (np.median(reached / dropped) if len(dropped) else 1.0)
        return Paired(
            velocity=landing,
            restitution=launch / landing,
            # d ln(launch)/dh is 1/(2 h) in vacuum; drag changes it by a few per cent of itself,
            # which does not matter in a model of noise.
            reading_factor=(0.5 / expected) ** 2,
            # All drops from one height share the error of that height.
            clusters=[f"drop {record.drop_height:g} m" for record in records],
            records=[(record,) for record in records],
        )

    def guess(
        self, records: Sequence[tuple[Rebound, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """Nothing: a height alone does not say what went wrong."""
        return {}
