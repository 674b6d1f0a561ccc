"""Predefined fits recover known truths with every method of solving the impacts."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize, special, stats

import jaxcontact as jc
from jaxcontact._calibration.problems.impacts import ImpactModel, transforms_of

CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8)
SPEED = np.geomspace(0.1, 5, 60)
ASKED = np.linspace(0.1, 1, 100)
SAME = {"exact": 1e-12, "phase": 1e-9, jc.Event(rtol=1e-10): 1e-9}
"""How far c is from the truth by each method: 1e-15, 2e-10 and 3e-10 were seen."""

SAME_LEARNED = {"phase": 1e-7, "event": 1e-6}
"""The same of a learned α(e)."""


def delivered(alpha):
    """e of a damping factor, by a bracketed root of the energy integral."""
    if alpha == 0:
        return 1.0

    def balance(e):
        return alpha * (1 + e) - np.log1p(alpha) + np.log1p(-alpha * e)

    return optimize.brentq(balance, 1e-6, min(1, 1 / alpha) * (1 - 1e-15), xtol=1e-15)


@pytest.fixture(scope="module")
def falling():
    """e(v) of a constant c."""
    return np.array([delivered(2e7 * v / 1.4e8) for v in SPEED])


@pytest.mark.slow("phase", "Event(rtol=1e-10)", reason="the fit once more by another method")
@pytest.mark.parametrize("method", SAME, ids=str)
def test_a_constant_c_comes_back(falling, method):
    found = jc.fit_damping(CONTACT, SPEED, falling, method=method)
    assert found.converged, found.reason
    assert found.params["c"] == pytest.approx(2e7, rel=SAME[method])
    # The start comes from the data and is near: one step leaves 3e-7.
    assert found.history[0] < 1e-5
    assert np.allclose(found.predict(SPEED[:3]), falling[:3], rtol=1e-8)


def test_a_constant_e_is_a_power_of_minus_one():
    found = jc.fit_damping(CONTACT, SPEED, np.full(60, 0.8), power=True)
    assert found.params["power"] == pytest.approx(-1, abs=1e-10)
    middle = np.sqrt(SPEED[0] * SPEED[-1])
    alpha = found.params["c"] * middle / 1.4e8
    assert delivered(float(alpha)) == pytest.approx(0.8, rel=1e-12)


@pytest.fixture(scope="module")
def best_beta():
    """The constant β nearest to e_out = e_in, by a scalar search with the beta function."""

    def loss(beta):
        ratio = 2.5 / beta
        factor = 1 / (ratio * special.beta(ratio, 1.5))
        return sum((delivered(factor * (1 - e) / e) - e) ** 2 for e in ASKED)

    return optimize.minimize_scalar(loss, (2.5, 3.5), tol=1e-12).x


def test_the_best_constant_beta(best_beta):
    found = jc.fit_energy_loss(ASKED)
    assert found.converged and found.params["beta"] == pytest.approx(best_beta, rel=1e-5)
    left = np.abs(found.residuals).mean()
    others = [np.abs(jc.restitution(law(e=ASKED)) - ASKED).mean() for law in (jc.HuGuo, jc.Flores)]
    assert left < others[0] < others[1]


@pytest.mark.slow(reason="the fit once more by another method")
def test_beta_is_the_same_by_another_method():
    found = jc.fit_energy_loss(ASKED[::9], method="event")
    exact = jc.fit_energy_loss(ASKED[::9])
    assert found.converged and exact.converged
    # A fit that misses its points ends within its `rtol`: measured 2e-9.
    assert float(found.params["beta"]) == pytest.approx(float(exact.params["beta"]), rel=1e-8)


@pytest.mark.slow(reason="the fit once more by another method")
@pytest.mark.parametrize("method", ["phase", "event"])
def test_a_learned_law_is_the_same_by_other_methods(method):
    asked = np.linspace(0.3, 1, 30)
    one = jc.Contact(mass=1.0, stiffness=1.0)
    found = jc.learn_law(asked, shape=jc.Rational(1), contact=one, method=method)
    exact = jc.learn_law(asked, shape=jc.Rational(1))
    assert found.converged and exact.converged
    assert np.allclose(
        found.params.law(asked).damping_factor(),
        exact.params.law(asked).damping_factor(),
        rtol=SAME_LEARNED[method],
        atol=SAME_LEARNED[method],
    )


def test_beta_of_e_delivers_what_is_asked_for():
    found = jc.fit_energy_loss(ASKED, degree=16)
    assert found.converged and np.abs(found.residuals).max() < 1e-6
    beta = found.problem.predict.beta(found.params, ASKED[:-1])
    # At each e it must be the β for which α is the exact one.
    ratio = 2.5 / np.asarray(beta)
    alpha = (1 - ASKED[:-1]) / ASKED[:-1] / (ratio * special.beta(ratio, 1.5))
    assert np.allclose(alpha, jc.exact_damping_factor(ASKED[:-1]), rtol=1e-4)


FINE = np.linspace(0.05, 1, 1777)
LEARNED = {"rational": 1e-8, "spline": 1e-8}


@pytest.mark.parametrize("form", LEARNED)
def test_a_law_is_learned(form):
    points = np.linspace(0.05, 1, 400)
    found = jc.learn_law(points, shape=form)
    assert found.converged
    off = np.abs(jc.restitution(found.params.law(FINE)) - FINE)
    assert off.max() < LEARNED[form]
    assert off.max() < 1e-5 * np.abs(jc.restitution(jc.CarvalhoMartins(e=FINE)) - FINE).max()


def test_a_network_learns_it_roughly():
    # It has too many parameters for one minimum; only the delivered curve counts.
    points = np.linspace(0.05, 1, 150)
    found = jc.learn_law(points, shape=jc.Network(width=5), max_steps=60, throw=False)
    assert np.abs(jc.restitution(found.params.law(FINE)) - FINE).max() < 1e-4


def test_a_law_is_learned_from_any_curve():
    target = np.asarray(jc.restitution(jc.LankaraniNikravesh(e=np.linspace(0.3, 1, 100))))
    found = jc.learn_law(np.linspace(0.3, 1, 100), target, shape=jc.Rational(3))
    e = np.linspace(0.31, 0.99, 50)
    assert np.allclose(found.params.law(e).damping_factor(), 0.75 * (1 - e**2), rtol=1e-6)


GUGAN = np.linspace(2.19, 5.50, 20)


def test_the_exponent_of_a_croquet_ball():
    """t_c ~ v^-0.23 and e(v) of a published regression; Hertz' contact would have v^-0.2."""
    e = np.sqrt(1 - 0.213 - 0.077 * GUGAN**0.4)
    duration = 0.97e-3 * (GUGAN / 2.19) ** -0.23
    start = jc.Contact(mass=0.45, stiffness=1e8, exponent=np.array(1.5))
    law = jc.ExactRestitution(e=e)
    found = jc.fit_impacts(law, start, GUGAN, duration=duration, fixed=("mass", "e"))
    assert found.converged and found.names == ("contact.stiffness", "contact.exponent")
    n = float(found.params.contact.exponent)
    # Without damping t_c ~ v^((1-n)/(1+n)); the e that falls with speed changes this slightly.
    assert (1 - n) / (1 + n) == pytest.approx(-0.23, abs=0.01)
    times = np.log(np.asarray(jc.impact(law, found.params.contact, GUGAN).duration))
    slope = stats.linregress(np.log(GUGAN), times).slope
    assert slope == pytest.approx(-0.23, abs=1e-4)


