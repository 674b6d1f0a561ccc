"""Every registered law, alone and under each transformation."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._forms import scale_of
from tests.test_impact.support import finite
from tests.test_laws.table import LAWS as TABLE

# Central differences of an outcome near 1: measured 1e-10, and 8e-15 between the modes.
DIFFERENCE, STEP, MODES = 1e-8, 1e-5, 1e-12

CONTACT = jc.Contact(0.7, 3e8)
LINEAR = ("kelvin_voigt", "linear_dashpot", "walton_braun", "luding")
MILLISECOND = 1e-3
# The forces of `step_damping` and `dmt` have no closed form: see test_dashpots and test_adhesive.
# test_plastic and test_wet have all derivatives of the others.
LAWS = sorted(TABLE.keys() - {"step_damping", "dmt", "viscoplastic", "wet_restitution"})


def lanes_of(name):
    """The law damped and elastic, and moved by a step along all parameters, in lanes."""

    def place(parameters):
        law = dict(zip(TABLE[name].names, parameters, strict=True))
        numbers = {"mass": CONTACT.mass, "stiffness": CONTACT.stiffness, "velocity": 1.3}
        return jax.tree.map(jnp.asarray, numbers | {"law": law})

    damped, _, elastic = map(place, TABLE[name].parameters)
    moved = [jax.tree.map(lambda x, by=by: x * by, damped) for by in (1 + STEP, 1 - STEP)]
    return jax.tree.map(lambda *x: np.stack(x), damped, elastic, *moved)


class SideBySide(jc.AbstractLaw):
    """Laws whose forms have one structure, each for a lane of its own: one program for all."""

    laws: tuple[jc.AbstractLaw, ...]
    tension = True

    def force(self, indentation, velocity, contact, impact_velocity):
        raise NotImplementedError

    def form(self, contact, scale):
        forms = [
            law.form(*jax.tree.map(lambda x, k=k: x[k], (contact, scale)))
            for k, law in enumerate(self.laws)
        ]
        return jax.tree.map(lambda *x: jnp.stack(x), *forms)


def contact_of(name, p):
    return jc.Contact(p["mass"], p["stiffness"], 1.0 if name in LINEAR else 1.5)


@functools.cache
def kind_of(name):
    """The structure of its form, and the exponent."""
    p, contact = lanes_of(name), contact_of(name, lanes_of(name))
    law, scale = jc.get_law(name, **p["law"]), scale_of(contact, p["velocity"])
    return jax.tree.structure(jax.eval_shape(law.form, contact, scale)), contact.exponent


@functools.cache
def everything(kind):
    """Lanes, outcome, gradient, and derivative along the parameters, of every law of a kind."""
    names = [name for name in LAWS if kind_of(name) == kind]

    def placed(p):
        law = SideBySide(tuple(jc.get_law(name, **p[name]["law"]) for name in names))
        mass, stiffness, velocity = (
            jnp.stack([p[name][x] for name in names]) for x in ("mass", "stiffness", "velocity")
        )
        return law, jc.Contact(mass, stiffness, kind[1]), velocity

    def solve(p):
        hit = jc.impact(*placed(p))
        assert hit.method == "exact"
        return hit.restitution + hit.duration / MILLISECOND, (hit.status, hit.restitution)

    @jax.jit
    @jax.vmap
    def solved(p):
        total, forward, (status, e) = jax.linearize(solve, p, has_aux=True)
        (gradient,) = jax.linear_transpose(forward, p)(jnp.ones_like(total))
        alone = jc.restitution(*placed(p))
        return total, status, jnp.stack([alone, e]), gradient, forward(p)

    lanes = {name: lanes_of(name) for name in names}
    total, status, e, gradient, along = jax.tree.map(np.asarray, solved(lanes))
    return {
        name: (lanes[name], total[:, k], status[:, k], e[..., k], gradient[name], along[:, k])
        for k, name in enumerate(names)
    }


@pytest.mark.parametrize("name", LAWS)
def test_all_transformations(name):
    """Also the law alone, which delivers the restitution of the impact."""
    lanes, total, status, e, gradient, along = everything(kind_of(name))[name]
    assert (status == jc.Status.SEPARATED).all()
    assert finite((total, gradient, along))
    np.testing.assert_allclose(e[:, 0], e[:, 1], rtol=1e-14)
    # Along the parameters: forward mode, reverse mode and differences agree.
    pairs = zip(jax.tree.leaves(gradient), jax.tree.leaves(lanes), strict=True)
    reverse = sum(np.asarray(slope) * x for slope, x in pairs)
    assert np.allclose(reverse, along, rtol=MODES, atol=MODES)
    assert abs((total[2] - total[3]) / (2 * STEP) - along[0]) <= DIFFERENCE
