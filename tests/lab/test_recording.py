"""Reading recordings: layouts, sources, and every fault named with source, row and column."""

import csv
import dataclasses
import importlib.resources
import io
import re

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact._flight import Flight
from jaxcontact._text.words import span
from jaxcontact.lab.layouts.layout import Paired, ReadingError, Record
from jaxcontact.lab.layouts.speeds import STICKS
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.recordings import LAYOUTS, Layout, make_pairs, register_layout
from tests.lab.sources import opened, read

INTERVALS = "ball,drop_height_m,trial,bounce,interval_s\na,1,1,1,0.4\na,1,1,2,0.36\n"
HEIGHTS = "ball,drop_height_m,trial,rebound_height_m\na,0.5,1,0.4\na,0.5,2,0.41\n"
TABLE = "velocity,restitution\n1.0,0.9\n2.0,0.88\n"
PEAKS = "ball,trial,bounce,height_m\na,1,1,0.8\na,1,2,0.6\n"
SPEEDS = "ball,velocity,rebound_velocity\na,1,0.8\na,1.5,1.1\n"
TEXTS = {
    "intervals": INTERVALS,
    "heights": HEIGHTS,
    "table": TABLE,
    "speeds": SPEEDS,
    "peaks": PEAKS,
    "stops": "ball,trial,drop_height_m,rest_time_s\na,1,1,4.1\na,2,1,4.2\n",
}


