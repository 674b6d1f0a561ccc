"""Run time of whole scenes against their error: `python benchmarks/scenes.py [--out FILE]`.

Ours beside SciPy and plain diffrax, both restarted at events, each at the loosest tolerance that
reaches the error. Then what an instantaneous impact and a gradient cost, in steps and in values.
What counts are the ratios; compile time is kept apart.
"""

from __future__ import annotations

import argparse
import functools
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.integrate import DOP853, solve_ivp

import jaxcontact as jc
from jaxcontact._scene._log import Log, blank_log
from jaxcontact._scene._progress import Rules, State
from jaxcontact._scene._schedule import advance, begun
from jaxcontact._scene._system import layout_of, numbers_of

ERROR = 1e-9
"""Wanted of final velocities, relative to the largest speed at the start."""

REFERENCE = 2.3e-14
"""The tolerance of the reference, the least that SciPy takes."""

LADDER = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)


class Line(NamedTuple):
    """Soft spheres: (N, D) positions and velocities, radii, masses, α and K, and how long.

    `longest`: the step of diffrax that does not miss a contact; by trial (twice that missed some).
    """

    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    alpha: float
    stiffness: float
    duration: float
    longest: float


def line(gap: float, stiffness: float, duration: float) -> Line:
    """Five unequal spheres in a line, of which the first one strikes."""
    radius = np.array([0.1, 0.12, 0.09, 0.11, 0.1])
    mass = np.array([0.2, 10.0, 1.0, 5.0, 10.0])
    ends = np.cumsum(2 * radius + gap)
    position = (ends - radius)[:, None]
    velocity = np.array([[2.0], [0.0], [0.0], [0.0], [0.0]])
    longest = duration if gap < 1e-3 else 2e-3
    return Line(position, velocity, radius, mass, 0.3, stiffness, duration, longest)


def oblique(slowness: float) -> Line:
    """Two spheres that pass each other: v_t T/d is `slowness`."""
    radius, mass, speed = np.array([0.1, 0.1]), np.array([1.0, 1.0]), 1.0
    # T = 2.94 X/v for Hertz, about; X = (μ v²/K)^0.4.
    length = slowness * 0.2 / 2.94
    stiffness = 0.5 * speed**2 / length**2.5
    position = np.array([[-0.2, 0.12], [0.0, 0.0]])
    velocity = np.array([[1.4, 0.0], [0.0, 0.0]])
    return Line(position, velocity, radius, mass, 0.3, stiffness, 0.3, 3e-3)


class Segment(NamedTuple):
    """Between two events: which pairs are closed, and their closing speeds at touch."""

    closed: np.ndarray
    speed: np.ndarray


def pairs_of(line: Line) -> tuple[np.ndarray, np.ndarray]:
    """First and second sphere of the pairs that can meet: neighbours in a line."""
    first = np.arange(len(line.mass) - 1)
    return first, first + 1


def geometry(xp, line: Line, y):
    """Indentations, their rates, and the unit normals of all pairs."""
    first, second = pairs_of(line)
    count, dim = line.position.shape
    x, v = y[: count * dim].reshape(count, dim), y[count * dim :].reshape(count, dim)
    apart, relative = x[first] - x[second], v[first] - v[second]
    length = xp.sqrt(xp.sum(apart * apart, axis=1))
    normal = apart / length[:, None]
    depth = (line.radius[first] + line.radius[second]) - length
    return depth, -xp.sum(normal * relative, axis=1), normal, v


def accelerated(xp, line: Line, y, closed, speed):
    """Newton's equations of all spheres."""
    depth, rate, normal, v = geometry(xp, line, y)
    deep = xp.where(closed & (depth > 0), depth, 0.0)
    force = line.stiffness * deep * xp.sqrt(deep) * (1 + line.alpha * rate / speed)
    force = xp.where(closed, xp.maximum(force, 0.0), 0.0)[:, None] * normal
    none = xp.zeros((1, normal.shape[1]))
    # Neighbours in a line: sphere k is the first of pair k and the second of pair k - 1.
    push = xp.concatenate([force, none]) - xp.concatenate([none, force])
    return xp.concatenate([v.ravel(), (push / line.mass[:, None]).ravel()])


