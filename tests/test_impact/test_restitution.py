"""Restitution alone: without a contact if the law allows it, and without a time integral."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._impact import restitutions

FORMULA = 1e-14
CONTACT = jc.Contact(0.7, 3e8)
ASKED = jnp.array([0.9, 0.7, 0.5, 0.3, 0.1])


@pytest.mark.parametrize(("dtype", "largest"), [(np.float64, 153), (np.float32, 18)])
def test_extreme_damping_delivers_its_inverse(dtype, largest):
    """α e = 1 up to e^-α, with derivative -1/α², up to where α² overflows."""
    alpha = jnp.asarray(10.0 ** np.linspace(1.9, largest, 500), dtype)
    e, slope = jax.jvp(lambda a: jc.restitution(jc.Damped(alpha=a)), (alpha,), (alpha,))
    rounding = 4 * np.finfo(dtype).eps
    assert np.allclose(e * alpha, 1, rtol=rounding, atol=0)
    assert np.allclose(slope, -e, rtol=rounding, atol=0)


def test_kuwabara_kono_loses_little_by_a_known_series():
    # 1 - e = C1 x - C2 x² with x = (3/2) A (K/m)^(2/5) v0^(1/5) and C2 = (3/5) C1²; the next
    # term is of order x³, here below 1e-6.
    mass, stiffness = 0.3, 4e7
    velocity = jnp.array([1e-3, 0.1, 10.0])
    small = 1e-3 / (stiffness / mass) ** 0.4 / velocity**0.2 / 1.5 * jnp.array([1.0, 3.0, 9.0])
    x = np.array([1e-3, 3e-3, 9e-3])
    contact = jc.Contact(mass, stiffness)
    lost = 1 - jc.restitution(jc.KuwabaraKono(A=small), contact, velocity)
    assert np.allclose(lost / x, 1.15344, rtol=0.01)
    assert np.abs(lost - (1.15344 * x - 0.6 * (1.15344 * x) ** 2)).max() < 1e-6


def test_bad_lanes_and_shapes():
    e = jc.restitution(jc.HuGuo(e=jnp.array([0.5, -1.0, np.nan, 1.0])))
    assert np.array_equal(np.isnan(e), [False, True, True, False]) and e[3] == 1
    grid_ = jc.restitution(jc.HuGuo(e=ASKED[:, None]), CONTACT, jnp.ones(3))
    assert grid_.shape == (5, 3)


@pytest.mark.parametrize("law", [jc.HuGuo, jc.AntypovElliott])
def test_no_time_is_computed(law):
    def program(function):
        """The operations of what XLA makes of it."""
        return jax.jit(function).lower(jnp.array(0.5)).compile().cost_analysis()["flops"]

    def here(e):
        return jc.restitution(law(e=e), CONTACT, 1.0)

    alone = program(lambda e: jc.restitution(law(e=e)))
    whole = program(lambda e: jc.impact(law(e=e), CONTACT, 1.0).duration)
    # The scale and the checks of a contact cost a little. One node of the integral costs more, but
    # is in a loop, which is counted once.
    assert program(here) <= alone + 50 < whole


def test_derivatives():
    e = jax.vmap(jax.grad(lambda e: jc.restitution(jc.ExactRestitution(e=e))))(ASKED)
    assert np.allclose(e, 1, rtol=1e-13)


def test_only_what_alpha_depends_on_is_needed():
    velocity = jnp.array([0.1, 1.0, 10.0, -1.0])
    slowing = jc.restitution(jc.ConstantDamping(c=3e7), CONTACT, velocity)
    marhefka = jc.restitution(jc.MarhefkaOrin(a=0.1), velocity=velocity)
    for e, alpha in ((slowing, velocity * (3e7 / 3e8)), (marhefka, 0.15 * velocity)):
        same = jc.restitution(jc.Damped(alpha=alpha))
        assert np.allclose(e[:3], same[:3], rtol=1e-15, atol=0) and np.isnan(e[3])
    of_n = jc.restitution(jc.EnergyLoss(0.5, 2.0), contact=CONTACT)
    assert of_n == pytest.approx(float(jc.restitution(jc.EnergyLoss(0.5, 2.0))), rel=1e-14)


def test_many_laws_at_once():
    laws = (jc.HuGuo, jc.Flores, jc.Tsuji, jc.MarhefkaOrin, jc.KelvinVoigt)
    e = jnp.tile(jnp.append(ASKED, 1.5), (len(laws), 1))
    hu_guo, flores, tsuji, speed, kelvin_voigt = restitutions(laws, e)
    assert speed is None
    for law, got in ((jc.HuGuo, hu_guo), (jc.Flores, flores), (jc.Tsuji, tsuji)):
        wanted = jc.restitution(law(e=e[0]))
        assert np.allclose(got, wanted, rtol=FORMULA, atol=0, equal_nan=True)
    assert np.allclose(kelvin_voigt[:-1], ASKED, rtol=FORMULA, atol=0)
    assert np.isnan(kelvin_voigt[-1])
