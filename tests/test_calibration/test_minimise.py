"""The minimiser, on functions whose minimum is known, and when it cannot succeed."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact._calibration._minimise import GRADIENT_TOLERANCE, minimise

ROSENBROCK = 1e-6
"""A gradient of 1e-8 over the least curvature there, 0.4: measured 2e-9."""


def rosenbrock(p):
    return (1 - p[0]) ** 2 + 100 * (p[1] - p[0] ** 2) ** 2


def line(p, x, y):
    return jnp.mean(jnp.square(p[0] + p[1] * x - y))


def test_rosenbrock():
    end = minimise(rosenbrock, jnp.array([-1.2, 1.0]))
    assert end.converged
    assert end.reason == "the gradient vanishes"
    assert end.gradient_norm <= GRADIENT_TOLERANCE * (1 + end.loss)
    np.testing.assert_allclose(end.parameters, [1.0, 1.0], rtol=ROSENBROCK)


def test_data_are_passed_on():
    x = jnp.linspace(0.0, 1.0, 5)
    end = minimise(line, jnp.zeros(2), x, 2 + 3 * x)
    np.testing.assert_allclose(end.parameters, [2.0, 3.0], rtol=1e-6)


def test_running_out_of_evaluations_is_said():
    end = minimise(rosenbrock, jnp.array([-1.2, 1.0]), max_evaluations=5)
    assert not end.converged
    assert end.evaluations == 5
    assert "5 evaluations" in end.reason


def test_a_wrong_gradient_is_said():
    @dataclasses.dataclass(frozen=True)
    class Corner:
        def __call__(self, p):
            return jnp.sum(jnp.abs(p))

    end = minimise(Corner(), jnp.array([0.3]))
    # At the corner the gradient jumps and never vanishes.
    assert not end.converged
    assert end.gradient_norm > 0.5
    assert "not enough" in end.reason or "no better point" in end.reason


def test_a_region_without_values_is_backed_out_of():
    # The first step from the start overshoots to p < 0, where the loss is NaN.
    end = minimise(lambda p: jnp.sum(p - jnp.log(p)), jnp.array([30.0]))
    assert end.converged
    np.testing.assert_allclose(end.parameters, [1.0], rtol=1e-6)


def test_a_bad_start_raises():
    with pytest.raises(ValueError, match="start"):
        minimise(lambda p: jnp.sum(jnp.log(p)), jnp.array([-1.0]))
    with pytest.raises(ValueError, match="max_evaluations"):
        minimise(rosenbrock, jnp.array([0.0, 0.0]), max_evaluations=0)
