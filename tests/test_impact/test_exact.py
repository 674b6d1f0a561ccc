"""The closed forms against forty digits.

Viscoelastic spheres by their series, against Taylor series and known limits.
"""

import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

import jaxcontact as jc
from tests import oracle
from tests.oracle import FIELDS, kuwabara_kono
from tests.oracle.stored import stored
from tests.oracle.viscoelastic_series import FILE
from tests.test_impact import units
from tests.test_impact.support import (
    UNIT,
    assert_within,
    column,
    errors,
    family,
    grid,
    impacts,
    outcome,
    scaled,
    slopes,
    values,
)
from tests.test_laws import table

# Formulas: measured 1e-15. Quadrature: measured 1.2e-13 (n = 3, α = 1.6e6), 5e-14 for n ≤ 2.
FORMULA, TIME = 1e-13, 1e-12
TOLERANCES = {
    "e": FORMULA, "max_indentation": FORMULA, "max_force": FORMULA, "energy_loss": FORMULA,
    "duration": TIME, "compression_time": TIME,
}  # fmt: skip


FAMILIES = [("hunt_crossley", {})]
FAMILIES += [("oscillator", {"ending": ending}) for ending in ("tension", "clamped", "approach")]
# All other exponents are those of the traced one.
EXPONENTS = [{"n": n} for n in (1.0, 1.5, 3.0)] + [{}]


@pytest.mark.parametrize(
    ("kind", "fixed"),
    [(kind, x | n) for kind, x in FAMILIES for n in EXPONENTS if grid(kind, **x, **n)],
    ids=str,
)
def test_closed_forms(kind, fixed):
    """By a concrete exponent, which selects its formulas, and by a traced one."""
    some, numbers, law = family(kind, **fixed)
    assert kind == "oscillator" or numbers.max() == 1.6e6
    n = fixed.get("n")
    solve = jax.jit(lambda x, traced: outcome(scaled(law(x), traced if n is None else n)))
    got = solve(numbers, column(some, "n"))
    assert_within(errors(got, values(some)), TOLERANCES, numbers)


# --- Through the front door, in SI units ---------------------------------------------------------

# From grains to buffers; X is known to about |ln X| = 20 units of rounding.
POINTS = {
    "K": np.array([1.4e8, 2.5e10, 3.0, 8e-3, 1e15, 4.2e5, 7e8, 1e6]),
    "m": np.array([1.0, 3e-8, 2e-3, 5e4, 1e-12, 0.7, 60.0, 0.02]),
    "v": np.array([4.2, 0.3, 1e-6, 12.0, 9e2, 0.05, 1.7, 3e-3]),
    "n": np.full(8, 1.5),
}
ALPHAS = [0.0, 1e-8, 0.3, 2.0, 14.4, 100.0, 1e4, 1.6e6]


def in_si(scaled, p):
    si = {f: np.float64(units.unit(f, p) * scaled[f]) for f in scaled}
    return si | {"energy_loss": scaled["energy_loss"]}


def assert_front_door(hit, want, p):
    got = outcome(hit, np.float64(units.unit("energy_loss", p)))
    assert_within(errors(got, want), TOLERANCES)
    assert hit.method == "exact"
    assert (hit.status == jc.Status.SEPARATED).all()
    rebound = want["e"] * p["v"]
    assert np.allclose(hit.rebound_velocity, rebound, rtol=FORMULA, atol=0)


def test_hunt_crossley_in_si_units():
    some = [c for a in ALPHAS for c in grid("hunt_crossley", n=1.5, alpha=a)]
    contact = jc.Contact(POINTS["m"], POINTS["K"])
    hit = impacts(jc.Damped(alpha=np.array(ALPHAS)), contact, POINTS["v"])
    assert_front_door(hit, in_si(values(some), POINTS), POINTS)


OSCILLATORS = {
    "kelvin_voigt": (jc.KelvinVoigt, 1.0, table.zeta_of_half_period, "tension"),
    "kelvin_voigt_clamped": (jc.KelvinVoigt, 1.0, table.clamped_zeta, "clamped"),
    "antypov_elliott": (jc.AntypovElliott, 1.5, table.zeta_of_half_period, "tension"),
    "tsuji": (jc.Tsuji, 1.5, lambda e: table.tsuji(e) / mp.sqrt(5), "tension"),
    "thornton": (jc.Thornton, 1.5, lambda e: table.thornton(e) * mp.sqrt(mpf(6) / 5), "clamped"),
    "jankowski": (jc.Jankowski, 1.5, lambda e: 2 * table.jankowski(e) / mp.sqrt(5), "approach"),
}


@stored()
def by_the_oracle(name, e):
    _, n, ratio, ending = OSCILLATORS[name]
    with mp.workdps(50):
        solved = oracle.oscillator(ratio(mpf(e)), n, ending)
    return np.array([float(getattr(solved, f)) for f in FIELDS])


