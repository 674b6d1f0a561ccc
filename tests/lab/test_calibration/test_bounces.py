"""Laws and drag from flights, against integrated motion, known truths and `calibrate`.

Trigger errors are separated from the scatter of the bounces, and left out if they are wrong.
"""

import itertools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._flight import Flight
from jaxcontact.lab.bounces import BounceModel, NextFlight, by_triggers
from jaxcontact.lab.recordings import make_pairs, read_recording
from tests.lab.sources import restitution_of

G = 9.81
BALL = jc.Drag(mass=0.0027, radius=0.02, coefficient=0.5)
SPEED = np.geomspace(0.3, 5, 40)
CONTACT = jc.Contact(mass=0.0027, stiffness=2e5)
BOTH = ("mass", "stiffness")  # what stays where the drag is fitted, too
ROUNDING = 1e-14  # logarithms of order 1 in double precision, relative: 1e-15 was seen


def slowing(gravity=G, ball=BALL):
    """1/v_t² at C_d = 1."""
    return ball.terminal_speed(gravity) ** -2 / ball.coefficient


duration, height_reached = jax.jit(Flight.duration), jax.jit(Flight.height_reached)
launch_speed, landing_speed = jax.jit(Flight.launch_speed), jax.jit(Flight.landing_speed)
speed_after_drop = jax.jit(Flight.speed_after_drop)


def predictor(kind, drag=True):
    slow = jnp.asarray(slowing()) if drag else None
    return eqx.filter_jit(NextFlight(jnp.asarray(G), slow, kind, "auto"))


def readings(e, kind, coefficient=None, speed=SPEED):
    """What is read of a ball of restitution e(v); in vacuum its impacts are at `speed`."""
    drag = None if coefficient is None else jc.Drag(BALL.mass, BALL.radius, coefficient)
    b = Flight(G, drag).rate
    if kind == "intervals":
        first = 2 * speed / G
        landing, read = landing_speed(launch_speed(first, G, b), G, b), duration
    else:
        first = speed**2 / (2 * G)
        landing, read = speed_after_drop(first, G, b), height_reached
    after = np.array([e(v) for v in np.asarray(landing)]) * landing
    return first, np.asarray(read(after, G, b))


@pytest.mark.parametrize("kind", ["intervals", "heights"])
def test_vacuum_is_the_limit_of_weak_drag(kind):
    first = np.array([0.1, 0.4, 0.9])
    law = jc.AntypovElliott(e=0.9)
    vacuum = BounceModel(law, CONTACT)
    free = predictor(kind, drag=False)(vacuum, first)
    power = 1 if kind == "intervals" else 2
    np.testing.assert_allclose(free, np.log(first) + power * np.log(0.9), rtol=ROUNDING)

    def of(coefficient):
        return predictor(kind)(BounceModel(law, CONTACT, coefficient), first)

    # To first order in b: ln T₂ falls by u²(1+e²)/4 with u = g T₁/2, ln h₂ by g h (1+e²).
    scale = (G * first / 2) ** 2 / 4 if kind == "intervals" else G * first
    expected = -slowing() * scale * (1 + 0.9**2)
    modes = jax.jit(lambda c: (of(c), jax.jacfwd(of)(c), jax.jacrev(of)(c)))
    for tiny in (0.0, 1e-12):
        value, *slopes = modes(tiny)
        np.testing.assert_allclose(slopes, [expected] * 2, rtol=1e-10)
        np.testing.assert_allclose(value, free, rtol=ROUNDING if tiny == 0 else 1e-9)


