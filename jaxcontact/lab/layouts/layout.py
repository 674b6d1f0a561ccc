"""Interface of column layouts, and their register."""

from __future__ import annotations

import abc
import collections
import dataclasses
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from ...extend import Flight, Floats, Words
from ..tables.heading import Meaning, words
from ..tables.match import Match
from ..tables.sheet import Row, Sheet

LABELS = {
    "ball": Meaning(words("ball, object, sample, specimen, material")),
    "trial": Meaning(words("trial, run, series, experiment, repetition, rep, drop number")),
    "bounce": Meaning(
        words(
            "bounce, bounce number, impact, impact number, number, n, k, i, lap, lap number, lap no"
        )
    ),
}
"""Columns that several layouts have."""

DROP_HEIGHT = Meaning(
    words("drop height, drop height m, dropped from, initial height, start height, h0, h 0"),
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


class ReadingError(NamedTuple):
    """A reading error: its unit, its printed form (`factor` · σ in `shown`), its quantity."""

    unit: str
    shown: str
    factor: float
    of: str


class Paired(NamedTuple, Generic[R]):
    """The n pairs that a layout makes of records, all arrays of shape (n,).

    Approach speeds `velocity` are in m/s. `restitution`, `reading_factor`, `covariance`, `reading`
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


class Flights(NamedTuple):
    """Successive flights as "intervals" in s or "heights" in m: before and after each bounce."""

    kind: str
    first: list[float]
    second: list[float]


class Layout(abc.ABC, Generic[R]):
    """A column layout: how its rows are read and paired, and its words in reports.

    `name`. `columns`, with the reading that is paired last. `measured`, the required columns.
    `meanings`, the recognised headings of a column and its unit; a column without an entry is
    recognised by its name only. `reading_error`, None if its effect is unknown. `uses_flight`,
    whether gravity and air drag affect the speeds.

    For reports: `made_of`, the origin of pairs. `pair_words` and `cluster_words`. `pair_rule`, when
    rows make a pair. `errors_words`, how standard errors by cluster are computed and what they
    account for. `known_errors`, the same, short and in full, for known reading errors.

    `instead`, what to do if a column is missing, by column. `fitted`, whether speed and e follow
    from a fit of each record, which needs the mass, and not from `pair`. `flight`, the kind in
    `Flights` and the attribute of a record, if a pair is two records of successive flights.
    """

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    measured: ClassVar[tuple[str, ...]]
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType({})
    reading_error: ClassVar[ReadingError | None] = None
    uses_flight: ClassVar[bool] = False
    made_of: ClassVar[str]
    pair_words: ClassVar[Words]
    cluster_words: ClassVar[Words] = ("row", "rows")
    pair_rule: ClassVar[str] = "each row is a pair"
    errors_words: ClassVar[str] = "by row (sandwich), valid if the scatter differs between rows"
    fitted: ClassVar[bool] = False
    flight: ClassVar[tuple[str, str] | None] = None
    instead: ClassVar[Mapping[str, str]] = MappingProxyType({})
    known_errors: ClassVar[Words] = (
        "errors of times known, scatter fitted",
        "from the known errors of the times, which pairs share, the unknown contact duration and "
        "the scatter of the bounces; differences between trials are not included",
    )

    def select(self, rows: Sequence[Row]) -> tuple[Sequence[Row], tuple[str, ...]]:
        """Return the rows to read, and notes on those that are left out."""
        return rows, ()

    @abc.abstractmethod
    def read(self, rows: Sequence[Row]) -> list[R]:
        """Return the records in `rows`, checked; raise RecordingError for a fault."""

    @abc.abstractmethod
    def facts(self, records: Sequence[R]) -> Mapping[str, str]:
        """Return counts and ranges of the records by name, for printing."""

    def notes(self, records: Sequence[R]) -> tuple[str, ...]:
        """Return notes on the processing of records, beyond the reading of their columns."""
        return ()

    @abc.abstractmethod
    def pair(self, records: Sequence[R], flight: Flight) -> Paired[R]:
        """Return the pairs in `records`, which are of one ball."""

    def flights(self, records: Sequence[tuple[R, ...]]) -> Flights | None:
        """Return the flights before and after each bounce, for `fit_bounces`; None without flights.

        `records` are those of all pairs.
        """
        if self.flight is None:
            return None
        kind, name = self.flight
        return Flights(kind, *([getattr(one[k], name) for one in records] for k in (0, 1)))

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
        return self.meanings.get(column, Meaning((column.casefold().replace("_", " "),)))

    def lacking(self, there: Iterable[str]) -> list[str]:
        """Return the required columns that are missing."""
        return [column for column in self.measured if column not in there]

    def fits(self, made: Match, sheet: Sheet) -> bool:
        """Return whether matching columns mean this layout if the user names none."""
        return True

    def at_rate(self, rate: float | None) -> Layout[R]:
        """Return the layout at `rate` readings per second; raise ValueError if it has no rate."""
        if rate is None:
            return self
        raise ValueError(
            f"Argument `rate` must be None for {self.made_of}, which have no sampling rate, but "
            f"is {rate:g}."
        )

    def __repr__(self) -> str:
        return self.name


def bounces_of(rows: Sequence[Row], groups: Sequence[Hashable]) -> list[int]:
    """Return the bounce number of each row in its group, from the column `bounce` or by order.

    Raises RecordingError for a number that a group has twice.
    """
    counts: collections.Counter[Hashable] = collections.Counter()
    seen: dict[tuple[Hashable, int], int] = {}
    bounces = []
    for row, group in zip(rows, groups, strict=True):
        counts[group] += 1
        bounce = row.count("bounce") if "bounce" in row.values else counts[group]
        first = seen.setdefault((group, bounce), row.number)
        if first != row.number:
            missing = "" if "trial" in row.values else "; name the trials in a column `trial`"
            told = f"bounce {bounce} of this trial is already in row {first}{missing}"
            row.refuse("bounce", told)
        bounces.append(bounce)
    return bounces


def adjacent(records: Sequence[R], place: Callable[[R], tuple[Hashable, int]]) -> list[tuple[R, R]]:
    """Return records with their next ones; `place` returns the group and the number in it."""
    at = {place(one): one for one in records}
    return [(one, at[group, k + 1]) for (group, k), one in at.items() if (group, k + 1) in at]


LAYOUTS: dict[str, Layout[Any]] = {}
"""All layouts by name; if the columns fit several, the first is used."""


def register_layout(layout: Layout[Any]) -> None:
    """Add a layout to `LAYOUTS`; raise ValueError if its name is in use."""
    if layout.name in LAYOUTS:
        raise ValueError(f"Argument `layout` must have a new name, but is {layout.name!r}.")
    LAYOUTS[layout.name] = layout
