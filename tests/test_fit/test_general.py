"""`fit` against other fitters, closed forms and simulations, and fits that could claim too much:
saddles, ends of wide intervals, zero weights.
"""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from scipy import optimize, stats

import jaxcontact as jc
from tests.test_fit.curves import FLAT, decay, line

RNG = np.random.default_rng(3)
X = np.linspace(0, 4, 50)
DECAY = 2.5 * np.exp(-1.3 * X) + 0.5 + 0.05 * RNG.normal(size=50)
LINE = 2 * X - 1 + RNG.normal(size=50)
START = {"a": 1.0, "b": 1.0, "c": 0.0}

SAME = 1e-6  # two fitters end where the loss is flat: relative to a standard error 1e-7 was seen
RECOVERED = 1e-10  # what the issue of speed asks for without noise; 1e-14 was seen


@pytest.fixture(scope="module")
def free():
    """The decay fitted with nothing but defaults."""
    return jc.fit(decay, DECAY, START, x=X)


def test_parameters_and_covariance_are_those_of_scipy(free):
    values, covariance = optimize.curve_fit(
        lambda x, a, b, c: a * np.exp(-b * x) + c, X, DECAY, (1, 1, 0), xtol=1e-14, ftol=1e-14
    )
    assert free.converged and free.names == ("a", "b", "c") and free.dof == 47
    errors = np.sqrt(np.diag(covariance))
    assert np.abs((free.values - values) / errors).max() < SAME
    assert np.allclose(free.covariance, covariance, rtol=1e-5)
    assert list(free.standard_errors.values()) == pytest.approx(errors, rel=1e-5)
    assert np.allclose(np.diag(free.correlation), 1)
    assert free.loss == pytest.approx(np.sum(free.residuals**2) / 2, rel=1e-12)
    assert free.history[-1] == pytest.approx(free.loss, rel=1e-12) and len(free.history) > 3
    assert np.allclose(free.predict(X[:3]), free.predict()[:3])
    assert str(pickle.loads(pickle.dumps(free))) == str(free)


@pytest.mark.parametrize("optimizer", [optax.adam(0.05), optax.lbfgs()], ids=["adam", "lbfgs"])
def test_the_optimisers_of_optax_end_there_too(optimizer, free):
    found = jc.fit(decay, DECAY, START, x=X, optimizer=optimizer)
    assert found.converged, found.reason
    # A thousandth of a standard error counts as zero.
    assert np.abs((found.values - free.values) / free.errors).max() < 2e-3


def test_backwards_and_in_single_precision_it_is_the_same(free):
    back = jc.fit(decay, DECAY, START, x=X, reverse=True)
    assert np.allclose(back.values, free.values, rtol=1e-10)
    with jax.enable_x64(False):
        found = jc.fit(decay, DECAY, START, x=X)
    assert np.allclose(found.values, free.values, rtol=1e-12)


def test_a_line_is_the_closed_form():
    sigma = 0.5 + X / 4
    found = jc.fit(line, LINE, FLAT, x=X, sigma=sigma)
    design = np.stack([np.ones(50), X], axis=1) / sigma[:, None]
    covariance = np.linalg.inv(design.T @ design)
    assert found.names == ("a", "b")
    assert np.allclose(found.values, covariance @ design.T @ (LINE / sigma), rtol=1e-9)
    assert np.allclose(found.covariance, covariance, rtol=1e-9)  # absolute: not scaled by the loss
    weighted = jc.fit(line, LINE, FLAT, x=X, weights=7 / sigma**2)
    assert np.allclose(weighted.values, found.values, rtol=1e-9)
    assert np.allclose(weighted.covariance, 2 * found.loss / 48 * covariance, rtol=1e-8)


def test_a_law_is_a_tree_of_parameters():
    v = jnp.linspace(0.1, 5, 40)

    def delivered(pair, v):
        law, contact = pair
        return jc.restitution(law, contact, v)

    true = jc.ConstantDamping(c=2e7), jc.Contact(mass=1.0, stiffness=1.4e8)
    start, data = (jc.ConstantDamping(c=5e6), true[1]), delivered(true, v)
    found = jc.fit(delivered, data, start, x=v, transforms=(None, jc.Fixed()))
    assert found.names == ("[0].c",) and isinstance(found.params[0], jc.ConstantDamping)
    assert found.values[0] == pytest.approx(2e7, rel=RECOVERED)
    # e depends on c/K only, and not on the mass.
    both = jc.fit(delivered, data, start, x=v)
    assert both.converged
    assert all(np.isnan(error) for error in both.standard_errors.values())
    told = {frozenset(direction.components) for direction in both.unidentified}
    assert told == {frozenset({"[0].c", "[1].stiffness"}), frozenset({"[1].mass"})}
    assert repr(both).count("not identifiable") == 5
    with pytest.raises(ValueError, match=r"`name` must be one of .* but is 'z'"):
        both.why_no_error("z")
    ratio = both.params[0].c / both.params[1].stiffness
    assert ratio == pytest.approx(2e7 / 1.4e8, rel=RECOVERED)


