"""Layouts of speeds before and after impacts, and of tables of e(v)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ...extend import MEASURED_RESTITUTION, Flight, Words
from ..tables.heading import Meaning, deviation_of
from ..tables.sheet import Row
from .layout import LABELS, Layout, Paired, ReadingError, Record, rows_as_pairs

STICKS = "; e = 0 of a body that sticks has no logarithm: leave its row out"
"""Advice for an impact without a rebound."""

VELOCITY = Meaning(
    "velocity, speed, v, v0, v 0, vn, v n, v in, vin, v i, impact velocity, impact speed, "
    "approach velocity, approach speed, closing velocity, closing speed, incoming velocity, "
    "incoming speed, incident velocity, incident speed, normal velocity, velocity before, "
    "speed before",
    "m/s",
    200.0,
    "impacts faster than 200 m/s",
)
E = Meaning(
    "restitution, e, cor, coefficient of restitution, restitution coefficient, en, e n, cr, c r, "
    "ε, eps, epsilon",
    "",
)
SIGMA_E = deviation_of(
    "restitution", ("e", "cor", "en", "ε", "restitution", "coefficient of restitution"), ""
)


@dataclasses.dataclass(frozen=True)
class MeasuredRestitution(Record):
    """A restitution measured at a known closing speed in m/s, and its standard deviation."""

    velocity: float
    restitution: float
    sigma: float | None = None


class RestitutionTable(Layout[MeasuredRestitution]):
    """Rows of closing speed and restitution, used unchanged; a column `ball` is optional."""

    name = "table"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "sigma": SIGMA_E,
        "velocity": VELOCITY,
        "restitution": E,
    }
    measured: ClassVar[tuple[str, ...]] = ("velocity", "restitution")
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {
        "speeds": ("velocity", "m/s"),
        "restitutions": ("restitution", ""),
    }
    made_of = "rows of speed and restitution"
    pair_words: ClassVar[Words] = (
        "pair of speed and restitution",
        "pairs of speed and restitution",
    )

    def read(self, rows: Sequence[Row]) -> list[MeasuredRestitution]:
        sigma = ["sigma"] * (bool(rows) and "sigma" in rows[0].values)
        points = [
            MeasuredRestitution(
                *row.place,
                row.positive("velocity"),
                row.positive("restitution", STICKS),
                *map(row.positive, sigma),
            )
            for row in rows
        ]
        e = np.array([point.restitution for point in points])
        if (high := e > MEASURED_RESTITUTION.high).any():
            i = int(np.argmax(high))
            guess = (
                "; is it in percent? then divide by 100, or write the unit in the heading, 'e [%]'"
                if np.median(e) > 2 and e.max() <= 120
                else ""
            )
            rows[i].refuse("restitution", f"{e[i]:g} is above 1.2, the largest plausible e{guess}")
        return points

    def pair(
        self, records: Sequence[MeasuredRestitution], flight: Flight
    ) -> Paired[MeasuredRestitution]:
        velocity, e = np.array([(one.velocity, one.restitution) for one in records]).T
        sigma = np.array([one.sigma for one in records if one.sigma is not None])
        made = rows_as_pairs(records, velocity, e, np.zeros(len(records)))
        if not sigma.size:
            return made
        return made._replace(covariance=np.diag((sigma / e) ** 2), absolute=True)


@dataclasses.dataclass(frozen=True)
class Collision(Record):
    """The speeds in m/s before and after one impact."""

    velocity: float
    rebound_velocity: float


class Speeds(Layout[Collision]):
    """Speeds before and after impacts, as from light gates and video: e is their ratio."""

    name = "speeds"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "ball": LABELS["ball"],
        "velocity": VELOCITY,
        "rebound_velocity": Meaning(
            "rebound velocity, rebound speed, v out, vout, v1, v 1, v r, vr, v after, "
            "velocity after, speed after, outgoing velocity, outgoing speed, exit velocity, "
            "exit speed, launch speed",
            "m/s",
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("velocity", "rebound_velocity")
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {
        "speeds": ("velocity", "m/s"),
        "rebounds": ("rebound_velocity", "m/s"),
    }
    reading_error: ClassVar[ReadingError | None] = ReadingError("m/s", "mm/s", 1e3, "each speed")
    made_of = "speeds before and after impacts"
    pair_words: ClassVar[Words] = ("pair of speeds", "pairs of speeds")

    def read(self, rows: Sequence[Row]) -> list[Collision]:
        before, after = self.measured
        records = [
            Collision(*row.place, row.positive(before), row.positive(after, STICKS)) for row in rows
        ]
        ratio = np.median([one.rebound_velocity / one.velocity for one in records] or [0.0])
        if ratio > MEASURED_RESTITUTION.high:
            rows[0].refuse(
                after,
                f"balls leave {ratio:.3g} times as fast as they came (the median); are the columns "
                "exchanged, or in different units?",
            )
        return records

    def pair(self, records: Sequence[Collision], flight: Flight) -> Paired[Collision]:
        before, after = np.array([(one.velocity, one.rebound_velocity) for one in records]).T
        # As for intervals, the noise is computed at the expected speed.
        expected = before * np.median(after / before)
        return rows_as_pairs(records, before, after / before, before**-2.0 + expected**-2.0)
