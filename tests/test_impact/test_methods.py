"""The methods, their options, and one defined outside the package.

The event-terminated solve, for every form of force, against forty digits. The phase-angle method:
correct where it is not flagged.
"""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

import jaxcontact as jc
from jaxcontact._impact import method_of
from tests import oracle
from tests.oracle import FIELDS
from tests.oracle.stored import stored
from tests.test_impact.support import (
    DAMPING,
    UNIT,
    assert_within,
    column,
    errors_of,
    family,
    finite,
    given_ratio,
    grid,
    impacts,
    lanes,
    values,
)

NUMBERS = ("restitution", "duration", "compression_time", "max_indentation", "max_force")

# --- Event solves ---------------------------------------------------------------------------------

# At the default rtol of 1e-9; measured 2.1e-9 for the loss, 1.3e-9 for the rest. n = 1 has the
# largest errors, 1.3e-8 for the energy loss.
PROMISE = 1e-8
ALL = dict.fromkeys(FIELDS, PROMISE)
OTHER_EXPONENTS = ALL | {"energy_loss": 2 * PROMISE}
MOST_STEPS = 128
CREEPING_STEPS = 256  # overdamped contacts without tension: measured 218


def assert_solved(hit, some, tolerances, numbers):
    assert hit.method == "event"
    assert (hit.status == jc.Status.SEPARATED).all()
    assert_within(errors_of(hit, some), tolerances, numbers)


# Of Kvaerno5, whose interpolant of order 5 would require another safety factor: measured 1.1e-8.
# The momentum of strong damping is solved relative to its own size, at the cost of rejected
# implicit steps. 1024 steps are too few from α = 100 on; 1536 measured sufficient.
STIFF = 3e-8
SOLVERS = {
    "own": ({}, PROMISE, "the library's own loop with Dopri8's"),
    "other": ({"solver": diffrax.Tsit5()}, PROMISE, "diffrax.diffeqsolve with Tsit5"),
    "stiff": ({"solver": diffrax.Kvaerno5(), "max_steps": 2048}, STIFF, "diffrax.diffeqsolve"),
}


@pytest.mark.slow("stiff", reason="a solver of another order, whose programs are its own")
@pytest.mark.parametrize("name", SOLVERS)
def test_hunt_crossley_at_any_damping(name):
    options, tolerance, words = SOLVERS[name]
    some, alpha, law = family("hunt_crossley", n=1.5)
    hit = impacts(law(alpha), UNIT[1.5], method=jc.Event(**options))
    assert_solved(hit, some, dict.fromkeys(ALL, tolerance), alpha)
    assert repr(hit).startswith(f"Impact by method 'event', {words}")
    if name == "own":
        # The coordinates remove the stiffness: the steps hardly depend on α.
        assert hit.steps.max() <= MOST_STEPS
        assert 10 * hit.steps.max() <= 17 * hit.steps.min()
        # SI units change nothing but the units.
        length = (2.5e-4 * 0.031**2 / 3.7e9) ** 0.4
        in_si = impacts(law(alpha), jc.Contact(2.5e-4, 3.7e9), 0.031, method="event")
        np.testing.assert_allclose(in_si.restitution, values(some)["e"], rtol=PROMISE)
        duration = values(some)["duration"] * length / 0.031
        np.testing.assert_allclose(in_si.duration, duration, rtol=PROMISE)


# Exponents between these are those of the traced one, below.
FORCES = [
    *(("hunt_crossley", {"n": n}) for n in (1.0, 3.0)),
    *(("kuwabara_kono", {"tension": tension}) for tension in (True, False)),
    *(("oscillator", {"ending": end, "n": 1.5}) for end in ("tension", "clamped", "approach")),
    *(("oscillator", {"ending": end, "n": 1.0}) for end in ("tension", "clamped")),
]


