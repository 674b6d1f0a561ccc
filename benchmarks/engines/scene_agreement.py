"""Exported scenes in their engines, beside `jc.simulate`.

`python -m benchmarks scene_agreement` runs every scene of `CASES` in its engine, with 201 outputs.
Compared are the instants of the impacts, and velocities, spins and energy at a moment at which no
body touches another. Two more scenes miss their tolerance by the error that their export states.
`OBLIQUE` has single impacts with `RigidCoulomb`, of which the rebounds are compared.

Needs `pip install '.[engines]'`. All runs take some ten minutes on two cores, most of it to compile
the growth of runs.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import jaxcontact as jc
from benchmarks.study import Study, lines, table
from tests.engines.test_export.run import run_scene

TIMES = np.linspace(0, 0.2, 201)
FREE = 180
"""Number of an output at which no body touches another."""
TOLERANCE = 2e-3
"""Of e. Drake's steps are of first order, so that a tenth of this takes minutes."""
PUSH = 0.1
"""Change of velocity in m/s from which a contact counts as an impact, and not as rest."""

RUBBER = jc.Material(1e8, 0.4, 1200.0)


def bounces(**words: Any) -> jc.Scene:
    """two balls on a slope"""
    balls = [
        jc.Sphere(0.01, 0.03, [0.0, 0.04], [0.3, -0.3], name="ball"),
        jc.Sphere(0.02, 0.1, [0.05, 0.05]),
    ]
    plane = jc.Plane([0.0, 0.0], [0.1, 1.0], name="table")
    given = {"law": jc.HuGuo(e=0.7), "stiffness": 1e8, "gravity": [0.0, -9.81]}
    return jc.Scene([*balls, plane], **{**given, **words})


def in_a_box() -> jc.Scene:
    """spheres of rubber in a box"""
    spheres = [
        jc.Sphere(0.02, position=[0.1, 0.12, 0.1], velocity=[1.0, 0.5, 0.3], material=RUBBER),
        jc.Sphere(0.03, position=[0.2, 0.15, 0.1], material=RUBBER),
        jc.Sphere(0.03, position=[0.2, 0.06, 0.2], material=RUBBER, fixed=True),
    ]
    return jc.Scene([*spheres, jc.Box([0.0] * 3, [0.3] * 3)], law=jc.HuGuo(e=0.8))


def laws_by_pair() -> jc.Scene:
    """the slope, laws by pair"""
    return bounces(law={("ball", "table"): jc.HuGuo(e=0.5), "default": jc.HuGuo(e=0.8)})


def shaken() -> jc.Scene:
    """shaken bodies, a periodic axis"""
    moving = jc.Vibration([0.002, 0.003], 20.0, 0.3)
    bodies = [
        jc.Sphere(0.01, position=[0.0, 0.05], material=RUBBER),
        jc.Sphere(0.02, position=[0.1, 0.0], fixed=True, motion=moving, material=RUBBER),
        jc.Sphere(0.01, position=[0.102, 0.04], material=RUBBER),
        jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Vibration(0.002, 25.0, 0.4)),
    ]
    return jc.Scene(bodies, law=jc.HuGuo(e=0.7), gravity=[0.0, -9.81], periodic=[0.2, None])


def in_a_moving_shell() -> jc.Scene:
    """a ball in a moving shell"""
    ball = jc.Sphere(0.1, position=[-0.3, 0.1, 0.2], velocity=[3.0, 6.0, -3.0], material=RUBBER)
    shell = jc.Shell([0.0] * 3, 0.8, RUBBER, motion=jc.Steady([0.1, 0.0, 0.0]))
    return jc.Scene([ball, shell], law=jc.HuGuo(e=0.8))


def rubs() -> jc.Scene:
    """the slope, `RigidCoulomb`"""
    return bounces(friction=jc.RigidCoulomb(0.3))


def rubs_by_pair() -> jc.Scene:
    """the slope, friction by pair"""
    friction = {("ball", "table"): jc.RigidCoulomb(0.1), "default": jc.RigidCoulomb(0.4)}
    return bounces(friction=friction)


def springs() -> jc.Scene:
    """the slope, `SpringSlider`"""
    return bounces(friction=jc.SpringSlider(0.3, ratio=0.8, form="rescaled"))


def ramps() -> jc.Scene:
    """the slope, `RegularizedCoulomb`"""
    return bounces(friction=jc.RegularizedCoulomb(0.3, 0.05))


