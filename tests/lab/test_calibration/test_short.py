"""The verdict of a calibration in words, for data that would make a careless sentence false."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

import jaxcontact as jc
from jaxcontact._fit import Candidate
from jaxcontact._fit.compare import _verdict
from jaxcontact.lab.calibration import summary_data
from jaxcontact.lab.calibration.report import equivalents_sentence, marking_rule
from jaxcontact.lab.calibration.summary_data import AtSpeed, PairSummary, RecordingSummary
from jaxcontact.lab.calibration.verdict import cautions, headlines, law_sentence
from jaxcontact.lab.choice.certainty import Curve, Line
from jaxcontact.lab.choice.equivalent_e import Asked
from jaxcontact.lab.choice.kind import Estimate
from jaxcontact.lab.choice.law_choice import ChoiceData, LawFit
from jaxcontact.lab.pairs.pairs import Noise

GOOD = {"adequate": True, "grounds": "residuals do not follow x, p = 0.4"}
BAD = {"adequate": False, "grounds": "residuals follow x, p < 1e-03"}
OPEN = {"adequate": None, "grounds": "one degree of freedom, and the noise is unknown"}
BEYOND = "extrapolated: no pair is so "


def fitted(kind, law, name="c/K", *, converged=True, **told):
    estimates = (Estimate(name, 0.2, 0.01, ""),)
    tests = GOOD | told
    where = "no step is left" if converged else "2 steps were not enough"
    return LawFit(
        *(kind, law, estimates, "point", True, "nothing", 0.01, 1.0),
        *(tests["adequate"], tests["grounds"], converged, where, 3),
    )


def candidate(name, k=1, *, aicc=0.0, bic=None, held_out=1.0, **other):
    told = {"loss": 1.0, "behind": None, "converged": True, "adequate": True, "p": 0.4} | other
    return Candidate(
        name=name, k=k, aicc=aicc, bic=aicc if bic is None else bic, held_out=held_out, **told
    )


CONSTANT = fitted("constant e", "exact", "e")
POWER = fitted("1 - b v^p", "power_restitution", "b")
UNTESTED = fitted("constant e", "exact", "e", **OPEN)
FLAT = AtSpeed(0.5, 0.9, 0.89, 0.91, True, 0.9, 0.9), AtSpeed(4.0, 0.9, 0.89, 0.91, True, 0.9, 0.9)


TABLE = RecordingSummary("ball.csv", "table", "", 10, 0, ("1",))
FLIGHTS = dataclasses.replace(TABLE, layout="heights")


def summary(
    laws=(CONSTANT, POWER), best="constant e", *, sure=False, rivals=(), at=FLAT, free=None, **other
):
    choice = ChoiceData(
        *(10, tuple(candidate(law.kind, converged=law.converged) for law in laws)),
        *(best, sure, "verdict", tuple(laws), Line(0.0, 0.0, 0.1)),
        free=Curve((0.0,), 0.5, 4.0, free, free is not None and free < -2), asked=(),
        next_measurement="", rivals=tuple(rivals),
    )  # fmt: skip
    rows = [PairSummary((k,), 0.5 * k, 0.9, 0.0, False, None) for k in range(1, 11)]
    law = None if best is None else jc.ExactRestitution(e=0.9)
    there = {"law": law, "contact": jc.Contact(1.0, 1.0), "given": (), "standard_errors": {}}
    there |= {"requested": "all", "recording": TABLE, "gravity": 9.81, "drag": None}
    there |= {"noise": Noise(0.01, 0.0), "threshold": 6.0, "trend": "constant"}
    there |= {"pairs": tuple(rows), "choice": choice, "with_marked": choice, "by_speed": ()}
    there |= {"versions": {}, "at": at, "scatter": 0.01}
    return jc.CalibrationSummary(**there | other)


def test_e_is_said_first_with_its_interval():
    assert headlines(summary())[0] == "e = 0.900 ± 0.010 (95 %) at 0.5 to 4 m/s"
    falls = (
        AtSpeed(0.9, 0.8353, 0.8313, 0.8393, True, 0.83, 0.84),
        AtSpeed(*(3.4, 0.7751, 0.7351, 0.8151, True, 0.775, 0.776)),
    )
    first, meaning = headlines(summary(at=falls))
    assert first == "e = 0.8353 ± 0.0040 (95 %) at 0.9 m/s, 0.775 ± 0.040 (95 %) at 3.4 m/s"
    assert "is for the mean e at a speed, given the law." in meaning
    assert "A single reading of e scatters by 1 %." in meaning
    # 0.83 and 0.84 lie outside the interval.
    assert "Laws that are not ruled out differ by up to 0.005" in meaning
    one = dataclasses.replace(falls[0], velocity=3.4), falls[1]
    assert headlines(summary(at=one))[0].startswith("e = 0.8353 ± 0.0040 (95 %) at 3.4 m/s")


def test_other_speeds_are_said_with_what_is_doubtful_about_them():
    slow, fast = FLAT
    at = (
        AtSpeed(2.0, 0.9, 0.88, 0.92, True, 0.9, 0.9),
        AtSpeed(9.0, 0.9, 0.7, 0.95, False, 0.6, 0.9),
        AtSpeed(0.1, 0.9, None, None, False, 0.9, 0.9),
    )
    _, *said, _ = headlines(summary(at=(slow, fast, *at)))
    assert said[0] == "e = 0.900 ± 0.020 (95 %) at 2 m/s"
    # The halves of this interval differ.
    assert said[1] == (
        f"e = 0.90 (95 %: 0.70 to 0.95) at 9 m/s ({BEYOND}fast; "
        "laws that are not ruled out: 0.60 to 0.90)"
    )
    assert said[2] == f"e = 0.9 at 0.1 m/s ({BEYOND}slow)"


def test_a_law_that_does_not_describe_the_data_has_no_interval():
    bad = fitted("constant e", "exact", "e", **BAD)
    of = summary((bad, POWER))
    assert "(no 95 % interval: the law does not describe the data)" in headlines(of)[0]
    assert "95 % interval is" not in " ".join(headlines(of)[1:])
    assert "It does not describe the data (residuals follow x, p < 1e-03); 1 - b v^p does." in (
        law_sentence(of)
    )
    both = summary((bad, fitted("1 - b v^p", "power_restitution", "b", **BAD)))
    assert "and no other law does." in law_sentence(both)
    assert "no other law" not in law_sentence(summary((bad,)))


@pytest.mark.parametrize(
    ("given", "words", "not_words"),
    [
        ({}, "It describes the data.", "ruled out"),
        ({"sure": True}, "The choice is sure: every other law is ruled out or", "Not ruled"),
        ({"rivals": ["A", "B"]}, "Not ruled out: A and B.", "The choice is sure"),
        ({"laws": (UNTESTED, POWER)}, "It could not be tested: one degree", "It describes"),
        (
            {"requested": "power_restitution", "sure": True},
            "1 - b v^p, b = 0.200 ± 0.010 (± standard error). This law was requested; the "
            "best of the compared laws is constant e.",
            "The choice is sure",
        ),
        ({"best": None, "at": ()}, "no fit converged", "describes"),
    ],
)
def test_the_law_in_words(given, words, not_words):
    said = law_sentence(summary(**given))
    assert words in said and not_words not in said


def test_what_may_be_wrong_is_said():
    assert cautions(summary()) == []
    lost = fitted("constant c", "constant_damping", converged=False)
    assert cautions(summary((CONSTANT, lost)))[0].startswith("NOT converged")
    # The laws have an AICc of 0.
    assert "a better law is possible" in cautions(summary(free=-3.0))[0]
    assert cautions(summary(free=-1.0)) == []
    assert summary(free=-1.0).choice.yardstick.startswith("no smooth curve is clearly better")
    falls = dataclasses.replace(summary().choice, line=Line(0.0, -0.5, 0.1))
    assert cautions(summary(choice=falls)) == []  # a table has no flights
    assert "air drag is not corrected" in cautions(summary(choice=falls, recording=FLIGHTS))[0]


def test_a_worst_case_stays_short():
    """Long names, many rivals, notes without end."""
    names = [f"a law with a rather long name {k}" for k in range(9)]
    laws = [CONSTANT, *(fitted(name, f"law_{name}") for name in names)]
    notes = tuple(f'column{k} = "some heading {k} [mm/s]" / 1000' for k in range(30))
    long = {"source": "folder/" * 15 + "ball.csv", "ball": "b" * 20, "notes": notes}
    recording = dataclasses.replace(TABLE, **long)
    lines = repr(summary(laws, rivals=names[:3], recording=recording, free=-9.0)).splitlines()
    assert len(lines) <= 23 and max(map(len, lines)) <= 108  # names of files are not wrapped
    assert any(line.endswith(" ... (--details)") for line in lines)


def test_what_stands_for_what_was_not_given_and_how_pairs_are_marked():
    note = summary_data.contact_note
    assert note(()).endswith("1 kg and 1 N/m^(3/2) are placeholders")
    assert note(("mass",)) == "stiffness not given: 1 N/m^(3/2) is a placeholder"
    assert note(("stiffness",)) == "mass not given: 1 kg is a placeholder"
    assert marking_rule(summary()).endswith("from the trend and from a smooth curve")
    assert marking_rule(summary(recording=FLIGHTS)).endswith("from the trend")


def test_an_e_that_no_law_delivers():
    asked = Asked("a", None, None, 0.1, 0.15), Asked("b", 0.25, 0.01, 0.0, 1.0)
    choice = dataclasses.replace(summary().choice, asked=asked)
    assert equivalents_sentence(choice) == (
        "parameter e of each law that delivers a constant e of 0.2000: b 0.2500; "
        "a constant e of 0.2000 is out of range for a (0.1 to 0.15)"
    )
    none = dataclasses.replace(choice, asked=asked[:1])
    assert equivalents_sentence(none).startswith("a constant e of 0.2000 is out of range")


# The verdict of a comparison.


def said(candidates, equal=None, order=None):
    candidates = tuple(sorted(candidates, key=lambda c: c.aicc))
    equal = [c for c in candidates if c.aicc - candidates[0].aicc < 2] if equal is None else equal
    names = order or [c.name for c in candidates]
    return _verdict(candidates, equal, names, None, "speeds", "trial")


def test_of_equally_simple_laws_the_lowest_aicc_is_best():
    a, b = candidate("a", aicc=1.0), candidate("b", aicc=0.0)
    order = ["first given", "a", "b"]
    assert said([a, b], order=order)[0] == "b"
    # The first is the reference: a constant e.
    assert said([a, b], order=["a", "b"])[0] == "a"
    # The same curve except for rounding: the one given first.
    same = candidate("a", aicc=1e-4)
    assert said([same, b], order=order)[0] == "a"
    simple = candidate("c", 0, aicc=1.5)
    assert said([a, b, simple])[0] == "c"


def test_bic_has_a_larger_penalty_only_where_numbers_differ():
    one = candidate("one", 1, aicc=9.0, bic=0.0)
    two = candidate("two", 2, aicc=0.0, bic=1.0)
    text = said([one, two])[1]
    assert "BIC, which has a larger penalty for each parameter, prefers one by 1.0." in text
    same = candidate("one", 2, aicc=9.0, bic=0.0)
    text = said([same, two])[1]
    assert "BIC prefers one by 1.0." in text and "penalty" not in text
    # With few points AICc has the larger penalty, and BIC favours more parameters.
    few, more = candidate("few", 1, aicc=0.0, bic=1.0), candidate("more", 2, aicc=9.0, bic=0.0)
    assert "penalty" not in said([few, more])[1] and "BIC prefers more" in said([few, more])[1]
    tie = candidate("other", 1, aicc=1.0, bic=1.0 - 1e-9)
    assert "BIC" not in said([tie, candidate("first", 1, aicc=0.0, bic=1.0)])[1]


def test_the_best_is_named_so_only_where_every_measure_says_so():
    bad = {"adequate": False, "p": 0.001}
    first, simple = candidate("first", 2, aicc=0.0, **bad), candidate("simple", 1, aicc=1.0, **bad)
    best, text = said([first, simple])
    assert best == "simple"
    assert text.startswith("simple comes as close as any. But it does not describe the data (p = ")
    best, text = said([first, candidate("far", 1, aicc=99.0, **bad)])
    assert text.startswith("The best is first. But it does not describe the data (p = 0.001), and ")
    unknown = candidate("unknown", adequate=None, p=None)
    assert "describes" not in said([unknown])[1]


def test_points_left_out_are_predicted_best_where_the_printed_errors_differ():
    near, far = candidate("near", aicc=0.0, held_out=1.02641), candidate("far", 1, aicc=50.0)
    ahead = dataclasses.replace(far, held_out=1.02639)
    assert "predicted best" not in said([near, ahead])[1]
    assert "are predicted best by far" in said([near, dataclasses.replace(far, held_out=0.9)])[1]


# Few pairs.


@pytest.fixture(scope="module")
def two():
    return jc.calibrate(jc.read_recording(velocity=[2.0, 3.0], restitution=[0.85, 0.83]), at=2.5)


def test_two_pairs_give_e_of_each_and_their_mean(two):
    log_e = np.log([0.85, 0.83])
    mean, error = np.exp(log_e.mean()), log_e.std(ddof=1) / np.sqrt(2)
    half = mean * np.sinh(stats.t.ppf(0.975, 1) * error)
    (at,) = two.at[2:]
    assert at.restitution == pytest.approx(mean, rel=1e-7)
    assert (at.high - at.low) / 2 == pytest.approx(half, rel=1e-5)
    lines = repr(two).splitlines()
    assert lines[2] == "e = 0.84 ± 0.13 (95 %), the mean of 2 pairs at 2 to 3 m/s"
    assert [line.split() for line in lines if line.startswith("  1 ")] == [["1", "2.000", "0.8500"]]
    text = " ".join(repr(two).split())
    assert "A trend of e with speed cannot be tested with 2 pairs" in text
    assert "a choice among laws needs at least 4 pairs of speed and restitution" in text
    assert "for the mean e, if e does not depend on speed" in text
    assert two.choice.best == "constant e" and not two.choice.sure
    assert "NOT" not in two.report() and two.converged


def test_few_pairs_are_saved_drawn_and_ready_for_export(two, tmp_path):
    two.save(tmp_path / "two.json")
    loaded = jc.load_calibration(tmp_path / "two.json")
    assert repr(loaded) == repr(two) and loaded.report() == two.report()
    assert loaded.at == two.at
    jc.plot.calibration(two)
    law, contact, speeds = loaded.__export__(jc.Contact(0.1, 1e5))
    assert float(law.e) == float(two.law.e) and contact.mass == 0.1
    assert speeds.min() == pytest.approx(2) and speeds.max() == pytest.approx(3)


def test_one_pair_has_no_error_and_equal_ones_none_that_they_tell():
    far = jc.calibrate(jc.read_recording(velocity=[0.9, 3.4], restitution=[0.835, 0.775]))
    # An interval ends at one.
    assert repr(far).splitlines()[2].startswith("e = 0.80 (95 %: 0.50 to 1.00), the mean of 2")
    one = jc.calibrate(jc.read_recording(velocity=[2.0], restitution=[1.05]))
    assert repr(one).splitlines()[2] == "e = 1.05 at 2 m/s, from one pair"
    assert "e is above 1 in a pair" in repr(one) and one.at[0].low is None
    same = jc.calibrate(jc.read_recording(velocity=[2.0, 3.0], restitution=[0.8, 0.8]))
    assert "95 %" not in repr(same)


@pytest.mark.parametrize(
    ("e", "relative"),
    [
        ([0.8], 0.02),
        # They share a reading, as successive intervals do: var = (4e-4 - 1e-4)/2.
        ([0.8, 0.81], np.sqrt(1.5e-4)),
        # They differ by more than their errors, so their own scatter counts.
        ([0.8, 0.9], np.log(0.9 / 0.8) / 2),
    ],
)
def test_known_errors_of_readings_give_that_of_few_pairs(monkeypatch, e, relative):
    """As of a sound, whose times have known errors."""
    from jaxcontact.lab.calibration import calibrate as _calibrate

    made, n = _calibrate.make_pairs, len(e)
    shared = {"covariance": np.array([[4e-4, -1e-4], [-1e-4, 4e-4]])[:n, :n], "reading": 0.02}
    monkeypatch.setattr(
        _calibrate, "make_pairs", lambda *of: dataclasses.replace(made(*of), **shared)
    )
    few = jc.calibrate(jc.read_recording(velocity=[2.0, 2.5][:n], restitution=e))
    assert few.pairs[0].error == pytest.approx(0.02 * 0.8)
    assert few.standard_errors["e"] == pytest.approx(relative * float(few.law.e), rel=1e-4)
    if n == 1:
        assert repr(few).splitlines()[2] == "e = 0.800 ± 0.031 (95 %) at 2 m/s, from one pair"
        assert "is from the known error of the reading" in repr(few)
    assert "0.800 ± 0.016" in repr(few)


def test_a_law_of_the_speed_is_not_fitted_to_few_pairs():
    recording = jc.read_recording(velocity=[2.0, 3.0], restitution=[0.85, 0.83])
    found = jc.calibrate(recording, laws="constant_damping")
    assert isinstance(found.law, jc.ExactRestitution) and found.requested != "all"
