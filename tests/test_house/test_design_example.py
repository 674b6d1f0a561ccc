"""The first page of the library, typed by hand: names, shapes and values that users rely on."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

ROUNDING = 1e-14
"""Formulas: measured 1e-15."""

SOLVED = 5e-9
"""The other methods and the trajectory against the closed form: measured 2e-10."""

SAMPLED = 1e-4
"""The largest of 200 samples against the maximum between them: measured 2e-5."""

FOUR_DIGITS = 5.1e-5

CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8, exponent=1.5)
LAW = jc.HuGuo(e=0.7)


@pytest.fixture(scope="module")
def hit():
    return jc.impact(LAW, CONTACT, velocity=4.2)


def test_contacts():
    steel = jc.Material(youngs_modulus=207e9, poisson_ratio=0.3, density=7800.0)
    contact = jc.Contact.sphere_plane(radius=0.01, sphere=steel, plane=steel)
    assert 1e10 < contact.stiffness < 2e10
    assert 0.03 < contact.mass < 0.035
    assert contact.exponent == 1.5
    assert CONTACT.mass == 1.0 and CONTACT.stiffness == 1.4e8


def test_laws():
    assert repr(LAW) == repr(jc.get_law("hu_guo", e=0.7))
    assert "hu_guo" in jc.list_laws()
    of_e = jc.HuntCrossley, jc.LankaraniNikravesh, jc.Flores, jc.Gonthier, jc.CarvalhoMartins
    laws = [kind(e=0.7) for kind in (*of_e, jc.ExactRestitution)]
    laws += [jc.Hertz(), jc.EnergyLoss(e=0.7, beta=2.5), jc.Damped(alpha=0.6)]
    for law in (*laws, jc.ConstantDamping(c=1e7)):
        assert law.damping_factor(CONTACT, 4.2) >= 0
    for law in (jc.KelvinVoigt(e=0.7), jc.Tsuji(e=0.7)):
        assert law.damping_ratio() > 0
    indentation, velocity = jnp.array([[1e-4], [2e-4]]), jnp.array([[4.0, 0.0, -2.0]])
    F = LAW.force(indentation, velocity, CONTACT, 4.2)
    assert F.shape == (2, 3)
    assert np.all(F > 0) and np.all(F[1] > F[0]) and np.all(F[:, 0] > F[:, 2])
    a = LAW.damping_factor(CONTACT, 4.2)
    np.testing.assert_allclose(a, 1.5 * 0.3 / 0.7, rtol=ROUNDING)
    assert a == LAW.damping_factor()


def test_impact(hit):
    assert hit.method == "exact"
    np.testing.assert_allclose(hit.restitution, 0.6973, atol=FOUR_DIGITS)
    np.testing.assert_allclose(hit.rebound_velocity, 4.2 * hit.restitution, rtol=ROUNDING)
    lost = 0.5 * 4.2**2 * (1 - hit.restitution**2)
    np.testing.assert_allclose(hit.energy_loss, lost, rtol=ROUNDING)
    assert 0 < hit.compression_time < hit.duration / 2 < 1e-3
    assert 1e-3 < hit.max_indentation < 1.9007e-3
    elastic_force = 1.4e8 * float(hit.max_indentation) ** 1.5
    assert elastic_force < hit.max_force < 2 * elastic_force
    for name in ("restitution", "duration", "compression_time", "max_force", "status"):
        assert getattr(hit, name).shape == ()
    for method in ("phase", "event"):
        again = jc.impact(LAW, CONTACT, velocity=4.2, method=method)
        assert again.method == method
        np.testing.assert_allclose(again.duration, hit.duration, rtol=SOLVED)


def test_trajectory(hit):
    path = jc.trajectory(LAW, CONTACT, velocity=4.2, samples=200)
    for name in ("time", "indentation", "velocity", "force"):
        assert getattr(path, name).shape == (200,)
    np.testing.assert_allclose(path.time[-1], hit.duration, rtol=SOLVED)
    np.testing.assert_allclose(path.velocity[0], 4.2, rtol=ROUNDING)
    np.testing.assert_allclose(path.indentation.max(), hit.max_indentation, rtol=SAMPLED)
    np.testing.assert_allclose(path.energy.total, 0.5 * 4.2**2, rtol=SOLVED)
    np.testing.assert_allclose(path.energy.dissipated[-1], hit.energy_loss, rtol=SOLVED)


def test_restitution_and_back():
    a = jc.exact_damping_factor(jc.restitution(LAW))
    np.testing.assert_allclose(a, LAW.damping_factor(), rtol=ROUNDING)
    assert jc.restitution(jc.ConstantDamping(c=1e7), CONTACT, 4.2) < 1


def test_bounce():
    run = jc.bounce(LAW, CONTACT, height=1.0, gravity=9.8)
    for name in ("time", "height", "impact_velocity", "restitution"):
        assert getattr(run, name).shape == (18,)  # until rest
    moving = np.asarray(run.status == jc.Status.SEPARATED)
    assert moving[:17].all() and not moving[17]  # the ball has come to rest
    assert np.all(np.diff(run.time[:17]) > 0) and np.all(np.diff(run.height[:17]) < 0)
    np.testing.assert_allclose(run.restitution[:17], 0.6973, atol=FOUR_DIGITS)