def adheres() -> jc.Scene:
    """the slope, `DMT`"""
    return bounces(law=jc.DMT(pull_off=5.0), stiffness=1e7)


def yields() -> jc.Scene:
    """the slope, `WaltonBraun`"""
    return bounces(law=jc.WaltonBraun(ratio=2.0, slope=0.0), stiffness=1e5, exponent=1.0)


def sticks() -> jc.Scene:
    """the slope, `Luding`"""
    law = jc.Luding(ratio=2.0, slope=0.0, adhesion=0.2)
    return bounces(law=law, stiffness=1e5, exponent=1.0)


def rubs_in_drake() -> jc.Scene:
    """the slope, Drake's law, `RigidCoulomb`"""
    law, friction = jc.MarhefkaOrin(a=0.15), jc.RigidCoulomb(0.3)
    # A hundred times as stiff as without friction, whose arm is shorter by half the overlap.
    return bounces(law=law, exponent=1.0, stiffness=1e6, friction=friction)


def falls_with_speed() -> jc.Scene:
    """the slope, Drake's law"""
    return bounces(law=jc.MarhefkaOrin(a=0.15), exponent=1.0, stiffness=1e4)


def falls_in_a_box() -> jc.Scene:
    """a box, Drake's law"""
    spheres = [
        jc.Sphere(0.02, 0.04, [0.1, 0.12, 0.1], [1.0, 0.5, 0.3]),
        jc.Sphere(0.03, 0.1, [0.2, 0.15, 0.1]),
    ]
    box = jc.Box([0.0] * 3, [0.3] * 3)
    return jc.Scene([*spheres, box], law=jc.MarhefkaOrin(a=0.15), stiffness=1e4, exponent=1.0)


def falls_on_a_line() -> jc.Scene:
    """a line, Drake's law"""
    spheres = [jc.Sphere(0.02, 0.04, [0.1]), jc.Sphere(0.03, 0.1, [0.2]), jc.Plane([0.0], [1.0])]
    law = jc.MarhefkaOrin(a=0.15)
    return jc.Scene(spheres, law=law, stiffness=1e4, exponent=1.0, gravity=[-9.81])


CASES = [
    *(("lammps", make) for make in (bounces, in_a_box, laws_by_pair, shaken, in_a_moving_shell)),
    *(("lammps", make) for make in (rubs, rubs_by_pair, adheres)),
    *(("mujoco", make) for make in (bounces, in_a_box, laws_by_pair, rubs, rubs_by_pair)),
    *(("exudyn", make) for make in (bounces, in_a_box, laws_by_pair, ramps, yields, sticks)),
    *(("drake", make) for make in (falls_with_speed, falls_in_a_box, falls_on_a_line)),
    ("drake", rubs_in_drake),
]

CLOSING = 1.0
"""Closing speed in m/s of the oblique impacts."""
OVER = 4e-3
"""Duration in s of their runs. A spin of 400 rad/s turns a ball by 45° before it touches."""


def on_a_plane(slip: float, **words: Any) -> jc.Scene:
    """Return a ball in space that meets a plane; spins about all axes add to its slip in m/s."""
    spin = [50.0, 400.0, 30.0]
    own = np.array([0.01 * spin[2], 0.0, -0.01 * spin[0]])
    velocity = slip * np.array([0.6, 0.0, 0.8]) - own + [0.0, -CLOSING, 0.0]
    ball = jc.Sphere(0.01, 0.03, [0.0, 0.012, 0.0], velocity.tolist(), spin=spin)
    plane = jc.Plane([0.0] * 3, [0.0, 1.0, 0.0])
    return jc.Scene([ball, plane], friction=jc.RigidCoulomb(0.3), **words)


def of_two(slip: float, factor: float, **words: Any) -> jc.Scene:
    """Return two bodies in the plane, whose inertia is `factor` m R², that meet along a slope."""
    normal, along = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    velocity = CLOSING * normal + slip * along
    place = -0.03 * normal - OVER / 2 * velocity
    first = jc.Sphere(0.01, 0.03, place.tolist(), velocity.tolist(), inertia=factor * 3e-6)
    second = jc.Sphere(0.02, 0.1, [0.0, 0.0], inertia=factor * 4e-5)
    return jc.Scene([first, second], friction=jc.RigidCoulomb(0.3), **words)


