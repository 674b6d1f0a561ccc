"""Recordings of one bouncing ball, read from any source, and the pairs (speed, e) in them."""

from __future__ import annotations

import bisect
import dataclasses
import functools
import itertools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...extend import POSITIVE, Flight, did_you_mean, rendered, require_choice, require_number
from ..layouts.layout import LAYOUTS, Layout, Record
from ..layouts.sound import intervals_in
from ..layouts.track import counts_frames, tracks_of, with_frames
from ..pairs.pairs import Ints, Pairs
from ..signals import with_clock
from ..sound.audio import Sound, sound_in
from ..tables.heading import Meaning, unused_notes
from ..tables.match import Match, Told, as_told, check_usual
from ..tables.sheet import RecordingError, Sheet
from ..tables.source import sheet_of
from ..track.model import Track
from .layout_of import layout_of
from .wide import as_trials

_SHIPPED_BALL = "blue"
_NUMBERS = re.compile(r"(?=.*\d)(?:[\d\s.,;:|+-]|(?<=\d)[eE](?=[\d+-]))*")


@dataclasses.dataclass(frozen=True, repr=False)
class Recording:
    """The measurements of one ball.

    `source` is their origin, `layout` their column layout (see `read_recording`), and `ball` the
    name of the ball ("" without a name). `records` are the measurements in order. `notes` say how
    they were read: recognised headings and converted units. `sound` is what was detected in a sound
    file, otherwise None (see `jc.plot.sound`).
    """

    source: str
    layout: Layout[Any]
    ball: str
    records: tuple[Record, ...]
    notes: tuple[str, ...] = ()
    sound: Sound | None = None

    def __len__(self) -> int:
        return len(self.records)

    @property
    def tracks(self) -> tuple[Track, ...]:
        """The evaluated tracks from video, one for each trial; empty for other recordings."""
        return tracks_of(self.records)

    def __repr__(self) -> str:
        facts = {
            "source": self.source,
            "layout": self.layout.name,
            "ball": self.ball or "(no name)",
            "rows": str(len(self)),
            **self.layout.facts(self.records),
        }
        if self.notes:
            facts["read as"] = "; ".join(self.notes)
        return "Recording\n" + "\n".join(f"  {name:<13}{fact}" for name, fact in facts.items())


