"""Sureness of a choice of law, by hand and by a short form of the study."""

import json
from collections import Counter

import jax
import numpy as np
import pytest
from scipy import stats

import jaxcontact as jc
from benchmarks.lab import choice_confusion
from jaxcontact.lab.choice.certainty import Certainty, excess_p
from jaxcontact.lab.choice.kinds import kinds_of

CONTACT = jc.Contact(mass=0.03, stiffness=1e6)
SPEED = np.geomspace(0.3, 4.0, 25)
SCATTER = 0.01 * np.random.default_rng(2).normal(size=SPEED.size)
PLASTIC = np.asarray(jc.ThorntonPlastic(yield_speed=0.1).restitution_at(SPEED))


@pytest.fixture(scope="module")
def plastic():
    return jc.choose_law(CONTACT, SPEED, PLASTIC * (1 + SCATTER))


def test_a_law_of_which_the_data_leave_no_doubt(plastic):
    assert plastic.best == "elastic-plastic" and plastic.sure
    assert "sure: every other law that does not contain it is excluded (p < 0.01" in plastic.verdict
    law = plastic.law()
    assert isinstance(law, jc.ThorntonPlastic) and law.yield_speed == pytest.approx(0.1, rel=0.1)
    # By hand: F of the larger sum of squares, with one direction more than the law has; and of the
    # smaller one of the law that contains it, with its damping.
    own = plastic.fits["elastic-plastic"]
    for kind, other in plastic.fits.items():
        narrow, wide = (other, own) if kind == "viscous and plastic" else (own, other)
        if other is not own:
            ratio = abs(other.loss - own.loss) / (narrow.loss / narrow.dof)
            p = stats.f.sf(ratio, 1, narrow.dof)
            assert excess_p(narrow, wide, 1) == pytest.approx(p)
            assert (p < 0.01) == (narrow is own) and (p < 0.01 or p >= 0.05), kind


def test_a_law_of_ones_choice_is_compared_with_a_constant_e_alone():
    found = jc.choose_law(CONTACT, SPEED, PLASTIC * (1 + SCATTER), laws="thornton_plastic")
    assert found.sure and found.verdict.endswith(
        "The choice is sure between the two: constant e is excluded (p < 0.01)."
    )


@pytest.mark.parametrize("seed", [100, 103, 106])
def test_a_single_slow_row_may_decide(seed):
    """All of the gain of adhesive bodies is that of the slowest row, where they almost stick."""
    v = np.linspace(0.4, 4, 20)
    noise = 1 + 0.01 * np.random.default_rng(seed).normal(size=v.size)
    found = jc.choose_law(CONTACT, v, np.sqrt(1 - (0.3 / v) ** 2) * noise)
    assert found.best == "adhesive (JKR)"
    assert found.law_fit(found.best).rms < 0.015 < found.law_fit("constant e").rms
    # The scatter of the gain by row, which that row dominates, does not count.
    (constant,) = (c for c in found.candidates if c.name == "constant e")
    assert constant.behind < 2 and constant.aicc - found.candidates[0].aicc > 10


def test_a_law_that_may_describe_five_points_goes_before_one_that_does_not():
    """AICc prefers the constant, which has one number less; F does not exclude a v^-p by it."""
    v = np.array([0.5, 1, 2, 3, 5])
    e = 0.7 * v**-0.15 * (1 + 0.02 * np.random.default_rng(4).normal(size=5))
    found = jc.choose_law(CONTACT, v, e, laws="bridges")
    first = found.candidates[0]
    assert first.name == "constant e" and first.adequate is False
    assert found.best == "a v^-p" and found.law_fit("a v^-p").adequate is None
    assert "lowest AICc is that of constant e, but it does not describe the data" in found.verdict


@pytest.mark.parametrize("seed", range(3))
def test_one_point_beyond_a_kink_gives_no_standard_error(seed):
    """Only the fastest row yields: its e is met exactly, and scatters from nothing."""
    v = np.geomspace(0.3, 4, 12)
    e = 1 - 0.0005 * np.random.default_rng(seed).random(12)
    e[-1] = 0.995
    found = jc.choose_law(CONTACT, v, e, laws="thornton_plastic", mark_outliers=False)
    fit, law = found.fits["elastic-plastic"], found.law_fit("elastic-plastic")
    assert v[-2] < fit.values[0] < v[-1] and np.isnan(fit.errors).all()
    assert "without a standard error: one point or group alone determines it" in law.said
    assert "one point or group alone determines it" in fit.summary()


