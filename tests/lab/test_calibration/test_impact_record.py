"""Records of one impact from another solver: K, the law and the touch are recovered."""

import re

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.fit_coverage import (
    DAMPING,
    DEPTH_ZERO,
    FORCE_ZERO,
    MASS,
    SPEED,
    STIFFNESS,
    TIME,
    TOUCH,
    clean_record,
)
from jaxcontact.lab.records.low_pass import limits_of

NOISE_FORCE, NOISE_DEPTH = 5.0, 2e-6
TRUE = {
    "law.c": DAMPING, "contact.stiffness": STIFFNESS, "velocity": SPEED, "start_time": TOUCH,
    "force_offset": FORCE_ZERO, "indentation_offset": DEPTH_ZERO,
}  # fmt: skip


@pytest.fixture(scope="module")
def clean():
    """Force and indentation at TIME, by scipy, with free flight before and after."""
    record = clean_record()
    return record["force"], record["indentation"]


def start():
    """Twenty to fifty per cent off."""
    return jc.ConstantDamping(c=3e6), jc.Contact(mass=MASS, stiffness=4e7), TIME, 1.2


CLEAN = 1e-5  # what the cubic between 128 samples leaves in K and c; 1e-6 was seen


def pulls(found):
    """How far numbers are from the truth, in standard errors."""
    return (found.values - [TRUE[name] for name in found.names]) / found.errors


@pytest.fixture(scope="module")
def near(clean):
    return jc.fit_record(*start(), force=clean[0], indentation=clean[1])


def test_a_clean_record(near):
    assert near.converged, near.reason
    assert set(near.names) == set(TRUE)
    true = [TRUE[name] for name in near.names]
    assert near.values.tolist() == pytest.approx(true, rel=CLEAN, abs=1e-9)


def test_noisy_records_hold_the_truth(clean):
    random, pull = np.random.default_rng(8), []
    sigma = {"sigma_force": NOISE_FORCE, "sigma_indentation": NOISE_DEPTH}
    for _ in range(20):
        force = clean[0] + NOISE_FORCE * random.normal(size=TIME.size)
        depth = clean[1] + NOISE_DEPTH * random.normal(size=TIME.size)
        found = jc.fit_record(*start(), force=force, indentation=depth, **sigma)
        assert found.converged, found.reason
        pull.append(pulls(found))
    # 120 pulls: their mean square is 1 within 0.13 for each standard deviation, if independent.
    assert 0.6 < np.mean(np.square(pull)) < 1.5 and np.mean(np.abs(pull) < 1.96) > 0.88


def test_an_offset_and_starts_off_by_two(clean):
    """Noise of 2 % of the peak, zeros of up to a tenth of it; of 1000 such fits 999 converged."""
    random, peak = np.random.default_rng(58), clean[0].max() - FORCE_ZERO
    for zero in (-0.1, 0.0, 0.05, 0.1):
        noise = 0.02 * random.normal(size=TIME.size)
        force = clean[0] - FORCE_ZERO + (zero + noise) * peak
        for factors in 2 ** random.uniform(-1, 1, size=(3, 3)):
            law = jc.ConstantDamping(c=DAMPING * factors[0])
            contact = jc.Contact(mass=MASS, stiffness=STIFFNESS * factors[1])
            found = jc.fit_record(law, contact, TIME, SPEED * factors[2], force=force)
            assert found.converged, found.reason
            true = DAMPING, STIFFNESS, SPEED, TOUCH, zero * peak
            assert np.abs((found.values - true) / found.errors).max() < 4


def test_a_filter_that_a_record_does_not_show_is_left_out(clean):
    force = clean[0] + 60 * np.random.default_rng(2).normal(size=TIME.size)
    found = jc.fit_record(*start(), force=force, low_pass_force=jc.LowPass(2500.0))
    assert found.converged and "low_pass_force.cutoff" not in found.names
    (note,) = found.notes
    ((cutoff, delay),) = re.findall(r"at least (\S+) Hz, its delay at most (\S+) s", note)
    # The bound of 2 kHz is that at which the sum of squares is larger by 3.84 of its variances.
    # Delays of filters of slow signals: 1/(2π f_c), and √2 times that at second order.
    assert float(delay) * float(cutoff) * 2 * np.pi == pytest.approx(np.sqrt(2), rel=0.1)
    assert jc.LowPass(1.0, 1).delay * 2 * np.pi == pytest.approx(1)
    held = {"fixed": ("mass", "low_pass_force"), "force": force}
    plain = jc.fit_record(*start(), force=force)
    for factor, excluded in ((0.7, True), (1.4, False)):
        low_pass = jc.LowPass(factor * float(cutoff))
        slow = jc.fit_record(*start(), low_pass_force=low_pass, **held)
        size = [np.sum(one.residuals**2) for one in (plain, slow)]
        assert (TIME.size * np.log(size[1] / size[0]) > 3.84) == excluded