@pytest.mark.parametrize(("kind", "fixed"), FORCES, ids=str)
def test_other_forces(kind, fixed):
    some, numbers, law = family(kind, **fixed)
    n = fixed.get("n", 1.5)
    if (kind, n) == ("oscillator", 1.0):
        some, numbers = [c for c in some if c.args["zeta"] < 1.4], numbers[numbers < 1.4]
    hit = impacts(law(numbers), jc.Contact(1.0, 1.0, n), method="event")
    tolerances = OTHER_EXPONENTS if kind == "hunt_crossley" else ALL
    assert_solved(hit, some, tolerances, numbers)
    # Overdamped contacts without tension end where forces cancel throughout restitution.
    moderate = numbers <= (1 if kind == "oscillator" else np.inf)
    assert hit.steps[moderate].max() <= MOST_STEPS and hit.steps.max() <= CREEPING_STEPS
    if hit.min_force is not None:
        exact = impacts(law(numbers), jc.Contact(1.0, 1.0, n), method="exact").min_force
        np.testing.assert_allclose(hit.min_force, exact, rtol=PROMISE, atol=1e-15)


UNKNOWN_FORCE = 3e-8  # for A = 5, where the force pulls back, e is 0.02: measured 1.4e-8 of that


class Viscoelastic(jc.AbstractLaw):
    """Kuwabara and Kono's force as a user would write it, unknown to the solver."""

    A: jnp.ndarray
    tension = True

    def force(self, indentation, velocity, contact, impact_velocity):
        root = jnp.sqrt(jnp.where(indentation > 0, indentation, 0))
        return contact.stiffness * (root * indentation + 1.5 * self.A * root * velocity)


def test_a_law_of_the_users():
    some, a, _ = family("kuwabara_kono", tension=True)
    hit = impacts(Viscoelastic(A=a), UNIT[1.5])
    assert_solved(hit, some, ALL | {"e": UNKNOWN_FORCE}, a)


def test_a_traced_exponent():
    some = [c for c in grid("hunt_crossley") if c.args["alpha"] in (0, 0.3, 20, 1e6)]
    alpha, n = column(some, "alpha"), column(some, "n")
    hit = impacts(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, n), method="event")
    assert_solved(hit, some, OTHER_EXPONENTS, alpha)


def test_a_weakly_damped_contact_pulls_just_before_its_end():
    """Its last step ends at x = 0 up to rounding, on either side."""
    law = jc.KuwabaraKono(A=np.array([1e-6, 1e-4, 1e-3]))
    exact, event = (impacts(law, UNIT[1.5], method=m).min_force for m in ("exact", "event"))
    np.testing.assert_allclose(event, exact, rtol=PROMISE)


# --- The phase angle ------------------------------------------------------------------------------

# Range in which every published law of the family has e ≥ 0.1, with n = 3/2; measured 4.6e-10. The
# force and the turn come from the same steps; measured 3.1e-10.
BY_PHASE = 1e-9
LARGEST_ALPHA = 14.4
ROUNDING = 1e-14  # below this the error and its estimate are rounding
MOST_CAUTIOUS = 1e5  # measured 190 to 14000 where the error is above 1e-11


def by_phase(**options):
    some, alpha, law = family("hunt_crossley", n=1.5)
    return impacts(law(alpha), UNIT[1.5], method=jc.Phase(**options)), some


def true_error(hit, some):
    error = errors_of(hit, some)
    return np.maximum(error["e"], error["duration"])


def assert_honest(hit, some):
    """Separated lanes: error ≤ estimate, and not a wild guess; the others: NaN and a flag."""
    good = hit.status == jc.Status.SEPARATED
    estimate, error = hit.error_estimate[good], true_error(hit, some)[good]
    assert (error <= np.maximum(estimate, ROUNDING)).all()
    assert (estimate <= MOST_CAUTIOUS * error)[error > 1e-11].all()
    assert (hit.status[~good] == jc.Status.NOT_CONVERGED).all()
    assert np.isnan(hit.restitution[~good]).all() and np.isnan(hit.duration[~good]).all()


def test_hunt_crossley_down_to_a_restitution_of_a_tenth():
    hit, some = by_phase()
    alpha = column(some, "alpha")
    right = alpha <= LARGEST_ALPHA
    assert (hit.status[right] == jc.Status.SEPARATED).all()
    error = {f: x[right] for f, x in errors_of(hit, some).items()}
    assert_within(error, dict.fromkeys(error.keys() - {"energy_loss"}, BY_PHASE), alpha[right])
    assert (hit.status[alpha >= 100] == jc.Status.NOT_CONVERGED).all()
    assert_honest(hit, some)
    assert hit.method == "phase" and (hit.steps == 32).all()


