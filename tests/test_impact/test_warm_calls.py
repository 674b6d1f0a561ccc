"""New numbers never trigger a compilation, warm calls only run, and no program calls the host."""

import functools
import importlib
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import jaxcontact as jc

INLINE = 1_000
"""XLA runs a program of fewer estimated operations in the caller's thread: 950 so, 1,499 not."""

# JAX calls this for a primitive outside a program, and for a traced program.
WORK = {"apply_primitive", "trace_to_jaxpr"}


def work_of(call):
    """How often a call makes JAX compute out of a program, or trace one."""
    seen = []

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_name in WORK:
            seen.append(frame.f_code.co_name)

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    return seen


def test_the_counter_counts():
    assert "apply_primitive" in work_of(lambda: jnp.sin(jnp.asarray([1.0, 2.0])))
    assert "trace_to_jaxpr" in work_of(lambda: jax.jit(lambda x: jnp.cos(x) + 17.0)(1.0))


_traced = []


class Counting(jc.AbstractLaw):
    """Kelvin and Voigt's force by a user who counts how often it is traced."""

    c: jax.Array | float
    tension = True

    def force(self, indentation, velocity, contact, impact_velocity):
        _traced.append(1)
        return contact.stiffness * indentation + self.c * velocity


def hu_guo(e, mass, stiffness, velocity, **options):
    law, contact = jc.HuGuo(e=e), jc.Contact(mass, stiffness)
    return jc.impact(law, contact, velocity, **options)


NUMBERS = [(0.5, 1.0, 1e8, 2.0), (0.6, 0.03, 3e5, 0.1), (1, 2, 10**9, 1)]


def arrays(numbers):
    return [jnp.asarray(float(x)) for x in numbers]


CALLS = {
    # A solve by event is that of the push.
    **{method: functools.partial(hu_guo, method=method) for method in ("exact", "phase")},
    "push": lambda e, m, K, v: hu_guo(e, m, K, v, external_force=m),
    "traced exponent": lambda e, m, K, v: jc.impact(
        jc.HuGuo(e=e), jc.Contact(m, K, jnp.asarray(1 + float(e) / 2)), v
    ),
    "restitution": lambda e, m, K, v: jc.restitution(jc.HuGuo(e=e)),
    "restitution in place": lambda e, m, K, v: jc.restitution(jc.HuGuo(e=e), jc.Contact(m, K), v),
    "restitution of a speed": lambda e, m, K, v: jc.restitution(
        jc.ConstantDamping(c=K), jc.Contact(m, K), v
    ),
    "a user's law": lambda e, m, K, v: jc.trajectory(Counting(c=e), jc.Contact(m, 1e6, 1.0), v),
}
# Outside of their programs these compute nothing.
PLAIN = {"exact", "phase", "restitution", "restitution in place"}


@pytest.mark.parametrize("name", CALLS)
def test_new_numbers_compile_nothing(name, compiled):
    CALLS[name](*NUMBERS[0])
    traced = len(_traced)
    assert name != "a user's law" or traced > 0
    jnp.asarray(1.0)  # JAX makes an array of a number by a program of its own
    compiled.clear()
    # A whole number is another type in a law that does not convert it.
    for numbers in NUMBERS[1:2] if name == "a user's law" else NUMBERS[1:]:
        CALLS[name](*numbers)
        CALLS[name](*arrays(numbers))
    assert not compiled and len(_traced) == traced
    if name in PLAIN:
        assert work_of(lambda: CALLS[name](*NUMBERS[1])) == []


def test_another_shape_or_exponent_does_compile(compiled):
    hu_guo(*NUMBERS[0])
    for call in (
        lambda: hu_guo(*arrays(NUMBERS[0])[:3], jnp.arange(1.0, 18.0)),
        lambda: jc.impact(jc.HuGuo(e=0.5), jc.Contact(1.0, 1e8, 1.4375), 2.0),
    ):
        compiled.clear()
        call()
        assert compiled


@pytest.mark.parametrize("n", [1.5, jnp.asarray(1.5)], ids=["static", "leaf"])
def test_an_impact_by_formula_needs_no_other_thread(n):
    impact = importlib.import_module("jaxcontact._impact.impact")
    problem = impact.problem_of(jc.HuGuo(e=0.7), jc.Contact(1.0, 1.4e8, n), 3.0)
    run = jax.jit(lambda problem: impact._begun(problem, impact.method_of("exact")))
    assert run.lower(problem).compile().cost_analysis()["flops"] < INLINE


def test_objects_are_those_that_equinox_builds():
    for make, *numbers in ((jc.Contact, 0.25, 0.75), (jc.HuGuo, 0.5), (jc.JKR, 0.5)):
        usual = type(eqx.Module).__call__(make, *numbers)
        assert all(eqx.tree_equal(make(*numbers), usual, typematch=True) for _ in range(2))
    assert work_of(lambda: (jc.HuGuo(e=0.6), jc.Contact(2.0, 3.0))) == []
    for wrong in (True, 5.0, "1.5", None):
        with pytest.raises(ValueError, match="`exponent`"):
            jc.Contact(1.0, 2.0, wrong)


PLACE = {"e": jnp.asarray(0.6), "K": jnp.asarray(3e8), "v": jnp.asarray(1.3)}


def everything(solve):
    """The text of one program: the value, alone and with both derivatives in a batch."""

    def point(p):
        return solve(p), jax.jacfwd(solve)(p), jax.grad(solve)(p)

    def program(p):
        return solve(p), jax.vmap(point)(jax.tree.map(lambda x: jnp.stack([x, x]), p))

    return str(jax.make_jaxpr(program)(PLACE))


def contact(p):
    return jc.Contact(0.7, p["K"])


def total(p, law=None, **options):
    law = law or jc.HuGuo(e=p["e"])
    hit = jc.impact(law, contact(p), p["v"], **options)
    return hit.restitution + hit.duration + hit.max_force + hit.compression_time


def trajectory(p):
    path = jc.trajectory(jc.KuwabaraKono(A=1e-6 * p["e"]), contact(p), p["v"], samples=3)
    return jnp.sum(path.indentation + path.energy.dissipated)


def bounce(p, **options):
    run = jc.bounce(jc.HuGuo(e=p["e"]), contact(p), p["v"], bounces=2, **options)
    return jnp.sum(run.height + run.time)


PROGRAMS = {
    **{x: functools.partial(total, method=x) for x in ("exact", "phase", "event")},
    "pushed": lambda p: total(p, external_force=p["e"]),
    "viscoelastic": lambda p: total(p, jc.KuwabaraKono(A=1e-6 * p["e"])),
    "restitution": lambda p: (
        jc.restitution(jc.HuGuo(e=p["e"]))
        + jc.restitution(jc.ConstantDamping(c=1e7), contact(p), p["v"])
    ),
    "trajectory": trajectory,
    "bounce": bounce,
    "bounce with gravity in contact": lambda p: bounce(p, gravity_in_contact=True),
}


QUICK = {"exact", "viscoelastic", "restitution", "bounce"}


@pytest.mark.slow(*(PROGRAMS.keys() - QUICK), reason="value, jacfwd and grad alone and in a batch")
@pytest.mark.parametrize("name", PROGRAMS)
def test_no_program_has_a_callback(name):
    assert "callback" not in everything(PROGRAMS[name])


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

    assert "callback" not in str(jax.make_jaxpr(lambda p: square(p["e"]) + 0)(PLACE))
    assert "callback" in everything(lambda p: square(p["e"]))