@pytest.mark.slow(reason="a study of 40 fits")
def test_intervals_hold_the_truth():
    """Tables of e and of t_c with known noise: 95 % intervals hold K, n and c."""
    random = np.random.default_rng(5)
    v = np.geomspace(0.3, 6, 20)
    true = jc.Contact(mass=0.45, stiffness=2e7, exponent=np.array(1.6))
    clean = jc.impact(jc.ConstantDamping(c=1.5e6), true, v)
    truth = np.array([1.5e6, 2e7, 1.6])
    start = jc.Contact(mass=0.45, stiffness=1e7, exponent=np.array(1.5))
    held = np.zeros(3)
    draws = 40
    for _ in range(draws):
        e = np.asarray(clean.restitution) + 0.01 * random.normal(size=20)
        duration = np.asarray(clean.duration) * np.exp(0.01 * random.normal(size=20))
        found = jc.fit_impacts(
            jc.ConstantDamping(c=1e6),
            start,
            v,
            e=np.minimum(e, 1),
            duration=duration,
            sigma_e=0.01,
            sigma_duration=0.01,
        )
        assert found.converged, found.reason
        held += np.abs(found.values - truth) <= 1.96 * np.sqrt(np.diag(found.covariance))
    # Of 40 draws 38 are expected; fewer than 34 have a probability of 1 %.
    assert (held >= 34).all(), held


