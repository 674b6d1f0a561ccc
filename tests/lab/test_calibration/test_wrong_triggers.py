"""Trigger errors: separated from the scatter of the bounces, and excluded if they are wrong."""

import numpy as np
import pytest

import jaxcontact as jc

CONTACT = jc.Contact(mass=0.0027, stiffness=2e5)
START = jc.ExactRestitution(e=0.5), CONTACT


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
        found = jc.fit_bounces(*START, first, second, **how)
        assert found.converged and told_by(found) == pytest.approx((0.3, 0.4), rel=0.25)


def test_one_trial_says_what_it_cannot_tell():
    random, triggers = np.random.default_rng(4), np.cumsum(0.8 * 0.9 ** np.arange(14))
    times = np.diff(triggers + 5e-4 * random.normal(size=14))
    found = jc.fit_bounces(*START, times[:-1], times[1:])
    low, high = found.interval()["law.e"]
    assert found.converged and low < 0.9 < high
    assert "standard errors exclude differences between trials" in str(found)
    # A user's statement about the errors is used.
    known = jc.fit_bounces(*START, times[:-1], times[1:], sigma=np.full(12, 0.01))
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
    found = jc.fit_bounces(*START, **data, loss=jc.Huber())
    assert found.converged, found.reason
    left = int(found.notes[0].split(" of ")[0])
    spoilt = np.abs(data["second"] / data["first"] / 0.85 - 1) > 0.1
    assert spoilt.sum() <= left <= 1.2 * spoilt.sum() and left > 25
    assert np.isnan(found.residuals[spoilt]).all() and found.residuals.size == spoilt.size
    low, high = found.interval()["law.e"]
    assert low < 0.85 < high and high - low < 2e-3
    # User weights count in addition to the marks.
    given = jc.fit_bounces(*START, **data, loss=jc.Huber(), weights=np.full(spoilt.size, 3.0))
    assert float(given.params.law.e) == pytest.approx(float(found.params.law.e), abs=1e-6)
    known = jc.fit_bounces(*START, **data, loss=jc.Huber(), sigma=1e-3)
    assert np.array_equal(np.isnan(known.residuals), np.isnan(found.residuals))


def test_a_recording_of_wrong_triggers_cannot_be_used():
    how = {**flights(0.3), "loss": jc.Huber()}
    with pytest.raises(jc.NumericalError, match="the recording cannot be used"):
        jc.fit_bounces(*START, **how)
    found = jc.fit_bounces(*START, **how, throw=False)
    assert not found.converged and "the recording cannot be used" in found.reason
    assert np.isnan(found.standard_errors["law.e"])
