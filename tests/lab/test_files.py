"""Files as people save them: each is read correctly, or refused with advice."""

import io
import re
from pathlib import Path

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.recordings import LAYOUTS
from tests.lab.sources import german, lines, open_document, parquet, refused, workbook, written

V, E = (1.0, 2.0, 2.5), (0.9, 0.85, 0.8)
ROWS = list(zip(V, E, strict=True))
KMH = [(3.6 * v, 100 * e) for v, e in ROWS]
MM_S = [(1000 * v, e) for v, e in ROWS]
NOTE = '"Messung Höhe 3"'
# name, content, expected notes
TABLES = {
    "plain.csv": (lines("velocity,restitution", ROWS), ""),
    "excel_german.csv": (
        b"\xef\xbb\xbf" + lines("v [km/h];COR (%)", KMH, ";", "\r\n", german).encode(),
        'velocity = "v [km/h]" / 3.6; restitution = "COR (%)" / 100; separated by semicolons; '
        "with decimal commas",
    ),
    "tabs_utf16.txt": (
        lines("Impact velocity\te", ROWS, "\t", "\r\n").encode("utf-16"),
        'velocity = "Impact velocity"; restitution = "e"; UTF-16; separated by tabs',
    ),
    "latin1.csv": (
        ("# Höhe über Tisch\n\n" + lines("speed (mm/s),e", MM_S)).encode("latin-1"),
        'velocity = "speed (mm/s)" / 1000; restitution = "e"; Latin-1',
    ),
    "savetxt.dat": (
        lines("# v e", ROWS, " ", number="{:.18e}".format),
        'velocity = "v"; restitution = "e"; separated by blanks',
    ),
    "aligned.txt": (
        "% by hand\nVelocity [m/s]   Coefficient of restitution\n"
        + "".join(f"  {v:8.3f}     {e:6.3f}\n" for v, e in ROWS),
        'velocity = "Velocity[m/s]"; restitution = "Coefficient of restitution"; separated by '
        "blanks",
    ),
    "instrument.csv": (
        'Device,XY 3\nDate,"24.11.2026"\n' + lines("No,Speed,COR", [], ",") + "-,mm/s,-\n"
        "1,1000,0.9\n2,2000,0.85\n3,2500,0.8\n",
        'velocity = "Speed [mm/s]" / 1000; restitution = "COR [-]"; rows 1 to 2 above the '
        "headings left out",
    ),
    "quotes.csv": (
        '"Speed, closing","velocity","restitution","note"\n'
        + "".join(f'"9","{v}","{e}",{NOTE}\n' for v, e in ROWS),
        "",
    ),
    "excel_hint.csv": (
        "sep=;\n" + lines("speed;cor", ROWS, ";"),
        'velocity = "speed"; restitution = "cor"; separated by semicolons',
    ),
    "book.xlsx": (
        workbook(("About", [["my ball"]]), ("Data", [["Lab 3"], [], ["v / (m/s)", "e"], *ROWS])),
        'velocity = "v / (m/s)"; restitution = "e"; '
        "sheet 'Data'; not read: 'About'; row 1 above the headings left out",
    ),
    "calc.ods": (
        open_document([("v [mm/s]", "e"), *MM_S]),
        'velocity = "v [mm/s]" / 1000; restitution = "e"',
    ),
    "frame.parquet": (
        parquet({"speed_mm_s": 1000 * np.array(V), "e": E}),
        'velocity = "speed_mm_s" / 1000; restitution = "e"',
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_as_what_it_means(name, tmp_path):
    content, notes = TABLES[name]
    recording = jc.read_recording(written(tmp_path, name, content))
    assert recording.layout.name == "table"
    got = [(record.velocity, record.restitution) for record in recording.records]
    # Converted numbers have one more rounding than those written here.
    np.testing.assert_allclose(got, ROWS, rtol=1e-15)
    assert "; ".join(recording.notes) == notes


MILLISECONDS = "t_flight / ms\n420\n360\n310\n"
OTHERS = {
    "intervals": (MILLISECONDS, "interval_s", [0.42, 0.36, 0.31]),
    "peaks": ("h\n0,8\n0,6\n0,45\n", "height_m", [0.8, 0.6, 0.45]),
    "speeds": ("v_in;v_out (mm/s)\n1;900\n2;1700\n", "rebound_velocity", [0.9, 1.7]),
    "heights": ("h0;h1 [cm]\n0,8;60\n0,8;62\n", "rebound_height_m", [0.6, 0.62]),
}


@pytest.mark.parametrize("layout", OTHERS)
def test_other_layouts(layout, tmp_path):
    text, column, numbers = OTHERS[layout]
    recording = jc.read_recording(written(tmp_path, "f.csv", text))
    assert recording.layout is LAYOUTS[layout]
    got = [next(reversed(vars(record).values())) for record in recording.records]
    assert got == numbers
    assert any(note.startswith(column) for note in recording.notes)


def test_what_the_columns_are_may_be_said(tmp_path):
    bare = written(tmp_path, "bare.txt", lines("1 1 0.9", [(2, 2, 0.85), (3, 2.5, 0.8)], " "))
    for told in ("speed=2,e=3", {"velocity": 2, "cor": 3}):
        records = jc.read_recording(bare, columns=told).records
        assert [(r.velocity, r.restitution) for r in records] == ROWS
    odd = written(tmp_path, "odd.csv", lines("Tempo,mm/s,Stosszahl", [(1, 1000, 0.9)]))
    told = {"speed [mm/s]": "mm/s", "e": "Stosszahl"}
    (record,) = jc.read_recording(odd, columns=told).records
    assert (record.velocity, record.restitution) == (1.0, 0.9)
    lone = written(tmp_path, "lone.csv", ".8\n.6\n.45\n")
    assert jc.read_recording(lone, columns="interval=1").layout.name == "intervals"
    assert jc.read_recording(lone, columns="h=1").layout.name == "peaks"
    # With a time beside it a height is a place of a track, unless it is said to be a peak.
    timed = {"time": [0.4, 1.2, 1.9, 2.4], "height (m)": [1, 0.64, 0.41, 0.26]}
    assert jc.read_recording(timed, columns={"height_m": 2}).layout.name == "peaks"
    with pytest.raises(ValueError, match=r"names 'sped', .* did you mean 'speed'\?"):
        jc.read_recording(odd, columns="sped=1,e=2")
    with pytest.raises(ValueError, match="must name columns of one layout, but names speed, h0"):
        jc.read_recording(odd, columns="speed=1,h0=2")


def test_what_is_written_is_believed(tmp_path):
    path = written(tmp_path, "f.csv", "v [mm/s];e\n1,500;0.9\n")
    for decimal, velocity in ((",", 0.0015), (".", 1.5)):
        assert jc.read_recording(path, decimal=decimal).records[0].velocity == velocity
    fast = written(tmp_path, "f.csv", "v [m/s],e\n1500,0.9\n2000,0.8\n")
    assert jc.read_recording(fast).records[0].velocity == 1500
    # By keyword the documented unit applies.
    assert len(jc.read_recording(velocity=[1500.0, 2000.0], restitution=[0.9, 0.8])) == 2


def test_the_beginning_of_a_long_file_decides(tmp_path):
    text = "v;e\n" + "".join(f"{1 + k % 7};0,{80 + k % 10}\n" for k in range(1000))
    recording = jc.read_recording(written(tmp_path, "long.csv", text))
    assert len(recording) == 1000 and recording.records[-1].row == 1001
    refused("row 1002, column e: is empty", written(tmp_path, "long.csv", text + "3\n"))


def test_what_people_write_around_a_table(tmp_path):
    head = "Run label,interval\n"
    text = head + "x,.5\nx,.45\nx,.4\n" + head + "x,.5\nx,.44\nMean,.46\nS.D.,.01\n"
    recording = jc.read_recording(written(tmp_path, "f.csv", text))
    places = [(r.trial, r.bounce) for r in recording.records]
    assert places == [("1", 1), ("1", 2), ("1", 3), ("2", 1), ("2", 2)]
    headings = "headings repeated in row 5 left out; rows 8 to 9 below the measurements left out"
    assert headings in "; ".join(recording.notes)
    rows = jc.read_recording(io.StringIO("v,e\n1,.9\n2,.8\nend of data\n"))
    assert len(rows) == 2


FORCES = [(k * 1e-3, 0.1, 0.2, float(k % 7)) for k in range(30)]
UNITS = {
    "of a force plate": ("abs time (s);Fx;Fy;Fz\ns;N;N;N\n", 6),
    "with moments": ("time;Mx;My;Fz\ns;N m;Nm;kN\n", 6000),
    "above the headings": ("s;N;N;N\ntime;Fx;Fy;Fz\n", 6),
    "unknown words between": ("time;a1;a2;Fz\n[s];[V];[V];[N]\n", 6),
}


@pytest.mark.parametrize("case", UNITS)
def test_a_row_of_units_is_no_heading(case):
    from jaxcontact.lab.recordings import read_columns

    head, most = UNITS[case]
    body = lines("", FORCES, ";", number=german)
    read = read_columns(io.StringIO(head.rstrip("\n") + body), ("time", "force"), needed=("time",))
    assert read.values["force"].size == 30
    assert read.values["force"].max() == most
    assert ("Fz [kN]" in " ".join(read.notes)) == (most == 6000)


@pytest.mark.parametrize("apart", [True, False])
def test_marks_of_numbers_are_told_in_linear_time(apart):
    """No row is compared with the rows before it."""
    from jaxcontact.lab.tables.grid import with_points

    compared = []

    class Number(int):
        __hash__ = int.__hash__

        def __eq__(self, other):
            compared.append(self)
            return int(self) == other

    cells = ["1,234.5", "2.5"] if apart else ["0,25", "1,5"]
    rows = [(Number(k), list(cells)) for k in range(2000)]
    found, commas = with_points(rows, "f", "." if apart else None, apart=apart)
    assert len(compared) <= len(rows) and commas == (not apart)
    assert found[-1][1] == (["1234.5", "2.5"] if apart else ["0.25", "1.5"])


TABLE = "velocity,restitution\n1.0,0.9\n2.0,0.88\n"
INTERVALS = "bounce,interval_s\n1,.4\n2,.36\n"
REFUSED = {
    "0.8\n0.6\n0.45\n": r"row 1: one column without a header may hold heights of successive "
    r"flights in m \(then e is about 0.87\) or intervals between impacts in s "
    r'\(then e is about 0.75\); choose with `columns="height=1"` or `columns="interval=1"`',
    "1,0.9\n2,0.8\n": r"row 1: has 2 columns and no header; name them, as in",
    "0,8\n0,6\n": r"row 1: '0,8' may be one number, 0.8, or two, 0 and 8; say which with",
    "v;e\n1,5;0.9\n": r"row 2: '0.9' has a decimal point, and '1,5' in row 2 a decimal comma",
    "v;e\n1,500;9,001\n": r"row 2: '1,500' may be 1.500 or 1500; say which with `decimal=",
    "v,e\n1,5,0,9\n": r"row 2, column e: has 4 fields .* are its commas decimal\?",
    "velocty,e\n1,0.9\n": r"row 1, column velocity: is missing; .*; is it 'velocty'\?",
    "speeed\n1\n": r"row 1, column speeed: no known column; .*; did you mean 'speed'\?",
    "v,e\n1500,0.9\n2000,0.8\n": r"row 2, column v: half of the values are 1750 or more, "
    r"in m/s impacts faster than 200 m/s; are they in mm/s\? write the unit .*, 'v \[mm/s\]'",
    "h\n80\n60\n45\n": r"row 2, column h: half of the values are 60 or more, .* 'h \[cm\]', or 'h",
    "h0,h1\n0.8,60\n0.7,50\n": r"row 2, column h1: balls rise to .* in cm\? then divide by 100",
    "v in,v out\n.9,1.8\n": r"column v out: balls leave 2 times as fast as they came .*exchanged",
    "dt\n420\n360\n": r"row 2, column dt: .* are they in ms\? then divide by 1000, or write",
    "v,e\n1,90\n2,85\n": r"row 2, column e: .* in percent\? then divide by 100, or write .*'e \[%",
    "v,speed,e\n1,1,0.9\n": r"row 1, column speed: may be velocity, as may column v; choose one",
    "v [knots],e\n1,0.9\n": r"row 1, column v \[knots\]: 'knots' is an unknown unit for velocity",
    "v,e\n1 m/s,0.9\n": r"row 2, column v: '1 m/s' is not a number; write the unit in",
    "bounce,interval\n1,.4\n2,.3\n1,.4\n": r"row 4, column bounce: .*; name the trials in a column",
    "h\n.3\n.5\n.8\n": r"row 2, column h: balls rise to 1.63 times the height before",
    "v;e\n1;90%\n": r"row 2, column e: '90%' is not a number; write the unit in",
    "t,h\n0,1\n.1,.9\n": r"column h: is a track of 2 frames, too few .*; if these are heights of "
    r'successive flights, say so with `columns="height_m=\.\.\."`',
    "intervalls\n.4\n": r"no known column; .*; did you mean 'interval_s'\?",
    "5,\tbounce\n6,\tbounce\n": "row 1: has 2 columns and no header; name them",
    "": "row 1: is empty",
    "a,b\n1,2\n": "row 1, column a: no known column; one of these sets is needed: interv",
    "velocity,restitution\n": "row 1, column restitution: holds a header but no measurement",
    "velocity,velocity\n1,2\n": "row 1, column velocity: appears twice",
    f"{TABLE}3.0\n": "row 4, column restitution: is empty",
    f"{TABLE}3.0,0.8,7\n": "row 4, column restitution: has 3 fields where the header has 2",
    f"{TABLE}1,nan\n": "row 4, column restitution: 'nan' is not a finite",
    f"{INTERVALS}2,.3\n": "row 4, column bounce: bounce 2 of this trial is already in row",
    f"{INTERVALS}x,.3\n": "row 4, column bounce: 'x' is not a whole number",
    f"{INTERVALS}1.5,.3\n": "row 4, column bounce: '1.5' is not a whole number",
    f"{INTERVALS}-1,.3\n": "row 4, column bounce: must not be negative, but is -1",
    'velocity,restitution\n1,"0.9': r"row 2: is not a CSV file \(",
    b"%PDF-1.7": "is a PDF; save the table as CSV",
    b"\x1f\x8b\x08": "is compressed",
    b"PK\x03\x04": "is a spreadsheet that cannot be read",
    b"PAR1": "is a parquet file that cannot be read",
    b"v,e\n1,\xff\n": "row 2, column e: 'ÿ' is not a number",
}


@pytest.mark.parametrize("content", REFUSED)
def test_what_is_refused_says_why_and_what_to_do(content, tmp_path):
    path = written(tmp_path, "f.csv", content)
    with pytest.raises(jc.RecordingError, match=REFUSED[content]) as caught:
        jc.read_recording(path)
    assert str(caught.value).startswith(f"{path}")


def test_units_alone_are_no_header():
    with pytest.raises(jc.RecordingError, match="row 2: has 2 columns and no header; name"):
        jc.read_recording(io.StringIO("m/s;-\n1;0,9\n2;0,8\n"))
    told = jc.read_recording(io.StringIO("mm/s;-\n1000;0,9\n2000;0,8\n"), columns="v=1,e=2")
    assert [r.velocity for r in told.records] == [1, 2]


def test_the_page_shows_what_happens(capsys):
    text = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (shown,) = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    exec(code, {})
    assert capsys.readouterr().out == shown
    table = [line.split("|") for line in text.splitlines() if line.startswith("| `")]
    # The columns of oblique impacts are in another table.
    rows = [row for row in table if row[1].strip(" `") in LAYOUTS]
    for row in rows:
        layout = LAYOUTS[row[1].strip(" `")]
        assert tuple(re.findall(r"`(\w+)`", row[2])) == layout.measured
        assert {*re.findall(r"`(\w+)`", row[2] + row[3])} == {*layout.columns}
        for heading in re.split(r"[,;] ", re.sub(r":.*", "", row[4]).strip()):
            assert any(layout.meaning(column).heading(heading) for column in layout.columns)
    assert len(rows) == len(LAYOUTS)
