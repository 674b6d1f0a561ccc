"""Properties of every law for any damping and push: energy, order, units.

Each family of forces has one program of a fixed number of lanes, which hypothesis fills.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxcontact as jc
from tests.test_impact.support import LANES, given_ratio, impacts

UNITS = 1e-12  # powers of numbers up to 1e±12: measured 2e-14
TINY = np.finfo(float).tiny  # what is smaller is flushed to zero
AGREE = 1e-8  # rEADME's bound of event solves, which is ten times that of the phase method
ORDER = 2e-8  # two neighbours may err by AGREE in opposite directions

FAMILIES = {
    "hunt_crossley": (lambda x: jc.Damped(alpha=x), 1.5),
    "oscillator": (lambda x: given_ratio(x, "tension"), 1.5),
    "clamped oscillator": (lambda x: given_ratio(x, "clamped"), 1.5),
    "kuwabara_kono": (lambda x: jc.KuwabaraKono(A=x), 1.5),
}
ROUTES = [(family, method) for family in FAMILIES for method in ("auto", "event")]

damping = st.one_of(st.floats(-6, 6).map(lambda x: 10**x), st.sampled_from([0.0, 1e-300, 1e6]))
scale = st.floats(-12, 12).map(lambda x: 10**x)


def lanes(one):
    return st.lists(one, min_size=LANES, max_size=LANES).map(np.array)


def solved(family, method, number, mass=1.0, stiffness=1.0, velocity=1.0, push=None):
    law_of, n = FAMILIES[family]
    contact = jc.Contact(mass, stiffness, n)
    return impacts(law_of(number), contact, velocity, external_force=push, method=method)


def parted(hit):
    return hit.status == jc.Status.SEPARATED


@pytest.mark.parametrize(("family", "method"), ROUTES)
@given(numbers=lanes(damping))
@settings(max_examples=15)
def test_more_damping_never_gives_more_rebound(family, method, numbers):
    """Nor is energy gained: e ≤ 1, and what is lost is between none and all."""
    numbers = np.sort(numbers)
    if (family, method) == ("kuwabara_kono", "event"):
        # Stronger damping by event takes seconds: see test_rounding.
        numbers = np.minimum(numbers, 1e2)
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


@given(
    numbers=lanes(damping), push=lanes(st.floats(-4, 4).map(lambda x: np.sign(x) * 10 ** abs(x)))
)
@settings(max_examples=25)
def test_a_push_gives_no_energy_to_a_contact_that_ends_where_it_began(numbers, push):
    hit = solved("hunt_crossley", "event", numbers, push=push)
    good = parted(hit)
    e, lost = hit.restitution[good], hit.energy_loss[good]
    assert np.all((e >= 0) & (lost >= 0))
    # A pulled contact separates where its force vanishes, at δ > 0, before the pull has done its
    # work.
    assert np.all(e[push[good] > 0] <= 1)


@given(numbers=lanes(damping), m=lanes(scale), k=lanes(scale), v=lanes(scale))
@settings(max_examples=25)
def test_units_drop_out(numbers, m, k, v):
    """Over 24 orders of magnitude: α alone decides, and the rest scales."""
    v = np.maximum(v, 1e-6)
    hit = solved("hunt_crossley", "auto", numbers, m, k, v)
    unit = solved("hunt_crossley", "auto", numbers)
    length = (m / k) ** 0.4 * v**0.8
    np.testing.assert_array_equal(hit.restitution, unit.restitution)
    for name, scale in {
        "duration": length / v,
        "compression_time": length / v,
        "max_indentation": length,
        "max_force": k * length**1.5,
        "energy_loss": m * v**2,
        "rebound_velocity": v,
    }.items():
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
        for name in ("restitution", "duration", "compression_time", "max_indentation", "max_force"):
            found, expected = (getattr(hit, name)[good] for hit in (other, exact))
            np.testing.assert_allclose(found, expected, rtol=AGREE, err_msg=name)
    assert parted(phase)[exact.restitution > 0.1].all()


radius = st.floats(-4, 1).map(lambda x: 10**x)
modulus = st.floats(5, 12).map(lambda x: 10**x)


@given(
    r=st.tuples(radius, radius),
    E=st.tuples(modulus, modulus),
    nu=st.tuples(*[st.floats(-0.9, 0.5)] * 2),
)
@settings(max_examples=20)
def test_the_order_of_the_bodies_does_not_matter(r, E, nu):
    bodies = [jc.Material(*one, 2000.0) for one in zip(E, nu, strict=True)]
    one = jc.Contact.sphere_sphere(*r, *bodies)
    other = jc.Contact.sphere_sphere(*r[::-1], *bodies[::-1])
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=1e-15)
    np.testing.assert_allclose(one.mass, other.mass, rtol=1e-15)
