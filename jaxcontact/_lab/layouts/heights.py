"""Layouts with one pair a row: heights of a drop and its rebound, and tables of e(v)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ..._calibration.pairs.plausible import MEASURED_RESTITUTION, in_percent, length_guess
from ..._flight import Flight, speed_after_drop, speed_to_reach
from ..._text.words import span
from ..tables.deviation import FROM_FILE, deviation_of
from ..tables.heading import Meaning, words
from ..tables.sheet import Row
from .layout import DROP_HEIGHT, LABELS, Flights, Layout, Paired, ReadingError, Record

STICKS = "; e = 0 of a body that sticks has no logarithm: leave its row out"
"""Advice for an impact without a rebound."""


@dataclasses.dataclass(frozen=True)
class Rebound(Record):
    """Height in m of the first rebound after a drop from `drop_height` m."""

    trial: str
    drop_height: float
    height: float


class Heights(Layout[Rebound]):
    """Drop and rebound heights: in vacuum e = √(h₁/h₀) at approach speed √(2 g h₀)."""

    name = "heights"
    columns = ("ball", "drop_height_m", "trial", "rebound_height_m")
    measured = ("drop_height_m", "rebound_height_m")
    meanings = MappingProxyType(
        {
            **LABELS,
            "drop_height_m": DROP_HEIGHT,
            "rebound_height_m": Meaning(
                words(
                    "rebound height, rebound height m, bounce height, height of rebound, rebound, "
                    "final height, height, h, h1, h 1"
                ),
                "m",
            ),
        }
    )
    reading_error = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    made_of = "drop and rebound heights"
    pair_words = ("pair of heights", "pairs of heights")
    cluster_words = ("drop height", "drop heights")
    errors_words = "by drop height (cluster-robust sandwich): drops from one height share its error"

    def read(self, rows: Sequence[Row]) -> list[Rebound]:
        records = [
            Rebound(*row.place, row.text("trial", "1"), *map(row.positive, self.measured))
            for row in rows
        ]
        rise = np.median([one.height / one.drop_height for one in records]) if records else 0.0
        if rise > MEASURED_RESTITUTION.high**2:
            told = f"balls rise to {rise:.3g} times the height they fell from (the median)"
            rows[0].refuse("rebound_height_m", told + length_guess(rise))
        return records

    def facts(self, records: Sequence[Rebound]) -> Mapping[str, str]:
        dropped = [record.drop_height for record in records]
        return {
            "drop heights": f"{len(set(dropped))}, {span(dropped, 'm')}",
            "rebounds": span([record.height for record in records], "m"),
        }

    def flights(self, records: Sequence[tuple[Rebound, ...]]) -> Flights:
        first, second = zip(*((one.drop_height, one.height) for (one,) in records), strict=True)
        return Flights("heights", list(first), list(second))

    def pair(self, records: Sequence[Rebound], flight: Flight) -> Paired[Rebound]:
        dropped, reached = np.array([(one.drop_height, one.height) for one in records]).T
        landing, _ = flight.evaluate(speed_after_drop, dropped)
        launch, _ = flight.evaluate(speed_to_reach, reached)
        # As for intervals, the noise is computed at the expected height.
        expected = dropped * np.median(reached / dropped)
        return Paired(
            velocity=landing,
            restitution=launch / landing,
            # d ln(launch)/dh is 1/(2 h) in vacuum. Drag changes it by a few per cent, which does
            # not matter in a model of noise.
            reading_factor=(0.5 / expected) ** 2,
            # All drops from one height share the error of that height.
            clusters=[f"drop {record.drop_height:g} m" for record in records],
            records=[(record,) for record in records],
        )


VELOCITY = Meaning(
    words(
        "velocity, speed, v, v0, v 0, vn, v n, v in, vin, v i, impact velocity, impact speed, "
        "approach velocity, approach speed, closing velocity, closing speed, incoming velocity, "
        "incoming speed, incident velocity, incident speed, normal velocity, velocity before, "
        "speed before"
    ),
    "m/s",
    200.0,
    "impacts faster than 200 m/s",
)
E = Meaning(
    words(
        "restitution, e, cor, coefficient of restitution, restitution coefficient, en, e n, cr, "
        "c r, ε, eps, epsilon"
    ),
    "",
)


@dataclasses.dataclass(frozen=True)
class MeasuredRestitution(Record):
    """A restitution measured at a known approach speed in m/s, and its standard deviation."""

    velocity: float
    restitution: float
    sigma: float | None = None


SIGMA_E = deviation_of(
    "restitution", ("e", "cor", "en", "ε", "restitution", "coefficient of restitution"), ""
)


class RestitutionTable(Layout[MeasuredRestitution]):
    """Rows of approach speed and restitution, used unchanged; a column `ball` is optional."""

    name = "table"
    columns = ("ball", "sigma", "velocity", "restitution")
    measured = ("velocity", "restitution")
    meanings = MappingProxyType(
        {"ball": LABELS["ball"], "velocity": VELOCITY, "restitution": E, "sigma": SIGMA_E}
    )
    made_of = "rows of speed and restitution"
    pair_words = ("pair of speed and restitution", "pairs of speed and restitution")

    def read(self, rows: Sequence[Row]) -> list[MeasuredRestitution]:
        there = [name for name in (*self.measured, "sigma") if rows and name in rows[0].values]
        advice = {"restitution": STICKS}
        points = [
            MeasuredRestitution(
                *row.place, *(row.positive(name, advice.get(name, "")) for name in there)
            )
            for row in rows
        ]
        e = np.array([point.restitution for point in points])
        if (high := e > MEASURED_RESTITUTION.high).any():
            i = int(np.argmax(high))
            guess = (
                "; is it in percent? then divide by 100, or write the unit in the heading, 'e [%]'"
                if in_percent(e)
                else ""
            )
            rows[i].refuse("restitution", f"{e[i]:g} is above 1.2, the largest plausible e{guess}")
        return points

    def facts(self, records: Sequence[MeasuredRestitution]) -> Mapping[str, str]:
        return {
            "speeds": span([record.velocity for record in records], "m/s"),
            "restitutions": span([record.restitution for record in records]),
        }

    def notes(self, records: Sequence[MeasuredRestitution]) -> tuple[str, ...]:
        return (FROM_FILE,) if records and records[0].sigma is not None else ()

    def pair(
        self, records: Sequence[MeasuredRestitution], flight: Flight
    ) -> Paired[MeasuredRestitution]:
        velocity, restitution = np.array([(one.velocity, one.restitution) for one in records]).T
        sigma = np.array([one.sigma for one in records if one.sigma is not None])
        return Paired(
            velocity=velocity,
            restitution=restitution,
            reading_factor=np.zeros(len(records)),
            clusters=[f"row {record.row}" for record in records],
            records=[(record,) for record in records],
            covariance=np.diag((sigma / restitution) ** 2) if sigma.size else None,
            absolute=sigma.size > 0,
        )
