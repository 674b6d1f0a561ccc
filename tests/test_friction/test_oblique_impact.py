"""Oblique impacts: published digits, conservation, edges, and derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.oracle.stored import stored
from tests.test_impact.support import slopes_of_lanes

ROUNDING = 1e-13  # relative; formulas of a few operations

PRINTED = 3e-8
"""Relative; half of the last digit printed for Chung & Ooi's test 4, whose spins have eight."""

ALUMINA = jc.Material(youngs_modulus=380e9, poisson_ratio=0.23, density=4000.0)
RADIUS, MU = 2.5e-3, 0.092
ON_PLANE = jc.Contact.sphere_plane(RADIUS, ALUMINA)
BALL = jc.RoundBodies(RADIUS)
LAW = jc.ExactRestitution(e=0.98)


def four(friction, slips, speed=2.0):
    """Four impacts, so that tests share the program of a law."""
    speed, slips = (np.broadcast_to(np.asarray(x, float), 4) for x in (speed, slips))
    hit = jc.oblique_impact(LAW, ON_PLANE, speed, slips, friction=friction, bodies=BALL)
    return jax.tree.map(np.asarray, hit)


def at_angle(degrees, friction):
    """Test 4 of Chung & Ooi (2011): v_t'/v_t and the spin."""
    normal, along = 3.9 * np.cos(np.radians(degrees)), 3.9 * np.sin(np.radians(degrees))
    hit = four(friction, along, normal)
    return hit.tangential_velocity[0] / along, hit.spin[0][0]


def test_the_published_row_at_sixty_degrees():
    # Every law slides throughout there.
    for friction in (jc.RigidCoulomb(MU), jc.WaltonFriction(MU, 0.4), jc.MawBarberFawcett(MU)):
        ratio, spin = at_angle(60.0, friction)
        assert ratio == pytest.approx(0.89482987, rel=PRINTED)
        assert spin == pytest.approx(-355.21200, rel=PRINTED)


@pytest.mark.parametrize(
    ("friction", "ratio", "spin", "within"),
    [
        (jc.SpringSlider(MU, form="displacement"), 0.69797188, -204.54187, PRINTED),
        (jc.SpringSlider(MU, form="force"), 0.71353918, -193.99926, PRINTED),
        # Six digits are printed, and the error of the table at this e is 2e-6.
        (jc.MawBarberFawcett(MU), 0.638147, -245.0567, 3.1e-6),
    ],
    ids=["displacement", "force", "row of springs"],
)
def test_the_published_row_at_ten_degrees(friction, ratio, spin, within):
    found = at_angle(10.0, friction)
    np.testing.assert_allclose(found, [ratio, spin], rtol=within)


def test_like_solid_spheres_have_the_textbook_numbers():
    steel = jc.Material(207e9, 0.3, 7800.0)
    contact = jc.Contact.sphere_sphere(0.01, 0.02, steel, steel)
    # Johnson (1985), section 7.3: 2 (1-ν)/(2-ν).
    assert contact.tangential_ratio == pytest.approx(2 * 0.7 / 1.7, rel=1e-6)
    masses = [steel.sphere_mass(r) for r in (0.01, 0.02)]
    pair = jc.RoundBodies(0.01, 0.02, mass=masses[0], other_mass=masses[1])
    assert pair.mobility(contact.mass) == pytest.approx(3.5, rel=1e-6)
    for shape, mobility in {"sphere": 3.5, "shell": 2.5, "disc": 3.0}.items():
        assert jc.RoundBodies(0.01, shape=shape).mobility(jnp.asarray(2.0)) == pytest.approx(
            mobility, rel=1e-6
        )


def laws_of_friction(mu=0.2):
    return {
        "rigid": jc.RigidCoulomb(mu), "walton": jc.WaltonFriction(mu, 0.4),
        "ramp": jc.RegularizedCoulomb(mu, 0.05), "table": jc.MawBarberFawcett(mu),
        "slider": jc.SpringSlider(mu),
    }  # fmt: skip


@functools.cache
def pairs(name):
    """Free impacts of pairs by their numbers and a factor of the friction law, from one program.

    Of 1000 random ones, and of one beside which each number is moved up and down.
    """
    draw = np.random.default_rng(3)
    random = np.column_stack(
        [draw.uniform(0.5, 2, (1000, 4)), draw.uniform(0.2, 3, 1000), draw.normal(0, 2, (1000, 3))]
    )
    place = np.array([1.0, 1.5, 1.0, 2.0, 2.0, 0.6, 0.5, -0.3, 1.0])
    steps = 1e-5 * np.diag(place)
    random = np.column_stack([random, np.ones(1000)])
    lanes = np.vstack([random, place + steps, place - steps, place, place])

    def outcome(numbers):
        r1, r2, m1, m2, v, vt, w1, w2, factor = numbers
        mass = m1 * m2 / (m1 + m2)
        contact = jc.Contact(mass=mass, stiffness=1e9, exponent=1.5, tangential_ratio=0.8)
        friction = jax.tree.map(lambda leaf: leaf * factor, laws_of_friction()[name])
        bodies = jc.RoundBodies(r1, r2, mass=m1, other_mass=m2)
        law, how = jc.ExactRestitution(e=0.8), {"friction": friction, "bodies": bodies}
        hit = jc.oblique_impact(law, contact, v, vt, spin=(w1, w2), **how)
        found = [hit.tangential_velocity, *hit.spin, hit.sliding_loss, hit.slip_velocity]
        return jnp.where(hit.ok, jnp.stack(found), jnp.nan)

    solve = slopes_of_lanes(outcome)
    # A thousand lanes have a form of their own, whose slopes take longer to compile.
    halves = [solve(half) for half in np.split(lanes, 2)]
    return lanes, *map(np.concatenate, zip(*halves, strict=True))


