"""Many balls at once, against `fit` ball by ball, and themselves without a bad neighbour."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._fit.many import search as many_search
from tests.test_fit.curves import fading

NEAR = 1e-6
"""In standard errors: an end of a search is as far from the minimum as rounding hides. Measured
2e-14 here, 6e-7 over 1,000 tables of e(v) of which some are nearly flat."""
ALIKE = 1e-5  # of covariances, relative: measured 2e-15 here, 1e-5 over the 1,000 tables
BALLS, POINTS = 11, 12
SIGMA = 0.01
START = {"a": 1.0, "b": 1.0}


def tables(seed=0, balls=BALLS):
    random = np.random.default_rng(seed)
    x = np.sort(random.uniform(0.1, 3, (balls, POINTS)), axis=1)
    a, b = random.uniform(0.5, 2, (balls, 1)), random.uniform(0.3, 2, (balls, 1))
    return x, a * np.exp(-b * x) + SIGMA * random.normal(size=x.shape)


X, Y = tables()


@pytest.fixture(scope="module")
def known():
    return jc.fit_many(fading, Y, START, x=X, sigma=SIGMA, batch_size=4)


def assert_alike(many, i, one):
    """One ball of many, beside a fit of it alone."""
    error = one.errors
    assert np.max(np.abs(many.values[i] - one.values) / error) < NEAR
    np.testing.assert_allclose(many.covariance[i], one.covariance, rtol=ALIKE)
    np.testing.assert_allclose(many.loss[i], one.loss, rtol=ALIKE)
    assert (many.dof[i], many.noise[i]) == (one.dof, pytest.approx(one.noise, rel=ALIKE))


def test_every_ball_is_as_fitted_alone(known):
    assert known.ok.all() and (known.status == jc.FitStatus.CONVERGED).all()
    assert known.params["a"].shape == (BALLS,)
    for i in range(BALLS):
        one = jc.fit(fading, Y[i], START, x=X[i], sigma=SIGMA)
        assert_alike(known, i, one)
        assert known.steps[i] == one.steps
        whole = known.fit(i)
        assert_alike(known, i, whole)
        np.testing.assert_allclose(whole.history, one.history, rtol=ALIKE)
        np.testing.assert_array_equal(whole.values, known.values[i])


def test_a_long_table_of_balls_that_differ_in_length():
    """e(v), as people have it: names in any order, and noise that is not known."""
    contact = jc.Contact(mass=0.05, stiffness=1e6)
    random = np.random.default_rng(1)
    names = np.array(["red"] * 7 + ["blue"] * 4)
    v = random.uniform(0.5, 4, names.size)
    c = np.where(names == "red", 1e4, 3e4)
    e = np.asarray(jc.restitution(jc.ConstantDamping(c=c), contact, v))
    e = e + 0.003 * random.normal(size=v.size)
    order = random.permutation(names.size)
    names, v, e = names[order], v[order], e[order]

    def predict(law, v):
        return jc.restitution(law, contact, v)

    start = jc.ConstantDamping(c=2e4)
    many = jc.fit_many(predict, e, start, balls=names, x=v)
    assert set(many.balls) == {"red", "blue"} and many.balls[0] == names[0]
    for i, name in enumerate(many.balls):
        of = names == name
        one = jc.fit(predict, e[of], start, x=v[of])
        assert_alike(many, i, one)
        whole = many.fit(name)
        assert len(whole.residuals) == of.sum()
    assert whole.interval()["c"] == pytest.approx(one.interval()["c"], rel=ALIKE)
    assert many.params.c[0] == many.values[0, 0]


def test_a_bad_ball_is_flagged_and_changes_no_other(known):
    def fitted(y, sigma, x, first):
        start = {"a": np.where(np.arange(BALLS) == 7, first, 1.0), "b": np.ones(BALLS)}
        how = {"x": x, "sigma": sigma, "transforms": {"a": jc.Positive()}, "batch_size": 4}
        return jc.fit_many(fading, y, start, own_start=True, **how)

    x, y, sigma = X.copy(), Y.copy(), np.full_like(Y, SIGMA)
    good = fitted(Y, sigma.copy(), X, 1.0)
    y[1, 3] = np.nan
    sigma[2, 0] = -1.0
    sigma[3, 1:] = np.inf
    x[5, 2] = np.inf
    many = fitted(y, sigma, x, -1.0)
    kinds = jc.FitStatus
    bad = {1: kinds.INVALID_INPUT, 2: kinds.INVALID_INPUT, 3: kinds.TOO_FEW_POINTS}
    bad |= {5: kinds.NOT_CONVERGED, 7: kinds.INVALID_INPUT}
    others = [i for i in range(BALLS) if i not in bad]
    assert [bad.get(i, kinds.CONVERGED) for i in range(BALLS)] == many.status.tolist()
    assert np.isnan(many.values[[*bad]]).all() and np.isnan(many.covariance[[*bad]]).all()
    for i in others:
        assert np.max(np.abs(many.values[i] - known.values[i]) / known.fit(i).errors) < NEAR
    np.testing.assert_array_equal(many.values[others], good.values[others])
    np.testing.assert_array_equal(many.covariance[others], good.covariance[others])
    with pytest.raises(ValueError, match="must have a fit, but 1: Data are not finite"):
        many.fit(1)
    with pytest.raises(ValueError, match="must be one of `balls`, such as"):
        known.fit("green")
    text = str(many)
    assert "6 converged, 1 not_converged" in text and "ball 1: Data are not finite" in text


def test_ends_that_are_not_plain_are_judged_as_by_fit():
    """A bound, a number that the data leave open, no finite prediction, and too few steps."""
    x = np.tile(np.linspace(0, 1, 6), (4, 1))
    x[1], x[3] = 1.0, -1e4
    y = 1 + 0 * x
    y[0] = -1 - x[0]
    y[2] = 1 + 2 * x[2]

    def line(p, x):
        return p["a"] * jnp.exp(p["b"]) + jnp.exp(-1e3 * x - 10) + p["b"] * x

    start, how = {"a": 1.0, "b": 0.5}, {"sigma": 0.1, "transforms": {"a": jc.Positive()}}
    many = jc.fit_many(line, y, start, x=x, **how)
    for i in range(3):
        one = jc.fit(line, y[i], start, x=x[i], throw=False, **how)
        assert many.fit(i).reason == one.reason == many.reasons[i]
        np.testing.assert_array_equal(np.isnan(many.covariance[i]), np.isnan(one.covariance))
    kinds = jc.FitStatus
    assert many.status[[0, 1, 3]].tolist() == [
        *(kinds.AT_BOUND, kinds.NOT_IDENTIFIABLE, kinds.NO_PREDICTION)
    ]
    short = jc.fit_many(line, y[2:3], start, x=x[2:3], max_steps=1, **how)
    assert short.status[0] == kinds.NOT_CONVERGED and not short.ok[0]
    assert not short.fit(0).converged


def test_each_ball_has_its_own_start_and_fixed_numbers():
    mass = np.linspace(1, 2, 3)
    x = np.tile(np.linspace(0.5, 2, 5), (3, 1))
    y = 3.0 * x / mass[:, None] + 0.01 * np.cos(9 * x)

    def predict(p, x):
        return p["force"] * x / p["mass"]

    start = {"force": np.array([1.0, 2.0, 3.0]), "mass": mass}
    held = {"mass": jc.Fixed()}
    many = jc.fit_many(predict, y, start, x=x, own_start=True, transforms=held)
    np.testing.assert_array_equal(many.params["mass"], mass)
    for i in range(3):
        own = {"force": start["force"][i], "mass": mass[i]}
        assert_alike(many, i, jc.fit(predict, y[i], own, x=x[i], transforms=held))


def test_huber_and_weights_are_those_of_fit():
    y = Y.copy()
    y[:, 4] += 0.4
    weights = np.ones_like(y)
    weights[:, 7] = 0
    robust = jc.fit_many(fading, y, START, x=X, sigma=SIGMA, loss=jc.Huber())
    weighted = jc.fit_many(fading, {"y": y}, START, x=X, weights={"y": weights})
    for i in (0, 3):
        one = jc.fit(fading, y[i], START, x=X[i], sigma=SIGMA, loss=jc.Huber())
        assert_alike(robust, i, one)
        assert_alike(weighted, i, jc.fit(fading, y[i], START, x=X[i], weights=weights[i]))


@pytest.mark.parametrize("shape", [(BALLS, 1), (1, POINTS)])
def test_a_sigma_of_each_ball_or_of_each_point_has_both_axes(shape):
    sigma = SIGMA * np.linspace(1, 3, max(shape)).reshape(shape)
    many = jc.fit_many(fading, Y, START, x=X, sigma=sigma, batch_size=4)
    own = np.broadcast_to(sigma, Y.shape)
    for i in (0, BALLS - 1):
        assert_alike(many, i, jc.fit(fading, Y[i], START, x=X[i], sigma=own[i]))


def test_other_values_and_another_number_of_balls_do_not_compile_again(known, compiled):
    x, y = tables(seed=5, balls=BALLS + 2)
    compiled.clear()
    many = jc.fit_many(fading, y, {"a": 1.3, "b": 0.8}, x=x, sigma=0.02, batch_size=4)
    assert compiled == []
    assert many.ok.all()


def test_finished_balls_leave_their_block(monkeypatch):
    """The slowest ball of all does not hold up the others, which would double the work."""
    limits = []
    advanced = many_search._advanced

    def counted(shared, lanes, search, limit, options, group):
        limits.append(int(limit))
        return advanced(shared, lanes, search, limit, options, group)

    monkeypatch.setattr(many_search, "_advanced", counted)
    y = Y.copy()
    y[4] = np.where(X[4] < 1, -5.0, 5.0)
    jc.fit_many(fading, y, START, x=X, sigma=SIGMA, batch_size=4)
    assert limits.count(limits[0]) == 3 and limits.count(limits[-1]) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"data": [[1.0, 2.0]]}, "must hold arrays, no lists"),
        ({"x": X[:3]}, "as long as that of `data`, 11"),
        ({"sigma": np.ones((3, 2))}, "have the shapes of `data`"),
        (
            {"sigma": np.ones(POINTS)},
            r"a length of 1 where all are alike, but has the shape \(12,\)",
        ),
        ({"weights": np.ones(BALLS)}, r"alike, but has the shape \(11,\)"),
        ({"sigma": 1.0, "weights": 1.0}, "both are given"),
        ({"loss": jc.Huber()}, "must be given with a `Huber` loss"),
        ({"data": Y[:, 0]}, r"must have the axes \(balls, points\) without `balls`"),
        ({"balls": [*range(10), np.nan]}, "`balls` must have one name for each of the 11 points"),
        ({"start": {"a": np.ones(3)}, "own_start": True}, "first axis is that of the 11 balls"),
        ({"start": {"a": 1.0, "b": 1.0, "unused": 1.0}}, "does not use unused"),
    ],
)
def test_wrong_arguments_are_named(change, words):
    given = {"predict": fading, "data": Y, "start": START, "x": X, "batch_size": 4}
    with pytest.raises(ValueError, match=words):
        jc.fit_many(**(given | change))
