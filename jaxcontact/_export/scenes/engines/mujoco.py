"""MuJoCo: a model in MJCF, with a script that runs it and writes the table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...._entry import rendered
from ...result import Export
from ...simulators.mujoco import IMPEDANCE
from ..engine import EqualSteps, SceneEngine, refuse_all, register_scene_engine, spaced
from ..model import SceneModel
from ..script import script

_MOST = 100
"""Largest number of spheres: each pair of bodies has an entry of its own."""

_RUN = """
model = mujoco.MjModel.from_xml_path("scene.xml")
state = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, state, 0)
table = Table()


def add(time):
    position, velocity = PLACE.copy(), numpy.zeros_like(PLACE)
    for k in numpy.flatnonzero(numpy.isfinite(MASS)):
        joint = model.body(f"sphere{k}").jntadr[0]
        q, v = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        velocity[k, :AXES] = state.qvel[v : v + AXES]
        # A free joint has the place itself, slides have the displacement.
        position[k, :AXES] = state.qpos[q : q + AXES] + (0 if AXES == 3 else PLACE[k, :AXES])
    table.add(time, position, velocity)


add(0.0)
for output in range(1, OUTPUTS + 1):
    mujoco.mj_step(model, state, nstep=BETWEEN)
    add(output * BETWEEN * STEP)
table.write()
"""


@register_scene_engine
class MuJoCoScene(SceneEngine):
    """A pair of geoms for each pair of bodies, with the solref of their effective mass."""

    name = "mujoco"

    def refuse(self, model: SceneModel) -> None:
        refuse_all(model, "MuJoCo", shells=True, periodic=True, motion=True)
        if model.scene.friction is not None:
            raise ValueError(
                "Argument `scene` must have `friction=None` for MuJoCo, whose friction changes the "
                f"normal force and with it e, but has {rendered(model.scene.friction.values[0])}."
            )
        if len(model.radius) > _MOST:
            raise ValueError(
                f"Argument `scene` must have at most {_MOST} spheres for MuJoCo, where each pair "
                f"is an entry, but has {len(model.radius)}."
            )

    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        title = "Run scene.xml in MuJoCo and write run.csv: python run.py"
        numbers = {"PLACE": model.position}
        run = script(title, ["import mujoco"], numbers, _RUN, model, steps)
        return {"scene.xml": _xml(model, exports, steps), "run.py": run}


def _xml(model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps) -> str:
    axes = model.dimensions
    geoms = [(wall.group, f"wall{k}") for k, wall in enumerate(model.flat)]
    geoms += [(int(group), f"sphere{k}") for k, group in enumerate(model.group)]
    bodies = [
        f'    <geom name="wall{k}" type="plane" size="0 0 1" pos="{spaced(wall.point)}" '
        f'zaxis="{spaced(wall.normal)}"/>  <!-- {model.name(wall.body)} -->'
        for k, wall in enumerate(model.flat)
    ]
    places, speeds = [], []
    for k, (place, velocity) in enumerate(zip(model.position, model.velocity, strict=True)):
        shape = f'<geom name="sphere{k}" type="sphere" size="{model.radius[k]:.17g}"'
        title = f"  <!-- {model.name(int(model.body[k]))} -->"
        if k in model.motions:
            bodies.append(f'    {shape} pos="{spaced(place)}"/>{title}')
            continue
        inertia = spaced(np.full(3, model.inertia[k]))
        joints = "<freejoint/>"
        if axes < 3:
            unit = np.eye(3)[:axes]
            joints = "".join(f'<joint type="slide" axis="{spaced(axis)}"/>' for axis in unit)
        bodies.append(
            f'    <body name="sphere{k}" pos="{spaced(place)}">{joints}<inertial pos="0 0 0" '
            f'mass="{model.mass[k]:.17g}" diaginertia="{inertia}"/>{shape}/></body>{title}'
        )
        places.append(spaced([*place, 1, 0, 0, 0]) if axes == 3 else spaced(np.zeros(axes)))
        turning = [*velocity, *model.spin[k]] if axes == 3 else velocity[:axes]
        speeds.append(spaced(turning))
    pairs = []
    for b, (second, name) in enumerate(geoms):
        for first, other in geoms[:b]:
            made = exports.get((min(first, second), max(first, second)))
            if made is not None:
                stiffness, damping = (made.parameters[x] for x in ("stiffness", "damping"))
                pairs.append(
                    f'    <pair geom1="{other}" geom2="{name}" condim="1" '
                    f'solref="{-stiffness:.12g} {0 - damping:.12g}" '
                    f'solimp="{IMPEDANCE:g} {IMPEDANCE:g} 0.001 0.5 2"/>'
                )
    lines = [
        '<mujoco model="scene">',
        f'  <option timestep="{steps.length:.17g}" gravity="{spaced(model.gravity)}" '
        'integrator="Euler" tolerance="1e-12"/>',
        "  <default>",
        '    <geom contype="0" conaffinity="0"/>',
        "  </default>",
        "  <worldbody>",
        *bodies,
        "  </worldbody>",
        "  <contact>",
        *pairs,
        "  </contact>",
        "  <keyframe>",
        f'    <key qpos="{" ".join(places)}" qvel="{" ".join(speeds)}"/>',
        "  </keyframe>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"
