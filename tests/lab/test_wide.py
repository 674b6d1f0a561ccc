"""Several sheets, columns side by side, and instants of bounces: records as in one tall table."""

import io

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact._flight import Flight
from jaxcontact.lab.recordings import make_pairs, read_columns
from tests.lab.sources import lines, read, refused, workbook, written

DROPS = {"first": [0.5, 0.45, 0.4], "second": [0.6, 0.5, 0.42]}


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
    mixed = "drop height (m),rebound 1 (cm),rebound 2 (cm)\n1,80,64\n"
    refused(r"column drop height \(m\): is in another unit", mixed)


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


# Instants of bounces, times by the clock, and intervals that are those of a ball.

T = np.array([0.52, 0.97, 1.36, 1.70, 2.0])
"""Instants of bounces, whose intervals shrink by 0.87 or so."""


def clock(seconds):
    return f"00:{seconds:05.2f}"


LABELS = "".join(f"{t:.6f}\t{t:.6f}\tbounce\n" for t in T)
INSTANTS = {
    "labels of Audacity": LABELS,
    "labels without a name, in German": LABELS.replace("bounce", "").replace(".", ","),
    "labels with frequencies": LABELS.replace("bounce\n", "b\n\\\t500\t2000\n"),
    "labels by the clock": "".join(f"0:{t:05.2f}\t0:{t:05.2f}\tbounce\n" for t in T),
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
    refused(r"0.4 s is not later than 0.5 s; if these are", bounce_time_s=[0.5, 0.4])


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
        refused(r"longer than 53.01 s", path)
        return
    recording = jc.read_recording(path)
    assert recording.layout.name == "intervals"
    np.testing.assert_allclose([r.seconds for r in recording.records], wanted, rtol=1e-14)
    refused(r"'00:00\.52' is not a number", {"interval [ms]": ["00:00.52"]})
    refused(r"'00:00\.52' is not a number", velocity=["00:00.52"], restitution=[0.5])


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
        refused(f"row 1, .*intervals {word}", source)
    if case != "two that are equal":
        refused(r"row [12].*intervals ", bounce_time_s=np.cumsum(steps))
        refused(r"each height is|balls rise to", height_m=steps)
    law, contact = jc.ConstantDamping(1.0), jc.Contact(1.0, 1.0)
    with pytest.raises(ValueError, match="`second` must be shorter than `first`"):
        jc.fit_bounces(law, contact, steps[:-1], steps[1:])


def test_intervals_of_balls_shrink_with_scatter():
    """Of 1,000 drops none is refused: e to 0.97, ten intervals, 2 % of scatter, one of them wrong;
    and with e = 0.99, and 0.5 %.
    """
    from jaxcontact._inverse.columns import not_shrinking

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
    refused("column y: is a track of 3 frames, too few", text)
    told = jc.read_recording(io.StringIO("t,y,dt\n0,1,.5\n.5,2,.4\n.9,3,.3\n"), columns="dt=3")
    assert told.layout.name == "intervals"
    # A word that means flights keeps its meaning.
    laps = jc.read_recording(io.StringIO("time,flight time\n.5,.5\n.9,.4\n"))
    assert laps.layout.name == "intervals"
