"""Speeds before and after an impact: e = v₂/v₁."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ..._calibration.pairs.plausible import MEASURED_RESTITUTION
from ..._flight import Flight
from ..._text.words import span
from ..tables.heading import Meaning, words
from ..tables.sheet import Row
from .heights import STICKS, VELOCITY
from .layout import LABELS, Layout, Paired, ReadingError, Record


@dataclasses.dataclass(frozen=True)
class Collision(Record):
    """The speeds in m/s before and after one impact."""

    velocity: float
    rebound_velocity: float


class Speeds(Layout[Collision]):
    """Speeds before and after impacts, as from light gates and video: e is their ratio."""

    name = "speeds"
    columns = ("ball", "velocity", "rebound_velocity")
    measured = ("velocity", "rebound_velocity")
    meanings = MappingProxyType(
        {
            "ball": LABELS["ball"],
            "velocity": VELOCITY,
            "rebound_velocity": Meaning(
                words(
                    "rebound velocity, rebound speed, v out, vout, v1, v 1, v r, vr, v after, "
                    "velocity after, speed after, outgoing velocity, outgoing speed, "
                    "exit velocity, exit speed, launch speed"
                ),
                "m/s",
            ),
        }
    )
    reading_error = ReadingError("m/s", "mm/s", 1e3, "each speed")
    made_of = "speeds before and after impacts"
    pair_words = ("pair of speeds", "pairs of speeds")

    def read(self, rows: Sequence[Row]) -> list[Collision]:
        before, after = self.measured
        records = [
            Collision(*row.place, row.positive(before), row.positive(after, STICKS)) for row in rows
        ]
        ratio = np.median([one.rebound_velocity / one.velocity for one in records] or [0.0])
        if ratio > MEASURED_RESTITUTION.high:
            rows[0].refuse(
                "rebound_velocity",
                f"balls leave {ratio:.3g} times as fast as they came (the median); are the columns "
                "exchanged, or in different units?",
            )
        return records

    def facts(self, records: Sequence[Collision]) -> Mapping[str, str]:
        return {
            "speeds": span([record.velocity for record in records], "m/s"),
            "rebounds": span([record.rebound_velocity for record in records], "m/s"),
        }

    def pair(self, records: Sequence[Collision], flight: Flight) -> Paired[Collision]:
        before, after = np.array([(one.velocity, one.rebound_velocity) for one in records]).T
        # As for intervals, the noise is computed at the expected speed.
        expected = before * np.median(after / before)
        return Paired(
            velocity=before,
            restitution=after / before,
            reading_factor=before**-2.0 + expected**-2.0,
            clusters=[f"row {record.row}" for record in records],
            records=[(record,) for record in records],
        )
