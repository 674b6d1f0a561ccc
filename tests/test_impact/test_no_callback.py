"""No program calls back to the host, which would exclude it from every compilation cache."""

import jax
import jax.numpy as jnp
import pytest

import jaxcontact as jc

PLACE = {"e": jnp.asarray(0.6), "K": jnp.asarray(3e8), "v": jnp.asarray(1.3)}


def callbacks(jaxpr):
    """The names of all primitives that call the host, however deep they stand."""
    found = []
    for equation in jaxpr.eqns:
        if "callback" in equation.primitive.name:
            found.append(equation.primitive.name)
        for inner in jax.tree.leaves(list(equation.params.values()), is_leaf=_is_program):
            if _is_program(inner):
                found += callbacks(getattr(inner, "jaxpr", inner))
    return found


def _is_program(x):
    return hasattr(x, "eqns") or hasattr(x, "jaxpr")


def everything(solve):
    """Value, both derivatives, and all of it for a batch, as one program."""

    def point(p):
        return solve(p), jax.jacfwd(solve)(p), jax.grad(solve)(p)

    def program(p):
        return point(p), jax.vmap(point)(jax.tree.map(lambda x: jnp.stack([x, x]), p))

    return jax.make_jaxpr(program)(PLACE).jaxpr


def contact(p):
    return jc.Contact(0.7, p["K"])


def total(hit):
    return hit.restitution + hit.duration + hit.max_force + hit.compression_time


def trajectory(p):
    path = jc.trajectory(jc.KuwabaraKono(A=1e-6 * p["e"]), contact(p), p["v"], samples=3)
    return jnp.sum(path.indentation + path.energy.dissipated)


def bounce(p, **options):
    run = jc.bounce(jc.HuGuo(e=p["e"]), contact(p), p["v"], bounces=2, **options)
    return jnp.sum(run.height + run.time)


PROGRAMS = {
    **{
        method: lambda p, method=method: total(
            jc.impact(jc.HuGuo(e=p["e"]), contact(p), p["v"], method=method)
        )
        for method in ("exact", "phase", "event")
    },
    "pushed": lambda p: total(
        jc.impact(jc.HuGuo(e=p["e"]), contact(p), p["v"], external_force=p["e"])
    ),
    "viscoelastic": lambda p: total(
        jc.impact(jc.KuwabaraKono(A=1e-6 * p["e"]), contact(p), p["v"])
    ),
    "restitution": lambda p: (
        jc.restitution(jc.HuGuo(e=p["e"]))
        + jc.restitution(jc.ConstantDamping(c=1e7), contact(p), p["v"])
    ),
    "trajectory": trajectory,
    "bounce": bounce,
    "bounce with gravity in contact": lambda p: bounce(p, gravity_in_contact=True),
}


@pytest.mark.slow(
    "event",
    "phase",
    "pushed",
    "trajectory",
    "bounce with gravity in contact",
    reason="value, jacfwd and grad traced alone and in a batch",
)
@pytest.mark.parametrize("name", PROGRAMS)
def test_no_program_has_a_callback(name):
    assert callbacks(everything(PROGRAMS[name])) == []


def test_a_callback_is_found():
    @jax.custom_jvp
    def square(x):
        return x**2

    @square.defjvp
    def derivative(primals, tangents):
        # Deep inside, and in the derivative only, like the error check of a linear solve.
        def slope(x):
            return jax.pure_callback(lambda x: 2 * x, x, x, vmap_method="sequential")

        (x,), (dx,) = primals, tangents
        return square(x), jax.lax.cond(x > 0, slope, lambda x: 2 * x, x) * dx

    def planted(p):
        return square(p["e"])

    assert callbacks(jax.make_jaxpr(planted)(PLACE).jaxpr) == []
    assert callbacks(everything(planted))