@pytest.mark.parametrize("name", laws_of_friction())
def test_free_pairs_keep_angular_momentum_and_energy(name):
    lanes, after, *_ = (np.transpose(x) for x in pairs(name)[:2])
    r1, r2, m1, m2, _, vt, w1, w2, _ = lanes
    mass, inertias = m1 * m2 / (m1 + m2), (0.4 * m1 * r1**2, 0.4 * m2 * r2**2)

    def spin_momentum(vt, w1, w2):
        # About the centre of mass; each body is its radius from the contact point.
        return inertias[0] * w1 + inertias[1] * w2 - mass * (r1 + r2) * vt

    def kinetic(vt, w1, w2):
        return (mass * vt**2 + inertias[0] * w1**2 + inertias[1] * w2**2) / 2

    loss, slip = after[3:]
    within = ROUNDING * 10 * np.abs(lanes).max() ** 3
    assert np.abs(spin_momentum(*after[:3]) - spin_momentum(vt, w1, w2)).max() < within
    assert np.abs(kinetic(*after[:3]) + loss - kinetic(vt, w1, w2)).max() < within
    assert np.abs(slip - (after[0] + r1 * after[1] + r2 * after[2])).max() < within
    if name != "slider":  # the "force" form may create energy, as its page says
        assert loss.min() > -within


@pytest.mark.parametrize("name", laws_of_friction())
def test_derivatives_agree_with_differences(name):
    lanes, values, forward, reverse = pairs(name)
    assert forward[-1] == pytest.approx(reverse[-1], rel=1e-9, abs=1e-12)
    high, low = values[1000:1009], values[1009:1018]
    by_differences = (high - low) / (2e-5 * lanes[-1])[:, None]
    # Central differences of this step are good to 1e-8 of curvature and rounding.
    assert pytest.approx(by_differences, rel=1e-6, abs=1e-6) == forward[-1].T


def test_outcomes_are_odd_in_the_slip():
    for friction in laws_of_friction().values():
        there, back = (four(friction, s * np.array([0.1, 0.7, 0.3, 3.0])) for s in (1, -1))
        assert np.array_equal(there.tangential_velocity, -back.tangential_velocity)
        assert np.array_equal(there.slip, back.slip)


def test_without_friction_nothing_happens_to_the_slip():
    slips = np.array([1.0, 0.0, -0.3, 20.0])
    for friction in laws_of_friction(0.0).values():
        hit = four(friction, slips)
        assert np.array_equal(hit.tangential_velocity, slips) and hit.ok.all()


@stored()
def along_the_ramp(slip, mu, ramp, alpha):
    """The slip velocity after an impact in scaled units, by integration."""

    def rate(t, y):
        force = max(y[0], 0) ** 1.5 * (1 + alpha * y[1])
        return [y[1], -force, -3.5 * mu * force * min(y[2] / ramp, 1)]

    def leaves(t, y):
        return y[0] + 1e-14 * (t < 1)

    leaves.terminal, leaves.direction = True, -1
    end = solve_ivp(rate, (0, 9), [0, 1, slip], events=leaves, rtol=1e-11, atol=1e-12)
    return end.y[2, -1]


def test_the_ramp_equals_an_integration():
    contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=1.5)
    given = jc.Damped(alpha=0.4), contact, 1.0, np.array([0.05, 0.4, 1.5, 4.0])
    hit = jc.oblique_impact(*given, friction=jc.RegularizedCoulomb(0.3, 0.2))
    expected = [along_the_ramp(slip, 0.3, 0.2, 0.4) for slip in given[-1].tolist()]
    # The kink of the ramp costs the integration some digits.
    np.testing.assert_allclose(hit.slip_velocity, expected, rtol=0, atol=1e-8)


def test_the_margin_tells_where_the_slope_jumps():
    mu, e, v = 0.2, jc.restitution(LAW), 2.0
    jump = 3.5 * mu * (1 + e) * v
    sides = jump * np.array([0.9, 1.1, 0.9, 1.1])
    rigid = four(jc.RigidCoulomb(mu), sides, v)
    assert rigid.margin[0] == pytest.approx(0.1, rel=1e-6)
    assert rigid.slip.tolist() == [jc.Slip.STUCK, jc.Slip.SLID] * 2
    back = four(jc.WaltonFriction(mu, 0.25), sides / 1.25, v)
    assert back.margin[0] == pytest.approx(0.1, rel=1e-6) and back.slip[0] == jc.Slip.REVERSED
    assert four(laws_of_friction()["table"], sides).margin is None