def ends(line: Line, k: int, sign: int) -> Callable:
    """The event at which a pair opens (1) or touches (-1)."""

    def gap(t, y):
        return sign * geometry(np, line, y)[0][k]

    gap.terminal, gap.direction = True, -1
    return gap


def by_scipy(line: Line, rtol: float) -> np.ndarray:
    """solve_ivp with DOP853, terminated by events and started again."""
    y = np.concatenate([line.position.ravel(), line.velocity.ravel()])
    count = len(line.mass) - 1
    closed, speed, t = np.zeros(count, bool), np.ones(count), 0.0
    while t < line.duration:
        found = solve_ivp(
            lambda t, y, c=closed, s=speed: accelerated(np, line, y, c, s),
            (t, line.duration),
            y,
            DOP853,
            events=[ends(line, k, 1 if closed[k] else -1) for k in range(count)],
            rtol=rtol,
            atol=1e-3 * rtol,
        )
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1:
            happens = np.array([len(times) > 0 for times in found.t_events])
            rate = geometry(np, line, y)[1]
            speed = np.where(happens & ~closed, rate, speed)
            closed = closed ^ happens
    return y[len(y) // 2 :]


class Fixed:
    """A scene as a static argument."""

    def __init__(self, line: Line):
        self.line = line


@functools.partial(jax.jit, static_argnums=0)
def _segment(fixed: Fixed, rtol, longest, t, y, closed, speed):
    line = fixed.line

    def gap(k: int) -> Callable:
        def of(t, y, args, **_):
            closed, _ = args
            depth = geometry(jnp, line, y)[0][k]
            return jnp.where(closed[k], depth, -depth)

        return of

    count = len(line.mass) - 1
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: accelerated(jnp, line, y, *args)),
        diffrax.Dopri8(),
        t,
        line.duration,
        None,
        y,
        args=(closed, speed),
        # Through a flight it would step over the touch and the opening that follows.
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol, dtmax=longest),
        event=diffrax.Event(
            [gap(k) for k in range(count)], optx.Newton(1e-13, 1e-13), direction=False
        ),
        max_steps=100_000,
        throw=False,
    )
    happens = jnp.stack(solution.event_mask)
    y = solution.ys[-1]
    speed = jnp.where(happens & ~closed, geometry(jnp, line, y)[1], speed)
    return solution.ts[-1], y, closed ^ happens, speed


