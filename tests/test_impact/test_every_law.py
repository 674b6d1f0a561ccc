"""Every registered law, alone and under each transformation."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import finite

OTHER = {"c": 3e6, "a": 0.05, "A": 2e-6, "alpha": 0.4, "beta": 2.2, "power": -0.4, "reference": 0.8}
OTHER |= {"yield_speed": 0.3, "loss": 0.2, "ratio": 1.5, "slope": 200.0, "pull_off": 1e3}
OTHER |= {"critical_speed": 0.2, "adhesion": 0.3}
# An undamped law: with e = 1, or with its own parameter 0.
ELASTIC = OTHER | {"e": 1.0, "c": 0.0, "a": 0.0, "A": 0.0, "alpha": 0.0, "loss": 0.0}
ELASTIC |= {"yield_speed": 9.0, "ratio": 1.0, "slope": 0.0, "pull_off": 1e-3, "critical_speed": 0.0}
# Central differences of an outcome near 1: measured 1e-10, and 8e-15 between the modes.
DIFFERENCE, STEP, MODES = 1e-8, 1e-5, 1e-12

CONTACT = jc.Contact(0.7, 3e8)
LINEAR = jc.Contact(0.7, 3e8, 1.0)
MILLISECOND = 1e-3
# The forces of `step_damping` and `dmt` have no closed form: see test_dashpots and test_adhesive.
LAWS = [
    x
    for x in jc.list_laws()
    if jc._laws.describe(x).cls.__module__.startswith("jaxcontact.")
    and x not in ("step_damping", "dmt")
]


def parameters(name, e, others):
    fields = inspect.signature(jc._laws.describe(name).cls).parameters
    others = others | {"bridges": {"a": 2 * e - 0.8}, "linear_dashpot": {"c": 4e3 * (1 - e)}}.get(
        name, {}
    )
    return {f: jnp.asarray(e if f == "e" else others[f]) for f in fields if f != "tension"}


def contact_of(name):
    return (
        LINEAR if name in ("kelvin_voigt", "linear_dashpot", "walton_braun", "luding") else CONTACT
    )


def solver(name):
    contact = contact_of(name)

    def solve(p):
        law = jc.get_law(name, **p["law"])
        placed = jc.Contact(p["mass"], p["stiffness"], contact.exponent)
        hit = jc.impact(law, placed, p["velocity"], method="exact")
        return hit.restitution + hit.duration / MILLISECOND, hit.status

    return solve


def place(law):
    return {
        "law": law,
        "mass": CONTACT.mass,
        "stiffness": CONTACT.stiffness,
        "velocity": jnp.asarray(1.3),
    }


@pytest.mark.parametrize("name", LAWS)
def test_all_transformations(name):
    solve = solver(name)

    # Not under `jit`, where every law would be its own program: laws of one form share solves.
    @jax.vmap
    def everything(p):
        """Outcome, gradient, and derivative along the parameters, of lanes, by one solve."""
        total, forward, status = jax.linearize(solve, p, has_aux=True)
        (gradient,) = jax.linear_transpose(forward, p)(jnp.ones_like(total))
        return total, status, gradient, forward(p)

    damped = place(parameters(name, 0.7, OTHER))
    elastic = place(parameters(name, 1.0, ELASTIC))
    moved = [jax.tree.map(lambda x, by=by: x * by, damped) for by in (1 + STEP, 1 - STEP)]
    lanes = jax.tree.map(lambda *x: jnp.stack(x), damped, elastic, *moved)
    total, status, gradient, along = everything(lanes)
    assert (status == jc.Status.SEPARATED).all()
    assert finite((total, gradient, along))
    # Along the parameters: forward mode, reverse mode and differences agree.
    reverse = sum(
        np.asarray(g) * np.asarray(x)
        for g, x in zip(jax.tree.leaves(gradient), jax.tree.leaves(lanes), strict=True)
    )
    assert np.allclose(reverse, along, rtol=MODES, atol=MODES)
    difference = (total[2] - total[3]) / (2 * STEP)
    assert abs(difference - along[0]) <= DIFFERENCE


@pytest.mark.parametrize("name", LAWS)
def test_the_law_alone_delivers_the_restitution_of_the_impact(name):
    law = jc.get_law(name, **parameters(name, 0.7, OTHER))
    contact = contact_of(name)
    hit = jc.impact(law, contact, 1.3)
    assert jc.restitution(law, contact, 1.3) == pytest.approx(float(hit.restitution), rel=1e-14)
