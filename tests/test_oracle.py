"""The oracle against itself: each number by two methods, and published or analytic results.

All other tests rely on `tests/oracle/reference.json`. These tests verify that file.
"""

import dataclasses
import json

import pytest
from mpmath import mp, mpf

from tests import oracle
from tests.oracle.generate import jobs, row

# Two independent derivations agree to the digits left by two differentiations.
TWO_WAYS = mpf("1e-45")
# The stored digits: one unit of rounding in the last of thirty, and more in differences.
STORED_VALUE, STORED_SLOPE = mpf("1e-28"), mpf("1e-20")


def assert_close(left: oracle.Impact, right: oracle.Impact, tolerance: mpf) -> None:
    with mp.workdps(oracle.DIGITS + 10):
        for f in oracle.FIELDS:
            a, b = getattr(left, f), getattr(right, f)
            assert abs(a - b) <= tolerance * max(1, abs(b)), f


# --- Hunt and Crossley's family -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("alpha", "n"),
    [(alpha, "1.5") for alpha in ("-0.2", "0", "1e-8", "5")] + [("40", "1"), ("-0.2", "3")],
)
def test_energy_integral_and_equation_of_motion_agree(alpha, n):
    by_motion = oracle.hunt_crossley_by_motion(alpha, n)
    assert_close(by_motion, oracle.hunt_crossley(alpha, n), TWO_WAYS)


DURATIONS = {"0": 3.2180654597190431, "0.5": 3.3382527559374, "2": 3.7802580375305}
DURATIONS |= {"5": 4.7978629204156, "20": 9.2346448597224}


def test_durations_computed_elsewhere():
    found = {alpha: float(oracle.hunt_crossley(alpha, "1.5").duration) for alpha in DURATIONS}
    assert found == pytest.approx(DURATIONS, rel=2e-14)


def test_restitution_satisfies_its_equation():
    for alpha in ("1e-8", "0.3", "5"):
        e = oracle.hunt_crossley(alpha, "1.5").e
        with mp.workdps(oracle.DIGITS + 10):
            a = mpf(alpha)
            assert abs(a * (1 + e) - mp.log((1 + a) / (1 - a * e))) < TWO_WAYS
    # At alpha = 2e6 the first digit of 1 - alpha e comes after 870 000 zeros.
    with mp.workdps(oracle.DIGITS):
        assert abs(oracle.hunt_crossley("2e6", "1.5").e - mpf("5e-7")) < TWO_WAYS


# --- the oscillators ------------------------------------------------------------------------------


@pytest.mark.parametrize(("zeta", "n"), [("0.1", "1.5"), ("0.5", "1"), ("0.975", "1")])
def test_restitution_with_tension_is_the_linear_oscillators(zeta, n):
    impact = oracle.oscillator(zeta, n, "tension")
    with mp.workdps(oracle.DIGITS + 10):
        z = mpf(zeta)
        w = mp.sqrt(1 - z * z)
        assert abs(impact.e / mp.exp(-mp.pi * z / w) - 1) < TWO_WAYS
        if n == "1":
            assert abs(impact.duration - mp.pi / w) < TWO_WAYS * 100


@pytest.mark.parametrize("n", ["1", "1.5"])
@pytest.mark.parametrize("zeta", ["0.05", "0.7", "1", "1.001", "50"])
def test_restitution_without_tension_is_schwager_and_poeschels(zeta, n):
    impact = oracle.oscillator(zeta, n, "clamped")
    with mp.workdps(oracle.DIGITS + 20):
        z = mpf(zeta)
        w = mp.sqrt(abs(1 - z * z))
        if z < 1:
            expected = mp.exp(-z * mp.atan2(2 * z * w, 2 * z * z - 1) / w)
        else:
            expected = mp.exp(-2) if z == 1 else mp.power((z + w) / (z - w), -z / w)
        assert abs(impact.e / expected - 1) < TWO_WAYS


def test_damping_on_approach_only_gives_back_what_the_spring_took():
    for zeta in ("0.2", "1000"):
        impact = oracle.oscillator(zeta, "1.5", "approach")
        elastic = oracle.hunt_crossley("0", "1.5")
        with mp.workdps(oracle.DIGITS + 10):
            taken = mp.power(impact.max_indentation, mpf("2.5")) / mpf("2.5")
            assert abs(impact.e**2 / 2 / taken - 1) < TWO_WAYS
            # Elastic times scale as e**(-1/5).
            rebound = impact.duration - impact.compression_time
            assert abs(rebound * mp.power(impact.e, mpf("0.2")) / elastic.duration - 0.5) < TWO_WAYS


def test_an_overdamped_oscillator_has_no_end_in_tension():
    with pytest.raises(ValueError, match="overdamped"):
        oracle.oscillator("1", "1.5", "tension")


# --- Kuwabara and Kono; gravity -------------------------------------------------------------------


