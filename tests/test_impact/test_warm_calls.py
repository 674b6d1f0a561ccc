"""A call with compiled programs only runs them."""

import sys

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


def test_objects_are_built_without_primitives():
    jc.HuGuo(e=0.5), jc.Contact(1.0, 2.0)
    assert work_of(lambda: (jc.HuGuo(e=0.6), jc.Contact(2.0, 3.0))) == []
