"""Costs of whole scenes: `python -m benchmarks scenes [--only GROUP]`.

The cost of an instantaneous impact and of a gradient, in empty steps and in values; the gain by
skipping unneeded parts; and beds, in CPU time with compiling. Other ways beside ours are in
benchmarks/run_time_error.py.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import jaxcontact as jc
from benchmarks.study import Study, machine_in_short
from benchmarks.time_and_error.measure import timed
from jaxcontact import AbstractLaw
from jaxcontact._scene.arrays.arrays import layout_of
from jaxcontact._scene.arrays.from_scene import arrays_of, inputs_of
from jaxcontact._scene.contact_times.cells import grid_of
from jaxcontact._scene.engine.log import Log, blank_log
from jaxcontact._scene.engine.loop import advance, initial_state
from jaxcontact._scene.engine.state import Rules, RunState, RunTask

ELASTIC = jc.ExactRestitution(e=1.0)


class Skip(NamedTuple):
    """A scene with and without something null, as functions of a factor of its speeds.

    Both return the final velocities that are to be the same; `soft`: impacts take time.
    """

    lean: Callable[[Array], Array]
    whole: Callable[[Array], Array]
    soft: bool = False


class PlainHertz(AbstractLaw):
    """Hertz's force, of which nothing is known but the force."""

    tension = False

    def force(self, indentation, velocity, contact, impact_velocity):
        depth = jnp.maximum(indentation, 0)
        safe = jnp.where(depth > 0, depth, 1)
        return contact.stiffness * jnp.where(depth > 0, safe**contact.exponent, 0)


def velocity(bodies, law, duration, count=None, *, instantaneous=True, room=64, **scene) -> Array:
    """At the end, of the first `count` spheres."""
    times = scene.pop("times", None)
    made = jc.Scene(bodies, law, **scene)
    run = jc.simulate(made, duration, times=times, instantaneous=instantaneous, max_impacts=room)
    return jnp.where(run.status == jc.Ending.COMPLETED, run.velocity[-1, :count], jnp.nan)


PLACES = np.array([[0.7, 0.8], [1.6, 2.9], [2.8, 1.1], [3.2, 3.1], [0.8, 2.0]])
SPEEDS = np.array([[1.0, 0.3], [-0.4, -0.9], [0.5, 0.8], [-0.7, 0.2], [0.2, -0.6]])
BOX = jc.Box([0.0, 0.0], [4.0, 4.0])


def box(factor, *, pins="fixed", **scene):
    """Five discs in a box, among four that stand."""
    corners = np.array([[1.2, 1.5], [2.2, 2.2], [3.4, 2.0], [2.0, 0.4]])
    balls = [jc.Sphere(0.2, 1.0, x, factor * v) for x, v in zip(PLACES, SPEEDS, strict=True)]
    how = {"mass": None, "fixed": True} if pins == "fixed" else {"mass": 1e30}
    stand = [jc.Sphere(0.2, position=x, **how) for x in corners]
    return velocity([*balls, *stand, BOX], ELASTIC, 1.5, 5, **scene)


def line(factor, dimensions=1, law=ELASTIC, gap=0.3, duration=6.0, **how):
    """Five unequal balls between two walls."""

    def vector(x):
        return jnp.stack([x, *[jnp.zeros_like(x)] * (dimensions - 1)])

    step = 0.2 + gap
    speeds = np.array([1.0, -0.4, 0.7, -1.1, 0.3])
    balls = [
        jc.Sphere(
            0.1, 1.0 + 0.3 * k, vector(jnp.asarray(step * k)), vector(factor * v),
            name=f"ball {k % 2}",
        )
        for k, v in enumerate(speeds)
    ]  # fmt: skip
    one = np.eye(dimensions)[0]
    walls = [jc.Plane(-0.5 * one, one), jc.Plane((4 * step + 0.5) * one, -one)]
    return velocity([*balls, *walls], law, duration, **how)[:, 0]


def alike(law):
    """The same law for all pairs, as a table."""
    return {("ball 0", "ball 1"): law(), ("ball 0", "ball 0"): law(), "default": law()}


def touching(factor, law):
    """A ball that hits four others in a row: all impacts are coupled."""
    balls = [jc.Sphere(0.1, 1.0, [0.2 * k], (factor * float(k == 0))[None]) for k in range(5)]
    return velocity(balls, law, 0.1, instantaneous=False, room=16, stiffness=1e6)