@pytest.mark.parametrize("far", [1e-6, 1e6])
def test_a_stiffness_far_off_is_no_start(clean, near, far):
    columns = {"force": clean[0], "indentation": clean[1]}
    contact = jc.Contact(mass=MASS, stiffness=4e7 * far)
    # The damping that would correspond to this stiffness, and the actual one.
    for c in (3e6, 3e6 * far):
        found = jc.fit_record(jc.ConstantDamping(c=c), contact, TIME, start()[3], **columns)
        assert found.converged, found.reason
        np.testing.assert_allclose(found.values, near.values, rtol=CLEAN, atol=1e-9)
    # Another law with almost the same damping, and a force alone, which needs the speed.
    held = {"fixed": ("mass", "velocity"), "force": clean[0]}
    found = jc.fit_record(jc.HuGuo(e=0.5), contact, TIME, SPEED, **held)
    assert found.converged and found.params.contact.stiffness == pytest.approx(STIFFNESS, rel=0.05)


def test_a_contact_beside_that_of_the_record_is_no_fit(clean):
    law, _, _, speed = start()
    contact = jc.Contact(mass=MASS, stiffness=4e13)
    held = ("mass", "velocity", "stiffness")
    found = jc.fit_record(law, contact, TIME, speed, force=clean[0], fixed=held, throw=False)
    assert not found.converged and "misses that of the record" in found.reason
    assert np.isnan(found.covariance).all()


def test_a_force_that_is_cut_counts_as_at_least_that(clean):
    """At 70 % of its maximum K is held; taken as it is read, it is wrong by many errors."""
    random, limit = np.random.default_rng(3), 0.7 * clean[0].max()
    force = np.minimum(clean[0] + NOISE_FORCE * random.normal(size=TIME.size), limit)
    found = jc.fit_record(*start(), force=force)
    assert found.converged, found.reason
    cut = int(np.sum(force == limit))
    said = f"{cut} of 150 readings of force are at a limit of the instrument"
    assert said in found.notes[0] and cut > 20
    assert np.abs(pulls(found)).max() < 3.5
    assert float(found.predict()["force"].max()) == pytest.approx(limit)
    # The noise is that of the readings that are not clipped: 5 N, known to 7 per cent.
    noise = np.sqrt(found.noise) / np.max(found.problem.factor)
    assert noise == pytest.approx(NOISE_FORCE, rel=0.25)


@pytest.mark.parametrize("step", [0.0, 0.5, 3.0])
def test_a_peak_in_steps_is_no_limit(step):
    time = np.linspace(-1, 1, 81)
    peak = 10 * (1 - time**2)
    peak = np.round(peak / step) * step if step else peak
    for two_sided in (False, True):
        assert not limits_of(peak, two_sided=two_sided).at_limit.any()
    cut = limits_of(np.minimum(peak, 6.0), two_sided=True)
    if step < 1:
        assert np.array_equal(cut.at_limit, peak >= 6) and cut.high == 6 and cut.low == -np.inf


def test_noise_does_not_make_a_peak_a_limit():
    """Of a fifth of a step it cuts the value beside a peak into short runs, and not the peak."""
    time, random = np.linspace(0, np.pi, 2500), np.random.default_rng(6)
    for noise in (0.2, 0.5, 1.0):
        for _ in range(30):
            peak = 33 * np.sin(time) + noise * random.normal(size=time.size)
            zero = random.uniform(0, 1)

            def steps(y, zero=zero):
                return np.round(y - zero)

            assert not limits_of(steps(peak), two_sided=False).at_limit.any()
            cut = limits_of(steps(np.minimum(peak, 29.0)), two_sided=False)
            assert cut.at_limit.any()


def test_an_indentation_that_ends_at_the_lower_limit(clean):
    depth = clean[1] + NOISE_DEPTH * np.random.default_rng(5).normal(size=TIME.size)
    low = -2e-4
    found = jc.fit_record(*start(), indentation=np.maximum(depth, low))
    assert found.converged, found.reason
    assert np.abs(pulls(found)).max() < 3.5
    assert "readings of indentation are at a limit" in str(found)
