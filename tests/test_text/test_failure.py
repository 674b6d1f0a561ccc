"""A single call that fails numerically raises; batches and traced calls flag their lanes.

Every failure comes from input: too few steps, too little room, a number out of its range.
"""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.test_new_form import Plain

CONTACT = jc.Contact(1.0, 1e6)
SHORT = jc.Event(max_steps=20)  # enough for e = 0.9, not for e = 0.01


def impact(e, **how):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 1.3, method=SHORT, **how)


def bounce(e, **how):
    return jc.bounce(jc.HuGuo(e=e), CONTACT, 1.0, bounces=2, method=SHORT, **how)


def simulate(e, **how):
    """A ball between two walls; a faster one has more impacts than there is room."""
    ball = jc.Sphere(0.1, 1.0, [0.0], jnp.stack([1.0 / jnp.asarray(e)]))
    walls = jc.Plane([-1.0], [1.0]), jc.Plane([1.0], [-1.0])
    scene = jc.Scene([ball, *walls], jc.Hertz())
    return jc.simulate(scene, 2.0, instantaneous=True, max_impacts=1, **how)


CALLS = {
    "impact": (impact, 0.01, "NOT_CONVERGED. The solve did not converge. Try another method"),
    "bounce": (bounce, 0.01, "NOT_CONVERGED. The solve did not converge. Try another method"),
    "simulate": (simulate, 0.1, "TOO_MANY_IMPACTS. Pass a larger `max_impacts`"),
}
GOOD = 0.9


@pytest.mark.parametrize("name", CALLS)
def test_a_single_call_raises_and_lanes_are_flagged(name):
    call, bad, words = CALLS[name]
    with pytest.raises(jc.NumericalError, match=f"`{name}` failed: {words}.*`throw=False`"):
        call(bad)
    with pytest.raises(jc.NumericalError, match=words):
        call(jnp.asarray(bad))
    flagged = call(bad, throw=False)
    assert not flagged.ok and flagged.ok.dtype == bool and flagged.ok.shape == ()
    good = call(GOOD)
    assert good.ok
    lanes = jnp.array([GOOD, bad, GOOD])
    # `simulate` has no lanes of its own, and flags those that are traced.
    many = jax.jit(jax.vmap(call))(lanes) if name == "simulate" else call(lanes)
    assert many.ok.tolist() == [True, False, True]
    for field in ("position", "restitution"):
        if (values := getattr(many, field, None)) is not None:
            np.testing.assert_allclose(values[0], getattr(good, field), rtol=1e-12)
            assert np.isfinite(values[2]).all() and not np.isfinite(values[1]).all()


def test_a_traced_call_flags():
    inside = jax.jit(lambda e: impact(e).ok)
    assert not inside(0.01) and inside(GOOD)


def test_derivatives_outside_of_jit_flag():
    """There the status is concrete, and other leaves are tracers."""
    (_, ok), slope = jax.value_and_grad(
        lambda e: (lambda hit: (hit.restitution, hit.ok))(impact(e)), has_aux=True
    )(0.01)
    assert not ok and not slope > 0


def test_results_that_are_no_failure():
    settled = jc.impact(jc.WetRestitution(e=0.5, critical_speed=0.1), CONTACT, 1e-3)
    assert settled.status == jc.Status.SETTLED and settled.ok
    gives = Plain(c=-40.0), jc.Contact(1.0, 1e6, 1.0), 1.0
    assert jc.impact(*gives).status == jc.Status.GAINED
    with pytest.raises(jc.NumericalError, match="`bounce` failed: GAINED"):
        jc.bounce(*gives, bounces=2)
    flying = jc.bounce(jc.HuGuo(e=0.9), CONTACT, 1.0, bounces=2)
    assert not flying.at_rest and flying.ok


def line(params, x):
    return jnp.exp(params["a"] * x)


def test_a_fit_that_does_not_converge_raises():
    x = np.linspace(0, 1, 9)
    how = {"data": np.exp(2 * x), "start": {"a": 0.1}, "x": x}
    assert jc.fit(line, **how).ok
    words = "`fit` failed: NOT CONVERGED, 1 steps were not enough: .*`max_steps`.*`throw=False`"
    with pytest.raises(jc.NumericalError, match=words):
        jc.fit(line, **how, max_steps=1)
    flagged = jc.fit(line, **how, max_steps=1, throw=False)
    assert not flagged.ok and flagged.ok.dtype == bool and flagged.steps == 1


def test_a_ready_made_fit_that_does_not_converge_raises():
    v = np.geomspace(0.5, 3, 8)
    e = 0.9 - 0.05 * v
    with pytest.raises(jc.NumericalError, match="`fit_damping` failed: NOT CONVERGED"):
        jc.fit_damping(CONTACT, v, e, max_steps=1)
    assert not jc.fit_damping(CONTACT, v, e, max_steps=1, throw=False).ok


def test_the_error_and_the_outcomes_can_be_pickled():
    with pytest.raises(jc.NumericalError) as caught:
        impact(0.01)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert pickle.loads(pickle.dumps(jc.Ending.CROWDED)) is jc.Ending.CROWDED
    assert jc.Status(4) is jc.Status.GAINED and jc.Status.GAINED.words.startswith("e > 1")