OBLIQUE: dict[str, Callable[..., jc.Scene]] = {
    "a ball on a plane, sticks": lambda **words: on_a_plane(0.5, **words),
    "a ball on a plane, slides": lambda **words: on_a_plane(3.0, **words),
    "two balls, stick": lambda **words: of_two(0.5, 0.4, **words),
    "two balls, slide": lambda **words: of_two(3.0, 0.4, **words),
    "two discs, stick": lambda **words: of_two(0.5, 0.5, **words),
    "two discs, slide": lambda **words: of_two(3.0, 0.5, **words),
}
"""Single impacts: slips of 0.5 m/s stop, those of 3 m/s last throughout."""
LAWS = {
    "lammps": {"law": jc.HuGuo(e=0.7), "stiffness": 1e8},
    "mujoco": {"law": jc.HuGuo(e=0.7), "stiffness": 1e8},
    "drake": {"law": jc.MarhefkaOrin(a=0.15), "stiffness": 1e6, "exponent": 1.0},
}
"""Law and stiffness of the oblique impacts: contacts of some 0.5 ms."""
HARDER = 1000
"""Factor of the stiffness of the harder contacts, a sixteenth as long, in Drake a thirtieth."""


def impacts_of(run: Any, unknown: np.ndarray) -> list[tuple[int, float]]:
    """Return the impacts in the outputs up to `FREE`: the sphere, and the instant in s.

    An impact changes the velocity by more than a flight does. Its instant is the mean of time,
    weighted by this change. Velocities that are `unknown` count as those of the output before.
    """
    time, velocity = np.asarray(run.time[: FREE + 1]), np.array(run.velocity[: FREE + 1])
    for row in range(1, len(time)):
        velocity[row][unknown[row]] = velocity[row - 1][unknown[row]]
    gravity = 0.0 if run.scene.gravity is None else np.asarray(run.scene.gravity)
    step = np.diff(time)
    push = np.linalg.norm(np.diff(velocity, axis=0) - gravity * step[:, None, None], axis=-1)
    middle, found = (time[1:] + time[:-1]) / 2, []
    free = [k for k, sphere in enumerate(run.scene.spheres) if not sphere.fixed]
    for k in free:
        pushed = np.flatnonzero(push[:, k] > PUSH / 10)
        for rows in np.split(pushed, np.flatnonzero(np.diff(pushed) > 1) + 1):
            whole = push[rows, k].sum()
            if whole > PUSH:
                found.append((k, float(middle[rows] @ push[rows, k] / whole)))
    return found


def of_simulate(engine: str, make: Callable[[], jc.Scene]) -> tuple[dict[str, Any], Any]:
    """Return what is compared of a run of `simulate` and its closing speeds, and its margin."""
    scene = make()
    made = jc.export_scene(scene, engine, TIMES[-1], times=TIMES, tolerance=TOLERANCE)
    run = jc.simulate(scene, TIMES[-1], times=TIMES)
    # Within an impact whose friction is a formula, `simulate` has no velocities.
    unknown, hits = np.isnan(run.velocity), run.impacts.to_dict()
    return {
        "speeds": list(made.velocity),
        "unknown": np.argwhere(unknown),
        "hits": impacts_of(run, unknown),
        "impacts": int(np.sum(hits["time"] < TIMES[FREE])),
        "closing": float(hits["closing_speed"].sum()),
        "margin": float(run.margin.time),
        "velocity": np.asarray(run.velocity[FREE]),
        "position": np.asarray(run.position[FREE]),
        "energy": np.asarray(run.energy)[[0, FREE]],
        "spin": None if run.spin is None else np.asarray(run.spin[FREE]),
    }, run.margin


def agreement(
    engine: str, make: Callable[[], jc.Scene], folder: Path, own: dict[str, Any]
) -> dict[str, Any]:
    """Return the largest differences between an engine's run and that of `simulate`.

    `velocity` in m/s, `spin` as the speed of a surface in m/s, `energy` over the largest one, and
    `time` in s between the same impacts, NaN if they differ in number or order, and at least the
    time between outputs where velocities are unknown. `margin` in s is that of `Run.margin`, and
    `closing` in m/s is the sum of all closing speeds.
    """
    scene, how = make(), {"times": TIMES, "tolerance": TOLERANCE, "velocity": own["speeds"]}
    made = jc.export_scene(scene, engine, TIMES[-1], **how)
    run = run_scene(made, folder)
    unknown = np.zeros(run.velocity.shape, bool)
    unknown[tuple(own["unknown"].astype(int).reshape(-1, 3).T)] = True
    mine, theirs = own["hits"], impacts_of(run, unknown)
    same = [k for k, _ in mine] == [k for k, _ in theirs]
    apart = [abs(a - b) for (_, a), (_, b) in zip(mine, theirs, strict=same)]
    if unknown.any():
        apart.append(float(TIMES[1]))
    energy = own["energy"]
    found = {
        "engine": engine,
        "scene": make.__name__,
        "impacts": own["impacts"],
        "velocity": float(np.abs(run.velocity[FREE] - own["velocity"]).max()),
        "place": float(np.abs(run.position[FREE] - own["position"]).max()),
        "energy": float(abs(run.energy[FREE] - energy[1]) / np.abs(energy).max()),
        "time": max(apart, default=0.0) if same else np.nan,
        "margin": own["margin"],
        "closing": own["closing"],
        "expected_error": made.expected_error,
    }
    if run.spin is not None and own["spin"] is not None:
        radius = np.array([float(sphere.radius) for sphere in scene.spheres])
        turning = np.asarray(run.spin[FREE] - own["spin"]).T * radius
        found["spin"] = float(np.abs(turning).max())
    return found


