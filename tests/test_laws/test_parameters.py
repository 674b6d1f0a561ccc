"""Parameters of every law: ranges, messages, precision, shapes; and printing."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_laws.table import ALPHA_OF_E, LAWS, VARIANTS

ROUNDING = 1e-14  # a few products: measured 7e-16

NAN, INF = float("nan"), float("inf")


def bad_numbers(name, argument):
    """What a parameter may not be, and the range the message should show."""
    if argument == "e":
        zero = () if LAWS[name].from_zero else (0.0,)
        return r"\[0, 1\]" if LAWS[name].from_zero else r"\(0, 1\]", (-0.1, 1.1, *zero)
    positive = ("beta", "reference", "yield_speed", "d")
    if argument in positive or (name, argument) == ("bridges", "a"):
        return r"\(0, inf\)", (0.0, -1.0)
    if argument == "ratio":
        return r"\[1, inf\)", (0.5,)
    if argument == "power":
        return r"\(-inf, inf\)", ()
    return r"\[0, inf\)", (-1.0,)


ARGUMENTS = [(name, argument) for name, law in LAWS.items() for argument in law.names]


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_scalars_out_of_range(name, argument):
    law = LAWS[name]
    good = dict(zip(law.names, law.parameters[0], strict=True))
    allowed, numbers = bad_numbers(name, argument)
    for number in (*numbers, NAN, INF):
        with pytest.raises(ValueError, match=f"`{argument}` must be in {allowed}, but is {number}"):
            law.cls(**(good | {argument: number}))


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_arrays_out_of_range_pass(name, argument):
    law = LAWS[name]
    # In lanes of all parameters, so that those of a law share its program.
    lanes = {one: np.full(5, x) for one, x in zip(law.names, law.parameters[0], strict=True)}
    bad = [*bad_numbers(name, argument)[1], NAN]
    lanes[argument][: len(bad)] = bad
    made = law.cls(**lanes)
    np.testing.assert_array_equal(getattr(made, argument), lanes[argument])
    # They have no formula; `impact` flags their lanes.
    if name in ("linear_dashpot", "step_damping"):
        return
    found = jc.restitution(made, jc.Contact(1.0, 1e8, law.exponent), 1.0)
    np.testing.assert_array_equal(np.isnan(found), np.arange(5) < len(bad))
    assert 0 < found[-1] < 1 or (name == "dmt" and found[-1] == 1)


def test_whole_numbers_are_numbers():
    for one in (1, np.int64(1), jnp.array(1), jnp.array([1, 1]), [1, 1], np.array([1.0, 1.0])):
        assert jnp.issubdtype(jc.HuGuo(e=one).e.dtype, jnp.floating)


@pytest.mark.parametrize("name", VARIANTS)
def test_shapes_broadcast(name):
    law = VARIANTS[name]
    numbers = [jnp.full((2, 1, 1), x) for x in law.parameters[0]]
    contact = jc.Contact(mass=jnp.full((1, 3, 1), 0.5), stiffness=1e8, exponent=law.exponent)
    d, v = jnp.linspace(-1e-3, 1e-3, 4).reshape(1, 1, 4), jnp.asarray(0.3)
    found = law.make(*numbers).force(d, v, contact, 1.0)
    wide = (2 if law.names else 1, 3, 4)
    assert jnp.broadcast_shapes(found.shape, (1, 3, 1)) == wide
    contact = jc.Contact(mass=0.5, stiffness=1e8, exponent=law.exponent)
    alone = [law.make(*law.parameters[0]).force(float(x), 0.3, contact, 1.0) for x in d.ravel()]
    assert all(x.shape == () for x in alone)
    np.testing.assert_allclose(
        np.broadcast_to(found, wide), np.broadcast_to(alone, wide), rtol=ROUNDING
    )


@pytest.mark.parametrize("name", VARIANTS)
def test_single_precision_stays(name):
    law = VARIANTS[name]
    places = jnp.asarray([1e-4, -1e-4, 2e-4], jnp.float32), jnp.asarray(0.1, jnp.float32)
    numbers = law.parameters[1], 0.5, 1e8, 1.0

    def force(parameters, mass, stiffness, v0):
        contact = jc.Contact(mass, stiffness, law.exponent)
        return law.make(*parameters).force(*places, contact, v0)

    found = force(*jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), numbers))
    # Python numbers take the precision of the arrays, in the law, the contact and the speed.
    of_numbers = jax.eval_shape(lambda: force(*numbers))
    assert found.dtype == of_numbers.dtype == jnp.float32
    parameters, mass, stiffness, v0 = numbers
    with mp.workdps(30):
        rest = [mp.mpf(x) for x in (0.1, stiffness, mass, v0, *parameters)]
        expected = [float(law.force(mp.mpf(d), *rest)) for d in places[0].tolist()]
    # Adhesion and the elastic force nearly cancel.
    rtol = (3 if name.startswith("jkr") else 1) * SINGLE
    np.testing.assert_allclose(found, expected, rtol=rtol)


SINGLE = 1e-6  # force in single precision: measured 1.5e-7


@pytest.mark.parametrize("name", ALPHA_OF_E)
def test_the_force_does_not_depend_on_the_unit_of_speed(name):
    """The ratio of the rate and v0 counts, at any v0; at none the force is finite."""
    law = LAWS[name].make(0.5)
    contact = jc.Contact(mass=1.0, stiffness=1e8)
    speeds = jnp.array([1e-100, 1e-12, jc.VELOCITY_THRESHOLD, 1.0])
    force = np.asarray(law.force(1e-3, speeds, contact, speeds))
    alpha = float(law.damping_factor())
    np.testing.assert_allclose(force, 1e8 * 1e-3**1.5 * (1 + alpha), rtol=ROUNDING)
    assert np.isfinite(law.force(1e-3, 1.0, contact, 0.0))
    assert np.isfinite(law.force(np.float32(1e-3), np.float32(1), contact, np.float32(0)))


def test_which_laws_pull_by_default():
    pulls = {name for name, law in LAWS.items() if law.make(*law.parameters[0]).tension}
    assert pulls == {
        *("kelvin_voigt", "antypov_elliott", "tsuji", "jankowski", "kuwabara_kono"),
        *("dmt", "jkr", "luding"),
    }


def test_derivative_in_a_traced_exponent():
    """d/dn of K d^n (1 + a v) is ln(d) times the force; finite at touch and apart."""
    d = jnp.array([1e-3, 0.3, 0.0, -1e-3])

    def force(n, d):
        return jc.Damped(alpha=0.5).force(d, 0.2, jc.Contact(1.0, 1e6, n), 1.0)

    value, slope = jax.jit(jax.vmap(jax.value_and_grad(force), (None, 0)))(jnp.asarray(1.8), d)
    expected = 1e6 * np.array([1e-3, 0.3]) ** 1.8 * 1.1
    np.testing.assert_allclose(value, [*expected, 0, 0], rtol=ROUNDING)
    np.testing.assert_allclose(slope, [*(expected * np.log([1e-3, 0.3])), 0, 0], rtol=ROUNDING)


def test_repr():
    assert repr(jc.HuGuo(e=0.7)) == "HuGuo(e=0.7)"
    assert repr(jc.Hertz()) == "Hertz()"
    assert repr(jc.HuGuo(e=0.7, tension=True)) == "HuGuo(e=0.7, tension=True)"
    assert repr(jc.EnergyLoss(e=0.5, beta=2.5)) == "EnergyLoss(e=0.5, beta=2.5)"
    assert repr(jc.Thornton(e=0.5)) == "Thornton(e=0.5)"
    assert repr(jc.KelvinVoigt(e=jnp.array([0.5, 0.6]), tension=False)) == (
        "KelvinVoigt(e=[0.5, 0.6], tension=False)"
    )
    seen = []
    jax.jit(lambda e: seen.append(repr(jc.HuGuo(e=e))))(jnp.ones(3))
    assert seen == ["HuGuo(e=f64[3])"]


def test_laws_are_pytrees_of_their_numbers():
    for law in LAWS.values():
        made = law.make(*law.parameters[0])
        leaves, structure = jax.tree.flatten(made)
        np.testing.assert_array_equal(leaves, law.parameters[0])
        assert repr(jax.tree.unflatten(structure, leaves)) == repr(made)
