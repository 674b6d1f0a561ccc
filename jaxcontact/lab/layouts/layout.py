"""Interface of column layouts, and their register."""

from __future__ import annotations

import abc
import collections
import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from ...extend import Flight, Floats, Words, span
from ..tables.heading import FROM_FILE, Meaning
from ..tables.match import Match
from ..tables.sheet import Row, Sheet

LABELS = {
    "ball": Meaning("ball, object, sample, specimen, material"),
    "trial": Meaning("trial, run, series, experiment, repetition, rep, drop number"),
    "bounce": Meaning(
        "bounce, bounce number, impact, impact number, number, n, k, i, lap, lap number, lap no"
    ),
}
"""Columns that several layouts have."""

DROP_HEIGHT = Meaning(
    "drop height, drop height m, dropped from, initial height, start height, h0, h 0",
    "m",
    10.0,
    "drops from more than 10 m",
)


@dataclasses.dataclass(frozen=True)
class Record:
    """One measurement: the name of its ball ("" without one), and its row number."""

    ball: str
    row: int


R = TypeVar("R", bound=Record)


@dataclasses.dataclass(frozen=True)
class TrialRecord(Record):
    """A reading after the impact `bounce` of a trial; with the next one of its group, a pair."""

    trial: str
    bounce: int

    @property
    def group(self) -> tuple[str, ...] | tuple[str, float | None, str]:
        """Key of the trial."""
        return self.ball, self.trial


T = TypeVar("T", bound=TrialRecord)


class ReadingError(NamedTuple):
    """A reading error: its unit, its printed form (`factor` · σ in `shown`), its quantity."""

    unit: str
    shown: str
    factor: float
    of: str


class Paired(NamedTuple, Generic[R]):
    """The n pairs that a layout makes of records, all arrays of shape (n,).

    Closing speeds `velocity` are in m/s. `restitution`, `reading_factor`, `covariance`, `reading`
    and `absolute` are those of `Pairs`. `clusters` names for each pair the group that shares
    errors. `records` are those of each pair; `unpaired` counts the records that make no pair.
    """

    velocity: Floats
    restitution: Floats
    reading_factor: Floats
    clusters: Sequence[str]
    records: Sequence[tuple[R, ...]]
    unpaired: int = 0
    covariance: Floats | None = None
    reading: float = 0.0
    absolute: bool = False


def rows_as_pairs(
    records: Sequence[R], velocity: Floats, e: Floats, reading_factor: Floats
) -> Paired[R]:
    """Return pairs of one record each; those of drops share errors with others from their height.

    The arrays have the shape (n,).
    """
    drops = [getattr(one, "drop_height", None) for one in records]
    return Paired(
        velocity,
        e,
        reading_factor,
        [
            f"row {r.row}" if h is None else f"drop {h:g} m"
            for r, h in zip(records, drops, strict=True)
        ],
        [(record,) for record in records],
    )


class Flights(NamedTuple):
    """Successive flights as "intervals" in s or "heights" in m: before and after each bounce."""

    kind: str
    first: list[float]
    second: list[float]