def test_viscoelastic_loss_starts_as_published():
    # 1 - e = C1 (3/2 a) - C2 (3/2 a)**2 + ..., C2 = 3/5 C1**2 (Schwager & Poeschel 1998).
    slope = oracle.derivative(oracle.kuwabara_kono, ("0", "1.5", True), 0)["e"]
    curvature = oracle.derivative(oracle.kuwabara_kono, ("0", "1.5", True), 0, 2)["e"]
    c1 = float(-slope / mpf("1.5"))
    assert c1 == pytest.approx(1.15344, abs=1e-5)
    assert float(curvature) / 2 / 1.5**2 == pytest.approx(0.6 * c1**2, rel=1e-14)


def test_the_clamp_of_a_weak_damper_is_not_stepped_over():
    # The force ends when x = -n a v, that is n a before the indentation does.
    free = oracle.kuwabara_kono("1e-9", "1.5", True)
    clamped = oracle.kuwabara_kono("1e-9", "1.5", False)
    assert float(free.duration - clamped.duration) == pytest.approx(1.5e-9, rel=1e-6)


def test_gravity_does_not_change_an_elastic_rebound():
    for gamma in ("0.5", "-0.05"):
        assert abs(oracle.with_gravity("0", "1.5", gamma).e - 1) < TWO_WAYS


def test_a_pushed_contact_may_settle():
    settled = oracle.with_gravity("2", "1.5", "0.5")
    assert settled.settled
    assert settled.e == 0
    assert not oracle.with_gravity("0.3", "1.5", "0.5").settled


@pytest.mark.parametrize(
    ("function", "args"),
    [
        (oracle.kuwabara_kono, ("5", "1.5", True)),
        (oracle.with_gravity, ("2", "1.5", "0.1")),
    ],
)
def test_series_do_not_depend_on_order_or_precision(function, args):
    assert_close(function(*args, order=45, bits=300), function(*args), TWO_WAYS)


# --- derivatives ----------------------------------------------------------------------------------


def test_a_kink_has_no_derivative():
    # The force of a Kelvin-Voigt contact peaks at touch from zeta = 1/2 on.
    slopes = oracle.derivative(oracle.oscillator, ("0.5", "1", "tension"), 0)
    assert slopes["max_force"] is None
    assert slopes["e"] is not None


def test_strings_are_decimals_and_floats_are_themselves():
    decimal, binary = oracle.hunt_crossley("0.3", "1.5").e, oracle.hunt_crossley(0.3, 1.5).e
    assert 0 < abs(decimal - binary) < 1e-16


# --- the stored file ------------------------------------------------------------------------------

STORED = json.loads(oracle.REFERENCE_FILE.read_text())


def test_the_file_holds_the_whole_grid_and_nothing_else():
    wanted: dict[str, list] = {}
    for job in jobs():
        wanted.setdefault(job.function, []).append(job.args)
    assert STORED["fields"] == list(oracle.FIELDS)
    assert {k: [r["args"] for r in rows] for k, rows in STORED["cases"].items()} == wanted


LIVE = {
    ("hunt_crossley", "0", "1.5"): 2, ("hunt_crossley", "1.6e6", "3"): 0,
    ("oscillator", ".95", "1.5", "tension"): 0, ("oscillator", ".999", "1", "clamped"): 1,
    ("oscillator", "0", "1.5", "approach"): 0, ("kuwabara_kono", "0", "1.5", False): 1,
    ("kuwabara_kono", "3", "1.5", True): 0, ("with_gravity", "2", "1.5", ".5"): 1,
}  # fmt: skip
"""Some of the grid: every function, and both ends of the parameter; with derivatives up to an order
where they cost little.
"""


@pytest.mark.parametrize("case", LIVE, ids=lambda case: "-".join(map(str, case)))
def test_stored_answers_are_what_the_oracle_says_today(case):
    (job,) = (job for job in jobs() if (job.function, *job.args.values()) == case)
    stored = next(r for r in STORED["cases"][job.function] if r["args"] == job.args)
    by = {"d": job.slopes[-1:] * (LIVE[case] > 0), "d2": job.curvatures * (LIVE[case] > 1)}
    fresh = row(dataclasses.replace(job, slopes=by["d"], curvatures=by["d2"]))

    def agree(a: list, b: list, tolerance: mpf) -> None:
        for x, y in zip(a, b, strict=True):
            assert (x is None) == (y is None)
            if x is not None:
                assert abs(mpf(x) - mpf(y)) <= tolerance * max(1, abs(mpf(y)))

    with mp.workdps(40):
        agree(stored["value"], fresh["value"], STORED_VALUE)
        for key, names in by.items():
            for name in names:
                agree(stored[key][name], fresh[key][name], STORED_SLOPE)
    assert stored.get("settled", False) == fresh.get("settled", False)
