"""Loops that XLA compiles as one function on CPUs, and the flag that makes it do so."""

import json
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


CASES = {
    "set": ("--xla_cpu_use_fusion_emitters=false", "", "", True, "set when"),
    "user's": (f"--xla_backend_extra_options={KEY}=512", "", "", False, "=512"),
    "refused": ("", "0", "", False, "JAXCONTACT_FAST_LOOPS is 0"),
    "late": ("", "", "late", False, "import jaxcontact first"),
    "refused in a child process": (
        f"--xla_backend_extra_options={KEY}=1000000",
        *("0", "", False, "JAXCONTACT_FAST_LOOPS"),
    ),
}
# JAX reads the flags with its first backend: each case is a copy of a process that has imported it.
PROGRAM = """
import json, os, sys, jax, jax.numpy as jnp, diffrax, optimistix
def far(x):
    return jax.lax.while_loop(lambda c: c[0] < 9, lambda c: (c[0] + 1, jnp.sin(c[1])), (0, x))[1]
for flags, choice, late, *_ in json.loads(sys.argv[1]):
    if os.fork():
        assert os.wait()[1] == 0
        continue
    os.environ.update(XLA_FLAGS=flags, JAXCONTACT_FAST_LOOPS=choice)
    if late: jax.devices()
    import jaxcontact as jc
    text = jax.jit(far).lower(jnp.ones(400)).compile().as_text()
    found = jc.fast_loops()
    assert bool(found) == found.on == ('small_call="true"' in text), (found, text)
    print(found.on, found.reason, flush=True)
    sys.exit()
"""


@pytest.fixture(scope="module")
def said():
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM, json.dumps([*CASES.values()])]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(zip(CASES, done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("name", CASES)
def test_what_is_said_is_what_xla_does(name, said):
    *_, on, reason = CASES[name]
    found, _, why = said[name].partition(" ")
    assert found == str(on)
    assert reason in why
