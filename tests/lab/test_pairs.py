"""Pairs (closing speed, e) of every layout, with the effect of reading errors."""

import importlib.resources

import jax
import numpy as np
import pytest

from jaxcontact._flight import Drag, Flight
from jaxcontact.lab.recordings import RecordingError, make_pairs, read_recording
from tests.lab.simulate import time_to_rest
from tests.lab.sources import opened

TABLE_TENNIS = Drag(mass=0.0027, radius=0.02, coefficient=0.5)

MONTE_CARLO = 0.03  # variance of 40000 draws: its own standard error is 0.7 %
ROUNDING = 1e-15
GRAVITY = 9.81


def pairs_of(source=None, flight=None, ball=None):
    return make_pairs(read_recording(source, ball=ball), flight or Flight())


ROOT = np.sqrt(2 * GRAVITY)
LAYOUTS = {
    "intervals": (
        {"interval_s": [0.4, 0.36, 0.3]},
        *([GRAVITY * 0.2, GRAVITY * 0.18], [0.9, 0.3 / 0.36]),
    ),
    "heights": (
        {"drop_height_m": [0.5], "rebound_height_m": [0.4]},
        *([ROOT * 0.5**0.5], [0.8**0.5]),
    ),
    "table": ({"velocity": [2], "restitution": [0.8]}, [2], [0.8]),
    # An error σ of each speed: ln e = ln v₂ - ln v₁.
    "speeds": (
        {"velocity": [1.0, 2.0, 4.0], "rebound_velocity": [0.8, 1.6, 3.2]},
        *([1, 2, 4], [0.8] * 3, [1 / v**2 + 1 / (0.8 * v) ** 2 for v in (1, 2, 4)]),
    ),
    # An error σ of each height: ln e = (ln h₂ - ln h₁)/2.
    "successive heights": (
        {"height_m": [1.0, 0.64, 0.4096, 0.5], "trial": [1, 1, 1, 2]},
        *([ROOT, ROOT * 0.8], [0.8] * 2),
        [1 / (4 * h**2) + 1 / (4 * (0.64 * h) ** 2) for h in (1, 0.64)],
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_each_layout_measures(layout):
    columns, velocity, e, *factor = LAYOUTS[layout]
    pairs = make_pairs(read_recording(**columns), Flight())
    np.testing.assert_allclose(pairs.velocity, velocity, rtol=ROUNDING)
    np.testing.assert_allclose(pairs.restitution, e, rtol=ROUNDING)
    if factor:
        np.testing.assert_allclose(pairs.reading_factor, factor[0], rtol=1e-14)
    assert pairs.unpaired == (layout == "successive heights")


def test_only_successive_bounces_of_one_trial_make_pairs():
    text = (
        "ball,drop_height_m,trial,bounce,interval_s\n"
        "a,1,1,1,0.4\na,1,1,3,0.3\n"  # bounce 2 is missing
        "a,1,2,4,0.2\n"  # another trial
        "a,2,1,2,0.3\n"  # another height
        "a,1,2,3,0.25\n"  # out of order, but successive to row 4
    )
    pairs = pairs_of(opened(text))
    assert (pairs.first_row.tolist(), pairs.second_row.tolist()) == ([6], [4])
    assert pairs.unpaired == 3


@pytest.mark.parametrize("drag", [None, TABLE_TENNIS])
def test_the_reading_factor_is_the_variance_that_trigger_errors_make(drag):
    flight, jitter = Flight(drag=drag), 1e-3
    rng = np.random.default_rng(5)
    true = np.array([0.5, 0.45, 0.405])
    expected = jitter**2 * make_pairs(read_recording(interval_s=true), flight).reading_factor
    triggers = np.concatenate([[0], np.cumsum(true)])
    times = np.diff(triggers + jitter * rng.standard_normal((40_000, 4)), axis=1)
    launch = jax.jit(Flight.launch_speed)(times, flight.gravity, flight.rate)
    landing = jax.jit(Flight.landing_speed)(launch, flight.gravity, flight.rate)
    log_e = np.log(np.asarray(launch)[:, 1:] / np.asarray(landing)[:, :-1])
    np.testing.assert_allclose(log_e.var(axis=0), expected, rtol=MONTE_CARLO)


def test_heights_agree_with_intervals_of_the_same_ball():
    text = (importlib.resources.files("jaxcontact.data") / "rebound_heights.csv").read_text()
    heights = pairs_of(opened(text), ball="blue")
    intervals = pairs_of(ball="blue")
    # Reading errors of 0.5-1 cm in 20 cm are 2 % of e, shared by the drops from one height.
    assert abs(np.median(heights.restitution) - np.median(intervals.restitution)) < 0.02


INTERVALS = "ball,drop_height_m,trial,bounce,interval_s\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            INTERVALS + "a,1,1,1,.4\na,1,1,2,.3\na,1,1,3,.2\n",
            "f.csv, row 4, column interval_s: 2 usable pairs of successive intervals of a, but at "
            "least 4 are needed (one parameter of the law, two of the noise, one to test the "
            "fit); two intervals make a pair if ball, drop height and trial agree and "
            "`bounce` is consecutive; add rows",
        ),
        (
            INTERVALS + "a,1,1,1,.4\na,1,1,3,.3\n",
            "f.csv, column interval_s: 0 usable pairs of successive intervals of a, but",
        ),
        (
            "velocity,restitution\n1,.9\n",
            "f.csv, row 2, column restitution: 1 usable pair of speed and restitution, but",
        ),
        (
            "ball,drop_height_m,trial,rebound_height_m\na,.5,1,.4\n",
            "f.csv, row 2, column rebound_height_m: 1 usable pair of heights of a, but",
        ),
    ],
)
def test_too_few_pairs_are_refused(text, message):
    with pytest.raises(RecordingError) as caught:
        pairs_of(opened(text)).needs_enough()
    assert str(caught.value).startswith(message)


def test_pairs_that_were_left_out_are_counted():
    pairs = pairs_of(opened("velocity,restitution\n1,.9\n2,.8\n3,.7\n4,.6\n"))
    pairs.needs_enough()
    with pytest.raises(RecordingError, match=r"2 usable pairs .*; 2 more are off the trend"):
        pairs.where(pairs.velocity < 3).needs_enough(marked=2)


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_the_time_to_rest_contains_the_fall(e):
    """Against flights added one by one, in vacuum and in air."""
    height = np.array([0.3, 1.0, 2.0])

    def pairs_at(law, drag=None):
        total = [time_to_rest(h, law, drag) for h in height]
        recording = read_recording(drop_height_m=height, rest_time_s=total)
        return make_pairs(recording, Flight(drag=drag))

    for drag in (None, TABLE_TENNIS):
        np.testing.assert_allclose(pairs_at(lambda v: e, drag).restitution, e, rtol=1e-6)
    # If e falls with the speed, it is that at v₀ e^(e/(1-e)), to first order in the power.
    power = 1e-4
    pairs = pairs_at(lambda v: e * v**-power)
    off = np.log(pairs.restitution / e) / -power - np.log(pairs.velocity)
    np.testing.assert_allclose(off, 0, atol=3e-3)
    with pytest.raises(RecordingError, match=r"0.4 s does not exceed the time of a fall from 1 m"):
        read_recording(drop_height_m=[1.0], rest_time_s=[0.4])
    # On the moon the fall alone takes 1.11 s.
    recording = read_recording(drop_height_m=[1.0, 1.0], rest_time_s=[1.2, 0.9])
    with pytest.raises(RecordingError, match=r"^row 2, column rest_time_s: 0.9 s .*, 1.11 s;"):
        make_pairs(recording, Flight(1.62))
