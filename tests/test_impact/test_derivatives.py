"""First derivatives in both modes, second ones of the closed form, against the oracle.

Derivatives of concrete numbers outside `jit` equal those inside, for every transformation.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact import units
from tests.test_impact.support import (
    column,
    given_ratio,
    grid,
    outcome,
    scaled,
    slopes,
    slopes_of_lanes,
    values,
)
from tests.test_impact.test_warm_calls import work_of

TOLERANCE = {"exact": 1e-11, "event": 1e-7, "phase": 1e-7}
"""Relative to the derivative or, where that is small, to 1e-3 of its unit: measured 2e-14, 3e-8
(event, at rtol 1e-11) and 2.1e-8 (phase)."""

SMALL = 1e-3

FIRST, SECOND = 1e-12, 1e-10
"""Closed forms by their one number, over all of its range: measured 1.3e-13, and 4e-13 (1.4e-11 for
the duration at n = 3, whose curvature vanishes with α)."""

METHODS = {"exact": jc.Exact(), "event": jc.Event(rtol=1e-11), "phase": jc.Phase()}

# The phase method reports the limit of its validity.
RANGE = {"exact": np.inf, "event": np.inf, "phase": 14.4}


def problem(largest: float):
    """Lanes from e = 1 to 1e-6, each at another place in SI units."""
    some = [c for c in grid("hunt_crossley", n=1.5) if c.args["alpha"] <= largest]
    places = {
        "alpha": column(some, "alpha"),
        "K": [1.4e8, 2.5e10, 3.0, 8e-3, 1e15, 4.2e5, 7e8, 1e6],
        "m": [1.0, 3e-8, 2e-3, 5e4, 1e-12, 0.7, 60.0, 0.02],
        "v": [4.2, 0.3, 1e-6, 12.0, 9e2, 0.05, 1.7, 3e-3],
        "n": [1.5],
    }
    return some, {k: np.resize(np.array(x), len(some)) for k, x in places.items()}


@pytest.mark.slow("event-False", "phase-False", reason="derivatives of solves by all parameters")
@pytest.mark.parametrize(
    ("method", "traced"), [("exact", True), ("exact", False), ("event", False), ("phase", False)]
)
def test_first_derivatives_by_every_parameter(method, traced):
    """Of the law's number and the contact; slopes of the laws' formulas are in test_formulas."""
    some, p = problem(RANGE[method])
    names = [k for k in p if traced or k != "n"]

    def solve(numbers):
        p = {"n": 1.5} | dict(zip(names, numbers, strict=True))
        law, contact = jc.Damped(p["alpha"]), jc.Contact(p["m"], p["K"], p["n"])
        hit = outcome(jc.impact(law, contact, p["v"], method=METHODS[method]))
        return jnp.stack([hit[f] for f in units.QUANTITIES])

    got, *both = slopes_of_lanes(solve)(np.stack([p[k] for k in names], axis=1))
    value, by_alpha, by_n = values(some), slopes(some, "alpha"), slopes(some, "n")
    for i, f in enumerate(units.QUANTITIES):
        in_si = np.float64(units.unit(f, p) * value[f])
        assert np.allclose(got[:, i], in_si, rtol=TOLERANCE[method], atol=0), f
        for j, by in enumerate(names):
            want = units.slope(f, by, p, value[f], {"alpha": by_alpha[f], "n": by_n[f]})
            size = np.maximum(np.abs(want), SMALL * units.natural(f, by, p))
            for mode, slope in zip(("forward", "reverse"), both, strict=True):
                error = np.max(np.abs(slope[:, i, j] - want) / size)
                assert error <= TOLERANCE[method], f"d {f}/d {by}, {mode}: {error:.2e}"


def assert_slopes(got, want, tolerance, number, label):
    """Relative errors; below a number of 1, where slopes may vanish, to 1e-3 at least."""
    least = np.where(np.asarray(number) < 1, SMALL, 0)
    for f in units.QUANTITIES:
        error = np.abs(got[f] - want[f]) / np.maximum(np.abs(want[f]), least)
        assert error.max() <= tolerance, f"{label} of {f}: {error.max():.2e} at {error.argmax()}"


@pytest.mark.slow("1.0", "3.0", reason="second derivatives at another exponent, 19 s of CPU each")
@pytest.mark.parametrize("n", [1.0, 1.5, 3.0])
def test_hunt_crossley_by_its_damping_factor(n):
    """Twice forward, and in reverse over forward."""
    some = grid("hunt_crossley", n=n)

    def solve(alpha):
        return outcome(scaled(jc.Damped(alpha=alpha), n))

    def slope(alpha):
        return jax.jvp(solve, (alpha,), (jnp.ones_like(alpha),))[1]

    alpha, curvature = column(some, "alpha"), slopes(some, "alpha", "d2")
    first, second = jax.jit(lambda alpha: jax.jvp(slope, (alpha,), (jnp.ones_like(alpha),)))(alpha)
    assert_slopes(first, slopes(some, "alpha"), FIRST, alpha, "slope")
    assert_slopes(second, curvature, SECOND, alpha, "curvature")
    back = jax.grad(lambda alpha: jnp.sum(slope(alpha)["duration"]))
    reverse = second | {"duration": jax.jit(back)(alpha)}
    assert_slopes(reverse, curvature, SECOND, alpha, "curvature, the other way")


@pytest.mark.parametrize("ending", ["tension", "clamped", "approach"])
def test_oscillators_by_their_damping_ratio(ending):
    some = grid("oscillator", ending=ending, n=1.5)

    def solve(zeta):
        found = outcome(scaled(given_ratio(zeta[0], ending), 1.5))
        return jnp.stack([found[f] for f in units.QUANTITIES])

    zeta = column(some, "zeta")
    for slope in slopes_of_lanes(solve)(zeta[:, None])[1:]:
        found = dict(zip(units.QUANTITIES, slope[..., 0].T, strict=True))
        assert_slopes(found, slopes(some, "zeta"), FIRST, zeta, "slope")


def test_slopes_of_a_strongly_damped_impact_are_the_same_in_other_units():
    """A push of ten thousand times the spring's force makes the matrices of its steps steep."""
    mass, stiffness, speed = np.array([[1e-12, 1e15, 1e3], [1e6, 1e15, 1e-6]]).T
    length = (mass * speed**2 / stiffness) ** 0.4
    given = {"damping": 1e4 * length / speed, "push": -1e4 * stiffness * length**1.5}

    def restitution(damping, push):
        law, contact = jc.KuwabaraKono(damping, tension=True), jc.Contact(mass, stiffness)
        return jc.impact(
            law, contact, speed, method=METHODS["event"], external_force=push
        ).restitution

    # Each push and damping twice, once for either slope.
    mass, stiffness, speed = (np.repeat(x, 2) for x in (mass, stiffness, speed))
    numbers = [np.repeat(x, 2) for x in given.values()]
    along = [x * np.tile(one, 2) for x, one in zip(numbers, ([1, 0], [0, 1]), strict=True)]
    slopes = jax.jvp(restitution, tuple(numbers), tuple(along))[1]
    np.testing.assert_allclose(slopes[:2], slopes[2:], rtol=TOLERANCE["event"])