VISCOUS = 1.1e-5
# The oscillator law of constant e compiles in half the time of the exact Hunt-Crossley law.
LAWS = {
    "exact": (jc.ExactRestitution(e=0.8), 0.9, lambda v: 0.9),
    "constant e": (jc.AntypovElliott(e=0.8), 0.9, lambda v: 0.9),
    "constant c": (
        *(jc.ConstantDamping(c=1e4), 2e4),
        restitution_of(jc.ConstantDamping(c=2e4), CONTACT),
    ),
    "viscous": (
        *(jc.KuwabaraKono(A=5e-6), VISCOUS),
        restitution_of(jc.KuwabaraKono(A=VISCOUS), CONTACT),
    ),
}
FOUND = 1e-10  # how far the numbers are from the truth, relative: 8e-12 was seen, by phase


@pytest.mark.slow(
    "viscous-heights-0.45-phase",
    reason="a fit whose model solves impacts by phase and follows drag",
)
@pytest.mark.parametrize(
    ("name", "kind", "drag", "method"),
    [
        ("exact", "intervals", None, "auto"),
        ("constant e", "intervals", 0.45, "auto"),
        ("constant c", "intervals", 0.45, "auto"),
        ("viscous", "heights", 0.45, "phase"),
    ],
)
def test_the_truth_comes_back(name, kind, drag, method):
    start, truth, e = LAWS[name]
    first, second = readings(e, kind, drag)
    how = {"kind": kind, "fixed": BOTH, "method": method} | ({"drag": BALL} if drag else {})
    # Single precision outside changes nothing.
    with jax.enable_x64(name != "constant e"):
        found = jc.fit_bounces(start, CONTACT, first, second, **how)
    assert found.converged and not found.unidentified, found.reason
    assert found.values == pytest.approx([truth, drag][: 2 if drag else 1], rel=FOUND)
    assert found.names[1:] == (("drag_coefficient",) if drag else ())
    assert (found.params.drag_coefficient is None) == (drag is None)
    np.testing.assert_allclose(found.predict(first), np.log(second), rtol=0, atol=1e-6)


NOISE = 0.003
DRAWS = 60


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("name", ["constant e", "constant c"])
def test_intervals_hold_the_truth(name, both):
    """Of readings with relative noise; with `both` the first has it too, and `sigma` counts it."""
    start, truth, e = LAWS[name]
    first, second = readings(e, "intervals", 0.5)
    random = np.random.default_rng(11)
    how = {"drag": BALL, "fixed": BOTH, "sigma": NOISE * np.sqrt(1 + both)}
    pull, errors = [], []
    for _ in range(DRAWS):
        off = NOISE * random.normal(size=(2, SPEED.size))
        read = first * np.exp(both * off[0]), second * np.exp(off[1])
        found = jc.fit_bounces(start, CONTACT, *read, **how)
        assert found.converged, found.reason
        errors.append(found.errors)
        pull.append((found.values - [truth, 0.5]) / found.errors)
    pull, errors = np.array(pull), np.array(errors)
    # Of 60 draws 57 are expected; fewer than 52 have a probability of 0.3 %.
    assert (np.sum(np.abs(pull) < 1.96, axis=0) >= 52).all()
    # The mean of 60 pulls is 0 ± 0.13: no bias, also with errors of the first reading.
    assert (np.abs(pull.mean(axis=0)) < 0.45).all()
    # C_d is known to 5 per cent; otherwise this test would pass with useless errors.
    assert (errors[:, 1] < 0.05).all()


def test_a_late_trigger_gets_no_other_weight():
    """The covariance of triggers is that of the flights which the fit expects, run by run."""
    flights = 0.7 * 0.85 ** np.arange(9)
    times = np.concatenate([[0], np.cumsum(flights)])

    def covariance(read, wrong=()):
        first, second = read[:-1], read[1:]
        expected = 0.85 * first
        expected[list(wrong)] = np.nan
        return by_triggers(first, second, expected).shape

    # By hand: an error of 1 s per trigger, two of which two neighbours share.
    slopes = np.zeros((8, 10))
    for i, (one, next_one) in enumerate(itertools.pairwise(flights)):
        slopes[i, i : i + 3] = 1 / one, -1 / one - 1 / next_one, 1 / next_one
    right = covariance(flights)
    np.testing.assert_allclose(right, slopes @ slopes.T, rtol=1e-12)
    late = np.array(times)
    late[7] += 0.03
    np.testing.assert_allclose(covariance(np.diff(late)), right, rtol=1e-12)
    # An excluded pair ends a run, and the next pair starts a new one.
    after = covariance(np.diff(late), wrong=(5, 6, 7))
    np.testing.assert_allclose(after[:5, :5], right[:5, :5], rtol=1e-12)


