"""Run time of whole scenes against their error.

`python benchmarks/scenes.py [--out FILE] [--only GROUP]`

Ours beside SciPy and plain diffrax, both restarted at events, each at the loosest tolerance that
reaches the error. Then what an instantaneous impact and a gradient cost, in steps and in values,
and what it is worth to skip what a scene does not need (`--only skips`). What counts are the
ratios; compile time is kept apart.
"""

from __future__ import annotations

import argparse
import functools
import json
import platform
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import diffrax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scene_skips
from scene_costs import best, gradient_cost, impact_cost
from scipy.integrate import DOP853, solve_ivp

import jaxcontact as jc

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
    # In turn, each for a tenth of a second at least, so that what else the machine does meets all
    # of them alike.
    for _ in range(8):
        for row in rows:
            often = max(3, int(0.1 / row["seconds"]))
            seconds = best(functools.partial(ways[row["way"]], row["rtol"]), often)[1]
            row["seconds"] = min(row["seconds"], seconds)
    for row in rows:
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
        print(
            f"{name:24}{row['way']:28} rtol {row['rtol']:.0e}  error {row['error']:.0e}"
            f"  {1e3 * row['seconds']:10.3f} ms  ({row['compile_s']:.1f} s before)", flush=True
        )  # fmt: skip
    return rows


GROUPS: dict[str, Callable[[], list[dict]]] = {
    "runs": lambda: [
        *compared("line, gaps of 0.1 m", line(0.1, 1e9, 15.0)),
        *compared("line, gaps of 1e-5 m", line(1e-5, 1e9, 0.02)),
        *compared("oblique pair, 4e-3", oblique(4e-3)),
    ],
    "impacts": lambda: [impact_cost(2, 4096), impact_cost(128, 2048), impact_cost(2048, 512)],
    "gradients": lambda: [gradient_cost(2, 64), gradient_cost(128, 256)],
    "skips": scene_skips.rows,
}


def main() -> None:
    """Print the tables; with --out also write them as JSON, over those of the same groups."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--only", choices=GROUPS, help="one group of rows")
    arguments = parser.parse_args()
    groups = {k: rows() for k, rows in GROUPS.items() if arguments.only in (None, k)}
    machine = {
        "processor": platform.machine(),
        "device": str(jax.devices()[0].device_kind),
        "jax": jax.__version__,
        "diffrax": diffrax.__version__,
        "precision": "float64",
    }
    print(machine)
    if arguments.out:
        known = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
        table = known | {"machine": machine} | groups
        arguments.out.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