def read_recording(
    source: str | os.PathLike[str] | IO[Any] | Mapping[str, Any] | Any = None,
    *,
    layout: str | None = None,
    ball: Any = None,
    columns: str | Mapping[str, int | str] | None = None,
    decimal: str | None = None,
    rate: float | None = None,
    sheet: str | int | None = None,
    **values: Any,
) -> Recording:
    """Read the recording of one bouncing ball from a file, a data frame, or arrays.

    The `layout` follows from the columns, unless it is named:

    - "intervals": `interval_s`, the time in s between impacts `bounce` and `bounce` + 1 of a
      `trial`, and `drop_height_m`;
    - "instants": `bounce_time_s`, the times in s of successive bounces; if a `label` marks some of
      them, the others are left out;
    - "stops": `drop_height_m` and `rest_time_s`, the time in s from the release until rest;
    - "heights": `drop_height_m` and `rebound_height_m`, a drop and its first rebound in m;
    - "table": `velocity`, the closing speed in m/s, and `restitution`;
    - "speeds": `velocity` and `rebound_velocity`, the speeds in m/s before and after an impact;
    - "peaks": `height_m`, the heights in m of successive flights of a trial;
    - "force", "acceleration", "indentation": `time` in s and the readings of an instrument in N,
      m/s² or m; several impacts in one record are separated; a record without `time` needs its
      sampling `rate` in Hz;
    - "sound": `time` or a `rate`, and `sound`, its samples in any unit;
    - "track": `y`, the height of a ball over time, and `x`, in m, pixels or any unit, with `time`
      in s, or the number `frame` of the frame and the `rate` in frames per second.

    `ball`, `trial`, `bounce` and the drop height of intervals are optional. Without them there is
    one ball and one trial, with bounces counted in order. `sigma`, the standard deviations of e or
    of intervals, is optional too. Times may be written as mm:ss.cc. Headings are recognised by
    meaning ("v", "COR", "speed (mm/s)", "t_flight / ms"). A unit in a heading is converted, and
    `notes` of the recording say so. Implausible numbers without a unit are refused.

    `source` is a path, an open file, a dict of columns, or a data frame (pandas, polars, or any
    object with `.columns` and `[name]`). Other columns are ignored. None reads the bounce intervals
    that ship with the package. Without `source`, columns may be given by keyword:
    `read_recording(interval_s=[0.42, 0.37, 0.33])`.

    A sound file may be WAV, or FLAC, OGG and MP3 with `pip install 'jaxcontact[sound]'`. The
    detected bounces give intervals with timing errors, each drop a trial. `notes` list doubtful
    sounds, which are not used.

    In a track, parabolas are fitted between the detected impacts, whose times have errors. `notes`
    give the scale and the camera tilt that follow from g, and doubtful impacts.

    A text file may be separated by commas, semicolons, tabs or blanks, in UTF-8, UTF-16 or Latin-1.
    It may have decimal commas, comments (#, %, //) and any line ends. Spreadsheets (.xlsx, .ods)
    and parquet files need `pip install 'jaxcontact[data]'`.

    `ball` chooses a ball by name, which is required if there are several ("blue" by default in the
    shipped data). A sequence of names is the column `ball`, given by keyword. `columns` assigns
    columns by number from 1 or by heading, as in "speed=2,e=5" or {"speed": 2, "e": "COR"}.
    `decimal`, "." or ",", is the decimal mark if the file leaves it ambiguous. `sheet` is the sheet
    of a spreadsheet, by name or by number from 1; sheets with equal headings are trials without it.

    Returns a `Recording`. Raises RecordingError, which names source, row and column, for a file
    that cannot be read; a column that is missing, repeated, not one-dimensional or of another
    length; a row with too many fields; a number that is missing, text, not finite or not positive;
    a repeated bounce; intervals that stay the same or grow; and a ball that does not exist or must
    be chosen. Rows of a file are its lines, including the header; in columns of values they count
    from 1. Raises ValueError for other arguments, including unknown columns among the keywords.
    """
    if layout is not None:
        require_choice("layout", layout, LAYOUTS)
    if decimal is not None:
        require_choice("decimal", decimal, (".", ","))
    meanings = _meanings()
    told = as_told(columns, meanings.values())
    if ball is not None and not isinstance(ball, str):
        if source is not None or not values:
            raise ValueError(
                "Argument `ball` must be the name of one ball in `source`, or a column of names "
                f"beside other columns given by keyword, but is {rendered(ball)}."
            )
        values, ball = {"ball": ball, **values}, None
    if values and told:
        raise ValueError(
            "Argument `columns` must be None where columns are given by keyword, but is "
            f"{rendered(columns)}."
        )
    if (found := sound_in(source)) is not None:
        no_columns = not told and decimal is None
        _check_sound(layout, rate, ball=ball is not None, columns=not no_columns)
        records, layout_used = intervals_in(*found), LAYOUTS["intervals"]
        notes = layout_used.notes(records)
        return Recording(found[0], layout_used, "", tuple(records), notes, records[0].sound)
    if ball is None and source is None and not values:
        ball = _SHIPPED_BALL
    rate = None if rate is None else require_number("rate", rate, POSITIVE)
    read = _read(source, values, layout, told, decimal, rate, sheet, meanings)
    chosen = chosen_ball(ball, [(one.ball, one.row) for one in read.records], read.sheet)
    return read.of(chosen, [record for record in read.records if record.ball == chosen])


