"""Loops that XLA compiles as one function on CPUs, and the flag that makes it do so."""

import os
import re
import subprocess
import sys

import jax
import pytest

from benchmarks.fast_loops import LOOPS

KEY = "xla_cpu_small_while_loop_byte_threshold"


def loops_in_pieces(text):
    """Return where loops of a compiled program are not within a small function, if it has one."""
    bodies = dict(re.findall(r"^(?:ENTRY )?%([\w.\-]+) [^\n]*\{\n(.*?)^\}", text, re.M | re.S))
    waiting = re.findall(r"to_apply=%([\w.\-]+)[^\n]*small_call=\"true\"", text)
    assert waiting
    within = set(waiting)
    while waiting:
        named = set(re.findall(r"%([\w.\-]+)", bodies[waiting.pop()])) & bodies.keys()
        waiting += named - within
        within |= named
    rest = "".join(bodies[name] for name in bodies.keys() - within)
    return re.findall(r" while\([^\n]*?op_name=\"([^\"]*)", rest), rest.count(" while(")


@pytest.mark.parametrize("name", LOOPS)
def test_each_loop_is_one_function(name):
    function, at = LOOPS[name]
    left = loops_in_pieces(jax.jit(function).lower(at).compile().as_text())
    assert left == ([], 0)


PROGRAM = """
import sys, jax, jax.numpy as jnp
if "late" in sys.argv: jax.devices()
import jaxcontact as jc
def far(x):
    return jax.lax.while_loop(lambda c: c[0] < 9, lambda c: (c[0] + 1, jnp.sin(c[1])), (0, x))[1]
text = jax.jit(far).lower(jnp.ones(400)).compile().as_text()
found = jc.fast_loops()
assert bool(found) == found.on == ('small_call="true"' in text), (found, text)
print(found.on, found.reason)
"""


@pytest.mark.parametrize(
    ("flags", "choice", "when", "on", "reason"),
    [
        ("--xla_cpu_use_fusion_emitters=false", "", "", True, "set when"),
        (f"--xla_backend_extra_options={KEY}=512", "", "", False, "=512"),
        ("", "0", "", False, "JAXCONTACT_FAST_LOOPS is 0"),
        ("", "", "late", False, "import jaxcontact first"),
        (f"--xla_backend_extra_options={KEY}=1000000", "0", "", False, "JAXCONTACT_FAST_LOOPS"),
    ],
    ids=["set", "user's", "refused", "late", "refused in a child process"],
)
def test_what_is_said_is_what_xla_does(flags, choice, when, on, reason):
    settings = {**os.environ, "XLA_FLAGS": flags, "JAXCONTACT_FAST_LOOPS": choice}
    command = [sys.executable, "-c", PROGRAM, when]
    done = subprocess.run(command, env=settings, capture_output=True, text=True, check=True)
    found, _, why = done.stdout.partition(" ")
    assert found == str(on)
    assert reason in why
