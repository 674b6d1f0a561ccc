"""Pairs (closing speed, e) of every layout, with the effect of reading errors, and their outliers.

The robust rule finds planted faults in their rows, and keeps honest scatter.
"""

import jax
import numpy as np
import pytest

from jaxcontact._flight import Drag, Flight
from jaxcontact.lab.pairs.outliers import THRESHOLD, find_outliers, mark, marked_in
from jaxcontact.lab.pairs.pairs import Noise, estimate_noise
from jaxcontact.lab.recordings import RecordingError, make_pairs, read_recording
from tests.lab import sources

TABLE_TENNIS = Drag(mass=0.0027, radius=0.02, coefficient=0.5)

MONTE_CARLO = 0.03  # variance of 40000 draws: its own standard error is 0.7 %
ROUNDING = 1e-15
GRAVITY = sources.GRAVITY

duration, landing = jax.jit(Flight.duration), jax.jit(Flight.landing_speed)


def pairs_of(text):
    """The pairs in the text of a file, in vacuum."""
    return make_pairs(sources.read(text), Flight())


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
    pairs = pairs_of(text)
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
    landed = landing(launch, flight.gravity, flight.rate)
    log_e = np.log(np.asarray(launch)[:, 1:] / np.asarray(landed)[:, :-1])
    np.testing.assert_allclose(log_e.var(axis=0), expected, rtol=MONTE_CARLO)


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
        pairs_of(text).needs_enough()
    assert str(caught.value).startswith(message)


def test_pairs_that_were_left_out_are_counted():
    pairs = pairs_of("velocity,restitution\n1,.9\n2,.8\n3,.7\n4,.6\n")
    pairs.needs_enough()
    with pytest.raises(RecordingError, match=r"2 usable pairs .*; 2 more are off the trend"):
        pairs.where(pairs.velocity < 3).needs_enough(marked=2)


fall, after_fall = jax.jit(Flight.time_to_fall), jax.jit(Flight.speed_after_drop)


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_the_time_to_rest_contains_the_fall(e):
    """Against flights added one by one, in vacuum and in air."""
    height = np.array([0.3, 1.0, 2.0])

    def pairs_at(law, drag=None):
        b = Flight(drag=drag).rate
        total, speed = fall(height, GRAVITY, b), after_fall(height, GRAVITY, b)
        for _ in range(300):
            launch = law(speed) * speed
            total, speed = total + duration(launch, GRAVITY, b), landing(launch, GRAVITY, b)
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


# Outliers.

SEEDS = range(12)

SHARE = 0.25
"""Recovering each of two scatters from 600 residuals: measured within 12 % in the normal case."""


def outliers_of(text):
    pairs = pairs_of(text)
    return pairs, find_outliers(pairs)


def rows(pairs, found):
    return {
        (int(pairs.first_row[k]), int(pairs.second_row[k])) for k in np.flatnonzero(found.flagged)
    }


def planted(seed):
    """Eight trials with a missed, a spurious and a late trigger: CSV, and the bad pairs of rows."""
    trials = sources.trials(lambda v: 0.88, seed, 8)
    merged = trials[1]
    trials[1] = np.concatenate([merged[:4], [merged[4] + merged[5]], merged[6:]])
    cut = trials[4]
    trials[4] = np.concatenate([cut[:6], [0.3 * cut[6], 0.7 * cut[6]], cut[7:]])
    trials[6][4:6] += 0.03, -0.03
    starts = 2 + np.cumsum([0, *map(len, trials)])
    faults = ("missed", 1, 3, 2), ("spurious", 4, 5, 3), ("late", 6, 3, 3)
    first = {kind: (int(starts[number]) + k, n) for kind, number, k, n in faults}
    bad = {(a + k, a + k + 1): kind for kind, (a, n) in first.items() for k in range(n)}
    return sources.as_csv(trials), bad


@pytest.mark.parametrize("seed", SEEDS)
def test_planted_faults_are_found_and_nothing_else(seed):
    text, bad = planted(seed)
    pairs, found = outliers_of(text)
    assert rows(pairs, found) == bad.keys()
    for k, guess in found.guess.items():
        assert bad[pairs.first_row[k], pairs.second_row[k]] in guess