HONEST = [
    ("hunt_crossley", {}, 5.0, 100.0),
    # Flagged where the angle turns back.
    ("kuwabara_kono", {"tension": True}, 0.6, 1.5),
    *(("oscillator", {"ending": "tension", "n": n}, 0.1, np.inf) for n in (1.0, 1.5)),
    ("oscillator", {"ending": "approach", "n": 1.5}, 1.0, np.inf),
]


@pytest.mark.parametrize(("kind", "fixed", "converged", "flagged"), HONEST, ids=str)
def test_others_are_honest(kind, fixed, converged, flagged):
    """Also by an exponent that is traced."""
    some, numbers, law = family(kind, **fixed)
    n = column(some, "n") if not fixed else fixed.get("n", 1.5)
    if not fixed:
        some, numbers, n = [c for c in some if c.args["n"] < 3], numbers[n < 3], n[n < 3]
    hit = impacts(law(numbers), jc.Contact(1.0, 1.0, n), method="phase")
    assert_honest(hit, some)
    assert (hit.status[numbers <= converged] == jc.Status.SEPARATED).all()
    assert (hit.status[numbers >= flagged] == jc.Status.NOT_CONVERGED).all()


def test_fewer_steps_are_worse_and_know_it():
    coarse, some = by_phase(steps=16, tolerance=1e-3)
    assert_honest(coarse, some)
    fine, _ = by_phase()
    assert (true_error(coarse, some) > 10 * true_error(fine, some))[:8].all()
    # The tolerance decides what counts as converged.
    assert (coarse.status == np.where(coarse.error_estimate <= 1e-3, 0, 2)).all()
    assert 0 < (coarse.status == 0).sum() < coarse.status.size


# --- The loss of energy ---------------------------------------------------------------------------

# Relative to the loss itself: measured 4e-16 (closed form), 1e-9 (event) and 1e-11 (phase).
LOSS = {"exact": 1e-14, "event": 1e-8, "phase": 1e-8}
ALPHA = [1e-12, 1e-10, 1e-7, 1e-4, 1e-2, 0.3, 0.499, 0.501, 2.0, 14.0]


@stored()
def lost(alpha):
    """1 - e² to forty digits."""
    with mp.workdps(oracle.DIGITS):
        e = oracle.hunt_crossley(mpf(alpha), "1.5").e
        return float((1 - e) * (1 + e))


@pytest.mark.parametrize("method", LOSS)
def test_little_is_lost_to_many_digits(method):
    hit = impacts(jc.Damped(alpha=np.array(ALPHA)), UNIT[1.5], method=method)
    assert np.allclose(2 * hit.energy_loss, list(map(lost, ALPHA)), rtol=LOSS[method], atol=0)
    assert (hit.energy_loss > 0).all()


@pytest.mark.parametrize("ending", ["tension", "clamped", "approach"])
@pytest.mark.parametrize("method", ["exact", "event"])
def test_oscillators_lose_little_to_many_digits(method, ending):
    zeta = np.array([1e-12, 1e-8, 1e-4, 0.03])
    hit = impacts(given_ratio(zeta, ending), UNIT[1.5], method=method)
    with mp.workdps(oracle.DIGITS):
        pairs = [(x, mp.pi if ending == "tension" else mp.acos(x)) for x in map(mpf, zeta.tolist())]
        half = 4 if ending == "clamped" else 2
        want = [float(-mp.expm1(-half * x * a / mp.sqrt(1 - x * x))) for x, a in pairs]
    assert np.allclose(2 * hit.energy_loss, want, rtol=LOSS[method], atol=0)


# --- Properties for any damping: energy, order, units ---------------------------------------------

UNITS = 1e-12  # powers of numbers up to 1e±12: measured 2e-14
TINY = np.finfo(float).tiny  # what is smaller is flushed to zero
AGREE = 1e-8  # README's bound of event solves, which is ten times that of the phase method
ORDER = 2e-8  # two neighbours may err by AGREE in opposite directions

