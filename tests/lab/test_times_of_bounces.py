"""Instants of bounces, times by the clock, and intervals that are those of a ball."""

import io

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from tests.lab.sources import refused, written

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
    refused("column y: is a track of 3 frames, too few", io.StringIO(text))
    told = jc.read_recording(io.StringIO("t,y,dt\n0,1,.5\n.5,2,.4\n.9,3,.3\n"), columns="dt=3")
    assert told.layout.name == "intervals"
    # A word that means flights keeps its meaning.
    laps = jc.read_recording(io.StringIO("time,flight time\n.5,.5\n.9,.4\n"))
    assert laps.layout.name == "intervals"
