"""Materials and contacts: published numbers, limits, symmetries, derivatives, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxcontact as jc
from jaxcontact import Contact, Material

ROUNDING = 2e-15  # products and roots of a few numbers: measured 5e-16
FAR = 5e-14  # bodies 1e14 times larger, and a lane beside others: measured 5e-15
SECOND_ORDER = 1e-10  # the share of (R1/R2)² with R1/R2 = 1e-5: 4e-11
TRACED = 5e-14  # a traced exponent against a static one, two rules of quadrature: measured 4e-15
DIFFERENCE = 1e-14  # derivatives of the same: measured 1e-15


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


CHUNG_AND_OOI = {
    "two glass spheres": (
        Contact.sphere_sphere(0.01, 0.01, GLASS, GLASS),
        20.0,
        "2.357023e9 2.7411e-4 1.06969e4 4.0339e-5",
    ),
    "alumina sphere on a rigid plane": (
        Contact.sphere_plane(0.0025, ALUMINA),
        3.9,
        "2.674832e10 8.0888e-6 615.35 6.1045e-6",
    ),
}


@pytest.mark.parametrize("name", CHUNG_AND_OOI)
def test_chung_and_ooi(name):
    """Chung & Ooi 2011, Granular Matter 13:643, elastic benchmarks."""
    contact, speed, printed = CHUNG_AND_OOI[name]
    hit = jc.impact(jc.Hertz(), contact, speed)
    found = contact.stiffness, hit.max_indentation, hit.max_force, hit.duration
    assert all(map(agrees, found, printed.split()))
    assert float(hit.restitution) == 1.0


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


radius = st.floats(-4, 1).map(lambda x: 10**x)
modulus = st.floats(5, 12).map(lambda x: 10**x)


@given(
    r=st.tuples(radius, radius),
    E=st.tuples(modulus, modulus),
    nu=st.tuples(*[st.floats(-0.9, 0.5)] * 2),
)
@settings(max_examples=20)
def test_the_order_of_the_bodies_does_not_matter(r, E, nu):
    bodies = [Material(*one, 2000.0) for one in zip(E, nu, strict=True)]
    one = Contact.sphere_sphere(*r, *bodies)
    other = Contact.sphere_sphere(*r[::-1], *bodies[::-1])
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=1e-15)
    np.testing.assert_allclose(one.mass, other.mass, rtol=1e-15)


# --- Derivatives ----------------------------------------------------------------------------------


def stiffness_and_mass(E, nu, R, E2, nu2, rho):
    contact = Contact.sphere_plane(R, Material(E, nu, rho), Material(E2, nu2))
    return jnp.stack([contact.stiffness, contact.mass])


def test_derivatives_by_material_and_radius():
    columns = [[2e11, 1e6], [0.3, 0.5], [0.01, 0.1], [7e10, 1e12], [0.2, -0.9], [7800.0, 1000.0]]
    E, nu, R, E2, nu2, rho = columns = np.array(columns)
    every = tuple(range(6))
    found = jax.jit(
        lambda *x: [jax.vmap(f(stiffness_and_mass, every))(*x) for f in (jax.jacrev, jax.jacfwd)]
    )(*columns)
    compliance, zero = (1 - nu**2) / E + (1 - nu2**2) / E2, 0 * R
    by_sphere = [(1 - nu**2) / E**2, 2 * nu / E, compliance / (2 * R)]
    by_plane = [(1 - nu2**2) / E2**2, 2 * nu2 / E2, zero]
    of_stiffness = np.array(by_sphere + by_plane) * 4 / 3 * np.sqrt(R) / compliance**2
    of_mass = [zero, zero, 4 * np.pi * R**2 * rho, zero, zero, 4 / 3 * np.pi * R**3]
    expected = np.stack([of_stiffness, of_mass], axis=-1)
    for slopes in found:
        np.testing.assert_allclose(slopes, expected, rtol=DIFFERENCE)


# --- Bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Contact(1.0, 1.0, 0.9), r"`exponent` must be in \[1, 3\], but is 0.9"),
        (lambda: Material(1.0, 0.51), r"`poisson_ratio` must be in \(-1, 0.5\], but is 0.51"),
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
    R2 = jnp.array([0.02, 0.01, 0.005])
    socket = Contact.sphere_socket(0.01, R2, STEEL)
    np.testing.assert_array_equal(np.isnan(socket.stiffness), [False, True, True])
    lanes = jc.impact(law, socket, 1.0)
    np.testing.assert_array_equal(lanes.status, [0, bad, bad])
    slope = jax.grad(
        lambda R: jnp.nansum(jc.impact(law, Contact.sphere_socket(0.01, R, STEEL), 1.0).duration)
    )(R2)
    assert np.all(np.isfinite(slope))
    broken = Contact.sphere_plane(0.01, Material(jnp.array([1e9, -1e9, 1e9]), 0.3, 1e3))
    np.testing.assert_array_equal(jc.impact(law, broken, 1.0).status, [0, bad, 0])


# --- Leaves and statics ---------------------------------------------------------------------------


def test_static_and_traced_exponent():
    static, traced = Contact(1.0, 1e8, 2.0), Contact(1.0, 1e8, jnp.asarray(2.0))
    assert static.exponent == 2.0 and type(static.exponent) is float
    assert isinstance(traced.exponent, jax.Array)
    assert len(jax.tree.leaves(static)) == 2 and len(jax.tree.leaves(traced)) == 3
    law = jc.Damped(alpha=0.5)
    one, other = jc.impact(law, static, 1.0), jc.impact(law, traced, 1.0)
    np.testing.assert_allclose(one.duration, other.duration, rtol=TRACED)
    np.testing.assert_allclose(one.max_force, other.max_force, rtol=TRACED)


def test_a_tree_of_numbers():
    contact = Contact.sphere_plane(0.01, STEEL)
    leaves, structure = jax.tree.flatten(contact)
    again = jax.tree.unflatten(structure, leaves)
    assert again.exponent == 1.5 and repr(again) == repr(contact)
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