FAMILIES = {
    "hunt_crossley": (lambda x: jc.Damped(alpha=x), 1.5),
    "oscillator": (lambda x: given_ratio(x, "tension"), 1.5),
    "clamped oscillator": (lambda x: given_ratio(x, "clamped"), 1.5),
    "kuwabara_kono": (lambda x: jc.KuwabaraKono(A=x), 1.5),
}
ROUTES = [(family, method) for family in FAMILIES for method in ("auto", "event")]

SCALE = st.floats(-12, 12).map(lambda x: 10**x)


def solved(family, method, number, mass=1.0, stiffness=1.0, velocity=1.0):
    law_of, n = FAMILIES[family]
    contact = jc.Contact(mass, stiffness, n)
    return impacts(law_of(number), contact, velocity, method=method)


def parted(hit):
    return hit.status == jc.Status.SEPARATED


@pytest.mark.parametrize(("family", "method"), ROUTES)
@given(numbers=lanes(DAMPING))
@settings(max_examples=15)
def test_more_damping_never_gives_more_rebound(family, method, numbers):
    """Nor is energy gained: e ≤ 1, and what is lost is between none and all."""
    numbers = np.sort(numbers)
    if (family, method) == ("kuwabara_kono", "event"):
        # Stronger damping by event takes seconds: see test_rounding.
        numbers = np.minimum(numbers, 10)
    hit = solved(family, method, numbers)
    good = parted(hit)
    e, lost = hit.restitution[good], hit.energy_loss[good]
    assert np.all((e >= 0) & (e <= 1)) and np.all((lost >= 0) & (lost <= 0.5))
    assert np.all(np.diff(e) <= ORDER * e[1:])
    if (family, method) == ("hunt_crossley", "auto"):
        # The contact is shallower and lasts longer.
        assert np.all(np.diff(hit.max_indentation) <= 1e-13)
        assert np.all(np.diff(hit.duration) >= -1e-13 * hit.duration[1:])
        assert np.all(np.diff(hit.compression_time) <= 1e-13)
        assert (hit.max_force > 0).all() and (hit.compression_time < hit.duration).all()
    # Weakly damped lanes are never flagged.
    assert np.all(good[numbers < 0.1])


@given(numbers=lanes(DAMPING), m=lanes(SCALE), k=lanes(SCALE), v=lanes(SCALE))
@settings(max_examples=25)
def test_units_drop_out(numbers, m, k, v):
    """Over 24 orders of magnitude: α alone decides, and the rest scales."""
    v = np.maximum(v, 1e-6)
    hit = solved("hunt_crossley", "auto", numbers, m, k, v)
    unit = solved("hunt_crossley", "auto", numbers)
    length = (m / k) ** 0.4 * v**0.8
    np.testing.assert_array_equal(hit.restitution, unit.restitution)
    for name, scale in {
        "duration": length / v, "compression_time": length / v, "max_indentation": length,
        "max_force": k * length**1.5, "energy_loss": m * v**2, "rebound_velocity": v,
    }.items():  # fmt: skip
        expected = getattr(unit, name) * scale
        np.testing.assert_allclose(
            getattr(hit, name), expected, rtol=UNITS, atol=TINY, err_msg=name
        )
    # The elastic contact is the shortest: 3.218 of its units.
    assert np.all(unit.duration >= 3.218)


@given(numbers=lanes(st.floats(-6, 1.3).map(lambda x: 10**x)))
@settings(max_examples=25)
def test_the_methods_agree(numbers):
    """Down to e = 0.03; what the phase method does not reach, it flags."""
    exact, event, phase = (
        solved("hunt_crossley", how, numbers) for how in ("auto", "event", "phase")
    )
    assert exact.method == "exact" and parted(exact).all() and parted(event).all()
    for other in (event, phase):
        good = parted(other)
        for name in NUMBERS:
            found, expected = (getattr(hit, name)[good] for hit in (other, exact))
            np.testing.assert_allclose(found, expected, rtol=AGREE, err_msg=name)
    assert parted(phase)[exact.restitution > 0.1].all()


# --- Bad lanes -----------------------------------------------------------------------------------

