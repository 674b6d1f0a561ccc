"""LAMMPS: granular balls on a wall, one box per restitution, far apart."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from .rebounds import MASS, RADIUS, SPEED, Drop

_BOX = """
    units si
    atom_style sphere
    boundary f f f
    comm_modify vel yes
    region box block -1 {side} -1 1 -1 1
    create_box 1 box
    pair_style granular
    pair_coeff * * {model}
"""
_RUN = """
    set atom 1*{count} diameter {diameter!r} density {density!r}
    velocity all set 0 0 {down!r}
    fix 1 all nve/sphere
    fix 2 all wall/gran granular {model} zplane 0 NULL
    thermo 0
    timestep {step!r}
"""


def _model(drop: Drop) -> str:
    p = drop.numbers
    return (
        f"hertz {p['k_n']!r} {p['e']!r} tangential linear_nohistory 0 0 damping coeff_restitution"
    )


def box_of(drop: Drop, places: list[float], steps: float) -> Any:
    """A box with balls at these heights over the plane, a meter from each other."""
    from lammps import lammps

    instance = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    model = _model(drop)
    instance.commands_string(_BOX.format(side=len(places), model=model))
    for k, gap in enumerate(places):
        instance.command(f"create_atoms 1 single {k} 0 {RADIUS + gap:.17g}")
    density = MASS / (4 / 3 * math.pi * RADIUS**3)
    instance.commands_string(
        _RUN.format(
            count=len(places),
            diameter=2 * RADIUS,
            density=density,
            down=-SPEED,
            model=model,
            step=drop.ladder(steps)[0],
        )
    )
    return instance


def solver(drops: list[Drop]) -> Any:
    """A box for every law; it is set back to the start, and run again."""
    groups: dict[str, list[int]] = {}
    for k, drop in enumerate(drops):
        groups.setdefault(_model(drop), []).append(k)

    @functools.cache
    def built(steps: float) -> list[Any]:
        return [
            (box_of(drops[lanes[0]], [drops[k].gap(steps) for k in lanes], steps), lanes)
            for lanes in groups.values()
        ]

    def run(steps: float) -> np.ndarray:
        found = np.empty(len(drops))
        for box, lanes in built(steps):
            order = box.numpy.extract_atom("id")[: len(lanes)] - 1
            gaps = np.array([drops[k].gap(steps) for k in lanes])
            box.numpy.extract_atom("x")[: len(lanes), 2] = RADIUS + gaps[order]
            box.numpy.extract_atom("v")[: len(lanes)] = (0, 0, -SPEED)
            box.command(f"run {drops[lanes[0]].ladder(steps)[1]}")
            order = box.numpy.extract_atom("id")[: len(lanes)] - 1
            found[np.array(lanes)[order]] = box.numpy.extract_atom("v")[: len(lanes), 2]
        return found / SPEED

    return run
