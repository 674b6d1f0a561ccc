"""Records of one impact from another solver: K, the law and the touch are recovered."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, signal

import jaxcontact as jc
from benchmarks import fit_coverage as truths
from benchmarks.fit_coverage import DAMPING, FORCE_ZERO, MASS, SPEED, STIFFNESS, TIME
from jaxcontact.lab.records.instrument_errors import rounding, rounding_of_white_noise, step_of
from jaxcontact.lab.records.low_pass import Course, limits_of

# As in a fit, where products of real and complex numbers are allowed.
pytestmark = pytest.mark.usefixtures("usual_promotion")

NOISE_FORCE, NOISE_DEPTH = 5.0, 2e-6
TRUE = {
    "law.c": DAMPING, "contact.stiffness": STIFFNESS, "velocity": SPEED, "start_time": truths.TOUCH,
    "force_offset": FORCE_ZERO, "indentation_offset": truths.DEPTH_ZERO,
    "low_pass_force.cutoff": truths.CUTOFF,
}  # fmt: skip


@pytest.fixture(scope="module")
def clean():
    """Force and indentation at TIME, by scipy, with free flight before and after."""
    record = truths.clean_record()
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
    assert {*near.names, "low_pass_force.cutoff"} == set(TRUE)
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
            true = DAMPING, STIFFNESS, SPEED, truths.TOUCH, zero * peak
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
    for noise in np.repeat((0.2, 0.5, 1.0), 30):
        peak = 33 * np.sin(time) + noise * random.normal(size=time.size)
        zero = random.uniform(0, 1)
        read, cut = (np.round(y - zero) for y in (peak, np.minimum(peak, 29.0)))
        assert not limits_of(read, two_sided=False).at_limit.any()
        assert limits_of(cut, two_sided=False).at_limit.any()


def test_an_indentation_that_ends_at_the_lower_limit(clean):
    depth = clean[1] + NOISE_DEPTH * np.random.default_rng(5).normal(size=TIME.size)
    low = -2e-4
    found = jc.fit_record(*start(), indentation=np.maximum(depth, low))
    assert found.converged, found.reason
    assert np.abs(pulls(found)).max() < 3.5
    assert "readings of indentation are at a limit" in str(found)


# A sensor behind a low-pass filter, against SciPy's; its noise, and that of quantised readings.

END, FIRST, LAST = 1.1e-3, 1.5, -1.0
PARTS = 127
DENSE = np.linspace(-2e-3, 4e-3, 120_001)
EVERY = 400


def force():
    return Course(jnp.zeros(()), lambda t: jnp.sin(jnp.pi * t / END) ** 1.5, END, (0.0, 0.0))


def depth():
    """A ramp before, half a sine, another ramp after: in units of 1 mm."""

    def inside(t):
        return 1e3 * FIRST * (END / jnp.pi * jnp.sin(jnp.pi * t / END) - t)

    return Course(jnp.asarray(1e3 * FIRST), inside, END, (-1e3 * FIRST * END, 1e3 * (LAST - FIRST)))


AGREES = 2e-6
"""Of the largest reading; a digital filter of 50 ns steps is off by 1e-7 to 1e-6 of it."""


@pytest.mark.parametrize("order", [1, 2, 5, 8])
@pytest.mark.parametrize("course", [force, depth])
def test_it_filters_as_scipy_does(course, order):
    at, made = slice(None, None, EVERY), course()
    signal_ = np.asarray(jax.jit(made.read)(DENSE))
    # A ramp that began long ago is only delayed.
    before = float(made.before)
    filtered = jax.jit(
        lambda cutoff: jc.LowPass(cutoff, order).read(course(), jnp.asarray(DENSE[at]), PARTS)
    )
    for cutoff in (1 / END, 3 / END, 30 / END):
        sections = signal.butter(order, cutoff, fs=1 / (DENSE[1] - DENSE[0]), output="sos")
        poles = signal.butter(order, 2 * np.pi * cutoff, analog=True, output="zpk")[1]
        late = float(np.sum(-1 / poles).real)
        expected = signal.sosfilt(sections, signal_ - before * DENSE) + before * (DENSE - late)
        atol = AGREES * np.abs(signal_).max()
        np.testing.assert_allclose(filtered(cutoff), expected[at], rtol=0, atol=atol)


def test_its_derivatives():
    moments = jnp.linspace(-1e-4, 2e-3, 60)

    @jax.jit
    def read(cutoff):
        def at(cutoff):
            return jc.LowPass(cutoff, 3).read(depth(), moments, PARTS)

        return jax.jvp(at, (cutoff,), (jnp.ones_like(cutoff),))

    step = 0.3
    slope = (read(3000.0 + step)[0] - read(3000.0 - step)[0]) / (2 * step)
    atol = 1e-6 * np.abs(slope).max()
    np.testing.assert_allclose(read(3000.0)[1], slope, rtol=0, atol=atol)


@pytest.mark.parametrize("order", [1, 2, 3, 8])
def test_noise_behind_it(order):
    """The correlation is the cosine transform of |H|²."""
    lags = np.linspace(0, 1e-3, 7)

    def power(w, lag):
        return np.cos(w * lag) / (1 + (w / (2 * np.pi * 900)) ** (2 * order))

    most = 2 * np.pi * 900 * (2000 if order == 1 else 60)
    seen = [integrate.quad(power, 0, most, args=(lag,), limit=4000)[0] for lag in lags]
    found = jc.LowPass(900.0, order).correlation(lags)[0]
    np.testing.assert_allclose(found, np.array(seen) / seen[0], rtol=0, atol=2e-3)


def test_the_noise_of_steps():
    """The covariance of rounding with a random zero, against draws."""
    random, step, draws = np.random.default_rng(4), 1.0, 40_000
    expected = np.array([0.0, 0.05, 0.4, 7.3])
    noise = 0.15**2 * np.array([[1, 0.9, 0, 0], [0.9, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    values = expected + random.multivariate_normal(np.zeros(4), noise, size=draws)
    zero = random.uniform(0, step, size=(draws, 1))
    off = step * np.round((values - zero) / step) + zero - expected
    found = noise + rounding(noise, expected, step)
    # Four standard deviations of a covariance from so many draws.
    blur = 4 * np.diag(found).max() / np.sqrt(draws)
    np.testing.assert_allclose(off.T @ off / draws, found, rtol=0, atol=blur)
    assert found[0, 1] > 0.04 > abs(found[0, 3]) + 0.01 and np.linalg.eigvalsh(found).min() > 0


def test_white_noise_in_steps_needs_no_matrix():
    sigma, expected = np.array([0.1, 0.2, 0.3, 0.15]), np.array([0.0, 0.5, 4.1, 7.3])
    own, root = rounding_of_white_noise(sigma, expected, 0.7)
    noise = np.diag(sigma**2)
    whole = noise + rounding(noise, expected, 0.7)
    np.testing.assert_allclose(np.diag(own) + root @ root.T, whole, rtol=0, atol=1e-15)
    assert own.min() > 0 and root.shape == (4, 24)


def test_steps_are_found():
    random = np.random.default_rng(5)
    smooth = np.sin(np.linspace(0, 6, 400)) + 0.01 * random.normal(size=400)
    assert step_of(smooth) == 0
    assert step_of(0.02 * np.round(smooth / 0.02) + 0.7) == pytest.approx(0.02, rel=1e-6)
    single = (np.round(smooth / 0.02) * np.float32(0.02)).astype(np.float32)
    assert step_of(single.astype(float)) == pytest.approx(0.02, rel=1e-4)
    # Two instruments in one column have no common resolution.
    assert step_of(np.concatenate([np.round(smooth, 1), np.round(smooth, 1) + 0.0137])) == 0


def test_a_record_behind_a_filter(monkeypatch):
    """K, c and the cut-off come back; noise is that of the readings, in steps or not."""
    random = np.random.default_rng(2)
    original, step, pull = jc.fit_record, 60.0, []

    def in_steps(*arguments, force, **others):
        return original(*arguments, force=step * np.round(force / step), **others)

    for read in (original, in_steps):
        monkeypatch.setattr(jc, "fit_record", read)
        found = truths.filtered_fit(random, fitted=True)
        # One in twenty is called inadequate, one in a thousand this clearly.
        assert found.converged and found.adequacy.p > 1e-3, found
        pull.append(pulls(found))
    assert np.abs(pull).max() < 3.5 and np.sqrt(np.mean(np.square(pull))) < 1.7
    assert "readings of force are rounded to steps of 60, 1.9 of" in found.notes[-1]


@pytest.mark.slow(reason="a fit to a record of 2500 readings")
def test_a_long_record_in_steps_is_not_too_sure():
    """Each step lasts for many readings, which share its error: errors grow tenfold."""
    time = np.linspace(0, 2.2e-3, 2500)
    clean = truths.course(time)["force"] + FORCE_ZERO
    step, random = truths.NOISE["force"] * clean.max(), np.random.default_rng(3)
    read = step * np.round((clean + step / 5 * random.normal(size=time.size)) / step - 0.3)
    law, contact = jc.ConstantDamping(c=3e6), jc.Contact(mass=MASS, stiffness=4e7)
    found = jc.fit_record(law, contact, time, 1.2, force=read + 0.3 * step)
    assert found.converged and np.abs(pulls(found)).max() < 3 and found._wider.max() > 50
    assert not any("limit" in note for note in found.notes)