def sleepers(factor, hop):
    """A ball that bounces, and four that rest, or hop."""
    bouncing = jc.Sphere(0.1, 1.0, [0.0, 0.9], jnp.stack([0.0 * factor, factor]))
    low = [jc.Sphere(0.1, 1.0, [1.0 + k, 0.1 + (hop > 0) * 1e-3], [0.0, hop]) for k in range(4)]
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0])
    law = jc.ExactRestitution(e=0.9)
    return velocity([bouncing, *low, floor], law, 1.5, 1, room=512, gravity=[0.0, -9.81])


SKIPS = {
    "no gravity: none, or zeros": Skip(box, lambda s: box(s, gravity=[0.0, 0.0])),
    "one dimension, or two": Skip(line, lambda s: line(s, 2)),
    "one shared law, or a table of equal ones": Skip(
        lambda s: line(s, law=jc.MarhefkaOrin(a=0.05), stiffness=1e6),
        lambda s: line(s, law=alike(lambda: jc.MarhefkaOrin(a=0.05)), stiffness=1e6),
    ),
    "no path, or 512 times": Skip(line, lambda s: line(s, times=np.linspace(0, 6, 512))),
    "pairs that stand: fixed, or of 1e30 kg": Skip(box, lambda s: box(s, pins="heavy")),
    "four balls at rest, or hopping": Skip(lambda s: sleepers(s, 0.0), lambda s: sleepers(s, 0.3)),
    "Hertz by its closed form, or by its force": Skip(
        lambda s: line(s, law=jc.Hertz(), stiffness=1e9, instantaneous=False),
        lambda s: line(s, law=PlainHertz(), stiffness=1e9, instantaneous=False),
        soft=True,
    ),
    "Hertz, or a damping of 0": Skip(
        lambda s: touching(s, jc.Hertz()),
        lambda s: touching(s, jc.Damped(alpha=0.0)),
        soft=True,
    ),
}


def skips(calls: int = 40) -> list[dict]:
    """Seconds of both of every pair, jitted and called in turn, the least of so many calls."""
    found = []
    for name, (lean, whole, _) in SKIPS.items():
        ways, least = [jax.jit(lean), jax.jit(whole)], [np.inf, np.inf]
        ends = [np.asarray(way(jnp.asarray(1.0))) for way in ways]
        for _ in range(calls):
            for k, way in enumerate(ways):
                start = time.perf_counter()
                jax.block_until_ready(way(jnp.asarray(1.0)))
                least[k] = min(least[k], time.perf_counter() - start)
        row = {"skip": name, "seconds": least[0], "seconds_whole": least[1]}
        row |= {
            "ratio": least[1] / least[0],
            "difference": float(np.max(np.abs(np.subtract(*ends)))),
        }
        print(f"{name:45} {1e6 * least[0]:9.1f} us, else {row['ratio']:6.2f} times", flush=True)
        found.append(row)
    return found


def best(function: Callable) -> tuple[float, float, np.ndarray]:
    """Seconds of the first call more than the best of the others, that best, and the result."""
    row, answer = timed(function, True)
    return row["compile_s"], row["seconds"], np.asarray(answer)


