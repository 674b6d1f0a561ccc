"""Loops that XLA compiles as one function on CPUs, and the flag that makes it do so."""

import os
import re
import subprocess
import sys

import jax
import pytest

from benchmarks.fast_loops import LOOPS

LAW = jc.HuGuo(e=0.8)
KEY = "xla_cpu_small_while_loop_byte_threshold"


def computations(text):
    """Return the instructions of each computation of a compiled program, and those it calls."""
    lines, name = {}, None
    for line in text.splitlines():
        if start := re.match(r"(?:ENTRY )?%([\w.\-]+) .*\{$", line):
            lines[name := start[1]] = []
        elif name and " = " in line:
            lines[name].append(line)
    calls = {
        name: {word for line in body for word in re.findall(r"%([\w.\-]+)", line)} & set(lines)
        for name, body in lines.items()
    }
    return lines, calls


def loops_in_pieces(text):
    """Return the loops of a compiled program that are not within one function."""
    lines, calls = computations(text)
    tagged = [line for body in lines.values() for line in body if 'small_call="true"' in line]
    waiting = [re.search(r"to_apply=%([\w.\-]+)", line)[1] for line in tagged]
    within = set()
    while waiting:
        name = waiting.pop()
        if name not in within:
            within.add(name)
            waiting += calls[name]
    return [
        line for name in lines.keys() - within for line in lines[name] if " while(" in line
    ], tagged


@pytest.mark.parametrize("name", LOOPS)
def test_each_loop_is_one_function(name):
    function, at = LOOPS[name]
    left, tagged = loops_in_pieces(jax.jit(function).lower(at).compile().as_text())
    assert tagged, f"{name}: no loop was compiled as one function"
    places = [re.search(r'op_name="([^"]*)"', line) for line in left]
    assert not left, f"{name}: in pieces {[place and place[1] for place in places]}"


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
