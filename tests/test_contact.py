"""Materials and contacts: published numbers, limits, symmetries, derivatives, bad input."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact import Contact, Material

ROUNDING = 2e-15
"""Products and roots of a few numbers: measured 5e-16."""

FAR = 5e-14
"""Bodies 1e14 times larger, and a lane beside others: measured 5e-15."""

SECOND_ORDER = 1e-10
"""The share of (R1/R2)² with R1/R2 = 1e-5: 4e-11."""

TRACED = 5e-14
"""A traced exponent against a static one, two rules of quadrature: measured 4e-15."""

DIFFERENCE = 1e-14
"""Derivatives of the same: measured 1e-15."""


def agrees(found, printed):
    """Whether a number rounds to the printed one, give or take one in its last digit."""
    mantissa = printed.lower().split("e")[0]
    decimals = len(mantissa.partition(".")[2])
    scale = float(printed) / float(mantissa)
    return abs(float(found) - float(printed)) <= 1.0001 * scale * 10**-decimals


def test_agrees_can_fail():
    assert agrees(1.0723e10, "1.0723e10") and agrees(1.07239e10, "1.0723e10")
    assert not agrees(1.07246e10, "1.0723e10") and not agrees(615.37, "615.35")


STEEL = Material(youngs_modulus=207e9, poisson_ratio=0.3, density=7800.0)
GLASS = Material(youngs_modulus=48e9, poisson_ratio=0.2, density=2800.0)
ALUMINA = Material(youngs_modulus=380e9, poisson_ratio=0.23, density=4000.0)


def test_steel_spheres():
    contact = Contact.sphere_sphere(0.01, 0.01, STEEL, STEEL)
    assert agrees(contact.stiffness, "1.0723e10")
    # One sphere has 33 g, and the effective mass of two is half of it.
    assert agrees(STEEL.sphere_mass(0.01), "0.033")
    np.testing.assert_allclose(contact.mass, STEEL.sphere_mass(0.01) / 2, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("contact", "speed", "stiffness", "indentation", "force", "duration"),
    [
        (
            Contact.sphere_sphere(0.01, 0.01, GLASS, GLASS),
            20.0,
            "2.357023e9",
            "2.7411e-4",
            "1.06969e4",
            "4.0339e-5",
        ),
        (
            Contact.sphere_plane(0.0025, ALUMINA),
            3.9,
            "2.674832e10",
            "8.0888e-6",
            "615.35",
            "6.1045e-6",
        ),
    ],
    ids=["two glass spheres", "alumina sphere on a rigid plane"],
)
def test_chung_and_ooi(contact, speed, stiffness, indentation, force, duration):
    """Chung & Ooi 2011, Granular Matter 13:643, elastic benchmarks."""
    hit = jc.impact(jc.Hertz(), contact, speed)
    assert agrees(contact.stiffness, stiffness)
    assert agrees(hit.max_indentation, indentation)
    assert agrees(hit.max_force, force)
    assert agrees(hit.duration, duration)
    assert float(hit.restitution) == 1.0


def test_hertz():
    contact = Contact(mass=1.0, stiffness=1.4e8)
    hit = jc.impact(jc.Hertz(), contact, 4.2)
    assert agrees(hit.max_indentation, "1.9007e-3")
    assert agrees(hit.duration * 4.2 / hit.max_indentation, "2.9433")
    by_hand = (5 * 1.0 * 4.2**2 / (4 * 1.4e8)) ** 0.4
    np.testing.assert_allclose(hit.max_indentation, by_hand, rtol=ROUNDING)


# --- Geometry -------------------------------------------------------------------------------------


def test_socket_becomes_a_plane():
    plane = Contact.sphere_plane(0.01, STEEL, GLASS)
    wide = Contact.sphere_socket(0.01, jnp.array([1e3, 1e8, 1e14]), STEEL, GLASS)
    # K grows by the fraction R1/(2 R2).
    np.testing.assert_allclose(
        wide.stiffness / plane.stiffness - 1, [5e-6, 0, 0], atol=SECOND_ORDER
    )
    assert wide.stiffness[0] > plane.stiffness
    np.testing.assert_allclose(wide.mass, plane.mass, rtol=ROUNDING)
    big = Contact.sphere_sphere(0.01, 1e12, STEEL, GLASS)
    np.testing.assert_allclose(big.stiffness, plane.stiffness, rtol=FAR)
    np.testing.assert_allclose(big.mass, plane.mass, rtol=FAR)


def test_a_socket_is_a_sphere_of_negative_radius():
    socket = Contact.sphere_socket(0.01, 0.013, STEEL, GLASS)
    hollow = Contact.sphere_sphere(0.01, jnp.asarray(-0.013), STEEL, GLASS, mass=1.0)
    np.testing.assert_allclose(socket.stiffness, hollow.stiffness, rtol=ROUNDING)


def test_spheres_may_be_exchanged():
    one = Contact.sphere_sphere(0.01, 0.03, STEEL, GLASS)
    other = Contact.sphere_sphere(0.03, 0.01, GLASS, STEEL)
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=ROUNDING)
    np.testing.assert_allclose(one.mass, other.mass, rtol=ROUNDING)


def test_a_hard_plane_is_rigid():
    hard = Material(youngs_modulus=1e30, poisson_ratio=0.3)
    for make in (Contact.sphere_plane, lambda r, *m: Contact.sphere_socket(r, 0.02, *m)):
        np.testing.assert_allclose(
            make(0.01, STEEL, hard).stiffness, make(0.01, STEEL).stiffness, rtol=ROUNDING
        )
        # Two equal materials are half as stiff as one.
        np.testing.assert_allclose(
            2 * make(0.01, STEEL, STEEL).stiffness, make(0.01, STEEL).stiffness, rtol=ROUNDING
        )


# --- Derivatives ----------------------------------------------------------------------------------


def stiffness_and_mass(E, nu, R, E2, nu2, rho):
    contact = Contact.sphere_plane(R, Material(E, nu, rho), Material(E2, nu2))
    return jnp.stack([contact.stiffness, contact.mass])


def mp_stiffness_and_mass(E, nu, R, E2, nu2, rho):
    compliance = (1 - nu**2) / E + (1 - nu2**2) / E2
    return [mp.mpf(4) / 3 * mp.sqrt(R) / compliance, mp.mpf(4) / 3 * mp.pi * R**3 * rho]


def test_derivatives_by_material_and_radius():
    rows = np.array([[2e11, 0.3, 0.01, 7e10, 0.2, 7800.0], [1e6, 0.5, 0.1, 1e12, -0.9, 1000.0]])
    columns = jnp.asarray(rows.T)
    every = tuple(range(6))
    found, forward = jax.jit(
        lambda *x: [jax.vmap(f(stiffness_and_mass, every))(*x) for f in (jax.jacrev, jax.jacfwd)]
    )(*columns)
    with mp.workdps(50):
        for lane, row in enumerate(rows):
            point = [mp.mpf(x) for x in row]
            for i in range(6):
                h = point[i] * mp.mpf("1e-15")
                high, low = (
                    mp_stiffness_and_mass(*point[:i], point[i] + s * h, *point[i + 1 :])
                    for s in (1, -1)
                )
                expected = [float((a - b) / (2 * h)) for a, b in zip(high, low, strict=True)]
                np.testing.assert_allclose(found[i][lane], expected, rtol=DIFFERENCE)
                np.testing.assert_allclose(forward[i][lane], expected, rtol=DIFFERENCE)


# --- Bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Contact(1.0, -1.0), r"`stiffness` must be in \(0, inf\), but is -1.0"),
        (lambda: Contact(1.0, 1.0, 0.9), r"`exponent` must be in \[1, 3\], but is 0.9"),
        (lambda: Material(1.0, 0.51), r"`poisson_ratio` must be in \(-1, 0.5\], but is 0.51"),
        (lambda: Material(1.0, -1.0), r"`poisson_ratio` must be in \(-1, 0.5\], but is -1.0"),
        (
            lambda: Contact.sphere_socket(0.01, 0.009, STEEL),
            "`socket_radius` must be larger than `radius` = 0.01, but is 0.009",
        ),
        (lambda: Contact.sphere_socket(0.01, 0.01, STEEL), "`socket_radius` must be larger"),
    ],
)
def test_scalars_out_of_range(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_mass_needs_a_density():
    bare = Material(1e9, 0.3)
    for make in (
        lambda **m: Contact.sphere_plane(0.01, bare, STEEL, **m),
        lambda **m: Contact.sphere_sphere(0.01, 0.01, STEEL, bare, **m),
        lambda **m: Contact.sphere_socket(0.01, 0.02, bare, **m),
    ):
        with pytest.raises(ValueError, match=r"`density`.*or give `mass` to the contact"):
            make()
        assert float(make(mass=0.5).mass) == 0.5
    # The plane and the socket do not move.
    Contact.sphere_plane(0.01, STEEL, bare)
    Contact.sphere_socket(0.01, 0.02, STEEL, bare)


def test_bad_lanes():
    bad = int(jc.Status.INVALID_INPUT)
    law = jc.HuGuo(e=0.5)
    good = jc.impact(law, Contact(1.0, 1e8, 1.5), 1.0)
    K = jnp.array([1e8, -1.0, jnp.nan, 1e8, 1e8, 1e8])
    m = jnp.array([1.0, 1.0, 1.0, 0.0, jnp.inf, 1.0])
    n = jnp.array([1.5, 1.5, 1.5, 1.5, 1.5, 3.5])
    hit = jc.impact(law, Contact(m, K, n), 1.0)
    np.testing.assert_array_equal(hit.status, [0] + [bad] * 5)
    np.testing.assert_array_equal(np.isnan(hit.duration), [False] + [True] * 5)
    np.testing.assert_allclose(hit.duration[0], good.duration, rtol=FAR)
    R2 = jnp.array([0.02, 0.01, 0.005])
    socket = Contact.sphere_socket(0.01, R2, STEEL)
    np.testing.assert_array_equal(np.isnan(socket.stiffness), [False, True, True])
    lanes = jc.impact(law, socket, 1.0)
    np.testing.assert_array_equal(lanes.status, [0, bad, bad])
    slope = jax.grad(
        lambda R: jnp.nansum(jc.impact(law, Contact.sphere_socket(0.01, R, STEEL), 1.0).duration)
    )(R2)
    assert np.all(np.isfinite(slope))
    broken = Contact.sphere_plane(0.01, Material(jnp.array([1e9, -1e9]), 0.3, 1e3))
    np.testing.assert_array_equal(jc.impact(law, broken, 1.0).status, [0, bad])


# --- Leaves and statics ---------------------------------------------------------------------------


def test_static_and_traced_exponent():
    static, traced = Contact(1.0, 1e8, 2.0), Contact(1.0, 1e8, jnp.asarray(2.0))
    assert static.exponent == 2.0 and type(static.exponent) is float
    assert type(Contact(1.0, 1e8, 2).exponent) is float
    assert isinstance(traced.exponent, jax.Array)
    assert len(jax.tree.leaves(static)) == 2 and len(jax.tree.leaves(traced)) == 3
    law = jc.Damped(alpha=0.5)
    one, other = jc.impact(law, static, 1.0), jc.impact(law, traced, 1.0)
    np.testing.assert_allclose(one.duration, other.duration, rtol=TRACED)
    np.testing.assert_allclose(one.max_force, other.max_force, rtol=TRACED)


def test_pytree_and_jit():
    contact = Contact.sphere_plane(0.01, STEEL)
    leaves, structure = jax.tree.flatten(contact)
    again = jax.tree.unflatten(structure, leaves)
    assert again.exponent == 1.5 and repr(again) == repr(contact)
    seen = []

    @jax.jit
    def stiffer(contact):
        seen.append(contact.exponent)
        return Contact(contact.mass, 2 * contact.stiffness, contact.exponent)

    double = stiffer(contact)
    stiffer(again)
    assert seen == [1.5]  # compiled once
    np.testing.assert_array_equal(double.stiffness, 2 * contact.stiffness)
    stiffer(Contact(1.0, 1.0, 2.0))
    assert seen == [1.5, 2.0]
    batch = jax.vmap(lambda R: Contact.sphere_plane(R, STEEL))(jnp.array([0.01, 0.04]))
    np.testing.assert_allclose(batch.stiffness / contact.stiffness, [1, 2], rtol=ROUNDING)
    assert batch.exponent == 1.5


def test_materials_broadcast():
    many = Material(jnp.array([1e9, 2e9]), 0.3, 1000.0)
    contact = Contact.sphere_plane(jnp.array([[0.1], [0.2], [0.3]]), STEEL, mass=1.0)
    assert contact.stiffness.shape == (3, 1)
    assert Contact.sphere_plane(0.1, many).stiffness.shape == (2,)
    assert Contact.sphere_sphere(0.1, 0.2, many, STEEL).mass.shape == ()
    assert Material(1e9, 0.3).density is None


def test_single_precision():
    single = [jnp.asarray(x, jnp.float32) for x in (207e9, 0.3, 7800.0, 0.01)]
    contact = Contact.sphere_sphere(single[3], single[3], *[Material(*single[:3])] * 2)
    assert contact.stiffness.dtype == contact.mass.dtype == jnp.float32
    assert agrees(contact.stiffness, "1.0723e10")


def test_repr():
    assert repr(Contact(1.0, 1.4e8)) == "Contact(mass=1, stiffness=140000000, exponent=1.5)"
    assert "exponent=2" in repr(Contact(1.0, 1.4e8, jnp.asarray(2.0)))