def test_a_product_is_determined_and_its_factors_are_not():
    def product(p, x):
        return p["K"] * p["m"] * x + p["b"]

    data = 6 * X + 1 + 0.01 * RNG.normal(size=50)
    positive = {"K": jc.Positive(), "m": jc.Positive()}
    found = jc.fit(product, data, {"K": 1.0, "m": 2.0, "b": 0.0}, x=X, transforms=positive)
    (direction,) = found.unidentified
    assert str(direction) == "ln K - ln m"
    assert np.isnan(found.standard_errors["K"]) and np.isnan(found.standard_errors["m"])
    alone = stats.linregress(X, data)
    assert found.standard_errors["b"] == pytest.approx(alone.intercept_stderr, rel=1e-5)
    assert found.dof == 48


@pytest.mark.parametrize("y", [2.0, 0.3, 1e5 / 3, -7e-9])
def test_fewer_points_than_numbers_of_an_array(y):
    """The line meets the point to rounding, which must not be taken for a slope of the loss."""
    start = np.array([1.0, 0.0])
    found = jc.fit(lambda p, x: p[0] * x + p[1], [y], start, x=np.array([3.0]), sigma=0.1)
    (direction,) = found.unidentified
    assert found.converged and found.loss < 1e-20 * max(1, y**2)
    # A line may rotate about its one point: the offset changes by -3 if the slope changes by 1.
    slope, offset = (direction.components[name] for name in found.names)
    assert slope / offset == pytest.approx(-1 / 3)


def through_zero(a, x):
    return a * x


@pytest.mark.parametrize("transform", [jc.Free(), jc.Positive(), jc.Between(1.0, 5.0)])
def test_a_transform_changes_neither_the_start_nor_the_errors(transform):
    """The data are met at the start: a first step from elsewhere would show in the history."""
    x = np.linspace(1, 2, 40)
    how = {"x": x, "transforms": transform}
    found = jc.fit(through_zero, 2 * x, 2.0, **how)
    assert found.history[0] < 1e-20 and found.params == pytest.approx(2.0, rel=1e-13)
    y = 2 * x + 0.01 * np.random.default_rng(0).normal(size=40)
    best = np.sum(x * y) / np.sum(x**2)
    error = np.sqrt(np.sum((y - best * x) ** 2) / 39 / np.sum(x**2))
    assert jc.fit(through_zero, y, 1.9, **how).errors[0] == pytest.approx(error, rel=1e-8)


def test_a_number_that_runs_to_its_bound_is_put_there():
    def flat(law, x):
        return jc.restitution(law) + 0 * x

    found = jc.fit(flat, np.array([1.1, 1.2, 1.3]), jc.HuGuo(e=0.5), x=np.zeros(3))
    assert found.converged and found.at_bound == ("e",) and "at its bound" in repr(found)
    assert found.params.e == 1 and found.loss == pytest.approx(0.07, rel=1e-12)
    assert np.isnan(found.standard_errors["e"])
    low = jc.fit(lambda c, x: c + 0 * x, -np.ones(3), 0.5, x=np.zeros(3), transforms=jc.Positive())
    assert low.at_bound == ("parameter",) and low.params < 1e-9


def test_many_starts_find_the_lower_valley():
    def well(p):
        return jnp.stack([p**2 - 4, 0.5 * (p - 2)])

    stuck = jc.fit(well, np.zeros(2), -3.0)
    found = jc.fit(well, np.zeros(2), -3.0, starts=16, spread=4.0)
    assert stuck.params < -1 and stuck.loss > 1
    assert found.params == pytest.approx(2, rel=1e-8) and found.loss < 1e-12
    assert found.starts.shape == (16,) and found.starts[0] == pytest.approx(stuck.loss)


def test_huber_is_scipys_and_bears_outliers():
    y = DECAY.copy()
    y[::7] += 2.0
    found = jc.fit(decay, y, START, x=X, sigma=0.05, loss=jc.Huber(1.345))
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}

    def scaled(p):
        return (p[0] * np.exp(-p[1] * X) + p[2] - y) / 0.05

    theirs = optimize.least_squares(scaled, (1, 1, 0), loss="huber", f_scale=1.345, **tight)
    assert np.allclose(found.values, theirs.x, rtol=1e-6)
    assert found.loss == pytest.approx(theirs.cost, rel=1e-9)
    alone = jc.fit(decay, y, START, x=X, loss=jc.Huber())
    squares = jc.fit(decay, y, START, x=X)
    off = [np.abs(one.values - [2.5, 1.3, 0.5]).max() for one in (found, alone, squares)]
    assert max(off[:2]) < 0.2 < off[2]


