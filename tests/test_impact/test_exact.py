"""The closed forms against forty digits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

import jaxcontact as jc
from tests import oracle
from tests.test_impact import units
from tests.test_impact.support import (
    assert_within,
    column,
    errors,
    given_ratio,
    grid,
    outcome,
    scaled,
    values,
)

# Formulas: measured 1e-15. Quadrature: measured 1.2e-13 (n = 3, α = 1.6e6), 5e-14 for n ≤ 2.
FORMULA, TIME = 1e-13, 1e-12
TOLERANCES = {
    "e": FORMULA,
    "max_indentation": FORMULA,
    "max_force": FORMULA,
    "energy_loss": FORMULA,
    "duration": TIME,
    "compression_time": TIME,
}


@pytest.mark.parametrize("n", [1.0, 1.25, 1.5, 2.0, 3.0])
def test_hunt_crossley(n):
    some = grid("hunt_crossley", n=n)
    alpha = column(some, "alpha")
    assert alpha.max() == 1.6e6
    got = jax.jit(lambda alpha: outcome(scaled(jc.Damped(alpha=alpha), n)))(alpha)
    assert_within(errors(got, values(some)), TOLERANCES, alpha)


def test_hunt_crossley_with_traced_exponents():
    some = grid("hunt_crossley")
    got = jax.jit(lambda a, n: outcome(scaled(jc.Damped(alpha=a), n)))(
        column(some, "alpha"), column(some, "n")
    )
    assert_within(errors(got, values(some)), TOLERANCES, column(some, "alpha"))


@pytest.mark.parametrize("ending", ["tension", "clamped", "approach"])
def test_oscillators(ending):
    for n in (1.0, 1.5, 2.0):
        some = grid("oscillator", ending=ending, n=n)
        if some:
            got = outcome(scaled(given_ratio(column(some, "zeta"), ending), n))
            assert_within(errors(got, values(some)), TOLERANCES, column(some, "zeta"))


@pytest.mark.parametrize("ending", ["tension", "clamped", "approach"])
def test_oscillators_with_traced_exponents(ending):
    some = grid("oscillator", ending=ending)
    got = jax.jit(lambda zeta, n: outcome(scaled(given_ratio(zeta, ending), n)))(
        column(some, "zeta"), column(some, "n")
    )
    assert_within(errors(got, values(some)), TOLERANCES, column(some, "zeta"))


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
    contact = jc.Contact(jnp.asarray(POINTS["m"]), jnp.asarray(POINTS["K"]))
    hit = jc.impact(jc.Damped(alpha=jnp.array(ALPHAS)), contact, jnp.asarray(POINTS["v"]))
    assert_front_door(hit, in_si(values(some), POINTS), POINTS)


def kelvin_voigt(e):
    decrement = -mp.log(e)
    return decrement / mp.sqrt(mp.pi**2 + decrement**2)


def kelvin_voigt_clamped(e):
    """ζ with ln e = -2ζ arccos(ζ)/√(1-ζ²)."""

    def miss(zeta):
        return mp.log(e) + 2 * zeta * mp.acos(zeta) / mp.sqrt(1 - zeta**2)

    return mp.re(mp.findroot(miss, mpf("0.3") if e > 0.3 else mpf("0.6")))


def thornton(e):
    h = "-6.918798 -16.41105 146.8049 -796.4559 2928.711 -7206.864 11494.29 -11342.18 6276.757"
    exponent = sum(mpf(x) * e ** (i + 1) for i, x in enumerate([*h.split(), "-1489.915"]))
    gamma = mp.sqrt(1 / (1 - (1 + e) ** 2 * mp.exp(exponent)) - 1)
    return gamma * mp.sqrt(mpf(6) / 5)


def jankowski(e):
    xi = 9 * mp.sqrt(5) / 2 * (1 - e**2) / (e * (e * (9 * mp.pi - 16) + 16))
    return 2 * xi / mp.sqrt(5)


def tsuji(e):
    a = "1.2728 -4.2783 11.087 -22.348 27.467 -18.022 4.8218".split()
    return mp.sqrt(2) * sum(mpf(x) * e**i for i, x in enumerate(a)) / mp.sqrt(5)


OSCILLATORS = {
    "kelvin_voigt": (jc.KelvinVoigt, {}, 1.0, kelvin_voigt, "tension"),
    "kelvin_voigt_clamped": (
        jc.KelvinVoigt,
        {"tension": False},
        1.0,
        kelvin_voigt_clamped,
        "clamped",
    ),
    "antypov_elliott": (jc.AntypovElliott, {}, 1.5, kelvin_voigt, "tension"),
    "tsuji": (jc.Tsuji, {}, 1.5, tsuji, "tension"),
    "thornton": (jc.Thornton, {}, 1.5, thornton, "clamped"),
    "jankowski": (jc.Jankowski, {}, 1.5, jankowski, "approach"),
}


@pytest.mark.parametrize("name", OSCILLATORS)
def test_oscillator_laws_in_si_units(name):
    law, options, n, ratio, ending = OSCILLATORS[name]
    asked = [0.2, 0.6, 0.9]
    with mp.workdps(50):
        solved = [oracle.oscillator(ratio(mpf(e)), n, ending) for e in asked]
    scaled = {f: np.array([float(getattr(s, f)) for s in solved]) for f in oracle.FIELDS}
    p = {k: x[:3] for k, x in POINTS.items()} | {"n": np.full(3, n)}
    contact = jc.Contact(jnp.asarray(p["m"]), jnp.asarray(p["K"]), n)
    hit = jc.impact(law(e=jnp.array(asked), **options), contact, jnp.asarray(p["v"]))
    assert_front_door(hit, in_si(scaled, p), p)
    if name.startswith(("kelvin_voigt", "antypov")):
        assert np.allclose(hit.restitution, asked, rtol=FORMULA, atol=0)
