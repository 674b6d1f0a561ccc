"""Loops that XLA compiles as one function on CPUs, and the flag that makes it do so."""

import os
import re
import subprocess
import sys

import jax
import pytest

import jaxcontact as jc

LAW = jc.HuGuo(e=0.8)
CONTACT = jc.Contact(mass=1.0, stiffness=1e4)
KEY = "xla_cpu_small_while_loop_byte_threshold"


def by_event(e):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 4.2, method=jc.Event()).restitution


def under_a_push(e):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 4.2, external_force=-9.81).restitution


def to_rest(height):
    how = {"method": jc.Event(), "gravity_in_contact": True, "bounces": 20}
    return jc.bounce(jc.Damped(alpha=0.6), CONTACT, height, gravity=9.81, **how).rest_time


def scene_of(friction=None, spheres=3):
    def run(speed):
        discs = [
            jc.Sphere(0.1, 0.5, position=[0.7 * k, 0.3], velocity=[speed if k == 0 else 0.0, 0.0])
            for k in range(spheres)
        ]
        floor = jc.Plane(point=[0.0, 0.0], normal=[0.0, 1.0])
        scene = jc.Scene([*discs, floor], LAW, gravity=[0.0, -9.81], friction=friction)
        return jc.simulate(scene, 1.0, instantaneous=True, max_impacts=64).velocity[-1]

    return run


def mechanism(gravity):
    system, start = jc.systems.double_pendulum(gravity=gravity)
    return jc.simulate(system, 2.0, **start, max_impacts=8).final.velocity


LOOPS = {
    "impact by event": (by_event, 0.5),
    "its derivative": (jax.grad(by_event), 0.5),
    "impact under a push": (under_a_push, 0.5),
    "bounce to rest with weight": (to_rest, 0.05),
    "instantaneous scene": (scene_of(), 0.1),
    "friction, two bodies found at a time": (scene_of(jc.RigidCoulomb(mu=0.3), spheres=9), 0.1),
    "mechanism": (mechanism, 9.81),
}


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
