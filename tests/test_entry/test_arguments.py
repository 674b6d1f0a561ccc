"""Arguments that are not numbers, contacts, materials or names raise an error that names them."""

import decimal
import fractions
import inspect

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

STEEL = jc.Material(2.1e11, 0.3, 7800.0)

NO_NUMBERS = [
    None,
    "0.5",
    b"1",
    True,
    1j,
    10**400,
    decimal.Decimal("0.5"),
    fractions.Fraction(1, 2),
    np.longdouble(0.5),
    np.array([0.5], np.longdouble),
    np.array(["0.5"]),
    np.array([0.5], object),
    np.array([1j]),
    np.array([True]),
    np.ma.masked_invalid([0.5, np.nan]),
    [0.5, [0.6]],
    {"e": 0.5},
    {0.5},
    object(),
    jnp.asarray([1j]),
    jnp.asarray([True]),
    lambda: 0.5,
]
NUMBERS = {
    "e": lambda x: jc.HuGuo(e=x),
    "mass": lambda x: jc.Contact(x, 1.0),
    "stiffness": lambda x: jc.Contact(1.0, x),
    "exponent": lambda x: jc.Contact(1.0, 1.0, x),
    "radius": lambda x: jc.Contact.sphere_plane(x, STEEL),
    "velocity": lambda x: jc.impact(jc.HuGuo(e=0.5), jc.Contact(1.0, 1.0), x),
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_no_number(name, value):
    with pytest.raises(ValueError, match=f"`{name}` must be a") as caught:
        NUMBERS[name](value)
    shown = " ".join(repr(value).split())
    assert shown[:20] in " ".join(str(caught.value).split())


@pytest.mark.parametrize("value", [None, 5, "steel", jc.HuGuo(e=0.5), jnp.ones(2)], ids=repr)
def test_no_contact_and_no_material(value):
    cases = {
        "sphere": lambda: jc.Contact.sphere_plane(0.1, value),
        "other": lambda: jc.Contact.sphere_sphere(0.1, 0.1, STEEL, value),
        "contact": lambda: jc.impact(jc.HuGuo(e=0.5), value, 1.0),
    }
    if value is not None:
        cases |= {
            "plane": lambda: jc.Contact.sphere_plane(0.1, STEEL, value),
            "socket": lambda: jc.Contact.sphere_socket(0.1, 0.2, STEEL, value),
            "contact ": lambda: jc.restitution(jc.HuGuo(e=0.5), value),
        }
    for name, call in cases.items():
        with pytest.raises(ValueError, match=f"`{name.strip()}` must be a `(Contact|Material)`"):
            call()


@pytest.mark.parametrize("name", [None, 5, ["hu_guo"], {}, "hu guo", b"hu_guo"], ids=repr)
def test_no_name_of_a_law(name):
    with pytest.raises(ValueError, match=r"`name` must be one of .*hu_guo"):
        jc.get_law(name)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int32, np.int64, float, int])
def test_scalars_of_numpy_are_concrete_exponents(kind):
    assert jc.Contact(1.0, 1.0, kind(2)).exponent == 2.0
    assert isinstance(jc.Contact(1.0, 1.0, kind(2)).exponent, float)


def test_flags_are_weights():
    """They keep a point or leave it out, as ones and zeros do."""
    x = np.linspace(0, 1, 5)
    keep = np.array([True, True, True, True, False])

    def line(a, x):
        return a * x

    fits = [
        jc.fit(line, np.where(keep, 2 * x, 100.0), 1.0, x=x, weights=weights, progress=False)
        for weights in (keep, keep.tolist(), keep.astype(float))
    ]
    assert all(fit.params == fits[0].params for fit in fits)
    assert fits[0].params == pytest.approx(2.0, rel=1e-9)


FRICTION = (
    "friction is `friction=` of a `Scene`, a `System` or `oblique_impact`, such as "
    "`RigidCoulomb(mu=0.3)`."
)
TURNS = "spheres of a scene with friction turn: `Sphere(spin=..., inertia=...)`."
NOT_MODELLED = {
    "friction_coefficient": FRICTION,
    "mu": FRICTION,
    "rolling_friction": FRICTION,
    "angular_velocity": TURNS,
    "omega": TURNS,
    "drag": "flights are in vacuum here (`calibrate` and `fit_bounces` have `drag`).",
    "cohesion": "bodies do not stick together (yet).",
    "restitution": "it belongs to a law, such as `ExactRestitution(e=0.8)`.",
}


@pytest.mark.parametrize(
    "made",
    [
        jc.Scene,
        jc.Sphere,
        jc.Plane,
        jc.Box,
        jc.Shell,
        jc.Contact,
        jc.Material,
        jc.bounce,
        jc.impact,
        jc.simulate,
        jc.random_spheres,
    ],
)
def test_what_is_not_modelled_is_said(made):
    for name, why in NOT_MODELLED.items():
        with pytest.raises(TypeError) as error:
            made(**{name: 0.5})
        assert str(error.value) == f"`{made.__name__}` has no argument `{name}`: {why}"
    known = next(iter(inspect.signature(made).parameters))
    with pytest.raises(TypeError, match=f"`{known}x`. Did you mean '{known}'?"):
        made(**{f"{known}x": 0.5})
    with pytest.raises(TypeError, match="required positional arg"):
        made()
    with pytest.raises(TypeError) as error:
        made(nothing_of_the_kind=0.5)
    assert str(error.value) == f"`{made.__name__}` has no argument `nothing_of_the_kind`."


def test_drag_is_where_the_message_says():
    for function in (jc.calibrate, jc.fit_bounces):
        assert "drag" in inspect.signature(function).parameters
