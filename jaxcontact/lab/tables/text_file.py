"""Tables in text files: encoding, column separator, comments and decimal commas.

The choice depends on the number of known headings and numbers that a reading gives, not on
frequencies of characters: `csv.Sniffer` takes the decimal comma of "0,5;0,8" for a separator.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from .grid import Known, grid_of, is_number, known_cells, with_points
from .sheet import Line, RecordingError, Sheet, seconds_in, sheet_of_rows

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_COMMENT = re.compile(r'\s*"?(#|%|//)')
_ENOUGH = 400
"""Lines from which the separator is chosen."""

_SEPARATORS = {"\t": "tabs", ";": "semicolons", "|": "bars", ",": "commas", " ": "blanks"}


def decoded(data: bytes, source: str) -> tuple[str, str]:
    """Return the text in bytes, and the name of its encoding, "" for UTF-8.

    UTF-16 is detected by its byte order mark or its zeros. Other bytes that are not UTF-8 are read
    as Windows-1252, which includes Latin-1. Raises RecordingError for bytes that are not text.
    """
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), "")
    if not encoding and b"\0" in data[:200]:
        # One byte of most characters in UTF-16 is zero: the second in little endian.
        little = data[1:200:2].count(0) > data[0:200:2].count(0)
        encoding = "utf-16-le" if little else "utf-16-be"
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if not encoding:
            return data.decode("cp1252", errors="replace"), "Latin-1"
        row = data[: error.start].count(b"\n") + 1
        raise RecordingError(f"is not {encoding.upper()} text", source, row) from error
    if encoding and any(ord(c) < 9 for c in text[:200]):
        raise RecordingError("is neither text nor a spreadsheet", source)
    return text, "UTF-16" if "16" in encoding else ""


class _Reading(NamedTuple):
    """One way to read a text: its rows, its score, and the error that stopped it, if any."""

    separator: str
    rows: list[Line]
    score: tuple[int, float]
    error: RecordingError | None = None


def text_grid(
    text: str, source: str, known: Known, decimal: str | None, notes: Sequence[str]
) -> Sheet:
    """Return the table in a text; raise RecordingError if it cannot be read unambiguously."""
    lines = text.removeprefix("\ufeff").splitlines(keepends=True)
    named = re.fullmatch(r"sep=(.)\s*", lines[0]) if lines else None
    if named:
        lines[0] = "\n"  # Excel writes its separator like this
    comments = [k for k, line in enumerate(lines) if _COMMENT.match(line)]
    data = list(lines)
    for k in comments:
        data[k] = "\n"
    if not any(line.strip(" \t\r\n,;|") for line in data):
        raise RecordingError("is empty; a header with the column names is needed", source, 1)
    allowed = [named[1]] if named else [s for s in _SEPARATORS if s != "," or decimal != ","]
    separator, rows = _best_reading(data, allowed, source, known)
    if separator == ",":
        _one_number_or_two(rows, source, known, decimal)
    above = [k for k in comments if rows and k + 1 < rows[0][0]]
    if above and not any(known_cells(cells, known) for _, cells in rows):
        # The last comment above the numbers may be the heading (`numpy.savetxt`).
        words = _COMMENT.sub("", lines[above[-1]]).strip().strip('"')
        heading = [cells for _, cells in _split([words], separator or " ", source)[0]]
        rows = [*((above[-1] + 1, cells) for cells in heading if known_cells(cells, known)), *rows]
    rows, commas = with_points(rows, source, decimal, apart=separator == ",")
    if separator not in ("", ","):
        notes = [*notes, f"separated by {_SEPARATORS.get(separator, repr(separator))}"]
    notes = [*notes, *["with decimal commas"] * commas]
    if (found := _labels(rows)) is not None:
        return sheet_of_rows(
            source, found[0], None, found[1], [*notes, "labels of an audio editor"]
        )
    return grid_of(rows, known, source, notes)


def _best_reading(
    data: list[str], separators: Sequence[str], source: str, known: Known
) -> tuple[str, list[Line]]:
    """Return the most fitting separator, "" without one, and the rows; raise their error."""
    # The beginning of a long file decides.
    readings = [_reading(data[:_ENOUGH], separator, source, known) for separator in separators]
    best = max(readings, key=lambda one: one.score)
    if best.score[1] == 0:
        # There is one column with every separator.
        return "", [
            (k, [line.strip().strip('"')]) for k, line in enumerate(data, 1) if line.strip()
        ]
    rows, error = best.rows, best.error
    if len(data) > _ENOUGH:
        rows, error = _split(data, best.separator, source)
    if error:
        raise error
    return best.separator, rows


def _labels(rows: list[Line]) -> tuple[list[str], list[Line]] | None:
    """Return the columns of audio labels: times in s, ends of ranges, if any, and texts.

    Audacity writes "0.52, 0.52, bounce", for some labels with a line of frequencies after a
    backslash.
    """
    made: list[Line] = []
    for row, cells in rows:
        if cells[0] == "\\":
            continue
        times = list(itertools.takewhile(is_number, cells))
        texts = cells[len(times) :]
        if not 1 <= len(times) <= 2 or len(texts) > 1 or any(map(is_number, texts)):
            return None
        try:
            made.append((row, [*map(seconds_in, times), *(texts or [""])]))
        except ValueError:  # 5, is not a number
            return None
    if len({len(cells) for _, cells in made}) != 1:
        return None
    ranges = len(made[0][1]) == 3
    lasting = [cells[1] - cells[0] for _, cells in made] if ranges else [1.0]
    growing = all(b[1][0] > a[1][0] for a, b in itertools.pairwise(made))
    named = any(cells[-1] for _, cells in made) or not any(lasting)
    if not growing or min(lasting) < 0 or not named:
        return None
    return ["start time", *["end of label"] * ranges, "label"], made


def _reading(data: list[str], separator: str, source: str, known: Known) -> _Reading:
    rows, error = _split(data, separator, source)
    widths = Counter(len(cells) for _, cells in rows if any(map(is_number, cells)))
    heading = max((known_cells(cells, known) for _, cells in rows), default=0)
    if not widths:  # only words, which blanks separate in any text
        width = max((len(cells) for _, cells in rows), default=0)
        share = 0.5 * (width > 1) * (heading > 0) * (separator != " ")
        return _Reading(separator, rows, (0, share), error)
    width = widths.most_common(1)[0][0]
    if width < 2:
        return _Reading(separator, rows, (heading > 0, 0.0), error)
    headings = [len(cells) for _, cells in rows if known_cells(cells, known) == heading > 0]
    # With one heading above two numbers, commas are decimal. With more words than numbers, blanks
    # separate the words of a heading.
    if headings and (headings[0] == 1 if separator == "," else headings[0] > width):
        return _Reading(separator, rows, (0, 0.0), error)
    good = [cells for _, cells in rows if len(cells) == width and any(map(is_number, cells))]
    share = sum(is_number(cell) for cells in good for cell in cells) / max(
        1, sum(len(cells) for _, cells in rows)
    )
    order = list(_SEPARATORS).index(separator) if separator in _SEPARATORS else 0
    return _Reading(separator, rows, (heading > 0, 1 + share - 1e-6 * order), error)


def _split(
    data: list[str], separator: str, source: str
) -> tuple[list[Line], RecordingError | None]:
    """Return the rows that are not blank, and the error that ended them, if any."""
    if separator == " ":
        data = list(map(_blanks, data))
    stream = io.StringIO("".join(data), newline="")
    reader = csv.reader(stream, delimiter=separator, strict=True, skipinitialspace=True)
    rows: list[Line] = []
    try:
        for fields in reader:
            cells = [field.strip() for field in fields]
            if any(cells):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        return rows, RecordingError(f"is not a CSV file ({error})", source, reader.line_num)
    return rows, None


def _blanks(line: str) -> str:
    """Return a blank-separated line with single blanks, and units joined to their words."""
    parts = line.split()
    if all(map(is_number, parts)):
        return " ".join(parts) + "\n"
    text = re.sub(r"\s+(?=[\[(])", "", line.strip())
    text = re.sub(r"\s*/\s*", "/", text)
    if re.search(r"\S\s{2,}\S", text):
        parts = [part.strip('"') for part in re.split(r"\s{2,}|\t", text)]
        text = " ".join(f'"{part}"' if " " in part else part for part in parts)
    return re.sub(r"[ \t]+", " ", text) + "\n"


def _one_number_or_two(rows: list[Line], source: str, known: Known, decimal: str | None) -> None:
    """Refuse "0,8" without a heading: one number with a decimal comma, or two."""
    if decimal is not None or any(known_cells(cells, known) for _, cells in rows):
        return
    whole = all(re.fullmatch(r"\d+", cell) for _, cells in rows for cell in cells)
    if whole and all(len(cells) == 2 for _, cells in rows):
        row, (left, right) = rows[0]
        raise RecordingError(
            f"'{left},{right}' may be one number, {left}.{right}, or two, {left} and {right}; say "
            'which with `decimal=","` or `decimal="."`',
            source,
            row,
        )