METHODS = ["exact", "phase", "event"]
GOOD = {"alpha": 1.0, "K": 3e8, "m": 0.7, "v": 1.3}
BAD = [
    *({"v": x} for x in (0.0, -1.0, 1e-10, np.nan, np.inf)),
    *({"alpha": x} for x in (-0.2, -1e-9, np.nan, np.inf)),
    *({"K": x} for x in (0.0, -3e8, np.nan, np.inf)),
    *({"m": x} for x in (0.0, -0.7, np.nan, np.inf)),
]
BATCH = [GOOD, *(GOOD | bad for bad in BAD), GOOD | {"alpha": 0.2}]


def columns(rows):
    return {k: np.array([x[k] for x in rows]) for k in GOOD}


def solve(p, method, by=impacts):
    return by(jc.Damped(p["alpha"]), jc.Contact(p["m"], p["K"]), p["v"], method=method)


@pytest.mark.parametrize("method", METHODS)
def test_bad_lanes_are_flagged_and_their_neighbours_untouched(method):
    hit = solve(columns(BATCH), method)
    good = np.array([x in (BATCH[0], BATCH[-1]) for x in BATCH])
    assert (hit.status[good] == jc.Status.SEPARATED).all()
    assert (hit.status[~good] == jc.Status.INVALID_INPUT).all()
    for f in (*NUMBERS, "rebound_velocity", "energy_loss"):
        value = getattr(hit, f)
        assert np.isfinite(value[good]).all() and np.isnan(value[~good]).all(), f
    harmless = [x if ok else GOOD for x, ok in zip(BATCH, good, strict=True)]
    without = solve(columns(harmless), method)
    assert eqx.tree_equal(*(jax.tree.map(lambda x: x[good], x) for x in (hit, without)))


@pytest.mark.slow("event", "phase", reason="derivatives of solves in lanes that fail")
@pytest.mark.parametrize("method", METHODS)
def test_bad_lanes_spoil_no_derivative(method):
    """Neither that of their neighbours nor that of what all lanes share."""

    def total(shared, own, is_shared):
        p = {k: jnp.where(is_shared[k], shared[k], own[k]) for k in GOOD}
        hit = solve(p, method, by=jc.impact)
        good = hit.status == jc.Status.SEPARATED
        numbers = hit.restitution + 1e3 * hit.duration + 1e-5 * hit.max_force
        return jnp.sum(jnp.where(good, numbers, 0))

    gradient = jax.jit(jax.grad(total, argnums=(0, 1)))
    shared, own = jax.tree.map(jnp.asarray, GOOD), columns(BATCH)
    for varied in (("alpha", "v"), ("K", "m")):
        of_shared, of_own = gradient(shared, own, {k: k not in varied for k in GOOD})
        assert finite((of_shared, of_own))
        for k in GOOD:
            kept = of_own[k][jnp.array([0, -1])] if k in varied else of_shared[k]
            assert (kept != 0).all(), k


def test_lanes_that_did_not_converge_spoil_no_derivative():
    def total(p):
        law = jc.Damped(alpha=jnp.array([0.5, 1e6]))
        hit = jc.impact(law, jc.Contact(p["m"], p["K"]), p["v"], method="phase")
        return hit.duration[0] + 0 * jnp.sum(jnp.nan_to_num(hit.duration))

    assert finite(jax.jit(jax.grad(total))({k: GOOD[k] for k in "Kmv"}))


# --- Method objects -------------------------------------------------------------------------------

CONTACT = jc.Contact(0.7, 3e8)
LAW = jc.Damped(alpha=1.0)


@pytest.mark.parametrize("name", ["exact", "phase", "event"])
def test_a_name_is_short_for_the_object(name):
    objects = {"exact": jc.Exact(), "phase": jc.Phase(steps=32), "event": jc.Event(max_steps=256)}
    assert method_of(name) == objects[name] == method_of(objects[name])
    assert impacts(LAW, CONTACT, 1.3, method=objects[name]).method == name


class Static(eqx.Module):
    """A method as a choice, and one as a part of a tree."""

    choice: jc.AbstractMethod = eqx.field(static=True)
    part: jc.AbstractMethod


