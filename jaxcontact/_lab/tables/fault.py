"""The error of a recording, with its location."""

from __future__ import annotations


class RecordingError(ValueError):
    """A fault in a recording, with its `source`, `row` and `column` (None if not applicable).

    `problem` is the message without the location. In a file `row` is the line, counting the header;
    in columns of values it counts measurements from 1.
    """

    def __init__(
        self, problem: str, source: str, row: int | None = None, column: str | None = None
    ):
        self.problem: str = problem
        self.source: str = source
        self.row: int | None = row
        self.column: str | None = column
        place = [source, f"row {row}" if row else "", f"column {column}" if column else ""]
        super().__init__(f"{', '.join(filter(None, place))}: {problem}")