def test_phases_last_as_long_as_the_contact():
    for friction in (jc.RigidCoulomb(0.2), jc.SpringSlider(0.2)):
        hit = four(friction, [0.1, 0.5, 1.0, 3.0], 1.0)
        total = hit.sliding_time + hit.sticking_time + hit.final_sliding_time
        lasts = np.broadcast_to(hit.normal.duration, total.shape)
        assert total == pytest.approx(lasts, rel=1e-9)
    assert float(hit.sliding_time[-1]) == pytest.approx(float(lasts[-1]), rel=1e-9)


def test_a_bad_lane_leaves_its_neighbours_alone():
    for friction in laws_of_friction().values():
        hit = four(friction, [1.0, np.nan, 1.0, np.inf], [2.0, 2, -1, 2])
        assert hit.ok.tolist() == [True, False, False, False]
        # Among lanes that are well.
        well = four(friction, 1.0).tangential_velocity[0]
        assert hit.tangential_velocity[0] == pytest.approx(well, rel=1e-12)
        assert np.isnan(hit.tangential_velocity[1:]).all()


def test_float32_is_close_to_float64():
    for friction in laws_of_friction().values():
        slips = np.array([0.3, 1.0, 0.1, 3.0])
        double = four(friction, slips)
        law, contact, friction, speed, slips = jax.tree.map(
            lambda x: jnp.asarray(x, "float32"), (LAW, ON_PLANE, friction, 2 * np.ones(4), slips)
        )
        hit = jc.oblique_impact(law, contact, speed, slips, friction=friction)
        assert hit.tangential_velocity.dtype == jnp.float32
        # Some rounding of float32, amplified by the factors of the curve.
        found, wanted = np.asarray(hit.tangential_velocity), double.tangential_velocity
        assert found == pytest.approx(wanted, rel=2e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spin": (1.0, 0.0)}, "`spin` must be 0 for ω1 without `bodies`"),
        ({"spin": (0.0, 1.0), "bodies": BALL}, "`spin` must be 0 for ω2 without `other_radius`"),
        ({"bodies": jc.RoundBodies(0.01, mass=1.0)}, "must have the effective mass"),
        ({"bodies": jc.RoundBodies(0.01, 0.01)}, "`mass` or `inertia`"),
        ({"contact": jc.Contact(1.0, 1e9), "friction": jc.SpringSlider(0.1)}, "`ratio`"),
        ({"law": jc.Tsuji(e=0.8), "friction": jc.MawBarberFawcett(0.1, 0.8)}, "its table|table is"),
    ],
)
def test_bad_input_is_named(change, message):
    given = {"law": LAW, "contact": ON_PLANE, "velocity": 1.0, "tangential_velocity": 1.0}
    given |= {"friction": jc.RigidCoulomb(0.1)} | change
    with pytest.raises(ValueError, match=message):
        jc.oblique_impact(**given)


def test_a_second_mass_without_a_second_radius_is_refused():
    with pytest.raises(ValueError, match="Argument"):
        jc.RoundBodies(0.01, other_mass=1.0)


@pytest.mark.parametrize(
    ("ratio", "alpha", "chi"),
    [
        # Between the ranges with and without damping, below both, and too strongly damped.
        (1.02, 0.15, "1.785"),
        (0.4, 0.0, "0.7"),
        (0.8, 1.47, "1.4"),
    ],
)
def test_an_impact_outside_of_the_table_is_told_with_its_numbers(ratio, alpha, chi):
    contact = jc.Contact(mass=0.05, stiffness=1e7, exponent=1.5)
    law, friction = jc.Damped(alpha=alpha), jc.MawBarberFawcett(0.2, ratio)
    words = (
        f"INVALID_INPUT. The table of `MawBarberFawcett` does not cover χ = λκ/2 = {chi} with "
        f"α = {alpha:g}. It covers χ from 0.8 to 1.8 for α = 0, and from 1 to 1.75 for α up to "
        "1.433"
    )
    with pytest.raises(jc.NumericalError) as error:
        jc.oblique_impact(law, contact, 2.0, 0.5, friction=friction)
    assert words in str(error.value) and "`SpringSlider`" in str(error.value)
    flagged = jc.oblique_impact(law, contact, 2.0, 0.5, friction=friction, throw=False)
    assert flagged.status == int(jc.Status.INVALID_INPUT)
    # Full sliding is known for every χ, and a batch is flagged lane by lane.
    both = jc.oblique_impact(law, contact, 2.0, np.array([0.5, 50.0]), friction=friction)
    assert both.ok.tolist() == [False, True]


def test_other_failures_keep_their_words():
    contact = jc.Contact(mass=0.05, stiffness=1e7, exponent=1.5)
    friction = jc.MawBarberFawcett(jnp.asarray(-1.0), 0.1)
    with pytest.raises(jc.NumericalError, match="A parameter is out of its range"):
        jc.oblique_impact(jc.Damped(alpha=0.0), contact, 2.0, 0.5, friction=friction)
