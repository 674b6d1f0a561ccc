"""Files that are ambiguous or wrong: each is refused with advice."""

import io

import pytest

import jaxcontact as jc
from tests.lab.sources import written

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
