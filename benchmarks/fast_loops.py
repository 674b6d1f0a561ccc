"""Loops with and without the flag of `jaxcontact.fast_loops`, each in a process of its own.

Ratios of the times of a call and of the CPU times of compiling it, and the largest relative
difference of results.
"""

import json
import os
import subprocess
import sys
import time

import jax
import numpy as np

import jaxcontact as jc
from benchmarks.study import ROOT, Study, by_line, lines
from benchmarks.time_and_error.measure import timed

CONTACT = jc.Contact(mass=1.0, stiffness=1e4)
LAW = jc.HuGuo(e=0.8)


def by_event(e):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 4.2, method=jc.Event()).restitution


def under_a_push(e):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 4.2, external_force=-9.81).restitution


def to_rest(height):
    how = {"method": jc.Event(), "gravity_in_contact": True, "bounces": 20}
    return jc.bounce(jc.Damped(alpha=0.6), CONTACT, height, gravity=9.81, **how).rest_time


def scene_of(friction=None, spheres=3, instantaneous=True):
    def run(speed):
        discs = [
            jc.Sphere(0.1, 0.5, position=[0.7 * k, 0.3], velocity=[0.0 if k else speed, 0.0])
            for k in range(spheres)
        ]
        floor = jc.Plane(point=[0.0, 0.0], normal=[0.0, 1.0])
        how = {"stiffness": 1e7, "gravity": [0.0, -9.81], "friction": friction}
        scene = jc.Scene([*discs, floor], LAW, **how)
        run = jc.simulate(scene, 1.0, instantaneous=instantaneous, max_impacts=64)
        return run.velocity[-1]

    return run


def over_time(e):
    return jc.trajectory(jc.HuGuo(e=e), CONTACT, 4.2).force


def mechanism(gravity):
    system, start = jc.systems.double_pendulum(gravity=gravity)
    return jc.simulate(system, 2.0, **start, max_impacts=8).final.velocity


LOOPS = {
    "impact by event": (by_event, 0.5),
    "its derivative": (jax.grad(by_event), 0.5),
    "impact under a push": (under_a_push, 0.5),
    "bounce to rest with weight": (to_rest, 0.05),
    "instantaneous scene of 3 discs": (scene_of(), 0.1),
    "the same of 9 discs with friction": (scene_of(jc.RigidCoulomb(mu=0.3), spheres=9), 0.1),
    "double pendulum": (mechanism, 9.81),
    "trajectory": (over_time, 0.5),
}
SOFT = {"soft scene of 3 discs": (scene_of(instantaneous=False), 0.1)}


def measured():
    rows = {}
    for name, (function, at) in (LOOPS | SOFT).items():
        lowered, start = jax.jit(function).lower(at), time.process_time()
        program, compiling = lowered.compile(), time.process_time() - start
        row, result = timed(lambda program=program, at=at: program(at), True)
        rows[name] = row["seconds"], compiling, np.asarray(result).ravel().tolist()
    return rows


HERE = "import json; from benchmarks.fast_loops import measured; print(json.dumps(measured()))"


def measure(known):
    off, on = (
        json.loads(
            subprocess.check_output(
                [sys.executable, "-c", HERE],
                cwd=ROOT,
                env={**os.environ, "JAXCONTACT_FAST_LOOPS": flag, "JAX_ENABLE_X64": "1"},
            )
        )
        for flag in ("0", "1")
    )
    cells = []
    for name, (slow, first, one) in off.items():
        fast, second, other = on[name]
        apart = np.max(np.abs(np.subtract(one, other))) / np.max(np.abs(one))
        cells.append([name, f"{slow / fast:.1f}", f"{second / first:.2f}", f"{apart:.1g}"])
    return cells


def table(cells):
    return lines(["program", "times as fast", "compiling, ratio", "difference"], cells)


STUDY = Study(__file__, __doc__, measure, table, "accuracy", text=by_line)
