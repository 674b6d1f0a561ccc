"""Recordings of bouncing balls, read from CSV: three column layouts, every fault with its place."""

from __future__ import annotations

import csv
import dataclasses
import importlib.resources
import io
import math
import pathlib
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, NoReturn

Layout = Literal["intervals", "heights", "table"]

COLUMNS: dict[Layout, tuple[str, ...]] = {
    "intervals": ("ball", "drop_height_m", "trial", "bounce", "interval_s"),
    "heights": ("ball", "drop_height_m", "trial", "rebound_height_m"),
    "table": ("velocity", "restitution"),
}
"""The columns each layout needs; a table may also have a column `ball`."""

SHIPPED = "bounce_intervals.csv"
SHIPPED_BALL = "blue"


class RecordingError(ValueError):
    """A fault in a recording, with its file, row (line of the file; the header is 1) and column."""

    def __init__(
        self, problem: str, *, file: str, row: int | None = None, column: str | None = None
    ):
        self.problem, self.file, self.row, self.column = problem, file, row, column
        place = [file]
        if row is not None:
            place.append(f"row {row}")
        if column is not None:
            place.append(f"column {column}")
        super().__init__(f"{', '.join(place)}: {problem}")


@dataclasses.dataclass(frozen=True)
class Interval:
    """Time between impacts `bounce` and `bounce + 1` of one trial; `row`, its line in the file."""

    ball: str
    drop_height: float
    trial: str
    bounce: int
    seconds: float
    row: int


@dataclasses.dataclass(frozen=True)
class Rebound:
    """Height in m of the first rebound after a drop from `drop_height` m."""

    ball: str
    drop_height: float
    trial: str
    height: float
    row: int


@dataclasses.dataclass(frozen=True)
class Point:
    """A restitution measured at a known approach speed in m/s."""

    ball: str
    velocity: float
    restitution: float
    row: int


Record = Interval | Rebound | Point


@dataclasses.dataclass(frozen=True)
class Recording:
    """The rows of one file: `file` is its name in messages, then the layout and the records."""

    file: str
    layout: Layout
    records: tuple[Record, ...]

    @property
    def balls(self) -> tuple[str, ...]:
        """The names in column `ball`, in order of appearance; `("",)` for a table without one."""
        return tuple(dict.fromkeys(record.ball for record in self.records))

    def of_ball(self, ball: str | None) -> tuple[str, tuple[Record, ...]]:
        """The name and the records of one ball; without a name the file must hold only one.

        Raises RecordingError if the ball is not in the file, or if there are several and none was
        named; the message lists them.
        """
        known = ", ".join(self.balls)
        if ball is None:
            if len(self.balls) > 1:
                raise RecordingError(
                    f"holds several balls ({known}); choose one with --ball",
                    file=self.file,
                    row=next(r.row for r in self.records if r.ball != self.balls[0]),
                    column="ball",
                )
            ball = next(iter(self.balls))
        elif ball not in self.balls:
            raise RecordingError(
                f"has no ball {ball!r}; it holds {known or 'no named ball'}",
                file=self.file,
                row=1,
                column="ball",
            )
        return ball, tuple(record for record in self.records if record.ball == ball)


def read_recording(path: str | pathlib.Path | None = None) -> Recording:
    """Read a recording from a CSV file; without a path, the bounce intervals of this package.

    The layout is told by the columns (see `COLUMNS`): successive bounce intervals in s, drop and
    rebound heights in m, or a table of approach speed in m/s and restitution. Other columns are
    ignored. Raises RecordingError for a file that cannot be read, a missing or doubled column, a
    row with too many or too few fields, a number that is text, not finite or not positive, and an
    interval that is there twice.
    """
    if path is None:
        resource = importlib.resources.files("jaxcontact.data") / SHIPPED
        return parse_recording(resource.read_text(encoding="utf-8"), SHIPPED)
    try:
        text = pathlib.Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RecordingError(
            f"cannot be read ({error.strerror or error})", file=str(path)
        ) from error
    except UnicodeDecodeError as error:
        # The bytes before the bad one are good, so its line can be counted.
        row = error.object[: error.start].count(b"\n") + 1
        raise RecordingError("is not UTF-8 text", file=str(path), row=row) from error
    return parse_recording(text, str(path))