# --- Of concrete numbers --------------------------------------------------------------------------


ROUNDING = {np.float64: 1e-12, np.float32: 2e-5}
"""Relative: one program is compiled for the value and the slopes, and rounds otherwise."""

NUMBERS = (0.6, 1.3, 1.4e8, 4.2)  # e, mass, stiffness and speed


def observed_of(law, n):
    def observed(e, mass=1.3, stiffness=1.4e8, speed=4.2):
        hit = jc.impact(law(e=e), jc.Contact(mass, stiffness, n), speed)
        return jnp.stack([hit.restitution, hit.duration * 1e3, hit.max_force / 1e4])

    return observed


observed = observed_of(jc.HuGuo, 1.5)
# For batches and second derivatives: the program of a quadrature takes seconds.
elementary = observed_of(jc.KelvinVoigt, 1.0)


EVERY = (0, 1, 2, 3)
ALONG = (1.0, 0.0, 1e7, -0.3)
TRANSFORMS = {
    "grad": lambda f: jax.grad(lambda *x: f(*x).sum(), EVERY),
    "jacfwd": lambda f: jax.jacfwd(f, EVERY), "jacrev": lambda f: jax.jacrev(f, EVERY),
    "jvp": lambda f: lambda *x: jax.jvp(f, x, ALONG),
    "linearize": lambda f: lambda *x: jax.linearize(f, *x)[1](*ALONG),
    "grad of jit": lambda f: jax.grad(jax.jit(lambda *x: f(*x).sum()), EVERY), "of one": jax.jacfwd,
}  # fmt: skip
OF_A_QUADRATURE = ("grad", "jacfwd")  # taken of `observed`, the others of `elementary`
TWICE = {
    "hessian": lambda f: jax.jacfwd(jax.grad(lambda *x: f(*x).sum())),
    "reverse over forward": lambda f: jax.grad(lambda *x: jax.jacfwd(f)(*x).sum()),
}


