"""Restitution alone: without a contact if the law allows it, and without a time integral."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._impact import restitutions
from tests.test_impact.support import UNIT, column, grid, values

FORMULA = 1e-14
ROUNDING = 4 * np.finfo(float).eps
CONTACT = jc.Contact(0.7, 3e8)
# Published restitutions of the laws for e = .9 .7 .5 .3 .1, four digits.
PUBLISHED = {
    "hunt_crossley": [0.9090, 0.7680, 0.6630, 0.5813, 0.5158],
    "lankarani_nikravesh": [0.9132, 0.7960, 0.7252, 0.6842, 0.6653],
    "flores": [0.8939, 0.6832, 0.4704, 0.2562, 0.0694],
    "hu_guo": [0.8999, 0.6973, 0.4877, 0.2707, 0.0741],
    "gonthier": [0.8764, 0.6696, 0.4877, 0.3042, 0.1010],
    "carvalho_martins": [0.9000, 0.7000, 0.5002, 0.3040, 0.1289],
    "exact": [0.9, 0.7, 0.5, 0.3, 0.1],
}
ASKED = jnp.array([0.9, 0.7, 0.5, 0.3, 0.1])


@pytest.mark.parametrize("name", PUBLISHED)
def test_laws_deliver_what_is_known_of_them(name):
    got = jc.restitution(jc.get_law(name, e=ASKED))
    # The additional hundredth of a unit covers a 5 in the next digit.
    assert np.abs(got - np.array(PUBLISHED[name])).max() < 0.51e-4
    # Another program may round differently: measured 1.1e-16.
    placed = jc.restitution(jc.get_law(name, e=ASKED), CONTACT, 1.0)
    assert np.allclose(got, placed, rtol=ROUNDING, atol=0)


def test_hunt_crossley_over_the_range():
    some = grid("hunt_crossley", n=1.5)
    got = jc.restitution(jc.Damped(alpha=column(some, "alpha")))
    assert np.allclose(got, values(some)["e"], rtol=FORMULA, atol=0)


@pytest.mark.parametrize(("dtype", "largest"), [(np.float64, 153), (np.float32, 18)])
def test_extreme_damping_delivers_its_inverse(dtype, largest):
    """α e = 1 up to e^-α, with derivative -1/α², up to where α² overflows."""
    alpha = jnp.asarray(10.0 ** np.linspace(1.9, largest, 500), dtype)
    e, slope = jax.jvp(lambda a: jc.restitution(jc.Damped(alpha=a)), (alpha,), (alpha,))
    rounding = 4 * np.finfo(dtype).eps
    assert np.allclose(e * alpha, 1, rtol=rounding, atol=0)
    assert np.allclose(slope, -e, rtol=rounding, atol=0)


def test_laws_that_depend_on_the_place():
    velocity = jnp.array([0.1, 1.0, 10.0])
    slowing = jc.restitution(jc.ConstantDamping(c=3e7), CONTACT, velocity)
    given = jc.restitution(jc.Damped(alpha=velocity * (3e7 / 3e8)))
    assert np.allclose(slowing, given, rtol=FORMULA, atol=0)
    marhefka = jc.restitution(jc.MarhefkaOrin(a=0.1), CONTACT, velocity)
    assert np.allclose(marhefka, jc.restitution(jc.Damped(alpha=0.15 * velocity)), rtol=FORMULA)


def test_kuwabara_kono():
    some = grid("kuwabara_kono", tension=True)
    got = jc.restitution(jc.KuwabaraKono(A=column(some, "a")), UNIT[1.5], 1.0)
    assert np.allclose(got, values(some)["e"], rtol=FORMULA, atol=0)


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
    assert jax.grad(lambda e: jc.restitution(jc.HuGuo(e=e)))(1.0) == pytest.approx(1.0, rel=1e-14)


def test_only_what_alpha_depends_on_is_needed():
    velocity = jnp.array([1.0, 2.0, -1.0])
    e = jc.restitution(jc.MarhefkaOrin(a=0.1), velocity=velocity)
    same = jc.restitution(jc.Damped(alpha=0.15 * velocity))
    assert np.allclose(e[:2], same[:2], rtol=1e-15)
    assert np.isnan(e[2])
    of_n = jc.restitution(jc.EnergyLoss(0.5, 2.0), contact=CONTACT)
    assert of_n == pytest.approx(float(jc.restitution(jc.EnergyLoss(0.5, 2.0))), rel=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((jc.ConstantDamping(c=1.0), None, 1.0), "`contact` is needed"),
        ((jc.ConstantDamping(c=1.0), CONTACT), "`velocity` is needed"),
        ((jc.KuwabaraKono(A=1.0),), "`contact` is needed"),
    ],
)
def test_what_is_missing_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        jc.restitution(*arguments)


def test_an_unknown_method_is_named_first():
    with pytest.raises(ValueError, match=r"`method` must be one of .* but is 'magic'"):
        jc.restitution(jc.HuGuo(e=0.5), method="magic")


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