def rebound(engine: str, name: str, folder: Path, harder: float = 1.0) -> dict[str, float]:
    """Return the largest differences after an oblique impact, in m/s, and its duration in s.

    Those of the velocities along the `normal` and across it, `slip`, and of the spins as speeds of
    the surface.
    """
    words = {**LAWS[engine], "stiffness": harder * LAWS[engine]["stiffness"]}
    scene = OBLIQUE[name](**words)
    speeds = (CLOSING, CLOSING)
    made = jc.export_scene(scene, engine, OVER, tolerance=TOLERANCE, velocity=speeds)
    run, own = run_scene(made, folder), jc.simulate(scene, OVER, times=[0.0, OVER])
    normal = np.array([0.0, 1.0, 0.0]) if scene.dimensions == 3 else np.array([0.6, 0.8])
    assert len(own.impacts.to_dict()["time"]) == 1
    apart = run.velocity[-1] - np.asarray(own.velocity[-1])
    across = apart - np.outer(apart @ normal, normal)
    assert run.spin is not None and own.spin is not None
    radius = np.array([float(sphere.radius) for sphere in scene.spheres])
    turning = (run.spin[-1] - np.asarray(own.spin[-1])).T * radius
    return {
        "normal": float(np.abs(apart @ normal).max()),
        "slip": float(np.linalg.norm(across, axis=1).max()),
        "spin": float(np.abs(turning).max()),
        "duration": max(made.duration for made in made.contacts),
    }


def of_soft_friction(folder: Path) -> float:
    """Return the change of e where MuJoCo's own soft friction takes the place of `noslip`."""
    scene = on_a_plane(1.0, **LAWS["mujoco"])
    speeds = (CLOSING, CLOSING)
    made = jc.export_scene(scene, "mujoco", OVER, tolerance=TOLERANCE, velocity=speeds)
    text = made.files["scene.xml"]
    for ours, usual in (
        ('impratio="1e-9"', 'impratio="1"'),
        ('iterations="100"', 'iterations="0"'),
    ):
        assert ours in text
        text = text.replace(ours, usual)
    soft = dataclasses.replace(made, files={**made.files, "scene.xml": text})
    e = float(run_scene(soft, folder).velocity[-1, 0, 1]) / CLOSING
    return e - float(jc.restitution(LAWS["mujoco"]["law"]))


def of_a_robot(folder: Path) -> tuple[jc.SceneExport, list[float]]:
    """Return the export to MuJoCo at a robot's step, and its errors of e.

    The contact lasts 9.65 ms and the step 2 ms; the ball touches at several places within a step.
    """
    law, stiffness, step = jc.KelvinVoigt(e=0.6, tension=False), 85667.0, 0.002
    times, errors = np.arange(3) * 40 * step, []
    for k, phase in enumerate((0.05, 0.2, 0.4, 0.6, 0.8, 0.95)):
        ball = jc.Sphere(0.1, 1.0, [0.1 + phase * step], [-1.0])
        scene = jc.Scene([ball, jc.Plane([0.0], [1.0])], law=law, stiffness=stiffness, exponent=1.0)
        made = jc.export_scene(
            scene, "mujoco", times[-1], times=times, time_step=step, velocity=(1.0, 1.0)
        )
        errors.append(float(run_scene(made, folder / str(k)).velocity[-1, 0, 0]) - 0.6)
    return made, errors


