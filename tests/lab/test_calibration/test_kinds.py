"""The curves e(v) of the kinds of laws, what they depend on, and plans of measurements."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.choice.kind import LogOutcomes
from jaxcontact.lab.choice.kinds import kinds_of, law_in

LITTLE = 1e-3
"""What a curve has instead of e = 0, where bodies stick: at a quarter of the energy it was 3e-4."""
SLOPE = 1e-6  # central differences with step 1e-5: measured 1e-9
SPEEDS = np.geomspace(0.05, 5.0, 40)
UNIT = jc.Contact(1.0, 1.0)
ANY_EXPONENT = ["exact", "constant_damping", "power_damping", "wet_restitution"]
ANY_EXPONENT += ["power_restitution"]
KINDS = {kind.law: kind for kind in kinds_of("all", 1.5)}
DASHPOTS = {law: kinds_of(law, 1.5)[1] for law in ("linear_dashpot", "step_damping")}
ALL = KINDS | DASHPOTS
# The kinks of a clamped force between steps: measured 7e-6.
STEPPED = 2e-5


@functools.partial(jax.jit, static_argnums=0)
def curves(kind, params):
    """e at SPEEDS for three rows of numbers, and its slope by the logarithm of all of a row."""
    model = LogOutcomes(kind, UNIT, jnp.asarray(1.5))

    def of(row):
        def shifted(shift):
            return jnp.exp(model({k: v * jnp.exp(shift) for k, v in row.items()}, SPEEDS))

        return jax.jvp(shifted, (jnp.zeros(()),), (jnp.ones(()),))

    return jax.vmap(of)(params)


def curve(kind, **params):
    """e at SPEEDS, by the one program of the kind."""
    return np.asarray(curves(kind, {k: np.full(3, float(v)) for k, v in params.items()})[0][0])


@functools.partial(jax.jit, static_argnums=0)
def e_of(kind, params, mass, stiffness, reference, speeds):
    return kind.restitution(params, jc.Contact(mass, stiffness), reference, speeds)


@pytest.mark.parametrize("kind", ALL.values(), ids=list(ALL))
def test_slope_and_start(kind):
    """No curve solves an equation of motion: an adaptive solve jumps by its tolerance, which stops
    a line search, and takes seconds.
    """
    start = kind.starts(0.88, UNIT, 1.5)[0]
    rows = {k: v * np.exp([-1e-5, 0.0, 1e-5]) for k, v in start.items()}
    (low, e, high), (_, slope, _) = map(np.asarray, curves(kind, rows))
    rtol = STEPPED if kind.law in DASHPOTS else SLOPE
    np.testing.assert_allclose(slope, (high - low) / 2e-5, rtol=rtol, atol=1e-9)
    # The start uses approximations and only has to be near.
    assert abs(float(np.interp(1.5, SPEEDS, e)) - 0.88) < 0.02
    model = LogOutcomes(kind, UNIT, jnp.asarray(1.5))
    assert "while" not in str(jax.make_jaxpr(model)(start, jnp.asarray(SPEEDS)))


def test_a_kind_contains_another_where_it_has_its_curves():
    pairs = {
        (wide.law, narrow.law)
        for wide in KINDS.values()
        for narrow in KINDS.values()
        if wide.contains(narrow)
    }
    assert pairs == {
        ("power_damping", "exact"), ("power_damping", "constant_damping"),
        ("viscoplastic", "constant_damping"), ("viscoplastic", "thornton_plastic"),
        ("wet_restitution", "exact"), ("power_restitution", "exact"),
    }  # fmt: skip
    e = curve(KINDS["exact"], e=0.7)
    alpha = float(jc.exact_damping_factor(0.7))
    c = {"c": alpha / 1.5, "power": -1.0}
    np.testing.assert_allclose(curve(KINDS["power_damping"], **c), e, rtol=1e-12)
    np.testing.assert_allclose(curve(KINDS["power_restitution"], loss=0.3, power=0.0), e)
    np.testing.assert_allclose(curve(KINDS["wet_restitution"], e=0.7, critical_speed=0.0), e)
    both = KINDS["viscoplastic"]
    never = curve(both, yield_speed=100.0, c=0.05)
    np.testing.assert_allclose(never, curve(KINDS["constant_damping"], c=0.05), rtol=1e-12)
    yields = curve(KINDS["thornton_plastic"], yield_speed=0.3)
    np.testing.assert_allclose(curve(both, yield_speed=0.3, c=0.0), yields, rtol=1e-7)


def test_a_loss_of_more_than_all_is_held_above_zero():
    e = curve(KINDS["power_restitution"], loss=0.9, power=1.0)
    assert e[-1] == pytest.approx(1e-6) and e[0] == pytest.approx(1 - 0.9 * SPEEDS[0] / 1.5)


def test_another_contact_moves_the_law_and_leaves_its_curve():
    """What a fit of contact times and forces relies on; e(v) depends on combinations alone."""
    hard, speeds = jc.Contact(0.3, 7e4), SPEEDS[::3]
    for name, kind in ALL.items():
        start = kind.starts(0.88, UNIT, 1.5)[0]
        moved = {name: float(value) for name, value in kind.moved(start, UNIT, hard).items()}
        assert kind.starts(0.88, hard, 1.5)[0] == pytest.approx(moved, rel=1e-14)
        law = law_in(kind.law_of(start, 1.5), UNIT, hard)
        e = np.asarray(jc.restitution(law, hard, speeds))
        found = np.asarray(e_of(kind, start, 1.0, 1.0, 1.5, speeds))
        np.testing.assert_allclose(e_of(kind, moved, 0.3, 7e4, 1.5, speeds), found, rtol=1e-12)
        rtol = STEPPED if name in DASHPOTS else 1e-12
        np.testing.assert_allclose(found[e > 0], e[e > 0], rtol=rtol)
        assert np.all((found[e == 0] > 0) & (found[e == 0] < LITTLE))


STICKING = {
    "wet_restitution": {"e": 0.9, "critical_speed": 1.0},
    "jkr": {"pull_off": float(1.0 / jc.JKR(pull_off=1.0).sticking_speed(UNIT)) ** 1.2},
}
"""Numbers with which bodies stick up to a speed of 1."""


@pytest.mark.parametrize("law", STICKING)
def test_a_search_comes_back_from_numbers_with_which_bodies_stick(law):
    """The measured bodies do not: logarithms, times and forces stay finite, and e has a slope."""
    kind, params = KINDS[law], STICKING[law]
    speeds = jnp.asarray([0.5, 0.99, 1.0, 1.01, 3.0])
    *_, last = params
    model = LogOutcomes(kind, UNIT, jnp.asarray(1.0))

    @jax.jit
    def both(value):
        one = (jnp.ones(()),)
        return jax.jvp(lambda x: model({**params, last: x}, speeds), (value,), one)

    log_e, slope = both(jnp.asarray(params[last]))
    assert np.all(np.diff(log_e) > 0) and np.all(slope < 0)
    hit = jax.jit(lambda v: kind.outcome(kind.law_of(params, 1.0), UNIT, v))(speeds)
    assert np.all(np.isfinite(hit.duration)) and np.all(np.isfinite(hit.max_force))


@pytest.mark.parametrize("yields", [0.2, 0.3, 1.0])
def test_yield_below_the_slowest_speed_is_found(yields):
    """A search from a yield speed above the data sees no plastic loss: it ended at constant c."""
    contact, speeds = jc.Contact(0.05, 1e6), np.linspace(0.5, 4, 12)
    e = jc.restitution(jc.Viscoplastic(yield_speed=yields, c=3e4), contact, speeds)
    choice = jc.choose_law(contact, speeds, e, laws="viscoplastic", mark_outliers=False)
    found = choice.fits["viscous and plastic"].params
    assert found["yield_speed"] == pytest.approx(yields, rel=1e-6)


SURFACES = {
    "bridges": {"a": 0.6, "power": 0.2},
    "viscoplastic": {"yield_speed": 0.2, "c": 0.05},
    "wet_restitution": {"e": 0.9, "critical_speed": 0.02},
    "jkr": {"pull_off": 0.01},
}


@pytest.mark.parametrize("law", SURFACES)
def test_metals_wet_and_adhesive_bodies_and_powers_are_found(law):
    """Their numbers from e without noise, in any contact, and not those of the others."""
    (constant, kind), params = kinds_of(law, 1.5), SURFACES[law]
    hard, v = jc.Contact(0.3, 7e4), np.geomspace(0.05, 5.0, 24)
    made = kind.law_of(kind.moved(params, UNIT, hard), 1.0)
    e = np.asarray(jc.restitution(made, hard, v))
    found = jc.choose_law(hard, v, e, laws=law)
    assert found.best == kind.name
    np.testing.assert_allclose(jc.restitution(found.law(), hard, v), e, rtol=1e-6)
    for name, value in vars(made).items():
        if name not in ("tension", "reference", "a"):  # a is e at the reference
            np.testing.assert_allclose(getattr(found.law(), name), value, rtol=1e-6)
    assert kind.contains(constant) == (law in ("wet_restitution", "bridges"))


def test_kinds_to_compare():
    def laws(*arguments):
        return [kind.law for kind in kinds_of(*arguments)]

    everything = ["constant_damping", "power_damping", "kuwabara_kono", "thornton_plastic"]
    everything += ["viscoplastic", "wet_restitution", "jkr", "power_restitution"]
    assert laws("all", 1.5) == ["exact", *everything]
    assert laws("all", 2.0) == laws("all", jnp.asarray(1.5)) == ANY_EXPONENT
    for law in [*everything, "bridges", *DASHPOTS]:
        assert laws(law, 1.5) == ["exact", law]
    assert laws("hu_guo", 1.5) == ["hu_guo", *everything]
    constant, *others = kinds_of("hu_guo", 1.5)
    wide = {kind.law for kind in others if kind.contains(constant)}
    assert wide == {"power_damping", "wet_restitution", "power_restitution"}
    assert laws("bridges", 2.0) == ["exact", "bridges"]
    refused = {"linear_dashpot": 1.0, "step_damping": 1.0, "nonsense": 1.5, "damped": 1.5}
    for bad, exponent in refused.items():
        with pytest.raises(ValueError, match=f"`laws` must be one of all, exact.*{bad}"):
            kinds_of(bad, exponent)


# Plans of measurements against enumeration and the equivalence theorem.

LAW = jc.ConstantDamping(c=2e7)
CONTACT = jc.Contact(mass=0.1, stiffness=1e8)
SIGMA = {"e": 0.01, "duration": 0.02}
PLACES = np.geomspace(0.05, 5, 6)
KNOWN = ("mass", "stiffness")


def planned(**how):
    return jc.design(LAW, CONTACT, **{"sigma": SIGMA, "candidates": PLACES, "readings": 4} | how)


DIFFERENCES = 1e-6  # relative: what central differences and the solve leave; 2e-8 was seen


@pytest.fixture(scope="module")
def all_plans():
    """The covariances of ln c and ln K by every plan of four readings."""

    def read(c, stiffness):
        with jax.enable_x64(True):
            contact = jc.Contact(mass=0.1, stiffness=1e8 * stiffness)
            hit = jc.impact(jc.ConstantDamping(c=2e7 * c), contact, PLACES)
            return np.concatenate([hit.restitution / 0.01, np.log(hit.duration) / 0.02])

    # d reading/d ln(parameter)/σ of e at all speeds, then of ln t_c: central differences.
    more, less = np.exp(1e-5), np.exp(-1e-5)
    differences = read(more, 1.0) - read(less, 1.0), read(1.0, more) - read(1.0, less)
    rows = np.stack(differences, axis=1) / 2e-5
    plans = np.array(list(itertools.combinations_with_replacement(range(12), 4)))
    information = np.einsum("pni,pnj->pij", rows[plans], rows[plans])
    good = np.linalg.det(information) > 1e-9 * np.linalg.det(information).max()
    return np.linalg.inv(information[good])


@pytest.mark.parametrize("goal", ["all", "law.c", "contact.stiffness"])
def test_the_plan_is_the_best_of_all_plans(all_plans, goal):
    names = ["law.c", "contact.stiffness"]
    wanted = names if goal == "all" else [goal]
    found = planned() if goal == "all" else planned(goal=goal)
    assert list(found.standard_errors) == names
    assert len(found.velocity) == len(found.quantity) == 4
    at = [names.index(name) for name in wanted]
    best = all_plans[np.argmin(np.linalg.det(all_plans[:, at][:, :, at]))]
    theirs = (np.sqrt(np.diag(best)) * [2e7, 1e8])[at]
    ours = [found.standard_errors[name] for name in wanted]
    assert ours == pytest.approx(theirs, rel=DIFFERENCES)
    if goal != "all":
        assert found.standard_errors[goal] < found.even[goal] and "spread evenly" in repr(found)


def test_two_laws_are_told_apart_where_they_differ_most():
    """Of a constant e: no reading is worse for it than those of the plan (equivalence)."""
    speeds = np.geomspace(0.05, 5, 25)
    constant = jc.ExactRestitution(e=0.8)
    found = planned(goal=constant, sigma={"e": 0.01}, candidates=speeds, readings=10)
    with jax.enable_x64(True):
        e = np.asarray(jc.restitution(LAW, CONTACT, speeds))
    # A constant lies halfway between the ends, and both are measured equally often.
    assert sorted(set(found.velocity)) == pytest.approx([0.05, 5.0])
    assert np.sum(found.velocity == 5) == 5
    half = (e.max() - e.min()) / 2 / 0.01
    assert found.noncentrality == pytest.approx(10 * half**2, rel=1e-6)
    assert found.readings_for(39.9 * half**2) == 40 and "distinguish the laws" in repr(found)
    assert found.readings_for(1e-6) == 2  # every point of the plan is needed


def test_a_law_that_contains_the_other_is_not_told_apart():
    power = jc.PowerDamping(c=1e7, power=0.2, reference=1.0)
    found = planned(goal=power, sigma={"e": 0.01}, fixed=(*KNOWN, "reference"))
    assert found.noncentrality == 0
    with pytest.raises(ValueError, match="No number of readings separates the laws"):
        found.readings_for()
    assert "read duration or max_force as well" in found.meaning