def by_diffrax(fixed: Fixed, longest: float, rtol: float) -> np.ndarray:
    """A jitted solve up to the next event, called again and again, with a longest step in s."""
    line = fixed.line
    y = jnp.concatenate([jnp.ravel(line.position), jnp.ravel(line.velocity)])
    count = len(line.mass) - 1
    closed, speed, t = jnp.zeros(count, bool), jnp.ones(count), jnp.asarray(0.0)
    for _ in range(1000):
        t, y, closed, speed = _segment(fixed, rtol, longest, t, y, closed, speed)
        if t >= line.duration:
            break
    return np.asarray(y[len(y) // 2 :])


def scene_of(line: Line, velocity: jax.Array | None = None) -> jc.Scene:
    """The same for the package."""
    velocity = jnp.asarray(line.velocity) if velocity is None else velocity
    spheres = [
        jc.Sphere(r, m, x, v)
        for r, m, x, v in zip(line.radius, line.mass, line.position, velocity, strict=True)
    ]
    return jc.Scene(spheres, jc.Damped(alpha=line.alpha), stiffness=line.stiffness)


def best(function: Callable, repeats: int = 5) -> tuple[float, float, np.ndarray]:
    """Seconds of the first call more than the best of the others, that best, and the result."""
    start = time.perf_counter()
    result = jax.block_until_ready(function())
    first = time.perf_counter() - start
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return max(first - min(times), 0.0), min(times), np.asarray(result)


def compared(name: str, line: Line) -> list[dict]:
    """One scene by all ways, each at the loosest tolerance that reaches the error."""
    truth = by_scipy(line, REFERENCE)
    fixed, scale = Fixed(line), np.max(np.abs(line.velocity))
    counted = jc.simulate(scene_of(line), line.duration, v0="touch").impacts
    room = len(counted) + 2

    @functools.partial(jax.jit, static_argnums=1)
    def ours(velocity, rtol):
        run = jc.simulate(
            scene_of(line, velocity), line.duration, rtol=rtol, v0="touch", max_impacts=room
        )
        return run.velocity[-1].ravel()

    given = jnp.asarray(line.velocity)
    ways: dict[str, Callable] = {
        "jaxcontact, jitted": lambda rtol: ours(given, rtol),
        "jaxcontact, from Python": lambda rtol: (
            jc.simulate(scene_of(line), line.duration, rtol=rtol, v0="touch").velocity[-1].ravel()
        ),
        "diffrax Dopri8, restarted": functools.partial(by_diffrax, fixed, line.longest),
        "scipy DOP853, restarted": lambda rtol: by_scipy(line, rtol),
    }
    rows = []
    for way, solve in ways.items():
        row = {"scene": name, "way": way, "impacts": len(counted), "reached": False}
        for rtol in LADDER:
            compile_s, seconds, found = best(functools.partial(solve, rtol), 5)
            error = float(np.max(np.abs(found - truth)) / scale)
            row |= {"rtol": rtol, "compile_s": compile_s, "seconds": seconds, "error": error}
            if error <= ERROR:
                row["reached"] = True
                break
        rows.append(row)
        print(
            f"{name:24}{way:28} rtol {row['rtol']:.0e}  error {row['error']:.0e}"
            f"  {1e3 * row['seconds']:10.3f} ms  ({row['compile_s']:.1f} s before)", flush=True
        )  # fmt: skip
    for row in rows:
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
    return rows


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


def empty(state: State, log: Log, rows: int) -> tuple[State, Log]:
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
    numbers, _ = numbers_of(scene, layout, contacts=False)
    rules = Rules(False, "peak", 0)
    end, tolerance = jnp.asarray(1e6), jnp.asarray(1e-9)
    state = eqx.filter_jit(begun)(layout, numbers, rules, end)
    jitted = eqx.filter_jit(advance)
    nothing = jax.jit(empty, static_argnums=2)

    def of(rows: int) -> tuple[float, float, float]:
        log = blank_log(rows, layout, numbers.dtype, 0)
        run = functools.partial(jitted, layout, numbers, rules, state, log, end, tolerance)
        compile_s, seconds, _ = best(lambda: run()[2], 5)
        _, without, _ = best(lambda: nothing(state, log, rows)[0].time, 5)
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
    _, one, _ = best(lambda: value(speeds), 9)
    compile_s, two, _ = best(lambda: gradient(speeds), 9)
    row = {"bodies": count, "impacts": impacts, "value_s": one, "gradient_s": two}
    row |= {"ratio": two / one, "compile_s": compile_s}
    print(f"a gradient among {count:5}, {impacts} impacts: {two / one:5.2f} values", flush=True)
    return row


def main() -> None:
    """Print the tables; with --out also write them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    runs = [
        *compared("line, gaps of 0.1 m", line(0.1, 1e9, 15.0)),
        *compared("line, gaps of 1e-5 m", line(1e-5, 1e9, 0.02)),
        *compared("oblique pair, 4e-3", oblique(4e-3)),
    ]
    impacts = [impact_cost(2, 4096), impact_cost(128, 2048), impact_cost(2048, 512)]
    gradients = [gradient_cost(2, 64), gradient_cost(128, 256)]
    machine = {
        "processor": platform.machine(),
        "device": str(jax.devices()[0].device_kind),
        "jax": jax.__version__,
        "diffrax": diffrax.__version__,
        "precision": "float64",
    }
    print(machine)
    if arguments.out:
        table = {"machine": machine, "runs": runs, "impacts": impacts, "gradients": gradients}
        arguments.out.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