def parse_recording(text: str, file: str) -> Recording:
    """The recording in CSV `text`; `file` is its name in messages. Raises as `read_recording`."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines: list[tuple[int, list[str]]] = []
    try:
        for fields in reader:
            lines.append((reader.line_num, fields))
    except csv.Error as error:
        raise RecordingError(
            f"is not a CSV file ({error})", file=file, row=reader.line_num
        ) from error
    lines = [(row, fields) for row, fields in lines if any(field.strip() for field in fields)]
    if not lines:
        raise RecordingError("is empty; a header with the column names is needed", file=file, row=1)
    header_row, header = lines[0]
    names = [name.strip() for name in header]
    layout = _layout(names, file, header_row)
    if len(lines) == 1:
        raise RecordingError(
            "holds a header but no measurement",
            file=file,
            row=header_row,
            column=COLUMNS[layout][-1],
        )
    rows = [_Row(file, row, names, [f.strip() for f in fields]) for row, fields in lines[1:]]
    records = tuple(_READERS[layout](row) for row in rows)
    if layout == "intervals":
        _refuse_doubles([r for r in records if isinstance(r, Interval)], file)
    return Recording(file, layout, records)


def _layout(names: Sequence[str], file: str, row: int) -> Layout:
    for name in names:
        if name and names.count(name) > 1:
            raise RecordingError("is there twice in the header", file=file, row=row, column=name)
    # The layout that lacks least is the one that was meant, and what it lacks is then named,
    # rather than all columns of all layouts.
    shared = {layout: sum(c in names for c in columns) for layout, columns in COLUMNS.items()}
    meant = max(COLUMNS, key=lambda layout: shared[layout] - len(COLUMNS[layout]))
    if "bounce" in names or "interval_s" in names:
        meant = "intervals"
    elif "rebound_height_m" in names:
        meant = "heights"
    if not any(shared.values()):
        choices = "; ".join(", ".join(columns) for columns in COLUMNS.values())
        raise RecordingError(
            f"no known column; the header must hold one of these sets: {choices}",
            file=file,
            row=row,
            column=names[0] or "1",
        )
    for column in COLUMNS[meant]:
        if column not in names:
            raise RecordingError(
                f"is missing; {meant} need the columns {', '.join(COLUMNS[meant])}",
                file=file,
                row=row,
                column=column,
            )
    return meant


@dataclasses.dataclass(frozen=True)
class _Row:
    file: str
    row: int
    names: Sequence[str]
    fields: Sequence[str]

    def __post_init__(self) -> None:
        if len(self.fields) > len(self.names):
            self.refuse(
                self.names[-1],
                f"has {len(self.fields)} fields where the header has {len(self.names)}",
            )

    def refuse(self, column: str, problem: str) -> NoReturn:
        raise RecordingError(problem, file=self.file, row=self.row, column=column)

    def text(self, column: str) -> str:
        place = self.names.index(column)
        if place >= len(self.fields) or not self.fields[place]:
            self.refuse(column, "is empty")
        return self.fields[place]

    def optional(self, column: str) -> str:
        return self.text(column) if column in self.names else ""

    def positive(self, column: str) -> float:
        text = self.text(column)
        try:
            value = float(text)
        except ValueError:
            self.refuse(column, f"{text!r} is not a number")
        if not math.isfinite(value):
            self.refuse(column, f"{text!r} is not a finite number")
        if value <= 0:
            self.refuse(column, f"must be positive, but is {text}")
        return value

    def count(self, column: str) -> int:
        text = self.text(column)
        try:
            value = int(text)
        except ValueError:
            self.refuse(column, f"{text!r} is not a whole number")
        if value < 0:
            self.refuse(column, f"must not be negative, but is {text}")
        return value


def _interval(row: _Row) -> Interval:
    return Interval(
        ball=row.text("ball"),
        drop_height=row.positive("drop_height_m"),
        trial=row.text("trial"),
        bounce=row.count("bounce"),
        seconds=row.positive("interval_s"),
        row=row.row,
    )


def _rebound(row: _Row) -> Rebound:
    return Rebound(
        ball=row.text("ball"),
        drop_height=row.positive("drop_height_m"),
        trial=row.text("trial"),
        height=row.positive("rebound_height_m"),
        row=row.row,
    )


def _point(row: _Row) -> Point:
    return Point(
        ball=row.optional("ball"),
        velocity=row.positive("velocity"),
        restitution=row.positive("restitution"),
        row=row.row,
    )


_READERS: dict[Layout, Callable[[_Row], Record]] = {
    "intervals": _interval,
    "heights": _rebound,
    "table": _point,
}


def _refuse_doubles(intervals: Iterable[Interval], file: str) -> None:
    seen: dict[tuple[str, float, str, int], int] = {}
    for record in intervals:
        key = (record.ball, record.drop_height, record.trial, record.bounce)
        if key in seen:
            raise RecordingError(
                f"bounce {record.bounce} of this trial is in row {seen[key]} already",
                file=file,
                row=record.row,
                column="bounce",
            )
        seen[key] = record.row