@pytest.fixture(scope="module")
def within():
    """Of every transform, by one program: value, slopes by all numbers, and twice by e."""

    @jax.jit
    def everything(*numbers):
        twice = jax.hessian(lambda *x: elementary(*x).sum())(*numbers)
        slopes = [jnp.stack(jax.jacfwd(f, EVERY)(*numbers)) for f in (observed, elementary)]
        return elementary(*numbers), *slopes, twice

    value, of_quadrature, slopes, twice = everything(*NUMBERS)
    along = np.array(ALONG) @ slopes
    return {
        "grad": of_quadrature.sum(axis=1),
        "jacfwd": of_quadrature,
        "jacrev": slopes,
        "jvp": [value, along],
        "linearize": along,
        "grad of jit": slopes.sum(axis=1),
        "of one": slopes[0],
        "hessian": twice,
        "reverse over forward": twice,
    }


@pytest.mark.parametrize("name", [*TRANSFORMS, *TWICE])
def test_a_derivative_is_that_within_a_program(name, within):
    function = observed if name in OF_A_QUADRATURE else elementary
    found = (TRANSFORMS | TWICE)[name](function)(*NUMBERS)
    np.testing.assert_allclose(found, within[name], rtol=ROUNDING[np.float64])


def test_in_single_precision(within):
    found = jax.jacfwd(observed, EVERY)(*(jnp.float32(x) for x in NUMBERS))
    assert {x.dtype for x in found} == {jnp.dtype("float32")}
    np.testing.assert_allclose(found, within["jacfwd"], rtol=ROUNDING[np.float32])


def total(*numbers):
    return elementary(*numbers).sum()


def test_batches_of_derivatives_and_derivatives_of_batches():
    e = np.linspace(0.3, 0.9, 4)
    singly = [jax.grad(total)(x) for x in e]
    np.testing.assert_allclose(jax.vmap(jax.grad(total))(e), singly, rtol=ROUNDING[np.float64])
    batch = jax.grad(lambda e: jax.vmap(total)(e).sum())(e)
    np.testing.assert_allclose(batch, singly, rtol=ROUNDING[np.float64])


@pytest.mark.slow("event", reason="the event solve is compiled twice, for ten seconds")
@pytest.mark.parametrize("method", ["event", "phase"])
def test_of_a_solve_beside_flags_and_counts(method):
    def solved(e, push):
        how = {} if method == "phase" else {"external_force": push}
        hit = jc.impact(jc.HuGuo(e=e), jc.Contact(1.0, 1e8), 1.0, method=method, **how)
        return hit.restitution + hit.duration * 1e3, (hit.status, hit.steps, hit.error_estimate)

    take = jax.value_and_grad(solved, (0, 1), has_aux=True)
    (value, aux), slopes = take(0.6, 30.0)
    (want, want_aux), want_slopes = jax.jit(take)(0.6, 30.0)
    np.testing.assert_allclose([value, *slopes], [want, *want_slopes], rtol=1e-10)
    assert jax.tree.map(jnp.result_type, aux) == jax.tree.map(jnp.result_type, want_aux)
    assert int(aux[0]) == int(want_aux[0])


def test_a_law_that_closes_over_a_number_beneath_the_derivative():
    """A number that is no argument of the program has no slope there."""

    def force(e, speed):
        class Mine(jc.AbstractHuntCrossley):
            number: jax.Array

            def damping_factor(self, contact=None, velocity=None):
                return self.number * (1 - e) / e

        return jc.impact(Mine(number=jnp.asarray(1.5)), jc.Contact(1.0, 1e8), speed).max_force

    found, want = (f(0.6, 2.0) for f in (jax.grad(force, (0, 1)), jax.jit(jax.grad(force, (0, 1)))))
    np.testing.assert_allclose(found, want, rtol=ROUNDING[np.float64])


def test_a_warm_derivative_compiles_and_traces_nothing_of_the_solve():
    jax.grad(total)(0.6)
    assert "trace_to_jaxpr" not in work_of(lambda: jax.grad(total)(0.7))
