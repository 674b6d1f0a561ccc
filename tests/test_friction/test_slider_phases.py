"""The tangential part of an impact by phases: digits, an independent solve, and derivatives.

Spring-sliders by event solves and along a trajectory, beside their phases.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._forms import restitution_of
from jaxcontact._friction.phases import slider_phases
from tests.oracle.spring_and_slider import psi2 as by_scipy

FORMS = ("force", "displacement", "rescaled")
NU_3 = 49 / 34  # χ of like spheres with ν = .3
NU_0 = 7 / 4
TANGENT = (0.3, -0.7, 0.2)
LANES = 256  # more than one group; every call has this shape, so that a form compiles once

DIGITS = 2e-12  # worst of the eleven: 1.2e-12, by the steps of order 8
PRINTED = 6e-10  # the other forms are known to nine digits
BESIDE_SCIPY = 5e-11  # worst of 4,000 lanes a form beside SciPy: 7e-12
FORMULA = 1e-14  # formula of gross slip: rounding of numbers up to 12
# Differences of order 4 with steps of 1e-4: 2e-9 in 99 % of the lanes; in a lane that passes a
# transition within the steps, where the second derivative may be unbounded, 4e-5.
DIFFERENCES, NEAR_TRANSITION = 1e-8, 1e-4
ROOT = 1e-7  # slopes where the position of a transition is rounded
SINGLE = 1e-5  # worst of 60,000 lanes: 5e-6


@functools.cache
def program(form):
    """The outcome, the slopes of ψ2, and that along `TANGENT` in forward mode."""

    def psi2(*numbers):
        outcome = slider_phases(*numbers, form)
        return outcome.psi2, outcome

    def both(*numbers):
        value, along, outcome = jax.linearize(psi2, *numbers, has_aux=True)
        back = jax.linear_transpose(along, *numbers)
        ahead = along(*(jnp.full_like(x, t) for x, t in zip(numbers, TANGENT, strict=True)))
        return outcome, back(jnp.ones_like(value)), ahead

    return jax.jit(both)


restitution = jax.jit(restitution_of)


def filled(*numbers):
    """Return the numbers as arrays of LANES, and how many of them count."""
    numbers = np.broadcast_arrays(*numbers)
    return [jnp.asarray(np.resize(x, LANES).astype(float)) for x in numbers], numbers[0].size


def solve(form, *numbers):
    return slopes_of(form, *numbers)[0]


def slopes_of(form, *numbers):
    numbers, count = filled(*numbers)
    outcome, slopes, _ = program(form)(*numbers)
    return jax.tree.map(lambda x: np.asarray(x)[:count], (outcome, slopes))


def random_lanes(count, least_alpha=0.0):
    draw = np.random.default_rng(5).uniform
    return draw(0, 8, count), draw(0.5, 2.5, count), draw(least_alpha, 2, count)


PSI1 = [0.25, 0.5, 0.75, 1.25, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5]
PSI2 = """.201974558753141 .340631597348631 .408202256698953 .24500755462582 .00282342440602431
    -.480591960595263 -.879499471177825 -1.1696068083995 -1.33850106873717 -1.3654667034749
    -1.20326025112982"""
FORCE_FORM = dict(zip(PSI1, map(float, PSI2.split()), strict=True))
"""ψ2 of the force form by ψ1 at `NU_3`, of 15 digits by mpmath."""


def test_digits_of_the_force_form():
    got = solve("force", PSI1, NU_3, 0.0)
    assert got.converged.all()
    np.testing.assert_allclose(got.psi2, list(FORCE_FORM.values()), rtol=0, atol=DIGITS)


@pytest.mark.parametrize(
    ("form", "psi2"),
    [
        ("displacement", [0.472404429, -0.093488850, -0.840940825, -1.188865976, -1.072224015]),
        ("rescaled", [0.244388598, -0.017063591, -0.831940472, -1.188865976, -1.072224015]),
    ],
)
def test_digits_of_the_other_forms(form, psi2):
    got = solve(form, [0.5, 1.5, 2.5, 3.5, 4.5], NU_3, 0.0)
    np.testing.assert_allclose(got.psi2, psi2, rtol=0, atol=PRINTED)


@pytest.mark.parametrize("form", FORMS)
def test_agrees_with_an_independent_solve(form):
    psi1, chi, alpha = lanes = random_lanes(LANES)
    got = solve(form, *lanes)
    assert got.converged.all()
    expected = [by_scipy(*lane, form) for lane in np.transpose(lanes)[:40].tolist()]
    np.testing.assert_allclose(got.psi2[:40], expected, rtol=0, atol=BESIDE_SCIPY)
    # Friction neither exceeds its limit nor outlasts the contact.
    e = np.asarray(restitution(alpha))
    assert np.all(np.abs(got.psi2 - psi1) <= 2 * chi * (1 + e) + FORMULA)
    assert np.all((got.stop >= -e) & (got.stop <= 1) & (got.slip >= -e) & (got.slip <= 1))


@pytest.mark.parametrize("form", FORMS)
def test_gross_slip_is_the_rigid_formula(form):
    alpha = np.array([0.0, 0.3, 1.0, 2.0])
    e = np.asarray(restitution(alpha))
    got = solve(form, 12.0, 1.5, alpha)
    np.testing.assert_allclose(got.psi2, 12 - 3 * (1 + e), rtol=0, atol=FORMULA)
    np.testing.assert_array_equal(got.stop, -e)
    np.testing.assert_array_equal(got.slip, 1)


def test_sliding_stops_where_the_elastic_formula_says():
    psi1 = np.array([0.5, 1.0, 1.5, 2.5, 4.0])
    stop = np.where(psi1 < 1, 1, (2 * NU_3 - psi1) / (2 * NU_3 - 1))
    np.testing.assert_allclose(solve("force", psi1, NU_3, 0.0).stop, stop, rtol=0, atol=FORMULA)


@pytest.mark.parametrize("form", FORMS)
def test_derivatives_in_both_modes_agree_with_differences(form):
    lanes = random_lanes(64, least_alpha=0.01)
    _, slopes = slopes_of(form, *lanes)
    step = 1e-4
    for k, slope in enumerate(slopes):
        four = [
            solve(form, *(x + s * step * (i == k) for i, x in enumerate(lanes))).psi2
            for s in (-2, -1, 1, 2)
        ]
        difference = (four[0] - 8 * four[1] + 8 * four[2] - four[3]) / (12 * step)
        error = np.abs(slope - difference)
        assert np.mean(error > DIFFERENCES) <= 0.05
        assert error.max() < NEAR_TRANSITION
    # The other mode, along a direction.
    *_, forward = program(form)(*filled(*lanes)[0])
    both = sum(s * t for s, t in zip(slopes, TANGENT, strict=True))
    np.testing.assert_allclose(forward[:64], both, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("form", FORMS)
def test_derivatives_are_continuous_at_transitions(form):
    first, last = (2 / 3 if form == "displacement" else 1), (1 if form == "force" else 2 / 3)
    # ψ1 above which the contact slides at touch, with and without damping, and to the end; and by
    # how much a slope may change over a gap. Above the first, it changes like gap^0.4
    # or gap^0.5.
    for place, alpha, change in [
        (first, 0.0, lambda gap: 3 * gap**0.4),
        (2 * first, 1.0, lambda gap: 10 * gap),
        (4 * NU_3 - last, 0.0, lambda gap: 10 * gap),
    ]:
        gap = np.array([-1e-6, -1e-9, 0, 1e-9, 1e-6])
        _, slopes = slopes_of(form, place + gap, NU_3, alpha)
        for slope in slopes:
            assert np.all(np.abs(slope - slope[2]) <= change(np.abs(gap)) + ROOT)


@pytest.mark.parametrize("form", FORMS)
def test_no_tangential_motion(form):
    outcome, slopes = slopes_of(form, [0.0, 1e-9], NU_3, 0.0)
    assert outcome.psi2[0] == 0
    assert slopes[1][0] == slopes[2][0] == 0
    # The slip before separation contributes ψ1^(2/3).
    np.testing.assert_allclose(slopes[0][0], slopes[0][1], rtol=0, atol=2e-6)
    if form != "rescaled":
        ratio = np.cos(np.pi * np.sqrt(0.01 + 2.4 * NU_3)) / np.sin(3 * np.pi / 5)
        np.testing.assert_allclose(slopes[0][0], ratio, rtol=0, atol=1e-9)


def test_energy():
    """Known defect of two forms: a contact that hardly slips gains energy. Not so "rescaled"."""
    psi1 = np.geomspace(1e-5, 8, LANES)
    ratio = {form: np.abs(solve(form, psi1, NU_0, 0.0).psi2) / psi1 for form in FORMS}
    np.testing.assert_allclose([ratio["force"][0], ratio["displacement"][0]], 1.0376, atol=1e-4)
    # The displacement form gains most at ψ1 = 0.6, where it slips a little.
    assert 1.06 < ratio["displacement"].max() < 1.065
    assert ratio["force"].max() < 1.0376
    for chi in (0.5, 1.0, NU_0, 2.5):
        assert np.all(np.abs(solve("rescaled", psi1, chi, 0.0).psi2) <= psi1)


def test_single_precision():
    lanes, _ = filled(*random_lanes(LANES))
    double = solve("rescaled", *lanes).psi2
    narrow = (np.asarray(x, np.float32) for x in lanes)
    single = jax.jit(functools.partial(slider_phases, form="rescaled"))(*narrow)
    assert single.psi2.dtype == jnp.float32
    assert single.converged.all()
    np.testing.assert_allclose(single.psi2, double, rtol=0, atol=SINGLE)


# --- Followed in time -----------------------------------------------------------------------------

EVENT = 1e-9  # of ψ2; the default tolerance. Measured: 1e-11
EVENT_SLOPE = 1e-5  # Measured: 3e-6 beside the touch
SPRINGS = 6e-4  # by which a row of springs may exceed its limit, relative. Measured: 4.7e-4
PATH = 2e-5  # of the slip at touch, with 200 samples. Measured: 1.7e-5

RATIO, DRAW = 0.8, np.random.default_rng(5)
SLIPS = np.concatenate([[0.02, 0.3], DRAW.uniform(0, 7, 30)])
CONTACT = jc.Contact(mass=1.0, stiffness=1.0, exponent=1.5)


SLIDERS = {form: jc.SpringSlider(1.0, RATIO, form) for form in FORMS}
ROWS = SLIDERS | {"table": jc.MawBarberFawcett(1.0, RATIO)}
GIVEN = jc.Damped(alpha=0.3), CONTACT, 1.0, SLIPS


def hits(friction):
    return jax.tree.map(np.asarray, jc.oblique_impact(*GIVEN, friction=friction))


def test_event_solves_agree_with_phases():
    """With their slopes, also beside the slip from which an undamped contact slides at touch. Of
    the form "rescaled", which is "force" up to the turn and "displacement" after it.
    """

    def after(slip, alpha):
        given = jc.Damped(alpha), CONTACT, 1.0, slip
        hit = jc.oblique_impact(*given, friction=SLIDERS["rescaled"], method="event")
        return hit.slip_velocity, (hit.slip, hit.ok)

    near = (1 + np.array([-1e-7, 1e-7])) / RATIO
    slips, alpha = np.append(SLIPS, near), np.append(np.full(SLIPS.size, 0.3), [0.0, 0.0])
    program = jax.jit(jax.vmap(jax.value_and_grad(after, has_aux=True)))
    (found, (slip, ok)), slopes = jax.tree.map(np.asarray, program(slips, alpha))
    phase, (by_slip, *_) = slopes_of("rescaled", RATIO * slips, 3.5 * RATIO / 2, alpha)
    # Slips near full sliding end with both rates near zero, where an end may be missed.
    assert ok.all() and np.array_equal(slip[:-2], hits(SLIDERS["rescaled"]).slip)
    np.testing.assert_allclose(RATIO * found, phase.psi2, rtol=0, atol=EVENT)
    np.testing.assert_allclose(slopes, by_slip, rtol=0, atol=EVENT_SLOPE)


@pytest.mark.parametrize("name", ROWS)
def test_a_trajectory_ends_at_the_outcome(name):
    path = jax.tree.map(np.asarray, jc.oblique_trajectory(*GIVEN, friction=ROWS[name]))
    error = path.slip_velocity[:, -1] - hits(ROWS[name]).slip_velocity
    assert (np.abs(error) / np.maximum(SLIPS, 1)).max() < PATH
    over = SPRINGS if name == "table" else 1e-12
    assert (np.abs(path.friction) <= path.force * (1 + over)).all()


def test_any_normal_law_is_followed():
    # Beside a linear spring all forms are the same, and strong friction sticks but for the end.
    contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=1.0)
    hit = jc.oblique_impact(jc.Hertz(), contact, 1.0, 0.01, friction=jc.SpringSlider(50.0, 0.5))
    assert hit.method == "event" and hit.ok
    # u'' = -λ κ u during the half period π. The spring slips in the last 1e-4 of it.
    wanted = 0.01 * np.cos(np.sqrt(3.5 * 0.5) * np.pi)
    assert float(hit.slip_velocity) == pytest.approx(wanted, abs=1e-6)
