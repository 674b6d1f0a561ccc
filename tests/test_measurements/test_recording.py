"""Reading recordings: three layouts, and every fault named with file, row and column."""

import csv
import importlib.resources

import pytest

from jaxcontact._measurements import COLUMNS, RecordingError, parse_recording, read_recording

INTERVALS = "ball,drop_height_m,trial,bounce,interval_s\na,1,1,1,0.4\na,1,1,2,0.36\n"
HEIGHTS = "ball,drop_height_m,trial,rebound_height_m\na,0.5,1,0.4\na,0.5,2,0.41\n"
TABLE = "velocity,restitution\n1.0,0.9\n2.0,0.88\n"
LAYOUTS = {"intervals": INTERVALS, "heights": HEIGHTS, "table": TABLE}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_layout_is_recognised(layout):
    recording = parse_recording(LAYOUTS[layout], "f.csv")
    assert recording.layout == layout
    assert [record.row for record in recording.records] == [2, 3]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_order_of_columns_blanks_and_other_columns_do_not_matter(layout):
    lines = [line.split(",") for line in LAYOUTS[layout].split()]
    changed = "\n\n".join(", ".join([*reversed(line), "x"]) for line in lines)
    plain = parse_recording(LAYOUTS[layout], "f.csv")
    again = parse_recording(changed, "f.csv")
    assert again.layout == layout
    # Rows are lines of the file: the blank lines count.
    assert [record.row for record in again.records] == [3, 5]
    for a, b in zip(plain.records, again.records, strict=True):
        assert {**vars(a), "row": 0} == {**vars(b), "row": 0}


CASES = [(layout, column) for layout, columns in COLUMNS.items() for column in columns]


@pytest.mark.parametrize(("layout", "column"), CASES)
def test_a_missing_column_is_named(layout, column):
    lines = [line.split(",") for line in LAYOUTS[layout].split()]
    place = lines[0].index(column)
    text = "\n".join(",".join(x for k, x in enumerate(line) if k != place) for line in lines)
    with pytest.raises(RecordingError, match=rf"f\.csv, row 1, column {column}: is missing"):
        parse_recording(text, "f.csv")


NUMBERS = {
    "drop_height_m": ("intervals", "heights"),
    "interval_s": ("intervals",),
    "rebound_height_m": ("heights",),
    "velocity": ("table",),
    "restitution": ("table",),
}
BAD_NUMBERS = {
    "abc": "'abc' is not a number",
    "-0.3": "must be positive, but is -0.3",
    "0": "must be positive, but is 0",
    "nan": "'nan' is not a finite number",
    "inf": "'inf' is not a finite number",
    "": "is empty",
}


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("layout", "column"), [(layout, c) for c, where in NUMBERS.items() for layout in where]
)
def test_a_bad_number_is_named(layout, column, bad):
    lines = [line.split(",") for line in LAYOUTS[layout].split()]
    lines[2][lines[0].index(column)] = bad
    text = "\n".join(",".join(line) for line in lines)
    with pytest.raises(RecordingError) as caught:
        parse_recording(text, "f.csv")
    assert str(caught.value) == f"f.csv, row 3, column {column}: {BAD_NUMBERS[bad]}"
    assert (caught.value.row, caught.value.column) == (3, column)


FAULTS = {
    "": "f.csv, row 1: is empty",
    "a,b\n1,2\n": "f.csv, row 1, column a: no known column",
    "velocity,restitution\n": "f.csv, row 1, column restitution: holds a header but no",
    "velocity,velocity\n1,2\n": "f.csv, row 1, column velocity: is there twice",
    TABLE + "3.0\n": "f.csv, row 4, column restitution: is empty",
    TABLE + "3.0,0.8,7\n": "f.csv, row 4, column restitution: has 3 fields",
    INTERVALS + "a,1,1,2,0.3\n": "f.csv, row 4, column bounce: bounce 2 .* row 3",
    INTERVALS + "a,1,1,x,0.3\n": "f.csv, row 4, column bounce: 'x' is not a whole number",
    INTERVALS + "a,1,1,-1,0.3\n": "f.csv, row 4, column bounce: must not be negative",
    'velocity,restitution\n1,"0.9': "f.csv, row 2: is not a CSV file",
}


@pytest.mark.parametrize("text", FAULTS)
def test_a_fault_is_named(text):
    with pytest.raises(RecordingError, match=FAULTS[text].replace("f.csv", r"f\.csv")):
        parse_recording(text, "f.csv")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"none\.csv: cannot be read"):
        read_recording(tmp_path / "none.csv")


def test_bytes_that_are_not_text_are_named(tmp_path):
    path = tmp_path / "bytes.csv"
    path.write_bytes(b"velocity,restitution\n1,0.9\n\xff,1\n")
    with pytest.raises(RecordingError, match=r"bytes\.csv, row 3: is not UTF-8"):
        read_recording(path)


def test_a_byte_order_mark_is_no_fault(tmp_path):
    path = tmp_path / "mark.csv"
    path.write_bytes(b"\xef\xbb\xbf" + TABLE.encode())
    assert len(read_recording(path).records) == 2


def test_a_choice_of_ball_is_needed_where_there_are_several():
    recording = parse_recording(HEIGHTS + "b,0.5,1,0.3\n", "f.csv")
    with pytest.raises(
        RecordingError, match=r"f\.csv, row 4, column ball: holds several balls \(a, b\)"
    ):
        recording.of_ball(None)
    with pytest.raises(RecordingError, match="has no ball 'c'; it holds a, b"):
        recording.of_ball("c")
    name, records = recording.of_ball("a")
    assert name == "a"
    assert [record.row for record in records] == [2, 3]


def test_the_shipped_measurements_are_whole():
    recording = read_recording()
    counts = {ball: len(recording.of_ball(ball)[1]) for ball in recording.balls}
    assert counts == {"pingpong": 445, "blue": 324, "tennis": 22}
    text = (importlib.resources.files("jaxcontact.data") / "rebound_heights.csv").read_text()
    heights = parse_recording(text, "rebound_heights.csv")
    assert heights.layout == "heights"
    assert len(heights.records) == len(list(csv.reader(text.splitlines()))) - 1 == 160
