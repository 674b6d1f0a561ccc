"""A scene in LAMMPS: input and data file for pair_style granular and fix wall/gran/region."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from ... import (
    DMT,
    AbstractLaw,
    AntypovElliott,
    MawBarberFawcett,
    RegularizedCoulomb,
    Scene,
    WaltonFriction,
    impact,
)
from ...extend import rendered
from ..result import Export
from ..scenes.engine import EqualSteps, SceneEngine, spaced
from ..scenes.model import Moving, SceneModel, Touch

_MOST = 40
"""Largest number of atom types; each pair of them has a line of its own."""

_GROUPS = 32
"""Largest number of groups in LAMMPS."""

_SKIN = 0.3
"""Neighbour skin over the smallest radius."""

_TANGENTIAL = {
    "force": "mindlin/force",
    "displacement": "mindlin",
    "rescaled": "mindlin_rescale/force",
}
"""Tangential models by the form of `SpringSlider`."""

_OTHERS = {
    MawBarberFawcett: "whose contact sticks and slips in parts, where LAMMPS has one spring, that "
    "of `SpringSlider`",
    RegularizedCoulomb: "whose ramp follows the normal force, where that of LAMMPS follows its "
    "damping",
    WaltonFriction: "which has no force over time",
}
"""Why a friction law is not one of LAMMPS."""

_MOBILITY = 3.5
"""λ of solid spheres; discs have 3."""

_ELASTIC = 1 - 1e-6
"""Largest e beside Coulomb friction, whose force below the limit is a multiple of the damping."""


class LammpsScene(SceneEngine):
    """One atom type for each group of spheres, and one fix for each wall and kind of contact."""

    name = "lammps"
    output = "run.dump"
    command = "mpirun -np 2 lmp -in scene.in"
    merges = True
    adhesive: ClassVar[tuple[type[AbstractLaw], ...]] = (DMT,)

    def refuse(self, model: SceneModel) -> None:
        for friction in () if model.scene.friction is None else model.scene.friction.values:
            if friction.kind not in ("rigid", "spring"):
                why = _OTHERS.get(type(friction), "which LAMMPS does not have")
                raise ValueError(
                    "Argument `scene` must have the friction law `RigidCoulomb` or `SpringSlider` "
                    f"for LAMMPS, but has {rendered(friction)}, {why}."
                )
        disc = model.dimensions == 2 and model.disc()
        if model.scene.friction is not None and not model.solid() and not disc:
            raise ValueError(
                "Argument `scene` must have spheres with the `inertia` of solid spheres for "
                "LAMMPS, 2/5 m R², or in two dimensions all of discs, 1/2 m R²."
            )
        types = int(model.group.max()) + 1
        if types > _MOST:
            raise ValueError(
                f"Argument `scene` must have at most {_MOST} kinds of spheres for LAMMPS, but has "
                f"{types}. Spheres differ by name, material, mass and radius; with materials in "
                "place of `stiffness` and an e that does not depend on speed, sizes do not count."
            )

    def options(self, touch: Touch, constant: bool) -> Iterable[Mapping[str, Any]]:
        radius = {"radius": touch.radius}
        if isinstance(touch.law, DMT):
            return (radius,)
        # A pull at the end would count as a normal force for friction.
        limited = {"damping": "limit_damping", **radius}
        if touch.friction is not None and touch.friction.kind == "rigid":
            return (limited,)
        if float(touch.contact.exponent) == 1:
            return ({"damping": "mass_velocity", **radius},)
        usual = () if constant else ({"damping": "viscoelastic", **radius},)
        return (radius, *usual) if touch.friction is None else (limited, radius, *usual)

    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        return {"scene.in": _input(model, exports, steps), "scene.data": _data(model)}

    def read(self, path: Path, scene: Scene) -> dict[str, np.ndarray]:
        return _read_dump(path, scene)


def _input(model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps) -> str:
    flat_space = model.dimensions < 3
    ends = ["m" if period is None else "p" for period in model.periods]
    ends[2] = "p" if flat_space else ends[2]
    skin = _SKIN * float(model.radius.min())
    fixed = sorted({int(model.group[row]) for row in model.motions})
    types = range(int(model.group.max()) + 1)
    mobile = [k for k in types if k not in fixed]
    lines = [
        "# A scene of jaxcontact for LAMMPS: mpirun -np 2 lmp -in scene.in",
        "units si",
        f"dimension {2 if flat_space else 3}",
        f"boundary {' '.join(ends)}",
        "atom_style sphere",
        "newton off",
        "comm_modify vel yes",
        "read_data scene.data",
        f"neighbor {skin:.12g} bin",
        "neigh_modify every 1 delay 0 check yes",
        "pair_style granular",
    ]
    other = next(iter(exports.values()))
    for b in types:
        for a in range(b + 1):
            pair = (a, b)
            known = exports.get(pair, other)
            touch = model.touches.get(pair, next(iter(model.touches.values())))
            lines.append(f"pair_coeff {a + 1} {b + 1} {_contact(known, touch, steps.length)}")
    lines.append(f"group mobile type {_types(mobile)}")
    if fixed:
        lines.append(f"group fixed type {_types(fixed)}")
        lines.append("neigh_modify exclude group fixed fixed")
    turning = " disc" if flat_space and model.scene.friction is not None and model.disc() else ""
    lines.append(f"fix motion mobile nve/sphere{turning}")
    pull = float(np.linalg.norm(model.gravity))
    if pull > 0:
        lines.append(f"fix gravity mobile gravity {pull:.17g} vector {spaced(model.gravity)}")
    lines += _fixed(model) if fixed else []
    lines += _walls(model, exports, steps.length)
    if flat_space:
        lines.append("fix plane all enforce2d")
    groups = 1 + sum(line.startswith("group ") for line in lines)
    if groups > _GROUPS:
        raise ValueError(
            f"Argument `scene` must need at most {_GROUPS} groups in LAMMPS, one for each moving "
            "sphere and each set of spheres with the same contact with a wall, but needs "
            f"{groups}."
        )
    every = steps.between
    lines += [
        f"timestep {steps.length:.17g}",
        f"thermo {every * max(1, steps.outputs // 10)}",
        *_energy(model),
        f"dump out all custom {every} run.dump {_columns(model.scene)}",
        "dump_modify out sort id units yes time yes format float %.15g",
        f"run {every * steps.outputs}",
    ]
    return "\n".join(lines) + "\n"


def _energy(model: SceneModel) -> list[str]:
    """Return the lines of the energy of each mobile sphere, kinetic and gravitational, in J."""
    pulls = ((k + 1, value) for k, value in enumerate(model.gravity) if value)
    pull = "".join(f" - ({value:.17g})*c_place[{axis}]" for axis, value in pulls)
    spins = turning = ""
    if model.scene.friction is not None:
        spins = " omegax omegay omegaz"
        factor = 0.2 if model.solid() else 0.25
        squares = " + ".join(f"c_place[{k}]^2" for k in (4, 5, 6))
        turning = f" + {factor}*radius^2*({squares})"
    return [
        f"compute place all property/atom xu yu zu{spins}",
        f'variable energy atom "gmask(mobile)*mass*(0.5*(vx^2 + vy^2 + vz^2){turning}{pull})"',
    ]


def _data(model: SceneModel) -> str:
    """Return the data file: types, diameters, densities, positions and velocities."""
    low, high = model.extent()
    margin = float(model.radius.max())
    bounds = []
    for axis, letter in enumerate("xyz"):
        period = model.periods[axis]
        flat = axis >= model.dimensions
        ends = (low[axis] - margin, high[axis] + margin) if period is None else (0.0, period)
        ends = (-margin, margin) if flat else ends
        bounds.append(f"{ends[0]:.17g} {ends[1]:.17g} {letter}lo {letter}hi")
    # LAMMPS keeps the whole periods of a place as flags, so that the output is unwrapped.
    position, image = model.position.copy(), np.zeros_like(model.position)
    for axis, period in enumerate(model.periods):
        if period is not None:
            image[:, axis], position[:, axis] = np.divmod(position[:, axis], period)
    count = len(model.radius)
    # The mass of a frozen sphere has no effect.
    mass = np.where(np.isfinite(model.mass), model.mass, 1.0)
    density = mass / (4 / 3 * np.pi * model.radius**3)
    number = np.arange(1, count + 1)
    atoms = np.column_stack([number, model.group + 1, 2 * model.radius, density, position, image])
    moves = np.column_stack([number, model.velocity, model.spin])
    text = io.StringIO()
    text.write(f"A scene of jaxcontact, in SI units\n\n{count} atoms\n")
    text.write(f"{int(model.group.max()) + 1} atom types\n\n" + "\n".join(bounds))
    text.write("\n\nAtoms # sphere\n\n")
    np.savetxt(text, atoms, fmt=["%d", "%d", *["%.17g"] * 5, *["%d"] * 3])
    text.write("\nVelocities\n\n")
    np.savetxt(text, moves, fmt=["%d", *["%.17g"] * 6])
    return text.getvalue()


def _contact(made: Export, touch: Touch, step: float) -> str:
    """Return the model of a contact as pair_coeff and fix wall/gran take it, for steps in s."""
    numbers = dict(made.parameters)
    _, _, tail = made.snippet.partition("pair_coeff * * ")
    normal, tangential = tail.split()[0], "linear_nohistory 0 0"
    damping = tail.partition(tangential)[2]
    friction = touch.friction
    if friction is not None and friction.kind == "rigid":
        numbers["e"] = min(numbers["e"], _ELASTIC)
        multiple = 1 / (_MOBILITY * step * _damping_rate(made, numbers["e"]))
        tangential = f"linear_nohistory {multiple:.12g} {float(friction.mu):.12g}"
    if friction is not None and friction.held is not None:
        assert touch.ratio is not None
        stiffness = touch.ratio * made.parameters["k_n"]
        model = "linear_history"
        if normal == "hertz":
            # f' = κ (3/2) K √δ u, and LAMMPS has k_t √(R δ) u with K = k_n √R.
            stiffness, model = 1.5 * stiffness, _TANGENTIAL[friction.held]
        tangential = f"{model} {stiffness:.12g} 0 {float(friction.mu):.12g}"
    values = " ".join(f"{value:.12g}" for value in numbers.values())
    return f"{normal} {values} tangential {tangential}{damping}"


def _damping_rate(made: Export, e: float) -> float:
    """Return the largest damping in an impact at the largest speed, over the mass, in 1/s.

    LAMMPS' friction below the limit μF is a multiple of it times the slip. Steps that stop the slip
    at once are the longest without overshoot.
    """
    mass, stiffness = float(made.contact.mass), float(made.contact.stiffness)
    depth = float(impact(made.law, made.contact, np.max(made.velocity)).max_indentation)
    zeta = float(AntypovElliott(e=jnp.asarray(e)).damping_ratio())
    return zeta * math.sqrt(5 * stiffness * math.sqrt(depth) / mass)


def _fixed(model: SceneModel) -> list[str]:
    """Return the lines for spheres that are fixed or move by a prescription."""
    lines = ["fix frozen fixed freeze"]
    for row, motion in model.motions.items():
        if motion is not None:
            name = model.name(int(model.body[row]))
            lines += [f"group {name} id {row + 1}", *_variables(name, motion)]
            flat = "z" if model.dimensions < 3 else ""
            letters = [
                "NULL" if axis == flat else f"v_{name}_{kind}{axis}"
                for kind in ("", "v")
                for axis in "xyz"
            ]
            lines.append(f"fix {name} {name} move variable {' '.join(letters)}")
    return lines


def _walls(model: SceneModel, exports: Mapping[tuple[int, int], Export], step: float) -> list[str]:
    """Return a region for each wall, and a fix for each kind of contact with it."""
    lines, names = [], {}

    def group_of(types: list[int]) -> str:
        return names.setdefault(tuple(sorted(types)), f"types{len(names)}")

    shapes: list[tuple[Any, str]] = [
        (wall, f"plane {spaced(wall.point)} {spaced(wall.normal)}") for wall in model.flat
    ]
    shapes += [(wall, f"sphere {spaced(wall.centre)} {wall.radius:.17g}") for wall in model.round]
    for number, (wall, shape) in enumerate(shapes):
        name = f"wall{number}_{model.name(wall.body)}"
        moves = ""
        if wall.motion is not None:
            lines += _variables(name, wall.motion)
            moves = f" move v_{name}_x v_{name}_y v_{name}_z"
        lines.append(f"region {name} {shape} side in units box{moves}")
        alike: dict[str, list[int]] = {}
        for pair, touch in model.touches.items():
            if wall.group in pair:
                contact = _contact(exports[pair], touch, step)
                alike.setdefault(contact, []).append(sum(pair) - wall.group)
        for k, (contact, groups) in enumerate(alike.items()):
            lines.append(
                f"fix {name}_{k} {group_of(groups)} wall/gran/region granular {contact} "
                f"region {name}"
            )
    return [f"group {name} type {_types(types)}" for types, name in names.items()] + lines


def _variables(name: str, motion: Moving) -> list[str]:
    """Return variables of the displacement and the velocity of a motion."""
    lines = []
    rate, phase = f"{motion.rate:.17g}", f"{motion.phase:.17g}"
    for letter, speed, swing in zip("xyz", motion.speed, motion.amplitude, strict=True):
        v, a = f"{speed:.17g}", f"{swing:.17g}"
        lines += [
            f'variable {name}_{letter} equal "{v}*time + {a}*(sin({rate}*time + {phase}) - '
            f'sin({phase}))"',
            f'variable {name}_v{letter} equal "{v} + {a}*{rate}*cos({rate}*time + {phase})"',
        ]
    return lines


def _types(groups: Iterable[int]) -> str:
    return " ".join(str(k + 1) for k in groups)


def _read_dump(path: Path, scene: Scene) -> dict[str, np.ndarray]:
    """Return the states of a dump file: (T,) and (T, N, D). Raises ValueError if it is cut."""
    times, frames, count, wanted, line = [], [], None, _columns(scene), ""
    with path.open() as file:
        for line in file:
            if line.startswith("ITEM: TIME") and "STEP" not in line:
                times.append(float(next(file, "nan")))
            elif line.startswith("ITEM: NUMBER"):
                count = int(next(file, "0"))
            elif line.startswith("ITEM: ATOMS") and count is not None and line.endswith("\n"):
                columns = line.removeprefix("ITEM: ATOMS").strip()
                if columns != wanted:
                    raise ValueError(
                        f"holds {_kind_of(columns)}, where `scene` gives {_kind_of(wanted)}"
                    )
                atoms = list(itertools.islice(file, count))
                if len(atoms) == count and atoms[-1].endswith("\n"):
                    frames.append(np.loadtxt(atoms, ndmin=2))
    if not times:
        raise ValueError("has no frame")
    if len(times) != len(frames) or not line.endswith("\n"):
        raise ValueError(f"is incomplete: it ends within frame {len(frames) + 1}")
    rows, axes = np.array(frames), scene.dimensions
    states = {"time": np.array(times), "position": rows[:, :, 1 : 1 + axes]}
    states["velocity"] = rows[:, :, 1 + axes : 1 + 2 * axes]
    states["energy"] = rows[:, :, -1].sum(axis=1)
    if scene.friction is not None:
        states["spin"] = rows[:, :, 1 + 2 * axes] if axes == 2 else rows[:, :, -4:-1]
    return states


def _columns(scene: Scene) -> str:
    """Return the columns of a dump; they tell the dimensions, and whether there is friction."""
    letters, spins = "xyz"[: scene.dimensions], ""
    if scene.friction is not None:
        spins = "z" if scene.dimensions == 2 else "xyz"
    names = [*(f"{x}u" for x in letters), *(f"v{x}" for x in letters)]
    return " ".join(["id", *names, *(f"omega{x}" for x in spins), "v_energy"])


def _kind_of(columns: str) -> str:
    """Return in words what the columns of a dump tell of a scene."""
    dimensions = sum(f"{x}u" in columns.split() for x in "xyz")
    friction = "with" if "omega" in columns else "without"
    return f"a run in {dimensions}D {friction} friction (columns {columns})"
