"""Several sheets, and columns side by side: the same records as in one tall table."""

import io

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact._flight import Flight
from jaxcontact.lab.recordings import make_pairs, read_columns
from tests.lab.sources import lines, workbook

DROPS = {"first": [0.5, 0.45, 0.4], "second": [0.6, 0.5, 0.42]}


def read(content, **how):
    stream = io.BytesIO(content) if isinstance(content, bytes) else io.StringIO(content)
    return jc.read_recording(stream, **how)


def refused(words, content, **how):
    with pytest.raises(jc.RecordingError, match=words):
        read(content, **how)


def numbers(recording):
    """Trials in order, each with its numbers by bounce."""
    trials = {}
    for one in recording.records:
        trials.setdefault(one.trial, []).append((one.bounce, list(vars(one).values())[-1]))
    return [[value for _, value in sorted(trial)] for trial in trials.values()]


def intervals(values):
    return [("interval (s)",), *((value,) for value in values)]


def test_equal_sheets_are_trials_and_others_are_chosen():
    about, table = ("About", [["my lab"]]), ("Table", [("v", "e"), (1, 0.9), (2, 0.8)])
    drops = [(name, intervals(values)) for name, values in DROPS.items()]
    whole = read(workbook(*drops, about))
    assert numbers(whole) == [*DROPS.values()]
    said = "; ".join(whole.notes)
    assert "sheets 'first', 'second'; not read: 'About'; row 1 of 'second' is row 5" in said
    pairs = make_pairs(whole, Flight())
    assert (pairs.first_row[-1], pairs.second_row[-1]) == (7, 8)
    mixed = workbook(*drops, table)
    told = r"different headings, 'first' \(interval \(s\)\);.* 'Table' \(v, e\); .* `sheet=`"
    refused(told, mixed)
    for sheet in ("second", 2, "2"):
        one = read(mixed, sheet=sheet)
        assert numbers(one) == [DROPS["second"]] and one.source == "the text, sheet 'second'"
        assert "not read: 'first', 'Table'" in one.notes
    refused("has no sheet 'x'; it has 'first', 'second'", mixed, sheet="x")
    refused("has no sheets; omit `sheet`", "v,e\n1,.9\n", sheet="x")
    with pytest.raises(ValueError, match="`sheet` must be None without a file"):
        jc.read_recording({"v": [1.0], "e": [0.9]}, sheet="x")
    bad = workbook(("Table", [("v", "e"), (1, "x")]), about)
    refused("sheet 'Table', row 2, column e: 'x' is not", bad)


def test_records_and_numbered_trials_are_not_joined():
    record = [("time (s)", "force (N)"), *((k * 1e-4, 0.0) for k in range(40))]
    book = workbook(("a", record), ("b", record))
    refused("a record in each of 'a', 'b'; choose one with", book)
    with pytest.raises(jc.RecordingError, match="a record in each of 'a', 'b'; choose one with"):
        read_columns(io.BytesIO(book), ("time", "force"), needed=("time",))
    numbered = [("trial", "interval"), (1, 0.5), (1, 0.4)]
    refused("numbers trials in each of several sheets", workbook(("a", numbered), ("b", numbered)))


def test_the_last_zero_of_a_stopwatch_is_no_interval():
    text = '"Event time (s)","Interval (s)"\n1,.5\n1.5,.45\n1.95,.4\n2.35,0\n'
    found = read(text)
    assert numbers(found) == [[0.5, 0.45, 0.4]]
    assert "row 5 left out: the last interval is 0" in found.notes
    refused(r"row 3, .* must be positive, but is 0", text.replace("1.5,.45", "1.5,0"))


def test_sets_of_columns_are_trials():
    text = "interval,interval\n.5,.6\n.45,.5\n.4,.42\n"
    assert numbers(read(text)) == [*DROPS.values()]
    pairs = [(1.0, 0.9), (1.5, 0.85), (2.0, 0.8), (3.0, 0.7), (4.0, 0.6)]
    for text in (
        "v,e,v,e\n1,.9,2,.8\n1.5,.85,3,.7\n,,4,.6\n",
        "v,e,,v,e\n1,.9,,2,.8\n1.5,.85,,3,.7\n,,,4,.6\n",
    ):
        for found in (read(text), jc.read_recording(pd.read_csv(io.StringIO(text)))):
            assert [(one.velocity, one.restitution) for one in found.records] == pairs
            assert "2 sets of columns side by side: each set is a trial" in found.notes
    shared = read("v,e,e,e\n1,.9,.91,.92\n2,.8,.81,.82\n").records
    assert [one.restitution for one in shared] == [0.9, 0.8, 0.91, 0.81, 0.92, 0.82]
    assert len(read("v,e,remark,remark\n1,.9,a,b\n").records) == 1