def test_methods_are_static_fields_and_parts_of_trees():
    traces = []

    @eqx.filter_jit
    def solve(how, event, alpha):
        traces.append(event.choice.rtol + event.part.rtol)
        law = jc.Damped(alpha=alpha)
        return [jc.impact(law, CONTACT, 1.3, method=m).duration for m in (how.choice, how.part)]

    def make():
        event = jc.Event(rtol=1e-6, solver=diffrax.Tsit5())
        return Static(jc.Phase(16), jc.Exact()), Static(event, event)

    by_phase, by_formula = solve(*make(), jnp.asarray(0.5))
    solve(*make(), jnp.asarray(0.7))
    assert traces == [2e-6]
    assert {jc.Event(rtol=1e-6), jc.Event(rtol=np.float64(1e-6))} == {jc.Event(rtol=1e-6)}
    assert jc.Event(rtol=1e-6) != jc.Event(rtol=1e-7)
    assert repr(jc.Event()) == "Event() by the library's own loop with Dopri8's coefficients"
    assert repr(make()[1].choice).endswith("solver=Tsit5()) by diffrax.diffeqsolve with Tsit5")
    by_adjoint = jc.Event(adjoint=diffrax.ForwardMode())
    assert by_adjoint.solved_by == "diffrax.diffeqsolve with Dopri8"
    exact = impacts(jc.Damped(alpha=0.5), CONTACT, 1.3).duration
    np.testing.assert_allclose([by_phase, by_formula], exact, rtol=1e-6)
    plain = jax.jit(lambda how: jc.impact(LAW, CONTACT, 1.3, method=how).restitution)(jc.Exact())
    # Two programs, which may differ by one rounding.
    np.testing.assert_allclose(plain, jc.restitution(LAW), rtol=3e-16)


class Classical(jc.AbstractMethod):
    """Steps of equal time, each at its last speed, written by a user."""

    step: float = eqx.field(static=True)
    name: ClassVar[str] = "classical"

    def chosen(self, form, pushed):
        return self

    def solve(self, lanes):
        alpha, n = lanes.form.alpha, lanes.n
        push = 0.0 if lanes.push is None else lanes.push
        h, yes = self.step, jnp.asarray(True)

        def advance(state, _):
            x, v = state
            rate = push - lanes.form.force(jnp.maximum(x, 0), v, n, yes)
            return (x + h * (v + h * rate), v + h * rate), (x, v, rate)

        touch = jnp.zeros_like(alpha), jnp.ones_like(alpha)
        x, v, rates = jax.lax.scan(advance, touch, length=int(6 / h))[1]
        inside = jax.lax.cummin((x >= 0).astype(int), axis=0) == 1
        last = jnp.sum(inside, axis=0) - 1
        x_last, v_last = (jnp.take_along_axis(y, last[None], 0)[0] for y in (x, v))
        force = jnp.where(inside, push - rates, 0)
        return jc.ScaledImpact(
            restitution=-v_last,
            duration=h * last.astype(x.dtype) - x_last / v_last,
            compression_time=h * jnp.sum((v > 0) & inside, axis=0, dtype=x.dtype),
            max_indentation=jnp.max(x, axis=0),
            max_force=jnp.max(force, axis=0),
        )


CRUDE = 3e-3  # of steps of the first order and ends within one of them


@pytest.mark.parametrize("force", [None, 100.0])
def test_a_method_of_the_users(force):
    law, how = jc.Damped(alpha=np.array([1.5, 0.6, 0.2])), Classical(step=2.5e-4)
    hit = jc.impact(law, CONTACT, 1.3, method=how, external_force=force)
    known = impacts(law, CONTACT, 1.3, external_force=force)
    assert hit.method == "classical" and known.method != "classical"
    for name in NUMBERS:
        np.testing.assert_allclose(getattr(hit, name), getattr(known, name), rtol=CRUDE)
    if force is None:
        e = jc.restitution(law, CONTACT, 1.3, method=how)
        np.testing.assert_array_equal(e, hit.restitution)
        run = jc.bounce(law, CONTACT, 0.1, method=how, bounces=2)
        np.testing.assert_allclose(run.restitution[:, 0], hit.restitution, rtol=CRUDE)
