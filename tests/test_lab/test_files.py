"""Files as people save them: each is read correctly, or refused with advice."""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact._lab.recordings import LAYOUTS

V, E = (1.0, 2.0, 2.5), (0.9, 0.85, 0.8)
ROWS = list(zip(V, E, strict=True))


def german(x):
    return f"{x:g}".replace(".", ",")


def lines(head, rows, between=",", end="\n", number="{:g}".format):
    return end.join([head, *(between.join(map(number, row)) for row in rows), ""])


def workbook(*sheets):
    """A spreadsheet as openpyxl writes it; the library reads it with another one."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets:
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def open_document(rows):
    """A spreadsheet of LibreOffice, as small as it may be; its numbers are in German."""
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    name = "urn:oasis:names:tc:opendocument:xmlns"

    def cell(value):
        if isinstance(value, str):
            return (
                f'<table:table-cell office:value-type="string"><text:p>{value}</text:p>'
                "</table:table-cell>"
            )
        return (
            f'<table:table-cell office:value-type="float" office:value="{value}"><text:p>'
            f"{german(value)}</text:p></table:table-cell>"
        )

    body = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    content = (
        f'<office:document-content xmlns:office="{name}:office:1.0" '
        f'xmlns:table="{name}:table:1.0" xmlns:text="{name}:text:1.0"><office:body>'
        f'<office:spreadsheet><table:table table:name="Data">{body}</table:table>'
        "</office:spreadsheet></office:body></office:document-content>"
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr("mimetype", kind)
        file.writestr("META-INF/manifest.xml", f'<manifest xmlns="{name}:manifest:1.0"/>')
        file.writestr("content.xml", content)
    return stream.getvalue()


def parquet(columns):
    stream = io.BytesIO()
    pd.DataFrame(columns).to_parquet(stream)
    return stream.getvalue()


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
        workbook(
            ("About", [["my ball"]]),
            ("Data", [["Lab 3"], [], ["v / (m/s)", "e"], *ROWS]),
        ),
        'velocity = "v / (m/s)"; restitution = "e"; sheet \'Data\'; row 1 above the headings '
        "left out",
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


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


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


def test_commas_that_may_be_two_things(tmp_path):
    path = written(tmp_path, "f.csv", "v [mm/s];e\n1,500;0.9\n")
    comma = jc.read_recording(path, decimal=",").records[0]
    point = jc.read_recording(path, decimal=".").records[0]
    assert (comma.velocity, point.velocity) == (0.0015, 1.5)


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
    b"%PDF-1.7": "is a PDF; save the table as CSV",
    b"\x1f\x8b\x08": "is compressed",
    b"PK\x03\x04": "is a spreadsheet that cannot be read",
    b"PAR1": "is a parquet file that cannot be read",
    b"v,e\n1,\xff\n": "row 2, column e: 'ÿ' is not a number",
}


@pytest.mark.parametrize("content", REFUSED)
def test_what_is_refused_says_why_and_what_to_do(content, tmp_path):
    with pytest.raises(jc.RecordingError, match=REFUSED[content]):
        jc.read_recording(written(tmp_path, "f.csv", content))


def test_what_is_written_is_believed(tmp_path):
    fast = written(tmp_path, "f.csv", "v [m/s],e\n1500,0.9\n2000,0.8\n")
    assert jc.read_recording(fast).records[0].velocity == 1500
    # By keyword the documented unit applies.
    assert len(jc.read_recording(velocity=[1500.0, 2000.0], restitution=[0.9, 0.8])) == 2


def test_pairs_of_speeds():
    from jaxcontact._flight import Flight
    from jaxcontact._lab.recordings import make_pairs

    before, after = np.array([1.0, 2.0, 4.0]), np.array([0.8, 1.6, 3.2])
    pairs = make_pairs(jc.read_recording(velocity=before, rebound_velocity=after), Flight())
    np.testing.assert_allclose(pairs.restitution, 0.8, rtol=1e-14)
    # An error σ of each speed: ln e = ln v₂ - ln v₁.
    np.testing.assert_allclose(pairs.reading_factor, 1 / before**2 + 1 / after**2, rtol=1e-14)


def test_pairs_of_successive_heights():
    from jaxcontact._flight import Flight
    from jaxcontact._lab.recordings import make_pairs

    recording = jc.read_recording(height_m=[1.0, 0.64, 0.4096, 0.5], trial=[1, 1, 1, 2])
    pairs = make_pairs(recording, Flight())
    np.testing.assert_allclose(pairs.restitution, 0.8, rtol=1e-14)
    np.testing.assert_allclose(pairs.velocity, np.sqrt(2 * 9.81 * np.array([1, 0.64])), rtol=1e-14)
    # An error σ of each height: ln e = (ln h₂ - ln h₁)/2.
    first, second = np.array([1, 0.64]), np.array([0.64, 0.4096])
    np.testing.assert_allclose(
        pairs.reading_factor, 1 / (4 * first**2) + 1 / (4 * second**2), rtol=1e-14
    )
    assert pairs.unpaired == 1


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


def test_the_beginning_of_a_long_file_decides(tmp_path):
    body = "".join(f"{1 + k % 7};0,{80 + k % 10}\n" for k in range(1000))
    recording = jc.read_recording(written(tmp_path, "long.csv", "v;e\n" + body))
    assert len(recording) == 1000 and recording.records[-1].row == 1001
    with pytest.raises(jc.RecordingError, match="row 1002, column e: is empty"):
        jc.read_recording(written(tmp_path, "long.csv", "v;e\n" + body + "3\n"))


T = np.array([0.52, 0.97, 1.36, 1.70, 2.0])
"""Instants of bounces, whose intervals shrink by 0.87 or so."""


def clock(seconds):
    return f"00:{seconds:05.2f}"


LABELS = "".join(f"{t:.6f}\t{t:.6f}\tbounce\n" for t in T)
INSTANTS = {
    "labels of Audacity": LABELS,
    "labels without a name, in German": LABELS.replace("bounce", "").replace(".", ","),
    "labels with frequencies": LABELS.replace("bounce\n", "b\n\\\t500\t2000\n"),
    "labels of Sonic Visualiser": "".join(f"{t},New Point\n" for t in T),
    "markers of Audition": "Name\tStart\tDuration\tTime Format\tType\tDescription\n"
    + "".join(f"Marker {k}\t0:{t:06.3f}\t0:00.000\tdecimal\tCue\t\n" for k, t in enumerate(T)),
    "markers of Reaper": "#,Name,Start,End,Length\n"
    + "".join(f"M{k},bounce,0:{t:06.3f},,\n" for k, t in enumerate(T)),
    "a stopwatch, the last lap first": "Lap;Split time\n"
    + "".join(f"{k};{clock(T[k])}\n" for k in (4, 3, 2, 1, 0)).replace(".", ","),
    "total times with their form": "Lap,Time (mm:ss.cc)\n"
    + "".join(f"{k},{clock(t)}\n" for k, t in enumerate(T)),
    "times and nothing else": "time\n" + "".join(f"{t}\n" for t in T),
    "times and their steps": "t,dt\n" + "".join(f"{t},\n" for t in T),
    "events": "t [ms],event\n100,release\n" + "".join(f"{1000 * t:.0f},Bounce\n" for t in T),
}


@pytest.mark.parametrize("form", INSTANTS)
def test_instants_of_bounces(form, tmp_path):
    recording = jc.read_recording(written(tmp_path, "f.txt", INSTANTS[form]))
    assert recording.layout.name == "instants"
    np.testing.assert_allclose([r.seconds for r in recording.records], np.diff(T), rtol=1e-12)
    assert [r.bounce for r in recording.records] in ([1, 2, 3, 4], [0, 1, 2, 3])
    assert ("release" in str(recording)) == (form == "events")


def test_a_pause_parts_drops_and_a_gap_makes_no_interval():
    told = {"bounce_time_s": [*T, *(T + 9)], "bounce": [1, 2, 3, 5, 6, 11, 12, 13, 14, 15]}
    recording = jc.read_recording(told)
    assert [(r.trial, r.bounce) for r in recording.records] == [
        *(("1", k) for k in (1, 2, 5)),
        *(("1, 2", k) for k in (11, 12, 13, 14)),
    ]
    with pytest.raises(jc.RecordingError, match=r"0.4 s is not later than 0.5 s; if these are"):
        jc.read_recording(bounce_time_s=[0.5, 0.4])


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("Lap,Lap time,Total time\n1,00:00.52,00:00.52\n2,00:00.45,00:00.97\n", [0.52, 0.45]),
        ("Lap time\n0:00:00.52\n0:00:00.45\n", [0.52, 0.45]),
        ("interval;std (ms)\n01:00,52;1\n00:45,5;2\n", None),
    ],
)
def test_times_by_the_clock(text, wanted, tmp_path):
    path = written(tmp_path, "f.csv", text)
    if wanted is None:  # read as 60.52 s, a flight of 3 km height
        with pytest.raises(jc.RecordingError, match=r"longer than 53.01 s"):
            jc.read_recording(path)
        return
    recording = jc.read_recording(path)
    assert recording.layout.name == "intervals"
    np.testing.assert_allclose([r.seconds for r in recording.records], wanted, rtol=1e-14)
    with pytest.raises(jc.RecordingError, match=r"'00:00\.52' is not a number"):
        jc.read_recording({"interval [ms]": ["00:00.52"]})
    with pytest.raises(jc.RecordingError, match=r"'00:00\.52' is not a number"):
        jc.read_recording(velocity=["00:00.52"], restitution=[0.5])


STEPS = (0.0085,) * 6
NO_BALLS = {
    "equal": STEPS,
    "equal but for rounding": (0.0083, 0.0084, 0.0083, 0.0083, 0.0084, 0.0083),
    "growing": (0.3, 0.33, 0.37, 0.4),
    "two that are equal": (0.4, 0.4),
}


@pytest.mark.parametrize("case", NO_BALLS)
def test_intervals_that_do_not_shrink_are_those_of_no_ball(case):
    steps = np.array(NO_BALLS[case])
    word = "grow, by the factor" if case == "growing" else "stay the same, "
    sources = [{"interval_s": steps}, {"dt": steps}, {"flight time (ms)": 1e3 * steps}]
    for source in [*sources, pd.DataFrame(sources[1])]:
        with pytest.raises(jc.RecordingError, match=f"row 1, .*intervals {word}"):
            jc.read_recording(source)
    if case != "two that are equal":
        with pytest.raises(jc.RecordingError, match=r"row [12].*intervals "):
            jc.read_recording(bounce_time_s=np.cumsum(steps))
        with pytest.raises(jc.RecordingError, match=r"each height is|balls rise to"):
            jc.read_recording(height_m=steps)
    law, contact = jc.ConstantDamping(1.0), jc.Contact(1.0, 1.0)
    with pytest.raises(ValueError, match="`second` must be shorter than `first`"):
        jc.fit_bounces(law, contact, steps[:-1], steps[1:])


def test_intervals_of_balls_shrink_with_scatter():
    """Of 1,000 drops none is refused: e to 0.97, ten intervals, 2 % of scatter, one of them wrong;
    and with e = 0.99, and 0.5 %.
    """
    from jaxcontact._calibration.pairs.plausible import not_shrinking

    random = np.random.default_rng(0)
    for e, scatter in ((0.6, 0.02), (0.9, 0.02), (0.97, 0.02), (0.99, 0.005)):
        steps = 0.5 * e ** np.arange(10) * np.exp(scatter * random.normal(size=(1000, 10)))
        steps[:, 6] *= 1 + (e < 0.99)
        assert not any(not_shrinking([one]) for one in steps)
    # With jitter some clock steps shrink by chance: those of Kendall's count.
    jitter = 1 + 0.02 * random.normal(size=(1000, 10))
    seen = np.mean([not_shrinking([one]) is not None for one in jitter])
    assert seen > 0.9


def test_steps_of_a_clock_beside_its_times_are_no_intervals():
    text = "t,y,dt\n0,0.23,0.0085\n0.0085,0.28,0.0085\n0.0170,0.31,0.0085\n"
    with pytest.raises(jc.RecordingError, match="column y: is a track of 3 frames, too few"):
        jc.read_recording(io.StringIO(text))
    told = jc.read_recording(io.StringIO("t,y,dt\n0,1,.5\n.5,2,.4\n.9,3,.3\n"), columns="dt=3")
    assert told.layout.name == "intervals"
    # A word that means flights keeps its meaning.
    laps = jc.read_recording(io.StringIO("time,flight time\n.5,.5\n.9,.4\n"))
    assert laps.layout.name == "intervals"


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_the_time_to_rest_contains_the_fall(e):
    """Against flights added one by one, in vacuum and in air."""
    from jaxcontact._flight import Drag, Flight
    from jaxcontact._lab.recordings import make_pairs
    from tests.test_lab.simulate import time_to_rest

    height = np.array([0.3, 1.0, 2.0])
    for drag in (None, Drag(0.0027, 0.02, 0.5)):
        total = [time_to_rest(h, lambda v: e, drag) for h in height]
        recording = jc.read_recording(drop_height_m=height, rest_time_s=total)
        pairs = make_pairs(recording, Flight(drag=drag))
        np.testing.assert_allclose(pairs.restitution, e, rtol=1e-6)
    # If e falls with the speed, it is that at v₀ e^(e/(1-e)), to first order in the power.
    power = 1e-4
    total = [time_to_rest(h, lambda v: e * v**-power, None) for h in height]
    pairs = make_pairs(jc.read_recording(drop_height_m=height, rest_time_s=total), Flight())
    off = np.log(pairs.restitution / e) / -power - np.log(pairs.velocity)
    np.testing.assert_allclose(off, 0, atol=3e-3)
    with pytest.raises(
        jc.RecordingError, match=r"0.4 s does not exceed the time of a fall from 1 m"
    ):
        jc.read_recording(drop_height_m=[1.0], rest_time_s=[0.4])


FORCES = [(k * 1e-3, 0.1, 0.2, float(k % 7)) for k in range(30)]
UNITS = {
    "of a force plate": ("abs time (s);Fx;Fy;Fz\ns;N;N;N\n", "Fz [N]"),
    "with moments": ("time;Mx;My;Fz\ns;N m;Nm;kN\n", "Fz [kN]"),
    "above the headings": ("s;N;N;N\ntime;Fx;Fy;Fz\n", "Fz [N]"),
    "unknown words between": ("time;a1;a2;Fz\n[s];[V];[V];[N]\n", "Fz [N]"),
}


@pytest.mark.parametrize("case", UNITS)
def test_a_row_of_units_is_no_heading(case):
    from jaxcontact._lab.recordings import read_columns

    head, wanted = UNITS[case]
    body = lines("", FORCES, ";", number=german)
    read = read_columns(io.StringIO(head.rstrip("\n") + body), ("time", "force"), needed=("time",))
    assert read.values["force"].size == 30
    assert read.values["force"].max() == (6000 if "kN" in wanted else 6)
    assert wanted in " ".join(read.notes) or wanted == "Fz [N]"


def test_units_alone_are_no_header():
    with pytest.raises(jc.RecordingError, match="row 2: has 2 columns and no header; name"):
        jc.read_recording(io.StringIO("m/s;-\n1;0,9\n2;0,8\n"))
    told = jc.read_recording(io.StringIO("mm/s;-\n1000;0,9\n2000;0,8\n"), columns="v=1,e=2")
    assert [r.velocity for r in told.records] == [1, 2]


def test_what_people_write_around_a_table(tmp_path):
    head = "Run label,interval\n"
    text = head + "x,.5\nx,.45\nx,.4\n" + head + "x,.5\nx,.44\nMean,.46\nS.D.,.01\n"
    recording = jc.read_recording(written(tmp_path, "f.csv", text))
    assert [(r.trial, r.bounce) for r in recording.records] == [
        *(("1", k) for k in (1, 2, 3)),
        *(("2", k) for k in (1, 2)),
    ]
    said = "; ".join(recording.notes)
    assert (
        "headings repeated in row 5 left out; rows 8 to 9 below the measurements left out" in said
    )
    rows = jc.read_recording(io.StringIO("v,e\n1,.9\n2,.8\nend of data\n"))
    assert len(rows) == 2


@pytest.mark.parametrize("apart", [True, False])
def test_marks_of_numbers_are_told_in_linear_time(apart):
    """No row is compared with the rows before it."""
    from jaxcontact._lab.tables.grid import with_points

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