@pytest.mark.parametrize("name", ["Rebound {} (cm)", "h{} [cm]", "Trial {}", "Bounce {}"])
def test_a_drop_with_ten_rebounds(name):
    random = np.random.default_rng(1)
    drops = np.array([50.0, 100.0, 150.0])
    heights = drops[:, None] * 0.7 * (1 + 0.02 * random.normal(size=(3, 10)))
    head = ",".join(["Drop height (cm)", *(name.format(k) for k in range(1, 11))])
    found = read(lines(head, np.column_stack([drops, heights]), number="{:.17g}".format))
    assert found.layout.name == "heights" and len(found) == 30
    got = [one.height for one in found.records]
    np.testing.assert_allclose(got, heights.T.ravel() / 100, rtol=1e-14)
    # Shrinking ones are successive bounces.
    heights = np.round(drops[:, None] * 0.7 ** np.arange(1, 11), 3)
    found = read(lines(head, np.column_stack([drops, heights])))
    assert found.layout.name == "peaks"
    expected = np.column_stack([drops, heights]) / 100
    np.testing.assert_allclose(numbers(found), expected, rtol=1e-3)


def test_columns_that_could_be_read_in_two_ways():
    two = "trial,dt (s),dt (s)\n1,.5,.6\n1,.45,.54\n2,.52,.7\n2,.47,.63\n"
    assert numbers(read(two)) == [[0.5, 0.45], [0.52, 0.47], [0.6, 0.54], [0.7, 0.63]]
    head, rows = "dt 1 (s),dt 2 (s),dt 3 (s)", [".6,.55,.5", ".54,.5,.45", ".48,.45,.4"]
    refused("Add a column `trial` if rows are trials", "\n".join([head, *rows]))
    sets = numbers(read("\n".join([f"bounce,{head}", *(f"{k},{r}" for k, r in enumerate(rows))])))
    assert sets == [[0.6, 0.54, 0.48], [0.55, 0.5, 0.45], [0.5, 0.45, 0.4]]
    # Repeats that fall are repeats; one unit and a mean at the end do not matter.
    rows = "1,.8,.76,.72,.76\n1.2,.96,.91,.87,.91\n"
    for head in ("h0 (m),rebound 1,rebound 2,rebound 3", "Height (m),Trial 1,Trial 2,Trial 3"):
        found = read(f"{head},Average\n{rows}")
        assert found.layout.name == "heights" and len(found) == 6
        assert [one.height for one in found.records] == [0.8, 0.96, 0.76, 0.91, 0.72, 0.87]
        assert found.notes[-1] == "not used: Average"
    with pytest.raises(jc.RecordingError, match=r"column drop height \(m\): is in another unit"):
        read("drop height (m),rebound 1 (cm),rebound 2 (cm)\n1,80,64\n")


def test_places_need_a_rate_only():
    time = np.arange(180) / 60
    landings = np.cumsum([0.45, 0.72, 0.576, 0.4608, 0.36864, 0.294912, 0.2359296])
    since = time - np.concatenate([[-0.45], landings])[np.searchsorted(landings, time)]
    flight = np.concatenate([[0.9], np.diff(landings)])[np.searchsorted(landings, time)]
    rows = np.column_stack([0.1 * time, 9.81 / 2 * since * (flight - since)])
    found = read(lines("x (m),y (m)", rows, number="{:.6f}".format), rate=60)
    # The fit states errors of .0009 to .0027.
    np.testing.assert_allclose(make_pairs(found, Flight()).restitution, 0.8, rtol=2e-3)
    assert "rows are frames, 60 per second" in found.notes


def test_a_column_of_oblique_impacts_that_is_left_out_is_named():
    names = "angle", "speed", "tangential_restitution", "rebound_spin"
    text = "angle (deg),speed,v_t after / v_t,v_t ratio,temperature\n10,1,.6,.6,20\n"
    found = read_columns(io.StringIO(text), names, needed=())
    assert 'tangential_restitution = "v_t after / v_t"' in found.notes
    assert found.notes[-1] == "not used: v_t ratio, temperature"
