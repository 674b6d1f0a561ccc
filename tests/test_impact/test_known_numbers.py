"""Derivatives of concrete numbers outside `jit` equal those inside, for every transformation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.test_warm_calls import work_of

ROUNDING = {np.float64: 1e-12, np.float32: 2e-5}
"""Relative: one program is compiled for the value and the slopes, and rounds otherwise."""

NUMBERS = (0.6, 1.3, 1.4e8, 4.2)  # e, mass, stiffness and speed


def outcome(e, mass=1.3, stiffness=1.4e8, speed=4.2):
    hit = jc.impact(jc.HuGuo(e=e), jc.Contact(mass, stiffness), speed)
    return jnp.stack([hit.restitution, hit.duration * 1e3, hit.max_force / 1e4])


def total(*numbers):
    return outcome(*numbers).sum()


EVERY = (0, 1, 2, 3)
ALONG = (1.0, 0.0, 1e7, -0.3)
TRANSFORMS = {
    "grad": lambda f: jax.grad(lambda *x: f(*x).sum(), EVERY),
    "jacfwd": lambda f: jax.jacfwd(f, EVERY),
    "jacrev": lambda f: jax.jacrev(f, EVERY),
    "jvp": lambda f: lambda *x: jax.jvp(f, x, ALONG),
    "linearize": lambda f: lambda *x: jax.linearize(f, *x)[1](*ALONG),
    "grad of jit": lambda f: jax.grad(jax.jit(lambda *x: f(*x).sum()), EVERY),
    "of one": lambda f: jax.jacfwd(f, 3),
    "hessian": lambda f: jax.jacfwd(jax.grad(lambda *x: f(*x).sum())),
    "reverse over forward": lambda f: jax.grad(lambda *x: jax.jacfwd(f)(*x).sum()),
}


@pytest.fixture(scope="module")
def within():
    """Of every transform, by one program: value, slopes by all numbers, and twice by e."""

    @jax.jit
    def everything(*numbers):
        jacobian = jax.jacfwd(outcome, EVERY)(*numbers)
        return outcome(*numbers), jnp.stack(jacobian), jax.hessian(total)(*numbers)

    value, slopes, twice = everything(*NUMBERS)
    along = np.array(ALONG) @ slopes
    return {
        "grad": slopes.sum(axis=1),
        "jacfwd": slopes,
        "jacrev": slopes,
        "jvp": [value, along],
        "linearize": along,
        "grad of jit": slopes.sum(axis=1),
        "of one": slopes[3],
        "hessian": twice,
        "reverse over forward": twice,
    }


@pytest.mark.parametrize("name", TRANSFORMS)
def test_a_derivative_is_that_within_a_program(name, within):
    found = TRANSFORMS[name](outcome)(*NUMBERS)
    np.testing.assert_allclose(found, within[name], rtol=ROUNDING[np.float64])


def test_in_single_precision():
    numbers = [jnp.float32(x) for x in NUMBERS]
    found = jax.jacfwd(outcome, EVERY)(*numbers)
    assert {x.dtype for x in found} == {jnp.dtype("float32")}
    np.testing.assert_allclose(
        found, jax.jit(jax.jacfwd(outcome, EVERY))(*numbers), rtol=ROUNDING[np.float32]
    )


def test_batches_of_derivatives_and_derivatives_of_batches():
    e = jnp.linspace(0.3, 0.9, 4)
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

    def duration(e, speed):
        class Mine(jc.AbstractHuntCrossley):
            number: jax.Array

            def damping_factor(self, contact=None, velocity=None):
                return self.number * (1 - e) / e

        return jc.impact(Mine(number=jnp.asarray(1.5)), jc.Contact(1.0, 1e8), speed).duration

    found = jax.grad(duration, (0, 1))(0.6, 2.0)
    np.testing.assert_allclose(
        found, jax.jit(jax.grad(duration, (0, 1)))(0.6, 2.0), rtol=ROUNDING[np.float64]
    )


def test_a_warm_derivative_compiles_and_traces_nothing_of_the_solve():
    jax.grad(total)(0.6)
    assert "trace_to_jaxpr" not in work_of(lambda: jax.grad(total)(0.7))