def test_tables_may_have_gaps():
    v = np.array([0.5, 1.0, 2.0, 4.0])
    hit = jc.impact(jc.ConstantDamping(c=1.5e7), CONTACT, v)
    e = np.array(hit.restitution)
    e[1] = np.nan
    start = jc.Contact(mass=1.0, stiffness=1e8)
    found = jc.fit_impacts(jc.ConstantDamping(c=1e7), start, v, e=e, duration=hit.duration)
    assert found.params.contact.stiffness == pytest.approx(1.4e8, rel=1e-9) and found.dof == 5
    assert np.isnan(found.residuals).sum() == 1
    lines = [line.split() for line in repr(found).splitlines()]
    shown = {line[0]: " ".join(line[2 : line.index("±")]) for line in lines if "±" in line}
    assert shown == {"law.c": "N s/m^(n+1)", "contact.stiffness": "N/m^n"}


class _Stepped(jc.ConstantDamping):
    d: float = eqx.field(static=True, default=1e-4)


def test_numbers_are_held_by_the_names_that_are_printed():
    model = ImpactModel(_Stepped(c=1e7), CONTACT)
    known = transforms_of(model, ("mass", "c"))
    assert known == transforms_of(model, ("contact.mass", "law.c")) and len(known) == 2
    # Static values remain in either case.
    assert transforms_of(model, ("mass", "law.d", "d", "exponent")).keys() == {"contact.mass"}
    message = (
        "`fixed` must name numbers of the law or the contact (law.c, contact.mass, "
        "contact.stiffness), but holds 'law.c_max'. Did you mean 'law.c'?"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        transforms_of(model, ("law.c_max",))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jc.fit_damping(CONTACT, [1.0, -1.0], [0.5, 0.5]), "`velocity` must be in"),
        (lambda: jc.fit_damping(CONTACT, [1.0, 2.0], [0.5, 1.5]), "is 1.5 at point 1"),
        (lambda: jc.fit_damping(CONTACT, [1.0], [0.5, 0.5]), "one number for each of the 1"),
        (lambda: jc.fit_damping(CONTACT, [1.0], [np.nan]), "`e` must be in"),
        (lambda: jc.Spline(intervals=1), "`intervals` must be a whole number of at least 4"),
        (
            lambda: jc.fit_impacts(jc.Hertz(), CONTACT, [1.0]),
            "`e` or `duration` or `max_force` must be given",
        ),
        (
            lambda: jc.fit_impacts(jc.Hertz(), CONTACT, [1.0], e=[0.5], fixed=("c",)),
            r"`fixed` must name numbers of the law or the contact \(contact.mass, contact.stiff",
        ),
        (
            lambda: jc.fit_impacts(
                jc.Hertz(), CONTACT, [1.0], e=[0.5], duration=[1e-3], sigma_e=0.1
            ),
            "for both columns or for none",
        ),
    ],
)
def test_bad_tables_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_fits_are_compared():
    random = np.random.default_rng(2)
    x = np.linspace(0, 3, 60)
    y = 2 * np.exp(-x) + 0.01 * random.normal(size=60)
    curves = {
        "decay": (lambda p, x: p[0] * jnp.exp(-p[1] * x), [1.0, 0.5]),
        "decay and floor": (lambda p, x: p[0] * jnp.exp(-p[1] * x) + p[2], [1.0, 0.5, 0.0]),
        "constant": (lambda p, x: p[0] + 0 * x, [1.0]),
    }
    fits = {name: jc.fit(f, y, start, x=x, sigma=0.01) for name, (f, start) in curves.items()}
    found = jc.compare_fits(fits)
    names = [candidate.name for candidate in found.candidates]
    assert names[-1] == "constant" and found.verdict.startswith(f"Use {names[0]}, which describes")
    by_name = {candidate.name: candidate for candidate in found.candidates}
    for name, fit in fits.items():
        k = len(fit.names)
        assert by_name[name].k == k
        aicc = 2 * fit.loss + 2 * k + 2 * k * (k + 1) / (60 - k - 1)
        assert by_name[name].aicc == pytest.approx(aicc, rel=1e-12)
        assert by_name[name].bic == pytest.approx(2 * fit.loss + k * np.log(60), rel=1e-12)
    assert by_name["decay"].held_out == pytest.approx(1, abs=0.3)
    assert by_name["constant"].held_out > 5
    assert "held out" in repr(found)