@pytest.mark.parametrize("seed", SEEDS)
def test_clean_recordings_lose_nothing(seed):
    # A law with a trend, and triggers so noisy that the shortest flights scatter by 5 %.
    _, found = outliers_of(sources.recording(lambda v: 0.9 - 0.02 * v, seed, jitter=3e-3))
    assert not found.flagged.any()
    # e = 0.97 with 3 % scatter: a sixth of the ratios are above 1.
    pairs, found = outliers_of(sources.recording(lambda v: 0.97, seed, jitter=0.0, scatter=0.03))
    assert (pairs.restitution > 1).sum() > 20 and not found.flagged.any()


def test_the_shipped_recordings_part_where_they_should():
    for ball, count in (("blue", 23), ("pingpong", 23), ("tennis", 0)):
        drag = TABLE_TENNIS if ball == "pingpong" else None
        pairs = make_pairs(read_recording(ball=ball), Flight(drag=drag))
        found = find_outliers(pairs)
        assert found.flagged.sum() == count
        # Every ratio from a missed trigger is excluded, and no deviation is near the threshold.
        gross = np.abs(np.log(pairs.restitution / np.median(pairs.restitution))) > 0.3
        assert found.flagged[gross].all()
        assert np.all(np.abs(np.abs(found.deviation) - THRESHOLD) > 0.1)


def test_the_found_rows_do_not_depend_on_their_order():
    text, bad = planted(0)
    head, *lines = text.split()
    order = np.random.default_rng(0).permutation(len(lines))
    shuffled = "\n".join([head, *(lines[k] for k in order)])
    where = {int(old) + 2: new + 2 for new, old in enumerate(order)}
    pairs, found = outliers_of(shuffled)
    assert rows(pairs, found) == {(where[a], where[b]) for a, b in bad}


@pytest.mark.parametrize("robust", [False, True])
def test_the_two_scatters_are_told_apart(robust):
    rng = np.random.default_rng(2)
    factor = np.geomspace(3, 300, 600)
    truth = Noise(relative=0.01, reading=0.002)
    residual = truth.sigma(factor) * rng.standard_normal(600)
    if robust:
        residual[::20] = 2.0
    found = estimate_noise(residual, factor, robust=robust)
    np.testing.assert_allclose(
        [found.relative, found.reading], [truth.relative, truth.reading], rtol=SHARE
    )
    # Perfect data have a floor of noise.
    assert np.all(estimate_noise(np.zeros(10), np.ones(10), robust=robust).sigma(np.ones(10)) > 0)


@pytest.mark.parametrize("n", [60, 200])
def test_a_steep_and_bent_curve_is_no_outlier(n):
    """e = 1 - b v^p with noise of half a per cent: no straight line follows its logarithm."""
    v = np.geomspace(0.2, 2, n)
    e = (1 - 0.4 * v**0.75) * (1 + 0.005 * np.random.default_rng(n).normal(size=n))
    straight = mark(v, e, np.zeros(n)).flagged
    pairs = make_pairs(read_recording(velocity=v, restitution=e), Flight())
    assert straight.any() and not find_outliers(pairs).flagged.any()
    e[n // 2] *= 0.6
    pairs = make_pairs(read_recording(velocity=v, restitution=e), Flight())
    assert np.flatnonzero(find_outliers(pairs).flagged).tolist() == [n // 2]


def test_a_pair_within_its_known_error_is_no_outlier():
    """Few pairs may agree by chance to less than that."""
    v = np.linspace(1, 2, 5)
    e = 0.8 * np.exp(np.array([1e-4, -1e-4, 0, 5e-3, 2e-4]))
    assert mark(v, e, np.zeros(5)).flagged.tolist() == [False, False, False, True, False]
    assert not mark(v, e, np.zeros(5), np.full(5, 2e-3)).flagged.any()
    assert mark(v, e, np.zeros(5), np.full(5, 5e-4)).flagged[3]


def test_rows_of_a_table_are_marked_as_its_pairs_are():
    """NaN is no row, a row with a large known error is no outlier, and three rows are too few."""
    v = np.linspace(1, 4, 12)
    e = 0.8 + 0.005 * np.cos(7 * v)
    e[2], e[5] = np.nan, 0.5
    marked, usual = marked_in(v, e)
    assert np.flatnonzero(marked).tolist() == [5]
    np.testing.assert_allclose(usual, 0.8, rtol=0.01)
    assert not marked_in(v, e, np.full(12, 0.06))[0].any()
    assert not marked_in(v[4:7], e[4:7])[0].any()