def test_a_refit_of_simulated_data_scatters_as_laplace_says(free):
    again = free.bootstrap(400, seed=1)
    assert again.converged.all()
    for name, error in free.standard_errors.items():
        # 400 draws determine a standard deviation to 3.5 %; the decay is almost linear in its
        # parameters.
        assert again.standard_errors[name] == pytest.approx(error, rel=0.15)
        low, high = again.interval()[name]
        assert low < free.params[name] < high


def test_the_profile_of_a_line_is_students():
    found = jc.fit(line, LINE, FLAT, x=X)
    profile, slope, error = found.profile("b"), found.params["b"], found.standard_errors["b"]
    far = stats.t.ppf(0.975, 48) * error
    assert np.allclose(profile.interval(), slope + np.array([-far, far]), rtol=1e-6)
    assert np.allclose(profile.deviation, (profile.values - slope) / error, rtol=1e-6, atol=1e-6)
    assert profile.interval(1 - 1e-9) == (-np.inf, np.inf)


def test_points_without_weight_do_not_count_and_others_are_named():
    y = DECAY.copy()
    y[[3, 8]] = np.nan
    with pytest.raises(ValueError, match="nan at point 3, nan at point 8"):
        jc.fit(decay, y, START, x=X)
    kept = np.isfinite(y)
    found = jc.fit(decay, y, START, x=X, weights=kept.astype(float))
    short = jc.fit(decay, y[kept], START, x=X[kept])
    assert np.allclose(found.values, short.values, rtol=1e-9) and found.dof == short.dof == 45
    assert np.allclose(found.covariance, short.covariance, rtol=1e-7)
    assert np.isnan(found.residuals[[3, 8]]).all()
    assert found.adequacy.structure_p == pytest.approx(short.adequacy.structure_p)


def test_a_fit_that_is_not_finished_says_so():
    found = jc.fit(decay, DECAY, START, x=X, max_steps=2, throw=False)
    assert not found.converged and "2 steps were not enough" in found.reason
    assert "NOT CONVERGED" in repr(found) and np.isnan(found.covariance).all()
    asked = (found.bootstrap, found.interval, found.confidence_band, found.prediction_band)
    for ask in (*asked, lambda: found.profile("a")):
        with pytest.raises(ValueError, match="did not converge"):
            ask()


def test_new_numbers_do_not_compile_again_and_progress_is_told():
    traces, seen = [], []

    def traced(p, x):
        traces.append(None)
        return decay(p, x)

    jc.fit(traced, DECAY, START, x=X)
    count = len(traces)
    again = jc.fit(traced, DECAY + 0.1, {"a": 2.0, "b": 1.5, "c": 0.1}, x=X + 0.5)
    assert again.converged and len(traces) == count
    found = jc.fit(decay, DECAY, START, x=X, progress=lambda step, loss: seen.append((step, loss)))
    jax.effects_barrier()
    assert [step for step, _ in seen] == list(range(found.steps))
    assert [loss for _, loss in seen] == pytest.approx(list(found.history))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"start": {"a": "x"}}, "`start` must hold a number"),
        ({"start": 1.5, "transforms": jc.Between(2, 3)}, "`start` must have its number in"),
        ({"sigma": 1.0, "weights": 1.0}, "`weights` must be None"),
        ({"data": DECAY[:-1]}, "`predict` must return the shape"),
        ({"data": DECAY + 1j}, "`data` must hold real numbers"),
        ({"start": {"a": 1.0, "b": -1e3, "c": 0.0}}, "must have a finite prediction"),
        ({"transforms": {"d": jc.Free()}}, "must name numbers of `start`, a, b, c"),
        ({"start": 1.0, "transforms": {"d": jc.Free()}}, "`start`, which is one number without"),
        ({"groups": [1, 2]}, "`groups` must have one name for each of the 50 points"),
        ({"sigma": 1.0, "noise": "by column"}, "Argument `noise` must be 'common' with `sigma`"),
        ({"correlation": np.eye(3)}, "`correlation` must be a symmetric matrix"),
        ({"correlation": 2 * np.eye(50)}, "`correlation` must be a symmetric matrix"),
        ({"correlation": np.tri(50)}, "`correlation` must be a symmetric matrix"),
        ({"correlation": np.ones((50, 50))}, "`correlation` must be positive definite"),
    ],
)
def test_bad_arguments_are_named(changed, message):
    arguments = {"data": DECAY, "start": START, "x": X} | changed
    data, start = arguments.pop("data"), arguments.pop("start")
    with pytest.raises(ValueError, match=message):
        jc.fit(decay if isinstance(start, dict) else (lambda p, x: p * x), data, start, **arguments)
    with pytest.raises(ValueError, match="`high` must be above `low`"):
        jc.Between(1.0, 1.0)