def test_a_mean_is_held_out_by_hand():
    y = np.random.default_rng(1).normal(size=12)
    groups = np.repeat([0, 1, 2], 4)
    mean = jc.fit(lambda a, x: a + 0 * x, y, 0.0, x=np.zeros(12))
    line = jc.fit(lambda p, x: p[0] + p[1] * x, y, [0.0, 0.0], x=np.arange(12.0))
    found = jc.compare_fits({"mean": mean, "line": line}, folds=3, groups=groups)
    off = [y[groups == g] - y[groups != g].mean() for g in range(3)]
    by_name = {candidate.name: candidate for candidate in found.candidates}
    assert by_name["mean"].held_out == pytest.approx(np.sqrt(np.mean(np.square(off))), rel=1e-8)


def test_what_cannot_be_compared():
    fit = jc.fit(lambda a, x: a + 0 * x, np.arange(5.0), 0.0, x=np.zeros(5))
    other = jc.fit(lambda a, x: a + 0 * x, np.ones(5), 0.0, x=np.zeros(5))
    robust = jc.fit(lambda a, x: a + 0 * x, np.arange(5.0), 0.0, x=np.zeros(5), loss=jc.Huber())
    for fits, message in (
        ({"a": fit}, "at least two"),
        ({"a": fit, "b": other}, "other data"),
        ({"a": fit, "b": robust}, "a scale of its own"),
    ):
        with pytest.raises(ValueError, match=message):
            jc.compare_fits(fits)
    with pytest.raises(ValueError, match="`folds` must be at most"):
        jc.compare_fits({"a": fit, "b": fit}, folds=9)
    assert jnp.isfinite(fit.loss)


def test_shapes_have_slopes_at_the_ends():
    # cos(k arccos t) had the slope NaN at e = 1, and an infinite one at e = 0.
    shape = jc.Rational(3)
    for e in (0.0, 1.0):
        assert jax.grad(lambda e: shape(e))(e) == pytest.approx(0.5, rel=1e-12)
    model = jc.fit_energy_loss(np.linspace(0.3, 1, 20), degree=2).problem.predict
    params = {"log_beta": jnp.array([0.9, 0.1, 0.05])}
    # T_1' = 1 and T_2' = 4 at t = 1, and dt/de = 2/0.7.
    slope = jax.grad(lambda e: jnp.log(model.beta(params, e)))(1.0)
    assert slope == pytest.approx((0.1 + 4 * 0.05) * 2 / 0.7, rel=1e-12)
