"""Layouts of heights (drops and rebounds, successive flights), of speeds, and of tables of e(v)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ...extend import (
    MEASURED_RESTITUTION,
    Flight,
    Words,
    in_percent,
    length_guess,
    not_shrinking,
    span,
    speed_after_drop,
    speed_to_reach,
)
from ..tables.heading import FROM_FILE, Meaning, deviation_of, words
from ..tables.sheet import Row
from .layout import (
    DROP_HEIGHT,
    LABELS,
    Flights,
    Layout,
    Paired,
    ReadingError,
    Record,
    adjacent,
    bounces_of,
)

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
    columns: ClassVar[tuple[str, ...]] = ("ball", "drop_height_m", "trial", "rebound_height_m")
    measured: ClassVar[tuple[str, ...]] = ("drop_height_m", "rebound_height_m")
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
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
    reading_error: ClassVar[ReadingError | None] = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    made_of = "drop and rebound heights"
    pair_words: ClassVar[Words] = ("pair of heights", "pairs of heights")
    cluster_words: ClassVar[Words] = ("drop height", "drop heights")
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
    columns: ClassVar[tuple[str, ...]] = ("ball", "sigma", "velocity", "restitution")
    measured: ClassVar[tuple[str, ...]] = ("velocity", "restitution")
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
        {"ball": LABELS["ball"], "velocity": VELOCITY, "restitution": E, "sigma": SIGMA_E}
    )
    made_of = "rows of speed and restitution"
    pair_words: ClassVar[Words] = (
        "pair of speed and restitution",
        "pairs of speed and restitution",
    )

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


@dataclasses.dataclass(frozen=True)
class Peak(Record):
    """Height in m of one flight, or of the drop."""

    trial: str
    bounce: int
    height: float


class Peaks(Layout[Peak]):
    """Heights of successive flights: in vacuum e = √(h₂/h₁) at approach speed √(2 g h₁)."""

    name = "peaks"
    columns: ClassVar[tuple[str, ...]] = ("ball", "trial", "bounce", "height_m")
    measured: ClassVar[tuple[str, ...]] = ("height_m",)
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
        {
            **LABELS,
            "height_m": Meaning(
                words("height, height m, h, peak, peak height, max height, maximum height, apex"),
                "m",
                10.0,
                "flights higher than 10 m",
            ),
        }
    )
    reading_error: ClassVar[ReadingError | None] = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    flight: ClassVar[tuple[str, str] | None] = ("heights", "height")
    made_of = "heights of successive flights"
    pair_words: ClassVar[Words] = ("pair of successive heights", "pairs of successive heights")
    cluster_words: ClassVar[Words] = ("trial", "trials")
    pair_rule = "two heights make a pair if ball and trial agree and `bounce` is consecutive"
    errors_words = (
        "by trial (cluster-robust sandwich): successive ratios share a height, which correlates "
        "them within a trial"
    )

    def read(self, rows: Sequence[Row]) -> list[Peak]:
        groups = [(row.place[0], row.text("trial", "1")) for row in rows]
        records = [
            Peak(ball, row.number, trial, bounce, row.positive("height_m"))
            for row, (ball, trial), bounce in zip(
                rows, groups, bounces_of(rows, groups), strict=True
            )
        ]
        rises = [b.height / a.height for a, b in _couples(records)]
        if rises and (rise := float(np.median(rises))) > MEASURED_RESTITUTION.high**2:
            told = f"balls rise to {rise:.3g} times the height before (the median)"
            rows[0].refuse("height_m", told + length_guess(rise))
        if rises and (factor := not_shrinking(_chains(records), 2.0)) is not None:
            rows[0].refuse(
                "height_m",
                f"each height is {factor:.4g} times the one before (the median), but those of a "
                "bouncing ball shrink; heights over time need a column `time`",
            )
        return records

    def facts(self, records: Sequence[Peak]) -> Mapping[str, str]:
        return {
            "trials": str(len({(record.ball, record.trial) for record in records})),
            "heights": span([record.height for record in records], "m"),
        }

    def pair(self, records: Sequence[Peak], flight: Flight) -> Paired[Peak]:
        couples = _couples(records)
        before, after = (
            np.array([[one.height for one in couple] for couple in couples]).reshape(-1, 2).T
        )
        landing, _ = flight.evaluate(speed_after_drop, before)
        launch, _ = flight.evaluate(speed_to_reach, after)
        # As for intervals, the noise of the second height is computed at its expected value.
        expected = before * (np.median(after / before) if len(before) else 1.0)
        return Paired(
            velocity=landing,
            restitution=launch / landing,
            # d ln(speed)/dh is 1/(2 h) in vacuum, for either height.
            reading_factor=(0.5 / before) ** 2 + (0.5 / expected) ** 2,
            clusters=[f"trial {first.trial}" for first, _ in couples],
            records=couples,
            unpaired=len(records) - len({id(one) for couple in couples for one in couple}),
        )


def _chains(records: Sequence[Peak]) -> list[np.ndarray]:
    """Return the heights of successive flights of each trial."""
    chains: dict[tuple[str, str], list[Peak]] = {}
    for one in records:
        chains.setdefault((one.ball, one.trial), []).append(one)
    return [
        np.array([one.height for one in sorted(chain, key=lambda one: one.bounce)])
        for chain in chains.values()
    ]


def _couples(records: Sequence[Peak]) -> list[tuple[Peak, Peak]]:
    return adjacent(records, lambda one: ((one.ball, one.trial), one.bounce))


@dataclasses.dataclass(frozen=True)
class Collision(Record):
    """The speeds in m/s before and after one impact."""

    velocity: float
    rebound_velocity: float


class Speeds(Layout[Collision]):
    """Speeds before and after impacts, as from light gates and video: e is their ratio."""

    name = "speeds"
    columns: ClassVar[tuple[str, ...]] = ("ball", "velocity", "rebound_velocity")
    measured: ClassVar[tuple[str, ...]] = ("velocity", "rebound_velocity")
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType(
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
