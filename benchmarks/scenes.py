"""Costs of whole scenes: `python -m benchmarks scenes [--only GROUP]`.

The cost of an instantaneous impact and of a gradient, in empty steps and in values; the gain by
skipping unneeded parts; and beds, in CPU time with compiling. Other ways beside ours are in
benchmarks/run_time_error.py.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks import scene_skips
from benchmarks.study import Study, machine_in_short
from benchmarks.time_and_error.measure import timed
from jaxcontact._scene.arrays.arrays import layout_of
from jaxcontact._scene.arrays.from_scene import inputs_of, scene_numbers
from jaxcontact._scene.contact_times.cells import grid_of
from jaxcontact._scene.engine.log import Log, blank_log
from jaxcontact._scene.engine.loop import advance, initial_state
from jaxcontact._scene.engine.state import Rules, RunState


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
    layout = layout_of(scene)
    numbers, _ = scene_numbers(inputs_of(scene), layout, contacts=False, soft=False)
    rules = Rules(False, "peak", 0)
    end, tolerance = jnp.asarray(1e6), jnp.asarray(1e-9)
    state = eqx.filter_jit(initial_state)(layout, numbers, rules, grid_of(layout, numbers))
    jitted = eqx.filter_jit(advance)
    nothing = jax.jit(empty, static_argnums=2)

    def of(rows: int) -> tuple[float, float, float]:
        log = blank_log(rows, layout, numbers.dtype, 0)
        run = functools.partial(jitted, layout, numbers, rules, state, log, end, tolerance)
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
    for axes, count in ((2, 3), (2, 6), (2, 12), (3, 4), (3, 8)):
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
    "skips": scene_skips.rows,
    "beds": beds,
}


def measure(known: dict | None, only: str | None) -> dict:
    """The groups that are asked for, over those of an earlier result."""
    groups = {k: rows() for k, rows in GROUPS.items() if only in (None, k)}
    return (known or {}) | {"machine": machine_in_short()} | groups


OPTIONS = {"--only": {"choices": GROUPS, "help": "one group of rows"}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
