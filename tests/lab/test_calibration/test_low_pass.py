"""A sensor behind a low-pass filter, against SciPy's; its noise, and that of quantised readings."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, signal

import jaxcontact as jc
from benchmarks import fit_coverage as truths
from jaxcontact.lab.records.instrument_errors import rounding, rounding_of_white_noise, step_of
from jaxcontact.lab.records.low_pass import Course

# As in a fit, where products of real and complex numbers are allowed.
pytestmark = pytest.mark.usefixtures("usual_promotion")

END, SPEED, LAST = 1.1e-3, 1.5, -1.0
PARTS = 127
DENSE = np.linspace(-2e-3, 4e-3, 120_001)
EVERY = 400


def force():
    return Course(jnp.zeros(()), lambda t: jnp.sin(jnp.pi * t / END) ** 1.5, END, (0.0, 0.0))


def depth():
    """A ramp before, half a sine, another ramp after: in units of 1 mm."""

    def inside(t):
        return 1e3 * SPEED * (END / jnp.pi * jnp.sin(jnp.pi * t / END) - t)

    return Course(jnp.asarray(1e3 * SPEED), inside, END, (-1e3 * SPEED * END, 1e3 * (LAST - SPEED)))


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


def test_what_is_no_filter():
    law, contact, slow = jc.Hertz(), jc.Contact(1.0, 1e6), jc.LowPass(100.0)
    time, long = np.linspace(0, 1, 5), np.linspace(0, 1, 4500)
    with pytest.raises(ValueError, match="`order` must be at most 8, but is 9"):
        jc.LowPass(100.0, order=9)
    with pytest.raises(ValueError, match="`low_pass_force` must be None without `force`"):
        jc.fit_record(law, contact, time, 1.0, indentation=time, low_pass_force=slow)
    with pytest.raises(ValueError, match=r"at most 2000 readings .* give every 3rd"):
        jc.fit_record(law, contact, long, 1.0, force=long, low_pass_force=slow)


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
    own = {"law.c": truths.DAMPING, "contact.stiffness": truths.STIFFNESS}
    own |= {"low_pass_force.cutoff": truths.CUTOFF, "start_time": truths.TOUCH}
    random = np.random.default_rng(2)
    original, step, pulls = jc.fit_record, 60.0, []

    def in_steps(*arguments, force, **others):
        return original(*arguments, force=step * np.round(force / step), **others)

    for read in (original, in_steps):
        monkeypatch.setattr(jc, "fit_record", read)
        found = truths.filtered_fit(random, fitted=True)
        # One in twenty is called inadequate, one in a thousand this clearly.
        assert found.converged and found.adequacy.p > 1e-3, found
        at = [found.names.index(name) for name in own]
        pulls.append((found.values[at] - [*own.values()]) / found.errors[at])
    assert np.abs(pulls).max() < 3.5 and np.sqrt(np.mean(np.square(pulls))) < 1.7
    assert "readings of force are rounded to steps of 60, 1.9 of" in found.notes[-1]


@pytest.mark.slow(reason="a fit to a record of 2500 readings")
def test_a_long_record_in_steps_is_not_too_sure():
    """Each step lasts for many readings, which share its error: errors grow tenfold."""
    time = np.linspace(0, 2.2e-3, 2500)
    clean = truths.course(time)["force"] + truths.FORCE_ZERO
    step, random = truths.NOISE["force"] * clean.max(), np.random.default_rng(3)
    read = step * np.round((clean + step / 5 * random.normal(size=time.size)) / step - 0.3)
    law, contact = jc.ConstantDamping(c=3e6), jc.Contact(mass=truths.MASS, stiffness=4e7)
    found = jc.fit_record(law, contact, time, 1.2, force=read + 0.3 * step)
    own = {"law.c": truths.DAMPING, "contact.stiffness": truths.STIFFNESS}
    own |= {"velocity": truths.SPEED, "start_time": truths.TOUCH, "force_offset": truths.FORCE_ZERO}
    pulls = (found.values - [own[name] for name in found.names]) / found.errors
    assert found.converged and np.abs(pulls).max() < 3 and found._wider.max() > 50
    assert not any("limit" in note for note in found.notes)