@pytest.mark.parametrize("name", OSCILLATORS)
def test_oscillator_laws_in_si_units(name):
    law, n, *_ = OSCILLATORS[name]
    options = {"tension": False} if name == "kelvin_voigt_clamped" else {}
    asked = [0.2, 0.6, 0.9]
    numbers = np.transpose([by_the_oracle(name, e) for e in asked])
    p = {k: x[:3] for k, x in POINTS.items()} | {"n": np.full(3, n)}
    contact = jc.Contact(p["m"], p["K"], n)
    hit = impacts(law(e=np.array(asked), **options), contact, p["v"])
    assert_front_door(hit, in_si(dict(zip(FIELDS, numbers, strict=True)), p), p)
    if name.startswith(("kelvin_voigt", "antypov")):
        assert np.allclose(hit.restitution, asked, rtol=FORMULA, atol=0)


EXACT = dict.fromkeys(FIELDS, 1e-14)  # measured 1.3e-15

SLOPES = 1e-13
"""Measured 1.9e-14, of a largest force that hardly changes; of the energy loss beside 1."""

SECOND = 1e-7  # central differences of slopes with step 1e-5, of second derivatives up to 10
SINGLE = 1e-5  # float32, of restitutions down to 1e-15 relative to themselves

ENDS = [float(np.expm1(s)) for s in json.loads(FILE.read_text())["ends"]]


def law(a, tension):
    return jc.KuwabaraKono(A=a, tension=tension)


def solved(a, tension):
    return outcome(jc.impact(law(a, tension), UNIT[1.5], 1.0))


LANES = 256  # of every call, so that all share one program; the last ones are filled


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
        filled = np.append(a, np.full(LANES - len(a), 0.3))
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
    a = np.array([1e-3, 0.3, 1.9, 2.8, 6.0, 40.0])
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
    below, above = (program(tension)(np.nextafter(a, to)) for to in (0, np.inf))
    for order, tolerance in enumerate((1e-14, 1e-12, 1e-10)):
        for f in FIELDS:
            np.testing.assert_allclose(
                below[order][f], above[order][f], rtol=tolerance, atol=1e-30, err_msg=f
            )


@stored()
def by_taylor(a, tension):
    found = kuwabara_kono(a, "1.5", tension)
    return np.array([float(getattr(found, f)) for f in FIELDS])


@pytest.mark.parametrize("tension", [True, False])
def test_between_the_cases_of_the_oracle(tension):
    a = np.geomspace(1e-4, 30, 32)
    want = np.transpose([by_taylor(x, tension) for x in a.tolist()])
    got = program(tension)(a)[0]
    assert_within(errors(got, dict(zip(FIELDS, want, strict=True))), EXACT, a)


def test_the_limits_of_strong_damping():
    a = np.array([10.0, 1e3, 1e6, 1e12, 1e20])
    pulling, clamped = program(True)(a)[0], program(False)(a)[0]
    # The creep back is independent of the impact: e a^5 and (duration/a - 5 ln a) become constants.
    np.testing.assert_allclose(pulling["e"] * a**5, 0.67929306393648530, rtol=1e-12)
    rest = pulling["duration"] / a - 5 * np.log(a)
    assert np.ptp(rest[2:]) < 1e-7 and rest[4] == pytest.approx(-0.35936705665442545, abs=1e-10)
    for name in ("max_indentation", "compression_time", "max_force"):
        np.testing.assert_array_equal(pulling[name], clamped[name])
    np.testing.assert_allclose(clamped["max_indentation"][2:] * a[2:] ** (2 / 3), 1, rtol=1e-8)
    # Where the force vanishes the bodies creep: 1.5 a v = -x.
    np.testing.assert_allclose(clamped["e"][2:] * 1.5 * a[2:] ** (5 / 3), 1, rtol=1e-8)


def test_single_precision():
    a = np.append(0, np.geomspace(1e-5, 1e3, 200)).astype(np.float32)
    for tension in (True, False):
        got = outcome(impacts(law(a, tension), UNIT[1.5]))
        want = program(tension)(a.astype(float))[0]
        assert all(got[f].dtype == np.float32 for f in FIELDS)
        assert_within(errors(got, want), dict.fromkeys(FIELDS, SINGLE), a)


def test_nothing_is_solved_where_the_series_serve():
    def impact(a, exponent):
        hit = jc.impact(law(a, False), jc.Contact(1.0, 1.0, exponent), 1.0)
        return hit.duration, jc.restitution(law(a, True), jc.Contact(1.0, 1.0, exponent), 1.0)

    assert "while" not in str(jax.make_jaxpr(lambda a: impact(a, 1.5))(0.3))
    # Another exponent, or a traced one, is solved.
    for n in (2.0, jnp.array(1.5)):
        contact = jc.Contact(1.0, 1.0, n)
        traced = jax.eval_shape(lambda at=contact: jc.impact(law(0.3, True), at, 1.0))
        assert traced.method == "event" and traced.steps is not None