def hard_box(count: int) -> jc.Scene:
    """Elastic discs on a lattice in a box, a tenth of it full, with random velocities."""
    side = int(np.ceil(np.sqrt(count)))
    radius = 0.5
    spacing = radius * np.sqrt(np.pi / 0.1)
    rng = np.random.default_rng(0)
    places = [((k % side + 0.5) * spacing, (k // side + 0.5) * spacing) for k in range(count)]
    speeds = rng.standard_normal((count, 2))
    spheres = [jc.Sphere(radius, 1.0, x, v) for x, v in zip(places, speeds, strict=True)]
    box = jc.Box([0.0, 0.0], [side * spacing] * 2)
    return jc.Scene([*spheres, box], jc.ExactRestitution(e=1.0))


def empty(state: RunState, log: Log, rows: int) -> tuple[RunState, Log]:
    """A loop that writes two rows of a state and one of a log, and decides nothing."""

    def step(k, carry):
        state, log = carry
        count = state.time.shape[0]
        i, j = k % count, (k + 1) % count

        def put(all):
            if all.ndim == 0:
                return all + 1 if jnp.issubdtype(all.dtype, jnp.integer) else all
            return all.at[i].set(all[j]).at[j].set(all[i])

        state = jax.tree.map(put, state)
        return state, jax.tree.map(lambda all: all.at[k].set(all[k - 1]), log)

    return jax.lax.fori_loop(1, rows, step, (state, log))


def impact_cost(count: int, impacts: int) -> dict:
    """What an instantaneous impact costs among so many bodies, in empty steps of a loop.

    By the difference of two lengths, so that the price of the call drops out.
    """
    scene = hard_box(count)
    model, _ = arrays_of(inputs_of(scene), layout_of(scene), contacts=False, soft=False)
    rules = Rules(False, "peak", 0)
    task = RunTask(model, rules, jnp.asarray(1e6), jnp.asarray(1e-9))
    state = eqx.filter_jit(initial_state)(model, rules, grid_of(model))
    jitted = eqx.filter_jit(advance)
    nothing = jax.jit(empty, static_argnums=2)

    def of(rows: int) -> tuple[float, float, float]:
        log = blank_log(rows, model, 0)
        run = functools.partial(jitted, task, state, log)
        compile_s, seconds, written = best(lambda: run()[2])
        # With a full cell the run would stop early and seem fast.
        assert int(written) == rows
        _, without, _ = best(lambda: nothing(state, log, rows)[0].time)
        return compile_s, seconds, without

    compile_s, long, long_empty = of(impacts)
    _, short, short_empty = of(impacts // 8)
    rest = impacts - impacts // 8
    each, step = (long - short) / rest, (long_empty - short_empty) / rest
    row = {"bodies": count, "impacts": impacts, "us_impact": 1e6 * each, "us_step": 1e6 * step}
    row |= {"steps": each / step, "compile_s": compile_s}
    print(
        f"an impact among {count:5}: {row['steps']:6.1f} empty steps of {row['us_step']:.2f} us",
        flush=True,
    )
    return row


def gradient_cost(count: int, impacts: int) -> dict:
    """A reverse gradient of one scalar by all velocities at the start, in values."""
    scene = hard_box(count)
    places = np.stack([s.position for s in scene.spheres])
    speeds = jnp.stack([s.velocity for s in scene.spheres])
    end = 0.25
    while len(times := jc.simulate(scene, end, instantaneous=True).impacts.time) <= impacts:
        end *= 2
    end = float(times[impacts - 1] + times[impacts]) / 2

    def scalar(velocity):
        spheres = [jc.Sphere(0.5, 1.0, places[k], velocity[k]) for k in range(count)]
        moved = jc.Scene([*spheres, scene.bodies[-1]], jc.ExactRestitution(e=1.0))
        run = jc.simulate(moved, end, instantaneous=True, max_impacts=impacts + 1)
        return jnp.sum(jnp.square(run.position[-1]))

    value, gradient = jax.jit(scalar), jax.jit(jax.grad(scalar))
    _, one, _ = best(lambda: value(speeds))
    compile_s, two, _ = best(lambda: gradient(speeds))
    row = {"bodies": count, "impacts": impacts, "value_s": one, "gradient_s": two}
    row |= {"ratio": two / one, "compile_s": compile_s}
    print(f"a gradient among {count:5}, {impacts} impacts: {two / one:5.2f} values", flush=True)
    return row


def beds() -> list[dict]:
    """Balls of 2 cm that settle in a box, in CPU seconds of the first and a later run."""
    rows = []
    for axes, count in ((2, 3), (2, 6), (2, 12), (2, 24), (3, 4), (3, 8), (3, 16)):
        low, high = [0.0] * axes, [0.06] * (axes - 1) + [0.02 * count]
        balls = jc.random_spheres(count, low=low, high=high, radius=0.01, mass=0.01, seed=1)
        law, down = jc.HuGuo(e=0.5), [0.0] * (axes - 1) + [-9.81]
        scene, times = jc.Scene([*balls, jc.Box(low, high)], law, stiffness=1e6, gravity=down), []
        for _ in range(2):
            start = time.process_time()
            run = jc.simulate(scene, 0.2, throw=False, progress=False)
            times.append(time.process_time() - start)
        row = {"axes": axes, "balls": count, "impacts": len(run.impacts), "ok": bool(run.ok)}
        rows.append(row | {"first_s": times[0], "later_s": times[1]})
        print(rows[-1], flush=True)
    return rows


GROUPS: dict[str, Callable[[], list[dict]]] = {
    "impacts": lambda: [impact_cost(2, 4096), impact_cost(128, 2048), impact_cost(2048, 512)],
    "gradients": lambda: [gradient_cost(2, 64), gradient_cost(128, 256)],
    "skips": skips,
    "beds": beds,
}


def measure(known: dict | None, only: str | None) -> dict:
    """The groups that are asked for, over those of an earlier result."""
    groups = {k: rows() for k, rows in GROUPS.items() if only in (None, k)}
    return (known or {}) | {"machine": machine_in_short()} | groups


OPTIONS = {"--only": {"choices": GROUPS, "help": "one group of rows"}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
