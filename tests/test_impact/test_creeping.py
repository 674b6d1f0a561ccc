"""Contacts that creep back: with an end, without an end, and undecidable ones.

The least force of a contact that may pull: by formula, by series, and along event solves.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import UNIT, impacts

# A linear spring and dashpot, ζ = A/2: with tension e = exp(-πζ/ω), T = π/ω, ω² = 1 - ζ².
ENDING = np.array([1e-9, 0.1, 1.0, 1.9, 1.99])
FOREVER = np.array([2.0, 2.05, 10.0, 1e4])
OMEGA = np.sqrt((1 - ENDING / 2) * (1 + ENDING / 2))

# Measured 3e-16 by formula, 1.3e-9 by event, for a traced exponent; e relative to 1.
EXACT, EVENT = 1e-14, 1e-8


def linear(a, n, **options):
    return impacts(jc.KuwabaraKono(A=a), jc.Contact(1.0, 1.0, n), **options)


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
    parted = hit.status == jc.Status.SEPARATED
    assert parted.sum() >= (ENDING.size if isinstance(n, float) else ENDING.size - 1)
    kept = parted[: ENDING.size]
    np.testing.assert_allclose(hit.duration[parted], (np.pi / OMEGA)[kept], rtol=tolerance)
    e = np.exp(-np.pi * ENDING / 2 / OMEGA)
    np.testing.assert_allclose(hit.restitution[parted], e[kept], rtol=0, atol=tolerance)


BY_EVENT = pytest.mark.parametrize(
    ("n", "method"), [(1.0, "event"), (jnp.array(1.0), "auto")], ids=["static", "traced"]
)


@BY_EVENT
def test_a_rebound_that_no_step_can_see_is_flagged(n, method):
    """e = 7e-44: the solver may give up, but not return the 34 s of where it lost the way."""
    hit = linear(1.999, n, method=method)
    assert hit.status == jc.Status.NOT_CONVERGED and np.isnan(hit.duration)
    duration = np.pi / np.sqrt((1 - 1.999 / 2) * (1 + 1.999 / 2))
    assert linear(1.999, 1.0).duration == pytest.approx(duration, rel=EXACT)
    if method == "event":
        law = jc.KuwabaraKono(A=np.array([1.9, 1.999, 2.0, 2.05, 1e4]))
        status = jc.trajectory(law, UNIT[n], 1.0, samples=3).status
        assert status.tolist() == [jc.Status.SEPARATED] + 4 * [jc.Status.NOT_CONVERGED]


@BY_EVENT
def test_the_force_jumps_at_touch(n, method):
    """x^(n-1) is 1 there, traced or not; no force is larger later."""
    assert linear(300.0, n, method=method).max_force == pytest.approx(300.0, rel=EXACT)


def test_without_tension_it_parts_where_the_force_vanishes():
    hit = impacts(jc.KuwabaraKono(A=2.0, tension=False), UNIT[1.0])
    assert hit.restitution == pytest.approx(np.exp(-2), rel=EXACT)


def test_inertia_ends_what_is_not_linear():
    hit = linear(np.array([0.1, 2.0, 2.05, 5.0]), np.array([1.2]))
    assert (hit.status == jc.Status.SEPARATED).all()
    assert (np.diff(hit.restitution) < 0).all() and (hit.restitution > 0).all()


STEPPED = 1e-8  # event solves and series or formulas: measured 2e-9 (values) and 2e-8 of slopes

LAWS = {
    "kelvin_voigt": (lambda p: jc.KelvinVoigt(e=p), [0.95, 0.5, 0.1], 1.0),
    "antypov_elliott": (lambda p: jc.AntypovElliott(e=p), [0.95, 0.5, 0.1], 1.5),
    "kuwabara_kono": (lambda p: jc.KuwabaraKono(A=p), [1e-3, 0.4, 3.0], 1.5),
}


@pytest.mark.slow("kelvin_voigt", "kuwabara_kono", reason="derivatives of one more event solve")
@pytest.mark.parametrize("name", LAWS)
def test_an_event_solve_finds_the_same(name):
    made, numbers, n = LAWS[name]
    parameter = jnp.array(numbers)

    def force(p, method):
        return jc.impact(made(p), UNIT[n], 1.0, method=method).min_force

    exact, event = (
        jax.jvp(lambda p, m=method: force(p, m), (parameter,), (parameter,))
        for method in ("exact", jc.Event(rtol=1e-11))
    )
    np.testing.assert_allclose(event[0], exact[0], rtol=STEPPED)
    np.testing.assert_allclose(event[1], exact[1], rtol=10 * STEPPED)


def test_a_linear_dashpot_lets_go_with_all_its_force():
    """-2ζ e at n = 1 for ζ < 1/2, where the force jumps to zero."""
    e = np.array([0.99, 0.3, 1.0])
    zeta = -np.log(e) / np.hypot(np.pi, np.log(e))
    least = impacts(jc.KelvinVoigt(e=e), UNIT[1.0]).min_force
    np.testing.assert_allclose(least, -2 * zeta * e, rtol=1e-14)


def test_it_is_printed_where_a_contact_may_pull():
    hit = impacts(jc.KelvinVoigt(e=0.5), UNIT[1.0], 2.0)
    assert "  min_force        -0.430907524 N\n" in repr(hit)
    hit = impacts(jc.KuwabaraKono(A=0.5, tension=False), UNIT[1.0])
    assert hit.min_force is None and "min_force" not in repr(hit)
    # These never pull, the last two with either value of `tension`. No program is needed to say so.
    for law, n in (
        *((jc.KelvinVoigt(e=0.5, tension=False), 1.0), (jc.LinearDashpot(c=0.3), 1.0)),
        *((jc.Jankowski(e=0.5), 1.5), (jc.HuGuo(e=0.5, tension=True), 1.5)),
    ):
        traced = jax.eval_shape(lambda law=law, n=n: jc.impact(law, UNIT[n], 1.0))
        assert traced.min_force is None


def test_bodies_that_creep_apart_for_ever():
    """An overdamped spring with tension: its largest numbers are those of its own way in."""
    hit = impacts(jc.LinearDashpot(c=np.array([5.0]), tension=True), UNIT[1.0])
    assert hit.status[0] == jc.Status.SETTLED and np.isnan(hit.min_force[0])
    assert hit.max_force[0] == pytest.approx(5.0, rel=1e-14)
    # x'' + 5x' + x = 0: x' = 0 at t = ln(r2/r1)/(r2-r1), r = (5 ∓ √21)/2.
    slow, fast = (5 - np.sqrt(21)) / 2, (5 + np.sqrt(21)) / 2
    turn = np.log(fast / slow) / (fast - slow)
    deepest = (np.exp(-slow * turn) - np.exp(-fast * turn)) / (fast - slow)
    assert hit.compression_time[0] == pytest.approx(turn, rel=1e-13)
    assert hit.max_indentation[0] == pytest.approx(deepest, rel=1e-13)
