"""What a column layout is, and the register of layouts."""

from __future__ import annotations

import abc
import collections
import dataclasses
from collections.abc import Hashable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from ..._flight import Flight, Floats
from ..._text.words import Words
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
"""What layouts have in common."""

DROP_HEIGHT = Meaning(
    words("drop height, drop height m, dropped from, initial height, start height, h0, h 0"),
    "m",
    10.0,
    "drops from more than 10 m",
)


@dataclasses.dataclass(frozen=True)
class Record:
    """One measurement: the name of its ball, "" for none, and the number of its row."""

    ball: str
    row: int


R = TypeVar("R", bound=Record)


class ReadingError(NamedTuple):
    """The unit of a reading error, how it is printed (`factor` · σ in `shown`), and of what."""

    unit: str
    shown: str
    factor: float
    of: str


class Paired(NamedTuple, Generic[R]):
    """What a layout makes of records: n pairs, all arrays of shape (n,).

    Approach speeds `velocity` in m/s, the measured `restitution`, `reading_factor` and `records` as
    in `Pairs`; `clusters` names for each pair the group that shares errors; `unpaired` counts the
    records that make no pair; `covariance`, `reading` and `absolute` as in `Pairs`.
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
    """A column layout: how its rows are read and paired, and the words that reports use of it.

    `name`; `columns`, the reading that is paired last; `measured`, those of them that cannot be
    left out; `meanings`, by which words a column is known, and its unit (a column that is not
    among them is known by its name only); `reading_error`, None where its effect is not known;
    `uses_flight`, whether gravity and the drag of the air enter the speeds.

    For reports: `made_of`, what pairs are made of; `pair_words` and `cluster_words`; `pair_rule`,
    when rows make a pair; `errors_words`, how standard errors by cluster are found and what they
    allow for; `known_errors`, the same in short and in full where the errors of readings are known.

    `instead`, what to do where a column is missing, by column. `fitted`, whether speed and e follow
    from a fit of each record, which needs the mass, and not from `pair`.
    """

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    measured: ClassVar[tuple[str, ...]]
    meanings: ClassVar[Mapping[str, Meaning]] = MappingProxyType({})
    reading_error: ClassVar[ReadingError | None]
    uses_flight: ClassVar[bool]
    made_of: ClassVar[str]
    pair_words: ClassVar[Words]
    cluster_words: ClassVar[Words]
    pair_rule: ClassVar[str]
    errors_words: ClassVar[str]
    fitted: ClassVar[bool] = False
    instead: ClassVar[Mapping[str, str]] = MappingProxyType({})
    known_errors: ClassVar[Words] = (
        "the errors of times are known; the scatter was fitted beside them",
        "by the known errors of the times, which pairs share, a contact of a duration that is "
        "not known, and the scatter of the bounces; how much trials differ, they do not tell",
    )

    @abc.abstractmethod
    def read(self, rows: Sequence[Row]) -> list[R]:
        """The records in `rows`, checked. Raises RecordingError for a fault."""

    @abc.abstractmethod
    def facts(self, records: Sequence[R]) -> Mapping[str, str]:
        """Counts and ranges of the records, by name, for print."""

    def notes(self, records: Sequence[R]) -> tuple[str, ...]:
        """What was done to the records, beyond how their columns were read."""
        return ()

    @abc.abstractmethod
    def pair(self, records: Sequence[R], flight: Flight) -> Paired[R]:
        """The pairs in `records`, which are of one ball."""

    def flights(self, records: Sequence[tuple[R, ...]]) -> Flights | None:
        """The flights before and after each bounce, for `fit_bounces`; None where there are none.

        `records` are those of all pairs.
        """
        return None

    def guess(
        self, records: Sequence[tuple[R, ...]], flagged: np.ndarray, e: float
    ) -> Mapping[int, str]:
        """What may have happened to flagged pairs, by number; nothing where it cannot be told.

        `records` are those of all pairs and `flagged` (n,) marks some; `e` is the usual
        restitution.
        """
        return {}

    def meaning(self, column: str) -> Meaning:
        """What a column may be called."""
        return self.meanings.get(column, Meaning((column.casefold().replace("_", " "),)))

    def lacking(self, there: Iterable[str]) -> list[str]:
        """The columns that cannot be left out and are not among those that are there."""
        return [column for column in self.measured if column not in there]

    def fits(self, made: Match, sheet: Sheet) -> bool:
        """Whether columns that match mean this layout, where nobody says so."""
        return True

    def at_rate(self, rate: float | None) -> Layout[R]:
        """The layout of a file of `rate` readings per second. Raises ValueError where none is."""
        if rate is None:
            return self
        raise ValueError(
            f"Argument `rate` must be None for {self.made_of}, which are no readings over time, "
            f"but is {rate:g}."
        )

    def __repr__(self) -> str:
        return self.name


def bounces_of(rows: Sequence[Row], groups: Sequence[Hashable]) -> list[int]:
    """The number of each row's bounce in its group: that of the column `bounce`, or in order.

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
            told = f"bounce {bounce} of this trial is in row {first} already{missing}"
            row.refuse("bounce", told)
        bounces.append(bounce)
    return bounces


LAYOUTS: dict[str, Layout[Any]] = {}
"""All layouts by name; where the columns fit several, the first is taken."""


def register_layout(layout: Layout[Any]) -> None:
    """Add a layout to `LAYOUTS`. Raises ValueError where its name is taken."""
    if layout.name in LAYOUTS:
        raise ValueError(f"Argument `layout` must have a new name, but is {layout.name!r}.")
    LAYOUTS[layout.name] = layout
