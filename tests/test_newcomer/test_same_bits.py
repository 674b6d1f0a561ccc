"""The same call gives the same bits in another process, and in a batch of another size."""

import hashlib
import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

ROOT = Path(__file__).parents[2]
LAW, CONTACT = jc.HuGuo(e=0.7), jc.Contact(1.0, 1e6)
SPEEDS = np.linspace(0.3, 1.7, 7)


def impact(**how):
    def outcome(v):
        hit = jc.impact(LAW, CONTACT, v, **how)
        return jnp.stack([hit.restitution, hit.duration, hit.max_indentation])

    return outcome


def billiard(velocity):
    balls = [jc.Sphere(0.05, 0.1, [x, 0.3], v) for x, v in ((0.0, velocity), (0.2, None))]
    bodies = [*balls, jc.Plane([0.0, 0.0], [0.0, 1.0])]
    return jc.Scene(bodies, LAW, stiffness=1e6, gravity=[0.0, -9.8])


def scene(v, instantaneous=True):
    how = {"instantaneous": instantaneous, "max_impacts": 16}
    return jc.simulate(billiard(jnp.stack([v, 0 * v])), 0.4, **how).position[-1]


def mechanism(v):
    friction = jc.RigidCoulomb(mu=0.3)
    incline, start = jc.systems.shaken_incline(0.1, (5e-3, 30.0), friction=friction)
    first = jnp.zeros(len(start["velocity"])).at[0].set(v / 10)
    start = {**start, "velocity": jnp.asarray(start["velocity"]) + first}
    return jc.simulate(incline, 0.1, **start, v0=0.1, max_impacts=8).final.velocity


CALLS = {
    "impact, exact": impact(method="exact"), "impact by event": impact(method="event"),
    "impact under a push": impact(external_force=-9.8),
    "trajectory": lambda v: jc.trajectory(LAW, CONTACT, v, samples=9).force,
    "scene, instantaneous": scene, "scene, soft": lambda v: scene(v, False), "mechanism": mechanism,
}  # fmt: skip


def batch(call, size):
    return np.asarray(jax.jit(jax.vmap(call))(SPEEDS[:size]))


def found():
    """Of every call: a digest of seven lanes; whether three and one alone are the same."""
    rows = {}
    for name, call in CALLS.items():
        whole, alone = batch(call, 7), np.asarray(call(jnp.asarray(SPEEDS[2])))
        same = np.array_equal(batch(call, 3), whole[:3]), np.array_equal(alone, whole[2])
        rows[name] = [hashlib.sha256(whole).hexdigest(), *map(bool, same)]
    return rows


@pytest.mark.nightly
def test_the_table_of_the_page_is_true():
    """Two processes compile for themselves, with the settings of users."""
    text = (ROOT / "docs" / "accuracy.md").read_text()
    rows = re.findall(r"^\| ([^|]+) \| (yes|no) \| (yes|no) \| (yes|no) \|$", text, re.MULTILINE)
    table = {name: [word == "yes" for word in words] for name, *words in rows}
    env = {name: os.environ[name] for name in ("PATH", "PYTHONPATH", "HOME") if name in os.environ}
    call = [sys.executable, "-m", "tests.test_newcomer.test_same_bits"]
    both = [subprocess.run(call, cwd=ROOT, env=env, check=True, capture_output=True) for _ in "ab"]
    one, other = (json.loads(run.stdout) for run in both)
    assert {name: [row[0] == other[name][0], *row[1:]] for name, row in one.items()} == table


def test_scenes_and_runs_are_pickled():
    whole = billiard(None)
    run = jc.simulate(whole, 0.4, instantaneous=True, max_impacts=16)
    one, again, final = (pickle.loads(pickle.dumps(x)) for x in (whole, run, run.final))
    assert (repr(one), repr(again), repr(final)) == (repr(whole), repr(run), repr(run.final))
    np.testing.assert_array_equal(again.position, run.position)
    np.testing.assert_array_equal(again.at(0.33).position, run.at(0.33).position)
    ends = [jc.simulate(x, 0.1, instantaneous=True, max_impacts=16) for x in (final, run.final)]
    np.testing.assert_array_equal(*(end.position[-1] for end in ends))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(json.dumps(found()))
