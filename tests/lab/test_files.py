"""Files as people save them: each is read correctly."""

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
    "of a force plate": ("abs time (s);Fx;Fy;Fz\ns;N;N;N\n", "Fz [N]"),
    "with moments": ("time;Mx;My;Fz\ns;N m;Nm;kN\n", "Fz [kN]"),
    "above the headings": ("s;N;N;N\ntime;Fx;Fy;Fz\n", "Fz [N]"),
    "unknown words between": ("time;a1;a2;Fz\n[s];[V];[V];[N]\n", "Fz [N]"),
}


@pytest.mark.parametrize("case", UNITS)
def test_a_row_of_units_is_no_heading(case):
    from jaxcontact.lab.recordings import read_columns

    head, wanted = UNITS[case]
    body = lines("", FORCES, ";", number=german)
    read = read_columns(io.StringIO(head.rstrip("\n") + body), ("time", "force"), needed=("time",))
    assert read.values["force"].size == 30
    assert read.values["force"].max() == (6000 if "kN" in wanted else 6)
    assert wanted in " ".join(read.notes) or wanted == "Fz [N]"


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