class Layout(abc.ABC, Generic[R]):
    """A column layout: how its rows are read and paired, and its words in reports.

    `name`. `meanings`, the recognised headings of each column and its unit, with the reading that
    is paired last. `columns`, by default those of `meanings`; one without a meaning is recognised
    by its name only. `measured`, the required columns. `reading_error`, None if its effect is
    unknown. `uses_flight`, whether gravity and air drag affect the speeds.

    For reports: `spans`, the attribute and the unit of each range to print. `made_of`, the origin
    of pairs. `pair_words` and `cluster_words`. `pair_rule`, when
    rows make a pair. `errors_words`, how standard errors by cluster are computed and what they
    account for. `known_errors`, the same, short and in full, for known reading errors.

    `instead`, what to do if a column is missing, by column. `fitted`, whether speed and e follow
    from a fit of each record, which needs the mass, and not from `pair`. `flight`, if pairs are
    made of flights: the kind in `Flights`, and the attributes of its first and its last record.
    """

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    measured: ClassVar[tuple[str, ...]]
    meanings: ClassVar[Mapping[str, Meaning]] = {}
    spans: ClassVar[Mapping[str, tuple[str, str]]] = {}
    reading_error: ClassVar[ReadingError | None] = None
    uses_flight: ClassVar[bool] = False
    made_of: ClassVar[str]
    pair_words: ClassVar[Words]
    cluster_words: ClassVar[Words] = ("row", "rows")
    pair_rule: ClassVar[str] = "each row is a pair"
    errors_words: ClassVar[str] = "by row (sandwich), valid if the scatter differs between rows"
    fitted: ClassVar[bool] = False
    flight: ClassVar[tuple[str, str, str] | None] = None
    instead: ClassVar[Mapping[str, str]] = {}
    known_errors: ClassVar[Words] = (
        "errors of times known, scatter fitted",
        "from the known errors of the times, which pairs share, the unknown contact duration and "
        "the scatter of the bounces; differences between trials are not included",
    )

    def __init_subclass__(cls) -> None:
        if "meanings" in vars(cls):
            cls.columns = tuple(cls.meanings)

    def select(self, rows: Sequence[Row]) -> tuple[Sequence[Row], tuple[str, ...]]:
        """Return the rows to read, and notes on those that are left out."""
        return rows, ()

    @abc.abstractmethod
    def read(self, rows: Sequence[Row]) -> list[R]:
        """Return the records in `rows`, checked; raise RecordingError for a fault."""

    def facts(self, records: Sequence[R]) -> Mapping[str, str]:
        """Return counts and ranges of the records by name, for printing."""
        return {
            fact: span([getattr(one, name) for one in records], unit)
            for fact, (name, unit) in self.spans.items()
        }

    def notes(self, records: Sequence[R]) -> tuple[str, ...]:
        """Return notes on the processing of records, beyond the reading of their columns."""
        sigma = getattr(records[0], "sigma", None) if records else None
        return () if sigma is None else (FROM_FILE,)

    @abc.abstractmethod
    def pair(self, records: Sequence[R], flight: Flight) -> Paired[R]:
        """Return the pairs in `records`, which are of one ball."""

    def flights(self, records: Sequence[tuple[R, ...]]) -> Flights | None:
        """Return the flights before and after each bounce, for `fit_bounces`; None without flights.

        `records` are those of all pairs.
        """
        if self.flight is None:
            return None
        kind, first, last = self.flight
        return Flights(
            kind, [getattr(r[0], first) for r in records], [getattr(r[-1], last) for r in records]
        )

    def guess(
        self, records: Sequence[tuple[R, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """Return the probable faults of flagged pairs, by number; unknown ones are omitted.

        `records` are those of all pairs and `flagged` (n,) marks some; `e` is the usual
        restitution.
        """
        return {}

    def meaning(self, column: str) -> Meaning:
        """Return the recognised headings and the unit of a column."""
        return self.meanings.get(column, Meaning(column))

    def lacking(self, there: Iterable[str]) -> list[str]:
        """Return the required columns that are missing."""
        return [column for column in self.measured if column not in there]

    def fits(self, made: Match, sheet: Sheet) -> bool:
        """Return whether matching columns mean this layout if the user names none."""
        return True

    def at_rate(self, rate: float | None) -> Layout[R]:
        """Return the layout at `rate` readings per second; raise ValueError if it has no rate."""
        if rate is None or "time" in self.measured:  # times already include the rate
            return self
        raise ValueError(
            f"Argument `rate` must be None for {self.made_of}, which have no sampling rate, but "
            f"is {rate:g}."
        )

    def __repr__(self) -> str:
        return self.name


Group = tuple[str, float | None, str]
"""The name of a ball, a drop height in m (None without it), and the name of a trial."""


def bounces_of(rows: Sequence[Row]) -> list[tuple[Row, Group, int]]:
    """Return each row with its trial and its bounce, from the column `bounce` or by order.

    Raises RecordingError for a number that a trial has twice.
    """
    groups: list[Group] = [
        (
            row.place[0],
            row.positive("drop_height_m") if "drop_height_m" in row.values else None,
            row.text("trial", "1"),
        )
        for row in rows
    ]
    counts: collections.Counter[Group] = collections.Counter()
    seen: dict[tuple[Group, int], int] = {}
    found = []
    for row, group in zip(rows, groups, strict=True):
        counts[group] += 1
        bounce = row.count("bounce") if "bounce" in row.values else counts[group]
        first = seen.setdefault((group, bounce), row.number)
        if first != row.number:
            missing = "" if "trial" in row.values else "; name the trials in a column `trial`"
            told = f"bounce {bounce} of this trial is already in row {first}{missing}"
            row.refuse("bounce", told)
        found.append((row, group, bounce))
    return found


def couples_of(records: Sequence[T]) -> list[tuple[T, T]]:
    """Return the records of successive bounces."""
    at = {(one.group, one.bounce): one for one in records}
    return [(one, at[group, k + 1]) for (group, k), one in at.items() if (group, k + 1) in at]


def chains_of(records: Sequence[T], name: str) -> list[Floats]:
    """Return the attribute `name` of the records of successive bounces, in chains."""
    at = {(one.group, one.bounce): getattr(one, name) for one in records}
    chains = []
    for group, k in at:
        if (group, k - 1) not in at:
            length = next(n for n in itertools.count(1) if (group, k + n) not in at)
            chains.append(np.array([at[group, k + n] for n in range(length)]))
    return chains


def unpaired(records: Sequence[T], couples: Sequence[tuple[T, T]]) -> int:
    """Return how many records make no pair."""
    return len(records) - len({id(one) for couple in couples for one in couple})


LAYOUTS: dict[str, Layout[Any]] = {}
"""All layouts by name; if the columns fit several, the first is used."""


def register_layout(layout: Layout[Any]) -> None:
    """Add a layout to `LAYOUTS`; raise ValueError if its name is in use."""
    if layout.name in LAYOUTS:
        raise ValueError(f"Argument `layout` must have a new name, but is {layout.name!r}.")
    LAYOUTS[layout.name] = layout