def read_recordings(
    source: Any,
    *,
    columns: str | Mapping[str, int | str] | None = None,
    decimal: str | None = None,
    rate: float | None = None,
    sheet: str | int | None = None,
) -> dict[str, Recording]:
    """Read the recordings of all balls in a table, by name; arguments as of `read_recording`."""
    if sound_in(source) is not None:
        raise ValueError("Argument `ball` must be None for a sound, which has no columns.")
    meanings = _meanings()
    told = as_told(columns, meanings.values())
    read = _read(source, {}, None, told, decimal, rate, sheet, meanings)
    balls: dict[str, list[Record]] = {}
    for record in read.records:
        balls.setdefault(record.ball, []).append(record)
    return {ball: read.of(ball, records) for ball, records in balls.items()}


class _Read(NamedTuple):
    """The records of all balls in a source, and how they were read."""

    sheet: Sheet
    layout: Layout[Any]
    found: Match
    records: Sequence[Record]

    def of(self, ball: str, records: Sequence[Record]) -> Recording:
        """Return the recording of one ball, which has these records."""
        sheet, found, layout = self.sheet, self.found, self.layout
        unused = unused_notes(sheet.names, found.places)
        notes = (*found.notes(), *sheet.notes, *layout.notes(records), *unused)
        sound = getattr(records[0], "sound", None)
        return Recording(sheet.source, layout, ball, tuple(records), notes, sound)


def _meanings() -> dict[str, dict[str, Meaning]]:
    """Return the meanings of the columns of each layout."""
    return {one.name: {name: one.meaning(name) for name in one.columns} for one in LAYOUTS.values()}


def _read(
    source: Any,
    values: Mapping[str, Any],
    layout: str | None,
    told: Told,
    decimal: str | None,
    rate: float | None,
    sheet_name: str | int | None,
    meanings: Mapping[str, Mapping[str, Meaning]],
) -> _Read:
    """Read the columns of a file, a data frame, or arrays."""
    every = {name: meaning for one in meanings.values() for name, meaning in one.items()}
    for name in values:
        if name not in every:
            raise ValueError(
                f"Argument `{name}` is no known column; these are {', '.join(every)}."
                f"{did_you_mean(name, every)}"
            )
    sheet = sheet_of(source, values, headings_of(every), decimal, sheet_name)
    # Places that are told are those of the table as it is.
    sheet = sheet if told else as_trials(sheet)
    if rate is not None and not counts_frames([*sheet.names, *told]):
        sheet = with_clock(sheet, rate)
    elif rate is not None:
        sheet = with_frames(sheet, rate)
    sheet = _with_trials(sheet, every, told)
    meant, found = layout_of(sheet, layout, told, meanings)
    if "trial" not in meant.columns and "time" in meant.columns:
        sheet.require_one()
    meant = meant.at_rate(rate)
    rows, left_out = meant.select(found.rows(sheet, meant.columns[-1]))
    sheet = dataclasses.replace(sheet, notes=(*sheet.notes, *left_out))
    records = [] if meant.fitted else meant.read(rows)
    if not sheet.by_keyword:
        check_usual(rows, meanings[meant.name])
    if meant.fitted:  # a long search, so units are checked first
        records = meant.read(rows)
    return _Read(sheet, meant, found, records)


def headings_of(meanings: Mapping[str, Meaning]) -> Callable[[str], bool]:
    """Return a function that tests whether a cell is a heading with one of the meanings."""

    # A text is tested with every separator that it might have, and so are rows of numbers.
    @functools.cache
    def is_heading(text: str) -> bool:
        return _NUMBERS.fullmatch(text) is None and any(
            text == name or meaning.heading(text) or meaning.unknown_unit(text)
            for name, meaning in meanings.items()
        )

    return lambda text: isinstance(text, str) and is_heading(text)


def chosen_ball(ball: str | None, places: Sequence[tuple[str, int]], sheet: Sheet) -> str:
    """Return the ball to use, by name or as the only one; raise RecordingError otherwise.

    `places` are ball and row of each measurement.
    """
    balls = dict.fromkeys(name for name, _ in places)
    named = ", ".join(filter(None, balls))
    if ball is None:
        ball, *others = balls
        if others:
            # By keyword, `ball` is the column.
            how = "give the columns as a dict and " if sheet.by_keyword else ""
            problem = f"holds several balls ({named}); {how}choose one with `ball=`, as in {ball=}"
            row = next(row for name, row in places if name == others[0])
            raise sheet.fault(problem, "ball", row)
    if ball not in balls:
        problem = f"has no ball {ball!r}; it holds {named or 'no named ball'}"
        raise sheet.fault(problem + did_you_mean(ball, balls).rstrip("?"), "ball")
    return ball