def of_a_constant(folder: Path) -> tuple[jc.SceneExport, list[float]]:
    """Return the export of a constant e to Drake, and its errors at the ends of the speeds."""
    law, errors = jc.HuGuo(e=0.7), []
    for speed in (0.2, 1.0):
        ball = jc.Sphere(0.1, 1.0, [0.101], [-speed])
        scene = jc.Scene([ball, jc.Plane([0.0], [1.0])], law=law, stiffness=1e4, exponent=1.0)
        made = jc.export_scene(scene, "drake", 0.2, velocity=(0.2, 1.0), tolerance=1e-2)
        e = float(run_scene(made, folder / str(speed)).velocity[-1, 0, 0]) / speed
        errors.append(e - float(jc.restitution(law)))
    return made, errors


MISSES = {
    "MuJoCo at a robot's step of 2 ms": of_a_robot,
    "a constant e in Drake, whose e falls with speed": of_a_constant,
}


def oblique() -> dict[str, Any]:
    """Return the rows of all oblique impacts, and the change of e by MuJoCo's soft friction."""
    rows = []
    for engine in LAWS:
        for name in OBLIQUE:
            row: dict[str, Any] = {"engine": engine, "name": name}
            for kind, harder in (("soft", 1.0), ("hard", HARDER)):
                with tempfile.TemporaryDirectory() as folder:
                    row[kind] = rebound(engine, name, Path(folder), harder)
            rows.append(row)
            print(row, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        return {"oblique": rows, "soft_friction": of_soft_friction(Path(folder))}


def measure(known: dict | None) -> dict[str, Any]:
    rows, missed = [], {}
    for engine, make in CASES:
        own, margin = of_simulate(engine, make)
        with tempfile.TemporaryDirectory() as folder:
            row = agreement(engine, make, Path(folder), own)
        rows.append(row | {"growth": float(margin.growth)})
        print(rows[-1], flush=True)
    for name, run in MISSES.items():
        with tempfile.TemporaryDirectory() as folder:
            made, errors = run(Path(folder))
        missed[name] = {"expected_error": made.expected_error, "errors": errors}
    return {"tolerance": TOLERANCE, "rows": rows, "missed": missed, **oblique()}


def _short(number: float) -> str:
    return f"{number:.2g}" if number < 10 else f"{number:.0f}"


TITLES = {make.__name__: str(make.__doc__) for _, make in CASES}
COLUMNS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "engine": lambda row: f"`{row['engine']}`",
    "scene": lambda row: TITLES[row["scene"]],
    "impacts": lambda row: row["impacts"],
    "velocity, mm/s": lambda row: _short(1e3 * row["velocity"]),
    "spin, mm/s": lambda row: _short(1e3 * row["spin"]) if "spin" in row else "",
    "energy": lambda row: f"{_short(100 * row['energy'])} %",
    "impact, ms": lambda row: _short(1e3 * row["time"]),
    "rival, ms": lambda row: _short(1e3 * row["margin"]) if np.isfinite(row["margin"]) else "none",
    "bound, mm/s": lambda row: _short(1e3 * row["growth"] * row["expected_error"] * row["closing"]),
}
BEYOND: dict[str, Callable[[tuple[str, dict[str, Any]]], str]] = {
    "beyond the tolerance": lambda miss: miss[0],
    "expected error of e": lambda miss: f"{miss[1]['expected_error']:.3g}",
    "measured": lambda miss: f"{max(map(abs, miss[1]['errors'])):.3g}",
}


def oblique_table(found: dict[str, Any]) -> str:
    """Return the table of the oblique impacts, and a sentence on MuJoCo's soft friction."""
    heads = ["contact, ms", "normal, mm/s", "across, mm/s", "spin, mm/s"]
    rows = []
    for row in found["oblique"]:
        names = ("duration", "normal", "slip", "spin")
        numbers = [row[kind][name] for kind in ("soft", "hard") for name in names]
        shown = ["0" if number < 1e-9 else f"{1e3 * number:.2g}" for number in numbers]
        rows.append([f"`{row['engine']}`", row["name"], *shown])
    return (
        f"{lines(['engine', 'impact', *heads, *heads], rows)}\n\nMuJoCo's own soft friction, in "
        f"place of `noslip`, changes e = 0.7 by {found['soft_friction']:.2f}\nin an impact of the "
        "ball on the plane with a slip of 1 m/s."
    )


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Return the tables of docs/export.md."""
    return {
        "": table(COLUMNS, found["rows"]),
        ", beyond": table(BEYOND, found["missed"].items()),
        ", oblique": oblique_table(found),
    }


STUDY = Study(__file__, __doc__, measure, tables, "export")
