"""The data of a plot of a run: positions of the spheres at enough times, and touches."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ..._entry import concrete, is_list, refusal, require_kind
from ..._scene import EngineRun, Run, Shell
from ..._scene.bodies.bodies import AbstractBody, spheres_of
from ..._scene.bodies.overlap import minimum_image
from ..._scene.result import Ending
from ..._system import SystemRun

_LEAST = 512
"""Smallest number of times at which a run is evaluated for a plot, including its impacts."""


class RunPath(NamedTuple):
    """A run at some times: (T,) in s, (T, N, D) in m, (T,) in J, spins in rad/s if it has any."""

    time: np.ndarray
    position: np.ndarray
    energy: np.ndarray
    spin: np.ndarray | None


def require_one_run(run: Any) -> Run | EngineRun:
    """Return a single run that has values to draw; ValueError for anything else."""
    if isinstance(run, EngineRun):
        return run
    require_kind("run", run, Run, "a `Run` (see `simulate`)")
    if np.ndim(run.reached) > 0:
        raise ValueError(
            "Argument `run` must be a single run, but is a batch of the shape "
            f"{np.shape(run.reached)}."
        )
    if not float(run.reached) > 0:
        raise ValueError(
            "Argument `run` must have values to draw, but all are NaN: its status is "
            f"{Ending.names_of(run.status).replace('_', ' ')!r}."
        )
    return run


def require_one_system_run(run: Any) -> SystemRun:
    """Return a single run of a mechanism that has values; ValueError for anything else."""
    require_kind("run", run, SystemRun, "a `SystemRun`")
    if run.time.ndim != 1:
        raise ValueError(
            f"Argument `run` must be a single run, but is a batch of {run.time.shape[:-1]}."
        )
    return run


def path_of(run: Run | EngineRun) -> RunPath:
    """Return a run at evenly spaced times, at its impacts, and at their ends.

    A run of another engine has its output times only.
    """
    if isinstance(run, EngineRun):
        return RunPath(run.time, in_cell(run, run.position), run.energy, run.spin)
    impacts, reached = run.impacts.to_dict(), float(run.reached)
    ends = impacts["time"] + impacts["duration"]
    kinks = np.unique([*impacts["time"], *ends[np.isfinite(ends)]])
    kinks = kinks[(kinks > 0) & (kinks < reached)]
    # Counts that are powers of two share the compiled program that evaluates the states.
    count = max(_LEAST, 1 << int(np.ceil(np.log2(1.5 * (len(kinks) + 1)))))
    even = np.linspace(0, reached, count - len(kinks))
    return states(run, np.sort(np.concatenate([even, kinks])))


def states(run: Run | EngineRun, times: np.ndarray) -> RunPath:
    """Return a run at some times; in periodic space each sphere by its image in the first cell.

    Positions of another engine between its output times lie on straight lines.
    """
    if isinstance(run, EngineRun):
        whole = run.position.copy()
        for axis, length in enumerate(run.scene.periodic):
            if length is not None:
                whole[..., axis] = np.unwrap(whole[..., axis], axis=0, period=float(length))
        position = make_interp_spline(run.time, whole, k=1)(times)
        energy = np.interp(times, run.time, run.energy)
        return RunPath(times, in_cell(run, position), energy, None)
    now = run.at(times)
    spin = None if now.spin is None else np.asarray(now.spin)
    return RunPath(times, in_cell(run, np.asarray(now.position)), np.asarray(now.energy), spin)


def turned(path: RunPath, times: np.ndarray, shown: tuple[int, ...]) -> np.ndarray | None:
    """Return the angles (T, N) in rad by which spheres have turned in the plane `shown`.

    None without spin. Between the times of a path, which include its impacts, spins are constant.
    """
    if path.spin is None or len(shown) == 1:
        return None
    first, second = shown
    spin = path.spin if path.spin.ndim == 2 else path.spin[..., 3 - first - second]
    sign = 1.0 if (second - first) % 3 == 1 else -1.0
    steps = sign * spin[:-1] * np.diff(path.time)[:, None]
    angle = np.concatenate([np.zeros((1, spin.shape[1])), np.cumsum(steps, axis=0)])
    return np.stack([np.interp(times, path.time, line) for line in angle.T], axis=1)


def in_cell(run: Run | EngineRun, position: np.ndarray) -> np.ndarray:
    """Return positions (..., D) shifted by whole periods into the first cell."""
    lengths = [np.inf if length is None else float(length) for length in run.scene.periodic]
    finite = np.where(np.isfinite(lengths), lengths, 1.0)
    return np.where(np.isfinite(lengths), position % finite, position)


def line_of(run: Run | EngineRun, path: RunPath, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the path of a sphere, (S,) in s and (S, D) in m.

    At the border of the periodic cell the path continues outside, is interrupted by NaN, and enters
    from outside on the other side. The frame then cuts it off without a gap.
    """
    time, line = path.time, path.position[:, row]
    step = np.diff(line, axis=0)
    jump = step - minimum_image(step, run.scene.periodic)
    at = np.flatnonzero(np.any(jump != 0, axis=1))
    out, back = line[at + 1] - jump[at], line[at] + jump[at]
    added = np.stack([out, np.full_like(out, np.nan), back], axis=1).reshape(-1, line.shape[1])
    when = np.stack([time[at + 1], time[at + 1], time[at]], axis=1).reshape(-1)
    places = np.repeat(at + 1, 3)
    return np.insert(time, places, when), np.insert(line, places, added, axis=0)


