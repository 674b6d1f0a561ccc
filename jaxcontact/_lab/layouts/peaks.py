"""Heights of successive flights: e = √(h₂/h₁)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ..._calibration.pairs.plausible import MEASURED_RESTITUTION, length_guess, not_shrinking
from ..._flight import Flight, speed_after_drop, speed_to_reach
from ..._text.words import span
from ..tables.heading import Meaning, words
from ..tables.sheet import Row
from .layout import LABELS, Layout, Paired, ReadingError, Record, adjacent, bounces_of


@dataclasses.dataclass(frozen=True)
class Peak(Record):
    """Height in m of one flight, or of the drop."""

    trial: str
    bounce: int
    height: float


class Peaks(Layout[Peak]):
    """Heights of successive flights: in vacuum e = √(h₂/h₁) at approach speed √(2 g h₁)."""

    name = "peaks"
    columns = ("ball", "trial", "bounce", "height_m")
    measured = ("height_m",)
    meanings = MappingProxyType(
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
    reading_error = ReadingError("m", "mm", 1e3, "each height")
    uses_flight = True
    flight = ("heights", "height")
    made_of = "heights of successive flights"
    pair_words = ("pair of successive heights", "pairs of successive heights")
    cluster_words = ("trial", "trials")
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