def _with_trials(sheet: Sheet, meanings: Mapping[str, Meaning], told: Told) -> Sheet:
    """Return the sheet with the number of its part as trial, if headings are repeated."""
    own = [text for text in [*sheet.names, *told] if meanings["trial"].heading(text)]
    if own and len(sheet.sheets) > 1:
        problem = "numbers trials in each of several sheets; choose one with `sheet=`"
        raise sheet.fault(problem, own[0])
    if not sheet.repeats or own:
        return sheet
    ends = sheet.repeats
    return sheet.beside(
        "trial", lambda _, number: 1 + bisect.bisect(ends, number), "each part is a trial"
    )


def _check_sound(layout: str | None, rate: float | None, *, ball: bool, columns: bool) -> None:
    """Raise ValueError for arguments that do not apply to a sound."""
    given = {"ball": ball, "columns or decimal": columns}
    if layout not in (None, "intervals"):
        problem = f"`layout` must be None or 'intervals' for a sound, but is {rendered(layout)}"
    elif any(given.values()):
        name = next(name for name, there in given.items() if there)
        problem = f"`{name}` must be None for a sound, which has no columns"
    elif rate is not None:
        problem = f"`rate` must be None for a sound, whose file holds it, but is {rendered(rate)}"
    else:
        return
    raise ValueError(f"Argument {problem}.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordedPairs(Pairs):
    """Pairs of a recording.

    `first_row` and `second_row` are the rows of `source` from which a pair was made (equal for one
    row). Reading errors are in `layout.reading_error.unit`. `records` are those of each pair;
    `unpaired` counts the records that make no pair.
    """

    source: str
    layout: Layout[Any]
    ball: str
    first_row: Ints
    second_row: Ints
    records: tuple[tuple[Record, ...], ...]
    flight: Flight
    unpaired: int

    @property
    def words(self) -> tuple[str, str]:
        return self.layout.pair_words

    @property
    def owner(self) -> str:
        return f" of {self.ball}" if self.ball else ""

    @property
    def rule(self) -> str:
        return self.layout.pair_rule

    @property
    def from_flights(self) -> bool:
        return self.layout.uses_flight

    def guess(self, flagged: NDArray[np.bool_], e: float) -> Mapping[int, str]:
        return self.layout.guess(self.records, flagged, e)

    def where(self, keep: NDArray[np.bool_]) -> RecordedPairs:
        records = tuple(itertools.compress(self.records, keep))
        kept = super().where(keep)
        assert isinstance(kept, RecordedPairs)
        return dataclasses.replace(kept, records=records)

    def fault(self, problem: str) -> ValueError:
        last = int(self.second_row.max()) if len(self) else None
        return RecordingError(problem, self.source, last, self.layout.columns[-1])


def make_pairs(recording: Recording, flight: Flight) -> RecordedPairs:
    """Return the pairs in a recording: e = launch speed/landing speed, at the landing speed.

    Speeds follow from the readings by `flight`, unless the layout gives them.
    """
    made = recording.layout.pair(recording.records, flight)
    order = {name: number for number, name in enumerate(dict.fromkeys(made.clusters))}
    fields = made._asdict()
    clusters, records = fields.pop("clusters"), tuple(fields.pop("records"))
    return RecordedPairs(
        **fields,
        source=recording.source,
        layout=recording.layout,
        ball=recording.ball,
        first_row=np.array([some[0].row for some in records], np.int64),
        second_row=np.array([some[-1].row for some in records], np.int64),
        cluster=np.array([order[name] for name in clusters], np.int64),
        cluster_names=tuple(order),
        records=records,
        flight=flight,
    )