def test_one_speed_does_not_tell_air_from_law():
    first, second = readings(lambda v: 0.9, "intervals", 0.5, np.full(SPEED.size, 3.0))
    found = jc.fit_bounces(LAWS["constant e"][0], CONTACT, first, second, drag=BALL, fixed=BOTH)
    assert found.converged and len(found.unidentified) == 1
    assert set(found.unidentified[0].components) == {"law.e", "drag_coefficient"}
    assert np.isnan(list(found.standard_errors.values())).all()


@pytest.mark.slow(reason="two fits with drag to sixty rebounds, 10 s of CPU")
def test_drops_from_one_height_share_its_error():
    """Sixty rebounds of a table-tennis ball from six heights, of which each is off."""
    source = Path(jc.__file__).parent / "data" / "rebound_heights.csv"
    records = read_recording(source, ball="pingpong").records
    heights = np.array([(one.drop_height, one.height) for one in records]).T
    how = {"kind": "heights", "drag": BALL, "fixed": BOTH}
    found = jc.fit_bounces(jc.ExactRestitution(e=0.9), CONTACT, *heights, **how)
    assert found.converged and found.adequate, found
    # With independent errors: 0.70 ± 0.06, and the model is inadequate.
    assert found.values == pytest.approx([0.968, 0.73], abs=0.02)
    assert found.errors == pytest.approx([0.009, 0.16], rel=0.15)
    assert found.notes == ("errors of drop heights 1.6 mm, scatter of ln h 1.6 %",)
    alone = jc.fit_bounces(
        jc.ExactRestitution(e=0.9), CONTACT, *heights, weights=np.ones(60), **how
    )
    assert alone.adequate is False and alone.errors[1] < 0.5 * found.errors[1]


CALIBRATED = 5e-4
"""e by Huber's loss against e by marked outliers and weights: 3e-4 was seen, a standard error."""


def test_table_tennis_with_its_drag_agrees_with_the_calibration():
    """Successive intervals of the recording that is shipped, spurious ones too."""
    recording = read_recording(ball="pingpong")
    seconds = {one.row: one.seconds for one in recording.records}
    pairs = make_pairs(recording, Flight())
    both = [[seconds[row] for row in rows] for rows in (pairs.first_row, pairs.second_row)]
    start, how = LAWS["constant e"][0], {"drag": BALL, "fixed": BOTH, "loss": jc.Huber()}
    measured = jc.fit_bounces(start, CONTACT, *both, **how)
    assert measured.converged, measured.reason
    e, coefficient = map(float, measured.values)
    # A smooth sphere has 0.4 to 0.5 at these speeds; 0.545 ± 0.013 was found. An e that falls with
    # speed, buoyancy and errors shared by a trial bias this number and are not in its error.
    assert 0.4 < coefficient < 0.65 and measured.standard_errors["drag_coefficient"] < 0.03
    ball = jc.Drag(BALL.mass, BALL.radius, coefficient)
    # Only one law for comparison, because compiling all of them takes most of the time.
    result = jc.calibrate(recording, laws="constant_damping", drag=ball)
    estimate = result.choice.law_fit("constant e").estimates[0]
    assert estimate.name == "e" and 0.94 < e < 0.97
    assert e == pytest.approx(estimate.value, abs=CALIBRATED)


HALF = jc.ExactRestitution(e=0.5), CONTACT