def test_single_precision_and_double_of_the_callers_thread_alone(plastic):
    """The fits run in other threads, which have only the settings of the process."""
    e = PLASTIC * (1 + SCATTER)

    def process(x64, promotion):
        jax.config.update("jax_enable_x64", x64)
        jax.config.update("jax_numpy_dtype_promotion", promotion)

    process(False, "standard")
    try:
        single = jc.choose_law(CONTACT, SPEED, e)
        with jax.enable_x64(True):
            double = jc.choose_law(jc.Contact(mass=0.03, stiffness=1e6), SPEED, e)
    finally:
        process(True, "strict")
    for found in (single, double):
        assert found.verdict == plastic.verdict
        aicc = [[one.aicc for one in choice.candidates] for choice in (found, plastic)]
        np.testing.assert_allclose(*aicc, rtol=1e-12)


def test_laws_with_too_many_parameters_for_the_data_are_named():
    few = jc.choose_law(CONTACT, SPEED[::8], PLASTIC[::8])
    kinds = ["constant e", "constant c", "Kuwabara-Kono", "elastic-plastic", "adhesive (JKR)"]
    assert [law.kind for law in few.laws] == kinds and not few.sure
    assert few.laws[0].errors_by == "point"
    others = "c as a power of v, viscous and plastic, wet and 1 - b v^p"
    assert few.verdict.endswith(f"More points are needed to compare {others}.")


def test_a_curve_beyond_all_laws_leaves_the_choice_open():
    """The curve of a linear dashpot is almost that of c as a power of v."""
    e = np.asarray(jc.restitution(jc.LinearDashpot(c=5.0), CONTACT, SPEED[::2]))
    found = jc.choose_law(CONTACT, SPEED[::2], e * (1 + 0.03 * SCATTER[::2]))
    assert not found.sure and Certainty(found.fits, found._kinds).standing(found.best).sure
    assert "not sure: a free smooth curve has an AICc lower" in found.verdict


def test_a_free_curve_is_no_alarm_by_chance():
    """By hand: F of one direction more than the law has numbers, for each of seven degrees."""
    alarms = []
    for size in (0, 0.01, 0.015, 0.06):
        e = PLASTIC * (1 + SCATTER + size * np.sin(3 * np.log(SPEED)))
        found = jc.choose_law(CONTACT, SPEED, e)
        k, p = len(found.free.coefficients), []
        for c in found.candidates:
            fit, more = found.fits[c.name], max(k - c.k, 0) + 1
            factor = np.asarray(fit.problem.factor)[: SPEED.size]
            z = factor * np.log(found.free(SPEED) / e)
            gain = (2 * fit.loss - z @ z) / more / (z @ z / (SPEED.size - k))
            p.append(stats.f.sf(gain, more, SPEED.size - k))
        lower = found.free.aicc < min(c.aicc for c in found.candidates) - 2
        alarms.append((lower, found.better_possible))
        assert found.better_possible == (lower and 7 * max(p) < 0.05)
    assert alarms[0] == (False, False) and alarms[-1] == (True, True)


def test_a_known_noise_makes_it_a_chi_square():
    found = jc.choose_law(CONTACT, SPEED, PLASTIC * (1 + SCATTER), sigma=0.01 * PLASTIC)
    own, other = (found.fits[kind] for kind in ("elastic-plastic", "1 - b v^p"))
    gain = 2 * (other.loss - own.loss)
    assert excess_p(own, other, 2) == pytest.approx(stats.chi2.sf(gain, 2))
    assert excess_p(other, own, 2) == 1 and found.sure


def test_what_keeps_it_open_is_said():
    """Near e = 1 all laws whose loss is a power of the speed are the same."""
    noisy = jc.choose_law(CONTACT, SPEED, 1 - 0.05 * SPEED**0.2 + 0.5 * SCATTER)
    assert not noisy.sure
    kinds = {kind.name: kind for kind in noisy._kinds}
    standing = Certainty(noisy.fits, noisy._kinds).standing(noisy.best)
    assert set(standing.rivals) >= {"Kuwabara-Kono", "1 - b v^p"} - {noisy.best}
    assert all(name in noisy.verdict for name in standing.rivals)
    assert standing.containing == {
        name for name, kind in kinds.items() if kind.contains(kinds[noisy.best])
    }


