"""Contacts that creep back: with an end, without an end, and undecidable ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

# A linear spring and dashpot, ζ = A/2: with tension e = exp(-πζ/ω), T = π/ω, ω² = 1 - ζ².
ENDING = np.array([1e-9, 0.1, 1.0, 1.9, 1.99])
FOREVER = np.array([2.0, 2.05, 10.0, 1e4])
OMEGA = np.sqrt((1 - ENDING / 2) * (1 + ENDING / 2))

# Measured 3e-16 by formula, 1.3e-9 by event, for a traced exponent; e relative to 1.
EXACT, EVENT = 1e-14, 1e-8


LANES, PATHS = ENDING.size + FOREVER.size, 4
"""Of every call, so that those of one exponent and method share a program."""


def linear(a, n, **options):
    law = jc.KuwabaraKono(A=jnp.resize(jnp.asarray(a), LANES))
    hit = jc.impact(law, jc.Contact(1.0, 1.0, n), 1.0, **options)
    return jax.tree.map(lambda x: x[: np.size(a)].reshape(np.shape(a)), hit)


def status_of_path(a, n):
    law = jc.KuwabaraKono(A=jnp.resize(jnp.asarray(a), PATHS))
    status = jc.trajectory(law, jc.Contact(1.0, 1.0, n), 1.0, samples=3).status
    return status[: np.size(a)].reshape(np.shape(a))


@pytest.mark.parametrize(
    ("n", "method", "tolerance"),
    [(1.0, "auto", EXACT), (1.0, "event", EVENT), (jnp.array(1.0), "auto", EVENT)],
    ids=["formula", "event", "traced"],
)
def test_linear_kuwabara_kono(n, method, tolerance):
    hit = linear(np.append(ENDING, FOREVER), n, method=method)
    settled = hit.status == jc.Status.SETTLED
    assert (settled == (np.append(ENDING, FOREVER) >= 2)).all()
    assert (hit.restitution[settled] == 0).all() and np.isinf(hit.duration[settled]).all()
    # A traced exponent is solved in the root of x: its lane with e = 3e-14 may be flagged.
    parted = np.asarray(hit.status == jc.Status.SEPARATED)
    assert parted.sum() >= (ENDING.size if isinstance(n, float) else ENDING.size - 1)
    kept = parted[: ENDING.size]
    np.testing.assert_allclose(hit.duration[parted], (np.pi / OMEGA)[kept], rtol=tolerance)
    e = np.exp(-np.pi * ENDING / 2 / OMEGA)
    np.testing.assert_allclose(hit.restitution[parted], e[kept], rtol=0, atol=tolerance)


@pytest.mark.parametrize("n", [1.0, jnp.array(1.0)], ids=["static", "traced"])
def test_a_rebound_that_no_step_can_see_is_flagged(n):
    """e = 7e-44: the solver may give up, but not return the 34 s of where it lost the way."""
    hit = linear(1.999, n, method="event")
    assert hit.status == jc.Status.NOT_CONVERGED and np.isnan(hit.duration)
    duration = np.pi / np.sqrt((1 - 1.999 / 2) * (1 + 1.999 / 2))
    assert status_of_path(1.999, n) == jc.Status.NOT_CONVERGED
    assert linear(1.999, 1.0).duration == pytest.approx(duration, rel=EXACT)


@pytest.mark.parametrize("n", [1.0, jnp.array(1.0)], ids=["static", "traced"])
def test_the_force_jumps_at_touch(n):
    """x^(n-1) is 1 there, traced or not; no force is larger later."""
    assert linear(300.0, n, method="event").max_force == pytest.approx(300.0, rel=EXACT)


def test_no_trajectory_of_what_has_no_end():
    for n in (1.0, jnp.array(1.0)):
        status = status_of_path([1.9, 2.0, 2.05, 1e4], n)
        assert status.tolist() == [jc.Status.SEPARATED] + 3 * [jc.Status.NOT_CONVERGED]


def test_without_tension_it_parts_where_the_force_vanishes():
    hit = jc.impact(jc.KuwabaraKono(A=2.0, tension=False), jc.Contact(1.0, 1.0, 1), 1.0)
    assert hit.restitution == pytest.approx(np.exp(-2), rel=EXACT)


def test_inertia_ends_what_is_not_linear():
    hit = linear(np.array([0.1, 2.0, 2.05, 5.0]), 1.2)
    assert (hit.status == jc.Status.SEPARATED).all()
    assert (np.diff(hit.restitution) < 0).all() and (hit.restitution > 0).all()
