"""Viscoelastic spheres by their series, against Taylor series, event solves and known limits."""

import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle import FIELDS, kuwabara_kono
from tests.oracle.viscoelastic_series import FILE
from tests.test_impact.support import (
    UNIT,
    assert_within,
    column,
    errors,
    grid,
    outcome,
    slopes,
    values,
)

EXACT = dict.fromkeys(FIELDS, 1e-14)
"""Measured 1.3e-15."""

SLOPES = 1e-13
"""Measured 1.9e-14, of a largest force that hardly changes; of the energy loss beside 1."""

EVENT = 3e-11
"""Of an event solve at rtol 1e-12, whose error it is."""

SECOND = 1e-7
"""Central differences of slopes with step 1e-5, of second derivatives up to 10."""

SINGLE = 1e-5
"""Float32, of restitutions down to 1e-15 relative to themselves."""

ENDS = [float(np.expm1(s)) for s in json.loads(FILE.read_text())["ends"]]


def law(a, tension):
    return jc.KuwabaraKono(A=a, tension=tension)


def solved(a, tension, **options):
    return outcome(jc.impact(law(a, tension), UNIT[1.5], 1.0, **options))


LANES = 256
"""Of every call, so that all share one program; the last ones are filled."""


@functools.cache
def program(tension):
    """Outcome, slopes and second derivatives of up to 256 lanes, compiled once."""

    def along(function, a):
        return jax.jvp(function, (a,), (jnp.ones_like(a),))

    def one(a):
        return along(lambda a: solved(a, tension), a)

    def all_of(a):
        (value, slope), (_, second) = along(one, a)
        return value, slope, second

    compiled = jax.jit(all_of)

    def padded(a):
        filled = jnp.asarray(np.append(a, np.full(LANES - len(a), 0.3)))
        return jax.tree.map(lambda x: np.asarray(x)[: len(a)], compiled(filled))

    return padded


@pytest.mark.parametrize("tension", [True, False])
def test_the_stored_cases(tension):
    some = grid("kuwabara_kono", tension=tension)
    a = column(some, "a")
    value, slope, second = program(tension)(a)
    assert_within(errors(value, values(some)), EXACT, a)
    want = slopes(some, "a")
    for f in FIELDS:
        error = np.abs(np.asarray(slope[f]) - want[f])
        relative = np.abs(want[f]) if f != "energy_loss" else 1
        assert np.max(error / relative) < SLOPES, f
    # Also at a = 0, where without tension the outcome continues in half powers from a^(5/2) on.
    assert all(np.isfinite(second[f]).all() for f in FIELDS)


@pytest.mark.parametrize("tension", [True, False])
def test_second_derivatives(tension):
    a = jnp.array([1e-3, 0.3, 1.9, 2.8, 6.0, 40.0])
    h = 1e-5 * a
    _, _, second = program(tension)(a)
    (_, high, _), (_, low, _) = (program(tension)(a + sign * h) for sign in (1, -1))
    for f in FIELDS:
        difference = (high[f] - low[f]) / (2 * h)
        np.testing.assert_allclose(second[f], difference, rtol=SECOND, atol=SECOND, err_msg=f)


@pytest.mark.parametrize("tension", [True, False])
def test_pieces_fit_together(tension):
    """The value, slope and second derivative of both pieces where they meet."""
    a = np.array(ENDS[1:])
    below, above = (program(tension)(jnp.asarray(np.nextafter(a, to))) for to in (0, np.inf))
    for order, tolerance in enumerate((1e-14, 1e-12, 1e-10)):
        for f in FIELDS:
            np.testing.assert_allclose(
                below[order][f], above[order][f], rtol=tolerance, atol=1e-30, err_msg=f
            )


@pytest.mark.parametrize(("a", "tension"), [("0.37", True), ("4.4", True), ("2.3", False)])
def test_new_cases_of_the_oracle(a, tension):
    want = kuwabara_kono(float(a), "1.5", tension)
    got = program(tension)(jnp.array([float(a)]))[0]
    found = errors(got, {f: np.array([getattr(want, f)]) for f in FIELDS})
    assert_within(found, EXACT)


@pytest.mark.parametrize("tension", [True, False])
def test_an_event_solve_knows_nothing_of_the_series(tension):
    a = jnp.asarray(np.append(0.0, np.geomspace(1e-4, 30, 63)))
    event = solved(a, tension, method=jc.Event(rtol=1e-12))
    assert_within(errors(program(tension)(a)[0], event), dict.fromkeys(FIELDS, EVENT), a)


def test_the_limits_of_strong_damping():
    a = jnp.array([10.0, 1e3, 1e6, 1e12, 1e20])
    pulling, clamped = program(True)(a)[0], program(False)(a)[0]
    # The creep back is independent of the impact: e a^5 and (duration/a - 5 ln a) become constants.
    np.testing.assert_allclose(pulling["e"] * a**5, 0.67929306393648530, rtol=1e-12)
    rest = np.asarray(pulling["duration"] / a - 5 * jnp.log(a))
    assert np.ptp(rest[2:]) < 1e-7 and rest[4] == pytest.approx(-0.35936705665442545, abs=1e-10)
    for name in ("max_indentation", "compression_time", "max_force"):
        np.testing.assert_array_equal(pulling[name], clamped[name])
    np.testing.assert_allclose(clamped["max_indentation"][2:] * a[2:] ** (2 / 3), 1, rtol=1e-8)
    # Where the force vanishes the bodies creep: 1.5 a v = -x.
    np.testing.assert_allclose(clamped["e"][2:] * 1.5 * a[2:] ** (5 / 3), 1, rtol=1e-8)


def test_single_precision():
    a = np.append(0, np.geomspace(1e-5, 1e3, 200))
    for tension in (True, False):
        contact = jc.Contact(*jnp.ones(2, jnp.float32), 1.5)
        lanes = jnp.asarray(a, jnp.float32)
        got = outcome(jc.impact(law(lanes, tension), contact, jnp.float32(1)))
        want = program(tension)(jnp.asarray(lanes, float))[0]
        assert all(got[f].dtype == jnp.float32 for f in FIELDS)
        assert_within(errors(got, want), dict.fromkeys(FIELDS, SINGLE), a)


def test_bad_lanes_are_flagged():
    a = jnp.array([0.3, -0.1, jnp.nan, jnp.inf, 0.3])
    hit = jc.impact(law(a, True), UNIT[1.5], 1.0)
    good = np.array([True, False, False, False, True])
    assert ((hit.status == jc.Status.SEPARATED) == good).all()
    assert (np.isfinite(hit.restitution) == good).all()
    e = jc.restitution(law(a, True), UNIT[1.5], 1.0)
    np.testing.assert_array_equal(e, hit.restitution)


def test_nothing_is_solved_where_the_series_serve():
    def impact(a, exponent):
        hit = jc.impact(law(a, False), jc.Contact(1.0, 1.0, exponent), 1.0)
        return hit.duration, jc.restitution(law(a, True), jc.Contact(1.0, 1.0, exponent), 1.0)

    assert "while" not in str(jax.make_jaxpr(lambda a: impact(a, 1.5))(0.3))
    # Another exponent, or a traced one, is solved.
    assert (
        jax.eval_shape(
            lambda n: jc.impact(law(0.3, True), jc.Contact(1.0, 1.0, n), 1.0), jnp.array(1.5)
        ).method
        == "event"
    )