def images(run: Run | EngineRun, shown: tuple[int, ...]) -> np.ndarray:
    """Return the offsets of the images that are drawn, (M, d).

    They are zero and, in periodic directions, one period to both sides. A sphere that is cut off at
    one end of periodic space appears at the other.
    """
    lengths = [run.scene.periodic[axis] for axis in shown]
    steps = [[0.0] if a is None else [0.0, -float(a), float(a)] for a in lengths]
    return np.array(list(itertools.product(*steps)))


def radii(run: Run | EngineRun) -> np.ndarray:
    """Return the radii (N,) of the spheres in m."""
    return np.array([float(sphere.radius) for sphere in run.scene.spheres])


def rows_of_spheres(run: Run | EngineRun) -> dict[int, int]:
    """Return the row of each sphere by its number among the bodies."""
    return {k: row for row, (k, _) in enumerate(spheres_of(run.scene.bodies))}


def touches(run: Run | EngineRun) -> tuple[np.ndarray, np.ndarray]:
    """Return when and where surfaces met at the impacts so far, (K,) in s and (K, D) in m.

    None are known of another engine.
    """
    if isinstance(run, EngineRun):
        return np.zeros(0), np.zeros((0, run.scene.dimensions))
    impacts, bodies, rows = run.impacts.to_dict(), run.scene.bodies, rows_of_spheres(run)
    times = impacts["time"]
    times = times[times <= float(run.reached)]
    if not len(times):
        return times, np.zeros((0, run.scene.dimensions))
    different, which = np.unique(times, return_inverse=True)
    position = np.asarray(run.at(different).position)[which]
    size, places = radii(run), np.zeros((len(times), run.scene.dimensions))
    for k in range(len(times)):
        first, second = int(impacts["first"][k]), int(impacts["second"][k])
        here, radius = position[k, rows[first]], size[rows[first]]
        if second in rows:
            apart = minimum_image(position[k, rows[second]] - here, run.scene.periodic)
            places[k] = here + apart * radius / (radius + size[rows[second]])
        else:
            places[k] = here - radius * _normal(
                bodies[second], int(impacts["face"][k]), here, times[k]
            )
    return times, in_cell(run, places)


def _normal(body: AbstractBody, face: int, place: np.ndarray, time: float) -> np.ndarray:
    """Return the unit normal (D,) of a wall or a shell at a place and time, to the free side."""
    if isinstance(body, Shell):
        inwards = body.centre_at(np.array([time]))[0] - place
        return inwards / np.linalg.norm(inwards)
    (normal,) = (wall.normal for wall in body.walls() if wall.face == face)
    return np.asarray(normal)


def axes_shown(value: Any, dimensions: int) -> tuple[int, ...]:
    """Return the axes of a plot: all, or two that are named; ValueError for anything else."""
    if value is None and dimensions < 3:
        return tuple(range(dimensions))
    named = value if is_list(value) else ()
    numbers = tuple(concrete(number) for number in named)
    sound = all(isinstance(number, int) and 0 <= number < dimensions for number in numbers)
    if dimensions == 1 or [len(numbers), len(set(numbers))] != [2, 2] or not sound:
        allowed = {
            1: "None for a run in one dimension",
            2: "two different numbers of 0 and 1, or None, for a run in two dimensions",
            3: "two different numbers of 0, 1 and 2, such as (0, 2), for a run in three dimensions",
        }[dimensions]
        raise refusal("axes", f"be {allowed}", value)
    return numbers  # pyright: ignore[reportReturnType]