class Frame:
    """As little of a data frame as is needed."""

    def __init__(self, columns):
        self._columns, self.columns = columns, list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def value(text):
    """What somebody would have in an array for this field."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text or None


def columns_of(text):
    """The columns of the text of a CSV file, as lists of numbers, texts and None."""
    names, *lines = csv.reader(text.split())
    return {n: [value(v) for v in c] for n, c in zip(names, zip(*lines, strict=True), strict=True)}


SOURCES = {
    "dict": jc.read_recording,
    "arrays": lambda columns: jc.read_recording(
        {name: np.array(values) for name, values in columns.items()}
    ),
    "frame": lambda columns: jc.read_recording(Frame(columns)),
    "pandas": lambda columns: jc.read_recording(pd.DataFrame(columns)),
    "nullable": lambda columns: jc.read_recording(pd.DataFrame(columns).convert_dtypes()),
    "keywords": lambda columns: jc.read_recording(**columns),
}


def place(name, row=None, column=None):
    """How a message begins."""
    parts = [name, f"row {row}" if row else "", f"column {column}" if column else ""]
    return ", ".join(filter(None, parts)) + ": "


def error_of(read, *arguments, **how):
    with pytest.raises(jc.RecordingError) as caught:
        read(*arguments, **how)
    return caught.value


def fault(read, *arguments, **how):
    return str(error_of(read, *arguments, **how))


@pytest.mark.parametrize("layout", TEXTS)
def test_each_layout_is_recognised_in_any_order_of_columns(layout):
    text = TEXTS[layout]
    recording = read(text)
    assert recording.layout is LAYOUTS[layout]
    assert recording.source == "f.csv" and len(recording) == 2
    assert [record.row for record in recording.records] == [2, 3]
    # Also with blanks and other columns.
    lines = [line.split(",") for line in text.split()]
    again = read("\n\n".join(", ".join([*reversed(line), "x"]) for line in lines))
    # Rows are lines of the file, including blank lines.
    assert [record.row for record in again.records] == [3, 5]
    for a, b in zip(recording.records, again.records, strict=True):
        assert dataclasses.replace(a, row=0) == dataclasses.replace(b, row=0)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("layout", TEXTS)
def test_every_source_gives_the_same_records(layout, source):
    wanted = read(TEXTS[layout])
    got = SOURCES[source](columns_of(TEXTS[layout]))
    assert (got.layout, got.ball) == (wanted.layout, wanted.ball)
    # Rows of columns count from 1, without a header.
    assert list(got.records) == [dataclasses.replace(r, row=r.row - 1) for r in wanted.records]


def test_files_by_name_by_path_and_open_are_the_same(tmp_path):
    path = tmp_path / "f.csv"
    path.write_text(HEIGHTS)
    with path.open() as stream:
        same = [jc.read_recording(str(path)), jc.read_recording(path), jc.read_recording(stream)]
    assert same[0] == same[1] == same[2] and same[0].source == str(path)
    assert jc.read_recording(io.StringIO(HEIGHTS)).source == "the text"
    assert "none.csv: cannot be read" in fault(jc.read_recording, tmp_path / "none.csv")
    # Bytes, and a byte order mark.
    path.write_bytes(b"\xef\xbb\xbf" + TABLE.encode())
    assert len(jc.read_recording(path)) == 2
    for how in ({"mode": "rb"}, {"encoding": "utf-8"}):
        with path.open(**how) as stream:
            assert len(jc.read_recording(stream)) == 2
    path.write_bytes(b"velocity,restitution\n1,0.9\n\xff,1\n")
    with path.open(encoding="utf-8") as stream:
        message = fault(jc.read_recording, stream)
    assert "f.csv, row 3: is not UTF-8 text; give its path" in message


def test_numbers_keep_every_bit():
    values = np.random.default_rng(0).random(50) + 0.1
    for kept in (values, values.astype(np.float32), jnp.asarray(values), pd.Series(values)):
        recording = jc.read_recording(velocity=kept, restitution=kept)
        got = np.array([record.restitution for record in recording.records])
        np.testing.assert_array_equal(got, np.asarray(kept, dtype=np.float64))


def test_by_keyword_one_trial_is_counted_in_order():
    def told(**columns):
        return [(r.trial, r.bounce) for r in jc.read_recording(**columns).records]

    assert told(interval_s=[0.4, 0.36, 0.33]) == [("1", k) for k in (1, 2, 3)]
    first = jc.read_recording(interval_s=[0.4, 0.36, 0.33]).records[0]
    assert (first.ball, first.drop_height) == ("", None)
    # Whole numbers name trials and bounces, whatever their type.
    ones, twos = [1, 1, 2, 2], np.array([1.0, 2.0, 1.0, 2.0])
    for how in ({"trial": ones}, {"trial": np.array(ones, float), "bounce": twos}):
        trials = told(interval_s=[0.4, 0.36, 0.5, 0.45], **how)
        assert trials == [("1", 1), ("1", 2), ("2", 1), ("2", 2)]
    (record,) = jc.read_recording(drop_height_m=[0.5], rebound_height_m=[0.4]).records
    assert (record.ball, record.trial) == ("", "1")


def test_the_layout_may_be_named():
    both = {**columns_of(INTERVALS), **columns_of(TABLE)}
    assert jc.read_recording(both).layout.name == "intervals"
    recording = jc.read_recording(both, layout="table")
    assert recording.layout.name == "table" and recording.ball == "a"
    missing = "is missing; the layout 'heights' needs"
    message = fault(jc.read_recording, opened(TABLE), layout="heights")
    assert message.startswith(place("f.csv", 1, "drop_height_m") + missing)


CASES = [
    (name, column)
    for name, layout in LAYOUTS.items()
    # Covered by test_records.py, test_tracks.py, test_sound.py and test_files.py.
    if not layout.fitted and name not in ("track", "sound", "instants")
    for column in layout.columns
]


@pytest.mark.parametrize(("layout", "column"), CASES)
def test_a_missing_column_is_named_if_it_is_needed(layout, column):
    columns = columns_of(TEXTS[layout])
    columns.pop(column, None)
    lines = (columns, *zip(*columns.values(), strict=True))
    text = "\n".join(",".join(map(str, line)) for line in lines)
    measured = LAYOUTS[layout].measured
    if column not in measured:
        assert len(read(text)) == 2
        return
    if column != "drop_height_m" and len(measured) == 1:
        return  # the labels alone do not determine the measured quantity
    problem = error_of(jc.read_recording, columns).problem
    # The message names no layout, because none was requested.
    assert "layout" not in problem and column in problem
    assert all(name in problem for name in LAYOUTS[layout].lacking(columns))
    assert "if a column holds it, name it" in problem
    same = fault(read, text).replace("f.csv, row 1", "the dict")
    assert fault(jc.read_recording, columns) == same
    asked = error_of(jc.read_recording, columns, layout=layout).problem
    needs = f"is missing; the layout {layout!r} needs the columns {', '.join(measured)}"
    assert asked.startswith(needs)
    if len(columns) > 1:
        message = fault(jc.read_recording, **columns)
        assert re.match("the columns given, column [a-z_]+: is missing; beside", message)


NUMBERS = {
    "intervals": ("drop_height_m", "interval_s"),
    "heights": ("drop_height_m", "rebound_height_m"),
    "table": ("velocity", "restitution"),
}
BAD_NUMBERS = {
    "abc": "'abc' is not a number",
    "-0.3": "must be positive, but is -0.3",
    "0": "must be positive, but is 0",
    "inf": "'inf' is not a finite number",
    "": "is empty",
}
PREFIX = dict.fromkeys(SOURCES, "the data frame") | {"keywords": "the columns given"}
PREFIX |= dict.fromkeys(("dict", "arrays"), "the dict")


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("layout", "column"), [(layout, c) for layout, names in NUMBERS.items() for c in names]
)
def test_a_bad_number_is_named_whatever_the_source(layout, column, bad):
    lines = [line.split(",") for line in TEXTS[layout].split()]
    lines[2][lines[0].index(column)] = bad
    text = "\n".join(",".join(line) for line in lines)
    problem = BAD_NUMBERS[bad] + (STICKS if (column, bad) == ("restitution", "0") else "")
    error = error_of(read, text)
    assert str(error) == place("f.csv", 3, column) + problem
    assert (error.row, error.column, error.problem) == (3, column, problem)
    for name, source in SOURCES.items():
        assert fault(source, columns_of(text)) == place(PREFIX[name], 2, column) + problem


@pytest.mark.parametrize("missing", [None, np.nan, float("nan"), pd.NA, pd.NaT, ""])
@pytest.mark.parametrize("column", ["ball", "trial", "bounce", "interval_s"])
def test_a_missing_value_is_named(column, missing):
    columns = columns_of(INTERVALS)
    columns[column][1] = missing
    for read_columns in (jc.read_recording, lambda c: jc.read_recording(pd.DataFrame(c))):
        assert fault(read_columns, columns).endswith(f"row 2, column {column}: is empty")


ROW = [1.0, 2.0]
BAD_COLUMNS = [
    ({"velocity": ROW, "restitution": [0.9]}, "restitution: has 1 values where column velocity"),
    ({"velocity": [ROW], "restitution": ROW}, "velocity: must be one-dimensional, but has the"),
    ({"velocity": 1.0, "restitution": 0.9}, "velocity: must be one-dimensional, but has the"),
    ({"velocity": [], "restitution": []}, "restitution: holds columns but no measurement"),
    ({"interval_s": ROW, "bounce": [1, 1]}, "bounce: bounce 1 of this trial is already in row 1"),
    (
        {"drop_height_m": ROW},
        "rebound_height_m: is missing; beside drop_height_m a column rebound_height_m or ",
    ),
    (
        {"velocity": ROW, "restitution": [0.5, 0.6], "ball": ["a", "b"]},
        "ball: holds several balls (a, b); give the columns as a dict and choose one with `ball=`",
    ),
]


@pytest.mark.parametrize(("columns", "message"), BAD_COLUMNS)
def test_bad_columns_are_named(columns, message):
    assert re.match(
        r"the columns given, (row 2, )?column " + re.escape(message),
        fault(jc.read_recording, **columns),
    )


def test_a_frame_may_have_other_columns():
    frame = pd.DataFrame({"velocity": ROW, "restitution": [0.5, 0.6], 3: [object(), [1]]})
    assert len(jc.read_recording(frame)) == 2
    twice = pd.concat([frame, frame], axis=1)
    assert "the data frame, column velocity: appears twice" in fault(jc.read_recording, twice)
    assert "the data frame: no known column" in fault(jc.read_recording, pd.DataFrame())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"speed": ROW}, "Argument `speed` is no known column; these are ball, drop_height_m, "),
        ({"source": {}, "velocity": ROW}, "Argument `source` must be None where columns are given"),
        ({"source": {}, "ball": ["a"]}, "Argument `ball` must be the name of one ball in `source`"),
    ],
)
def test_bad_arguments_raise(arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        jc.read_recording(**arguments)
    assert caught.type is ValueError


def test_a_choice_of_ball_is_needed_where_there_are_several():
    text = HEIGHTS + "b,0.5,1,0.3\n"
    several = "holds several balls (a, b); choose one with `ball=`, as in ball='a'"
    assert fault(read, text) == place("f.csv", 4, "ball") + several
    assert fault(jc.read_recording, columns_of(text)) == place("the dict", 3, "ball") + several
    none = place("f.csv", 1, "ball") + "has no ball 'c'; it holds a, b"
    assert fault(read, text, ball="c") == none
    assert "has no ball 'c'; it holds no named ball" in fault(read, TABLE, ball="c")
    recording = read(text, ball="a")
    assert recording.ball == "a"
    assert [record.row for record in recording.records] == [2, 3]
    assert read(HEIGHTS).ball == "a"


def test_the_shipped_measurements_are_whole():
    assert jc.read_recording().ball == "blue"
    counts = {ball: len(jc.read_recording(ball=ball)) for ball in ("pingpong", "blue", "tennis")}
    assert counts == {"pingpong": 445, "blue": 324, "tennis": 22}
    path = importlib.resources.files("jaxcontact.data") / "rebound_heights.csv"
    heights = [jc.read_recording(str(path), ball=ball) for ball in counts]
    assert {one.layout.name for one in heights} == {"heights"}
    rows = len(list(csv.reader(path.read_text().splitlines()))) - 1
    assert sum(map(len, heights)) == rows == 160


def test_a_recording_prints_itself():
    assert repr(jc.read_recording()).splitlines() == [
        "Recording",
        "  source       bounce_intervals.csv (shipped with the package)",
        "  layout       intervals",
        "  ball         blue",
        "  rows         324",
        "  trials       30",
        "  intervals    0.113 to 0.878 s",
    ]
    assert "drop heights 1, 0.5 m\n  rebounds     0.4 to 0.41 m" in repr(read(HEIGHTS))
    assert "ball         (no name)" in repr(read(TABLE))
    assert "speeds       1 to 2 m/s\n  restitutions 0.88 to 0.9" in repr(read(TABLE))


# A layout defined outside the package works without further changes.


@dataclasses.dataclass(frozen=True)
class Gate(Record):
    before: float
    after: float


class Gates(Layout):
    """Speeds in m/s that light gates read before and after an impact."""

    name = "gates"
    columns = ("operator", "drop_speed", "rebound_speed")
    measured = ("drop_speed", "rebound_speed")
    reading_error = ReadingError("m/s", "mm/s", 1e3, "each speed")
    uses_flight = False
    made_of = "readings of two gates"
    pair_words = ("pair of gates", "pairs of gates")
    cluster_words = ("operator", "operators")
    pair_rule = "each row is a pair"
    errors_words = "by operator"

    def read(self, rows):
        for row in rows:
            if row.positive("rebound_speed") > 10:
                row.refuse("rebound_speed", "is faster than the gate can read")
        return [
            Gate("", row.number, row.positive("drop_speed"), row.positive("rebound_speed"))
            for row in rows
        ]

    def facts(self, records):
        return {"speeds": span([record.before for record in records], "m/s")}

    def pair(self, records, flight):
        before, after = np.array([(r.before, r.after) for r in records]).T
        return Paired(
            velocity=before,
            restitution=after / before,
            reading_factor=before**-2 + after**-2,
            clusters=[f"operator {k % 2}" for k in range(len(records))],
            records=[(record,) for record in records],
        )

    def guess(self, records, flagged, e):
        return {int(k): "a hand in the gate" for k in np.flatnonzero(flagged)}


@pytest.fixture
def gates():
    layout = Gates()
    register_layout(layout)
    yield layout
    del LAYOUTS["gates"]


def gate_columns(n=12):
    speed = np.linspace(1, 4, n)
    return {"drop_speed": speed, "rebound_speed": speed * (0.8 + 0.01 * np.sin(np.arange(n)))}


def test_it_is_read_and_paired(gates):
    read = gate_columns(13)
    read["rebound_speed"][5] = 0.2
    recording = jc.read_recording(**read)
    assert recording.layout is gates
    assert "layout       gates" in repr(recording) and "speeds       1 to 4 m/s" in repr(recording)
    pairs = make_pairs(recording, Flight())
    np.testing.assert_array_equal(pairs.restitution, read["rebound_speed"] / read["drop_speed"])
    assert pairs.cluster_names == ("operator 0", "operator 1")
    assert pairs.layout.reading_error.unit == "m/s"
    assert find_outliers(pairs).guess == {5: "a hand in the gate"}


def test_its_faults_are_named(gates):
    with pytest.raises(ValueError, match="must have a new name, but is 'gates'"):
        register_layout(Gates())
    bad = gate_columns()
    bad["rebound_speed"][3] = 11
    with pytest.raises(jc.RecordingError, match="row 4, column rebound_speed: is faster than"):
        jc.read_recording(**bad)
    assert len(jc.read_recording(gate_columns())) == 12
    del bad["rebound_speed"]
    with pytest.raises(
        jc.RecordingError,
        match="column rebound_speed: is missing; beside drop_speed a column rebound_speed",
    ):
        jc.read_recording(bad)
    few = make_pairs(jc.read_recording(**gate_columns(1)), Flight())
    with pytest.raises(jc.RecordingError, match="1 usable pair of gates, but at least 4"):
        few.needs_enough()
