"""Pairs (approach speed, restitution) from recordings, with how strongly a reading error enters."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .._flight import Flight, Floats
from ._recording import Interval, Layout, Point, Rebound, Record, RecordingError

Ints = NDArray[np.int64]

LEAST_PAIRS = 4
"""One parameter of the law, two of the noise, and one left over to judge the fit by."""

ERROR_UNIT: dict[Layout, Literal["s", "m"] | None] = {
    "intervals": "s",
    "heights": "m",
    "table": None,
}
"""The unit of the reading error; None where it is not known how one enters."""


@dataclasses.dataclass(frozen=True)
class Pairs:
    """n measured pairs; every array has the shape (n,).

    `velocity` is the approach speed in m/s and `restitution` the measured e. `first_row` and
    `second_row` are the lines of the file that a pair was made of (equal unless it was made of two
    intervals). `reading_factor` says how a reading error enters: an error of standard deviation σ
    (s for a trigger time, m for a height) gives ln e the variance σ² · `reading_factor`. `cluster`
    numbers the trials (shape (n,)), whose names are `cluster_names`.
    """

    file: str
    layout: Layout
    ball: str
    velocity: Floats
    restitution: Floats
    reading_factor: Floats
    first_row: Ints
    second_row: Ints
    cluster: Ints
    cluster_names: tuple[str, ...]
    sources: tuple[tuple[Record, ...], ...]
    flight: Flight
    unpaired: int

    def __len__(self) -> int:
        return len(self.velocity)

    def where(self, keep: NDArray[np.bool_]) -> Pairs:
        """The pairs for which `keep` (n,) is true."""
        arrays = ("velocity", "restitution", "reading_factor", "first_row", "second_row", "cluster")
        kept = {name: getattr(self, name)[keep] for name in arrays}
        sources = tuple(s for s, k in zip(self.sources, keep, strict=True) if k)
        return dataclasses.replace(self, sources=sources, **kept)

    def needs_enough(self) -> None:
        """Raise RecordingError where there are fewer pairs than a fit and its noise need."""
        if len(self) >= LEAST_PAIRS:
            return
        what = {
            "intervals": "pairs of successive intervals",
            "heights": "pairs of heights",
            "table": "pairs of speed and restitution",
        }[self.layout]
        column = {"intervals": "interval_s", "heights": "rebound_height_m"}.get(
            self.layout, "restitution"
        )
        row = int(self.second_row.max()) if len(self) else 1
        of_ball = f" of {self.ball}" if self.ball else ""
        raise RecordingError(
            f"{len(self)} usable {what}{of_ball}, but at least {LEAST_PAIRS} are needed "
            "(one parameter of the law, two of the noise, one to judge the fit by)",
            file=self.file,
            row=row,
            column=column,
        )


def make_pairs(
    file: str, layout: Layout, ball: str, records: Sequence[Record], flight: Flight
) -> Pairs:
    """The pairs in `records`, which are of one ball and one layout.

    Two intervals make a pair where they are of one trial and their bounces are consecutive:
    e = launch(T₂)/landing(T₁) at approach speed landing(T₁), in vacuum T₂/T₁ at g T₁/2. A drop and
    its rebound make one: e = launch(h₁)/landing(h₀), in vacuum sqrt(h₁/h₀). In a table each row is
    one, and `flight` plays no part.
    """
    if layout == "intervals":
        return _from_intervals(file, ball, [r for r in records if isinstance(r, Interval)], flight)
    if layout == "heights":
        return _from_heights(file, ball, [r for r in records if isinstance(r, Rebound)], flight)
    return _from_table(file, ball, [r for r in records if isinstance(r, Point)], flight)


def _number(names: Sequence[str]) -> tuple[Ints, tuple[str, ...]]:
    order = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return np.array([order[name] for name in names], dtype=np.int64), tuple(order)


def _rows(records: Sequence[Record]) -> Ints:
    return np.array([record.row for record in records], dtype=np.int64)


def _floats(values: Sequence[float]) -> Floats:
    return np.array(values, dtype=np.float64)


def _from_intervals(file: str, ball: str, records: Sequence[Interval], flight: Flight) -> Pairs:
    by_place = {(r.drop_height, r.trial, r.bounce): r for r in records}
    couples = [
        (first, by_place[place])
        for first in records
        if (place := (first.drop_height, first.trial, first.bounce + 1)) in by_place
    ]
    used = {record.row for couple in couples for record in couple}
    t1 = _floats([first.seconds for first, _ in couples])
    t2 = _floats([second.seconds for _, second in couples])
    landing = flight.landing_speed(flight.launch_speed(t1))
    restitution = flight.launch_speed(t2) / landing
    # The size of the noise is taken from the interval that was to be expected, not from the one
    # that was read: otherwise an interval read too short would be given less weight than one read
    # too long, and the fit would be biased.
    expected = t1 * (np.median(t2 / t1) if len(t1) else 1.0)
    landing_slope = flight.log_slopes(t1)[1] / t1
    launch_slope = flight.log_slopes(expected)[0] / expected
    # Three trigger times make two intervals. With independent errors of the triggers,
    # ln e = launch_slope (n₃ - n₂) - landing_slope (n₂ - n₁), whose variance over σ² is
    factor = 2 * (launch_slope**2 + landing_slope**2 + launch_slope * landing_slope)
    cluster, names = _number(
        [f"drop {first.drop_height:g} m, trial {first.trial}" for first, _ in couples]
    )
    return Pairs(
        file=file,
        layout="intervals",
        ball=ball,
        velocity=landing,
        restitution=restitution,
        reading_factor=factor,
        first_row=_rows([first for first, _ in couples]),
        second_row=_rows([second for _, second in couples]),
        cluster=cluster,
        cluster_names=names,
        sources=tuple(couples),
        flight=flight,
        unpaired=sum(record.row not in used for record in records),
    )


def _from_heights(file: str, ball: str, records: Sequence[Rebound], flight: Flight) -> Pairs:
    dropped = _floats([r.drop_height for r in records])
    reached = _floats([r.height for r in records])
    landing = flight.speed_after_drop(dropped)
    expected = dropped * (np.median(reached / dropped) if len(dropped) else 1.0)
    # d ln(launch)/dh is 1/(2 h) in vacuum; drag changes it by a few per cent of itself, which
    # is nothing to a noise model.
    factor = (0.5 / expected) ** 2
    # Ten drops from one height share the error of that height.
    cluster, names = _number([f"drop {r.drop_height:g} m" for r in records])
    return Pairs(
        file=file,
        layout="heights",
        ball=ball,
        velocity=landing,
        restitution=flight.speed_to_reach(reached) / landing,
        reading_factor=factor,
        first_row=_rows(records),
        second_row=_rows(records),
        cluster=cluster,
        cluster_names=names,
        sources=tuple((r,) for r in records),
        flight=flight,
        unpaired=0,
    )


def _from_table(file: str, ball: str, records: Sequence[Point], flight: Flight) -> Pairs:
    cluster, names = _number([f"row {r.row}" for r in records])
    return Pairs(
        file=file,
        layout="table",
        ball=ball,
        velocity=_floats([r.velocity for r in records]),
        restitution=_floats([r.restitution for r in records]),
        reading_factor=np.zeros(len(records)),
        first_row=_rows(records),
        second_row=_rows(records),
        cluster=cluster,
        cluster_names=names,
        sources=tuple((r,) for r in records),
        flight=flight,
        unpaired=0,
    )