def test_the_sandwich_over_groups_is_that_of_the_definition(free):
    groups = np.repeat(np.arange(10), 5)
    found = jc.fit(decay, DECAY, START, x=X, groups=groups)
    assert found.by_group and not free.by_group
    assert np.array_equal(found.values, free.values)
    p = found.params
    jacobian = np.stack([np.exp(-p["b"] * X), -p["a"] * X * np.exp(-p["b"] * X), np.ones(50)], 1)
    bread = np.linalg.inv(jacobian.T @ jacobian)
    terms = jacobian * found.residuals[:, None]
    scores = np.stack([terms[groups == g].sum(0) for g in range(10)])
    expected = bread @ scores.T @ scores @ bread * 10 / 9
    assert np.allclose(found.covariance, expected, rtol=1e-5)
    # Too few groups do not determine the correlation in them.
    few = jc.fit(decay, DECAY, START, x=X, groups=np.repeat(np.arange(5), 10))
    assert not few.by_group and np.allclose(few.covariance, free.covariance)


UNIT = np.linspace(0, 1, 80)
NOISE = np.random.default_rng(4).standard_t(2, size=80)
LARGE_SAMPLE = 0.03
"""Measured: 0.2 % to 1.1 % for six seeds; forgetting the curvature of Huber's loss gives 14 %."""


def scaled(p, x):
    return p["scale"] * decay(p, x)


@pytest.mark.parametrize(
    ("shape", "slope"), [(lambda a: a**2, 3.0), (jnp.cos, -1.0)], ids=["square", "cosine"]
)
def test_a_maximum_is_no_fit(shape, slope):
    result = jc.fit(lambda p, x: shape(p["a"]) * x, slope * UNIT, {"a": 0.0}, x=UNIT, throw=False)
    assert not result.converged
    assert "saddle or a maximum" in result.reason


def test_a_number_the_data_tell_well_is_not_at_the_end_of_a_wide_interval():
    y = 100 * UNIT + 0.1 * np.random.default_rng(4).normal(size=80)
    free, bounded = (
        jc.fit(lambda p, x: p * x, y, 1e4, x=UNIT, transforms=transform)
        for transform in (None, jc.Between(0, 1e9))
    )
    assert bounded.converged and not bounded.at_bound
    np.testing.assert_allclose(bounded.values, free.values, rtol=SAME)
    np.testing.assert_allclose(bounded.covariance, free.covariance, rtol=SAME)


def test_huber_counts_the_points_that_have_weight():
    y = 1 + 2 * UNIT + 0.1 * NOISE
    some = jc.fit(line, y, FLAT, x=UNIT, weights=np.arange(80) % 2.0, loss=jc.Huber())
    few = jc.fit(line, y[1::2], FLAT, x=UNIT[1::2], loss=jc.Huber())
    np.testing.assert_allclose(some.covariance, few.covariance, rtol=SAME)


def test_the_profile_of_huber_agrees_with_its_standard_error():
    x = np.linspace(0, 1, 2000)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(0).standard_t(2, size=2000)
    result = jc.fit(line, y, FLAT, x=x, loss=jc.Huber())
    low, high = result.profile("b").interval(0.6827)
    assert (high - low) / 2 == pytest.approx(result.standard_errors["b"], rel=LARGE_SAMPLE)


def test_more_named_numbers_than_points_are_refused():
    x, start = UNIT[:3], {"scale": 1.0, "a": 1.0, "b": 1.0, "c": 0.0}
    with pytest.raises(ValueError, match=r"has numbers to fit \(4: a, b, c, scale\), but holds 3"):
        jc.fit(scaled, 2 * x, start, x=x)
    # A point without weight does not count, and a fixed parameter is not fitted.
    how = {"x": x, "transforms": {"scale": jc.Fixed(), "b": jc.Fixed()}}
    with pytest.raises(ValueError, match=r"\(2: a, c\), but holds 1"):
        jc.fit(scaled, 2 * x, start, weights=[1.0, 0.0, 0.0], **how)
    assert jc.fit(scaled, 2 * x, start, weights=[1.0, 1.0, 0.0], **how).dof == 0
    # An array may have more numbers than there are points.
    powers = np.stack([UNIT[1:3], UNIT[1:3] ** 2, UNIT[1:3] ** 3])
    assert jc.fit(lambda p, x: p @ x, UNIT[1:3], np.ones(3), x=powers).unidentified