def test_an_inadequate_law_is_never_sure():
    wave = 0.8 + 0.05 * np.sin(4 * np.log(SPEED))
    wavy = jc.choose_law(CONTACT, SPEED, wave + 0.1 * SCATTER)
    assert not wavy.sure and "does not describe the data" in wavy.verdict
    assert "a better law is possible" in wavy.yardstick
    np.testing.assert_allclose(wavy.free(SPEED), wave, atol=0.01)


@pytest.mark.parametrize("trials", [5, 12])
def test_trials_may_be_shifted(plastic, trials):
    """Few of them are asked about what is left beside a shift of each, many by their signs."""
    trial = np.arange(SPEED.size) % trials
    shift = 0.003 * np.random.default_rng(4).normal(size=trials)[trial]
    found = jc.choose_law(CONTACT, SPEED, PLASTIC * (1 + 0.3 * SCATTER + shift), groups=trial)
    assert found.sure and found.best == plastic.best


def test_three_trials_of_two_points_leave_it_open():
    six = slice(None, 24, 4)
    e = (PLASTIC * (1 + 0.1 * SCATTER))[six]
    found = jc.choose_law(CONTACT, SPEED[six], e, groups=[0, 1, 2, 0, 1, 2])
    assert not found.sure and "the fit could not be tested" in found.verdict


def test_contact_times_and_forces_take_part():
    """They determine the stiffness, and e(v) is that of e alone."""
    hit = jc.impact(jc.ConstantDamping(c=3e5), jc.Contact(0.01, 1e6), SPEED)
    noise = np.random.default_rng(3).normal(size=(3, SPEED.size))
    clean = np.stack([hit.restitution, hit.duration, hit.max_force])
    e, duration, force = clean * np.exp(np.array([[0.01], [0.02], [0.03]]) * noise)
    start, how = jc.Contact(0.01, 3e6), {"laws": "constant_damping", "duration": duration}
    force = np.where(SPEED > 1, force, np.nan)
    found = jc.choose_law(start, SPEED, e, max_force=force, **how)
    fit, contact = found.fits["constant c"], found.contact_of()
    assert found.best == "constant c" and found.sure and found.count == SPEED.size
    assert fit.dof == 2 * SPEED.size + np.isfinite(force).sum() - 2
    assert abs(float(contact.stiffness) - 1e6) < 4 * fit.standard_errors["stiffness"] < 1e5
    assert found.law().c == pytest.approx(3e5, rel=0.05)
    # The law and its contact deliver the fitted curve.
    want, _ = found.curve("constant c", SPEED)
    np.testing.assert_allclose(jc.restitution(found.law(), contact, SPEED), want, rtol=1e-10)
    assert found.laws[1].estimates[-1].name == "K"
    assert found.free.aicc is None and found.yardstick == ""


@pytest.mark.slow(reason="a study of 16 tables by its benchmark")
def test_the_study_in_seconds(tmp_path):
    def study(only):
        words = ["--tables", "2", "--only", only, "--into", str(tmp_path)]
        choice_confusion.STUDY.command(words)
        return json.loads((tmp_path / "choice_confusion.json").read_text())

    for truth in ("constant c", "c rises", "elastic-plastic", "wet"):
        result = study(f"{truth}, 25 points, noise proportional")
    sums = choice_confusion.shares(result)["all"]
    assert sums["tables"] == 16 and sums["clear"] >= 5
    # Two standard deviations beyond 2 % and 80 %.
    assert sums["wrong"] <= 1 and sums["clear and right"] >= 0.5 * sums["clear"]
    # Whether the curve of the right law is off is counted where the choice is sure of it.
    sure = 0
    for name, cell in result["cells"].items():
        sure += cell["sure"].get(choice_confusion.TRUTHS[name.split(",")[0]].kind, 0)
        assert cell["left"] <= cell["strictly left"] <= cell["right"]
        assert cell["wrong"] == cell["strict"]
    assert sum(cell["right"] for cell in result["cells"].values()) == sure


def test_the_committed_study_has_all_cells():
    result = choice_confusion.STUDY.result()
    assert set(result["cells"]) == {name for name, _ in choice_confusion.cells()}
    truths = choice_confusion.TRUTHS.values()
    assert {truth.kind for truth in truths} == {None, *(kind.name for kind in kinds_of("all", 1.5))}
    assert Counter(truth.kind is None for truth in truths) == {False: 10, True: 2}