def told_by(found):
    """The errors of triggers in ms, and the scatter of ln e in per cent, that a fit tells."""
    trigger, scatter = found.notes[-1].split(", ")
    return float(trigger.split()[-2]), float(scatter.split()[-2])


def test_the_sizes_of_both_errors_are_those_of_the_data():
    """Robust or not; twenty trials tell 0.3 ms and 0.4 % to a quarter."""
    random, first, second = np.random.default_rng(12), [], []
    for _ in range(20):
        ratios = 0.85 * np.exp(0.004 * random.normal(size=9))
        times = np.cumsum([0, *(0.8 * np.cumprod([1, *ratios]))]) + 3e-4 * random.normal(size=11)
        first, second = [*first, *np.diff(times)[:-1]], [*second, *np.diff(times)[1:]]
    for how in ({}, {"loss": jc.Huber()}):
        found = jc.fit_bounces(*HALF, first, second, **how)
        assert found.converged and told_by(found) == pytest.approx((0.3, 0.4), rel=0.25)


def test_one_trial_says_what_it_cannot_tell():
    random, triggers = np.random.default_rng(4), np.cumsum(0.8 * 0.9 ** np.arange(14))
    times = np.diff(triggers + 5e-4 * random.normal(size=14))
    found = jc.fit_bounces(*HALF, times[:-1], times[1:])
    low, high = found.interval()["law.e"]
    assert found.converged and low < 0.9 < high
    assert "standard errors exclude differences between trials" in str(found)
    # A user's statement about the errors is used.
    known = jc.fit_bounces(*HALF, times[:-1], times[1:], sigma=np.full(12, 0.01))
    assert known.notes == ()


def flights(wrong):
    """180 pairs of a ball with e = 0.85, of whose triggers a share is missed or spurious."""
    random, first, second, trial = np.random.default_rng(7), [], [], []
    for number in range(25):
        times = np.concatenate([[0], np.cumsum(0.8 * 0.85 ** np.arange(10))])
        times += 2e-4 * random.normal(size=11)
        kept = times[random.random(11) > wrong / 2]
        extra = random.uniform(0, times[-1], random.binomial(11, wrong / 2))
        t = np.diff(np.sort([*kept, *extra]))
        first, second = [*first, *t[:-1]], [*second, *t[1:]]
        trial += [number] * (len(t) - 1)
    table = {"first": np.array(first), "second": np.array(second), "groups": trial}
    return {name: column[:180] for name, column in table.items()}


def test_wrong_triggers_are_left_out():
    data = flights(0.1)
    found = jc.fit_bounces(*HALF, **data, loss=jc.Huber())
    assert found.converged, found.reason
    left = int(found.notes[0].split(" of ")[0])
    spoilt = np.abs(data["second"] / data["first"] / 0.85 - 1) > 0.1
    assert spoilt.sum() <= left <= 1.2 * spoilt.sum() and left > 25
    assert np.isnan(found.residuals[spoilt]).all() and found.residuals.size == spoilt.size
    low, high = found.interval()["law.e"]
    assert low < 0.85 < high and high - low < 2e-3
    # User weights count in addition to the marks.
    given = jc.fit_bounces(*HALF, **data, loss=jc.Huber(), weights=np.full(spoilt.size, 3.0))
    assert float(given.params.law.e) == pytest.approx(float(found.params.law.e), abs=1e-6)
    known = jc.fit_bounces(*HALF, **data, loss=jc.Huber(), sigma=1e-3)
    assert np.array_equal(np.isnan(known.residuals), np.isnan(found.residuals))


def test_a_recording_of_wrong_triggers_cannot_be_used():
    how = {**flights(0.3), "loss": jc.Huber()}
    with pytest.raises(jc.NumericalError, match="the recording cannot be used"):
        jc.fit_bounces(*HALF, **how)
    found = jc.fit_bounces(*HALF, **how, throw=False)
    assert not found.converged and "the recording cannot be used" in found.reason
    assert np.isnan(found.standard_errors["law.e"])
