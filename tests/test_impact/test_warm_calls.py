"""A call with compiled programs only runs them."""

import importlib
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import jaxcontact as jc

LAW, CONTACT = jc.HuGuo(e=0.7), jc.Contact(1.0, 1.4e8)

CALLS = {
    "impact": lambda speed: jc.impact(LAW, CONTACT, speed),
    "phase": lambda speed: jc.impact(LAW, CONTACT, speed, method="phase"),
    "restitution": lambda speed: jc.restitution(LAW),
    "restitution of a speed": lambda speed: jc.restitution(LAW, CONTACT, speed),
}

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


@pytest.mark.parametrize("name", CALLS)
def test_a_warm_call_computes_nothing_by_itself(name):
    CALLS[name](3.0)
    assert work_of(lambda: CALLS[name](4.0)) == []


@pytest.mark.parametrize("n", [1.5, jnp.asarray(1.5)], ids=["static", "leaf"])
def test_an_impact_by_formula_needs_no_other_thread(n):
    impact = importlib.import_module("jaxcontact._impact.impact")
    problem = impact.problem_of(LAW, jc.Contact(1.0, 1.4e8, n), 3.0)
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
