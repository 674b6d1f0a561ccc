"""Scalars of NumPy, flags as weights, and arguments that do not exist.

Values that are no numbers, contacts, materials or names are passed in `tests/test_every_argument`.
"""

import inspect

import numpy as np
import pytest

import jaxcontact as jc


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int32, np.int64, float, int])
def test_scalars_of_numpy_are_concrete_exponents(kind):
    assert jc.Contact(1.0, 1.0, kind(2)).exponent == 2.0
    assert isinstance(jc.Contact(1.0, 1.0, kind(2)).exponent, float)


def test_arrays_are_copied():
    """Also where JAX could share their memory: at an address that is a multiple of 64 bytes."""
    raw = np.zeros(16)
    at = -raw.ctypes.data % 64 // 8
    mine = raw[at : at + 8]
    mine[:] = np.linspace(0.1, 0.8, 8)
    law, was = jc.HuGuo(e=mine), mine.copy()
    found = jc.fit(lambda a, x: a * x, 2 * was, 1.0, x=mine)
    mine[:] = 1.0
    assert np.array_equal(law.e, was) and np.array_equal(found.problem.x, was)


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
    "friction_coefficient": FRICTION, "mu": FRICTION, "rolling_friction": FRICTION,
    "angular_velocity": TURNS, "omega": TURNS,
    "drag": "flights are in vacuum here (`calibrate` and `fit_bounces` have `drag`).",
    "cohesion": "bodies do not stick together (yet).",
    "restitution": "it belongs to a law, such as `ExactRestitution(e=0.8)`.",
}  # fmt: skip


@pytest.mark.parametrize(
    "name",
    "Scene Sphere Plane Box Shell Contact Material bounce impact simulate random_spheres".split(),
)
def test_what_is_not_modelled_is_said(name):
    made = getattr(jc, name)
    for absent, why in NOT_MODELLED.items():
        with pytest.raises(TypeError) as error:
            made(**{absent: 0.5})
        assert str(error.value) == f"`{name}` has no argument `{absent}`: {why}"
    known = next(iter(inspect.signature(made).parameters))
    with pytest.raises(TypeError, match=f"`{known}x`. Did you mean '{known}'?"):
        made(**{f"{known}x": 0.5})
    with pytest.raises(TypeError, match="required positional arg"):
        made()
    with pytest.raises(TypeError) as error:
        made(nothing_of_the_kind=0.5)
    assert str(error.value) == f"`{name}` has no argument `nothing_of_the_kind`."
