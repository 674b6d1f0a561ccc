"""MuJoCo: solref and solimp, and a model in MJCF with a script that runs it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ... import Contact, RigidCoulomb
from ..at_time_step import Scheme
from ..engine import Draft, Wanted, register_engine
from ..result import Export
from ..scenes.engine import EqualSteps, SceneEngine, refuse_all, refuse_friction, script, spaced
from ..scenes.model import SceneModel, Touch
from .dashpots import LINEAR, SpringAndDashpot, pushing_dashpot

_IMPEDANCE = 0.9
"""MuJoCo's own default at the start of a contact."""

_STEPS = 400
"""Steps per contact at which it was measured."""

_MOST = 100
"""Largest number of spheres: each pair of bodies has an entry of its own."""

_FRICTION = 'cone="elliptic" impratio="1e-9" noslip_iterations="100" noslip_tolerance="1e-12"'
"""The options for Coulomb friction. The soft constraints of friction, which would change the normal
force, vanish by the ratio of impedances. Then `noslip` finds the friction of this normal force.
"""

_HEAVY = 1e4
"""Largest mass in the model over the square of the smallest μ. `noslip` leaves friction out if the
determinant of its equations, at least μ⁴/m², is below 1e-10.
"""

_LOOSE, _SMALL = 1e-5, 1e-3
"""Force in the model's unit by which `noslip` may exceed μF, and the largest share of μ times the
impulse of an impact that this may make.
"""

_RUN = """
model = mujoco.MjModel.from_xml_path("scene.xml")
state = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, state, 0)
table = Table()


def add(time):
    position, velocity, spin = PLACE.copy(), numpy.zeros_like(PLACE), numpy.zeros_like(PLACE)
    for k in numpy.flatnonzero(numpy.isfinite(MASS)):
        joint = model.body(f"sphere{k}").jntadr[0]
        q, v = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        velocity[k, :AXES] = state.qvel[v : v + AXES]
        # A free joint has the place itself, slides have the displacement.
        free = AXES == 3 or SPINS
        position[k, :AXES] = state.qpos[q : q + AXES] + (0 if free else PLACE[k, :AXES])
        if SPINS:
            # The spin of a free joint is that along the axes of the body.
            turn = state.qpos[q + 3 : q + 7]
            mujoco.mju_rotVecQuat(spin[k], state.qvel[v + 3 : v + 6], turn)
    table.add(time, position, velocity, spin if AXES == 3 else spin[:, 2:])


add(0.0)
for output in range(1, OUTPUTS + 1):
    mujoco.mj_step(model, state, nstep=BETWEEN)
    add(output * BETWEEN * STEP)
table.write()
"""


@register_engine
class MuJoCo(SceneEngine):
    """solref and solimp: with constant impedance a contact obeys δ'' = -k δ - b δ', without
    tension.

    This is Kelvin-Voigt without tension per unit of mass. ζ = b/(2√k) follows from e in closed
    form, and k from the duration. A scene has a pair of geoms for each pair of bodies, with the
    solref of their effective mass. Friction is that of `noslip`, by Coulomb's law with the normal
    force of the soft contact.
    """

    name = "mujoco"

    def draft(self, wanted: Wanted) -> Draft:
        stiffness, zeta = pushing_dashpot(wanted)
        k = stiffness / wanted.mass
        damping = 2 * zeta * math.sqrt(k)
        parameters = {
            "stiffness": k,
            "damping": damping,
            "dampratio": zeta,
            "impedance": _IMPEDANCE,
        }
        units = {"stiffness": "1/s^2", "damping": "1/s", "dampratio": "", "impedance": ""}
        return Draft(
            model="solref in the direct format, constant solimp",
            law=SpringAndDashpot(rate=jnp.asarray(damping)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units=units,
            snippet=(
                f'<option timestep="{wanted.duration / _STEPS:.3g}"/>\n'
                f"<default>\n  <geom {_solver(parameters)}/>\n</default>"
            ),
            steps=_STEPS,
            expected_error=0.009,
            scheme=Scheme.SEMI_IMPLICIT,
            limit=(
                f"for both geoms, here by default. {LINEAR}. e is the same at all speeds and "
                "masses. The time step must resolve the contact; the usual steps of milliseconds "
                "do not."
            ),
            source="mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters; "
            "Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
        )

    def refuse(self, model: SceneModel) -> None:
        refuse_all(model, "MuJoCo", shells=True, periodic=True, motion=True)
        refuse_friction(model, "MuJoCo", RigidCoulomb)
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


def _solver(parameters: Mapping[str, float]) -> str:
    """Return the attributes of a soft contact in the direct format."""
    # 0 - damping, because -0.0 would print as -0.
    return (
        f'solref="{-parameters["stiffness"]:.12g} {0 - parameters["damping"]:.12g}" '
        f'solimp="{_IMPEDANCE:g} {_IMPEDANCE:g} 0.001 0.5 2"'
    )


def _xml(model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps) -> str:
    axes, unit = model.dimensions, _unit_of_mass(model)
    # In the plane, too, as `noslip` needs both directions of friction.
    free = axes == 3 or model.scene.friction is not None
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
        inertia = spaced(np.full(3, model.inertia[k] / unit))
        joints = "<freejoint/>"
        if not free:
            along = np.eye(3)[:axes]
            joints = "".join(f'<joint type="slide" axis="{spaced(axis)}"/>' for axis in along)
        bodies.append(
            f'    <body name="sphere{k}" pos="{spaced(place)}">{joints}<inertial pos="0 0 0" '
            f'mass="{model.mass[k] / unit:.17g}" diaginertia="{inertia}"/>{shape}/></body>{title}'
        )
        places.append(spaced([*place, 1, 0, 0, 0]) if free else spaced(np.zeros(axes)))
        turning = [*velocity, *model.spin[k]] if free else velocity[:axes]
        speeds.append(spaced(turning))
    pairs = []
    _require_mu(model, exports, unit)
    for b, (second, name) in enumerate(geoms):
        for first, other in geoms[:b]:
            pair = min(first, second), max(first, second)
            made = exports.get(pair)
            if made is not None:
                friction = _friction(_mu(model.touches[pair]), steps)
                solver = _solver(made.parameters)
                pairs.append(f'    <pair geom1="{other}" geom2="{name}" {friction} {solver}/>')
    rubs = "" if model.scene.friction is None else f" {_FRICTION}"
    lines = [
        '<mujoco model="scene">',
        *([] if unit == 1 else [f"  <!-- masses in units of {unit:.17g} kg -->"]),
        f'  <option timestep="{steps.length:.17g}" gravity="{spaced(model.gravity)}" '
        f'integrator="Euler" tolerance="1e-12"{rubs}/>',
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


def _unit_of_mass(model: SceneModel) -> float:
    """Return the unit of mass in kg: with friction the heaviest sphere has `_HEAVY` μ² of it.

    Masses in another unit move alike, as `solref` acts on the acceleration.
    """
    coefficients = [mu for touch in model.touches.values() if (mu := _mu(touch)) > 0]
    heaviest = float(np.max(model.mass, where=np.isfinite(model.mass), initial=0.0))
    return heaviest / (_HEAVY * min(coefficients) ** 2) if coefficients else 1.0


def _mu(touch: Touch) -> float:
    return 0.0 if touch.friction is None else float(touch.friction.mu)


def _require_mu(model: SceneModel, exports: Mapping[tuple[int, int], Export], unit: float) -> None:
    """Raise ValueError for a μ whose friction is within the error of `noslip`."""
    asked, least = [], []
    for pair, made in exports.items():
        if (mu := _mu(model.touches[pair])) > 0:
            impulse = float(made.contact.mass) / unit * float(np.min(made.velocity))
            asked.append(mu)
            least.append(_LOOSE * float(np.max(made.duration)) / (_SMALL * impulse))
    if np.any(np.array(least) > asked):
        # They grow with the unit of mass, as 1/μ² of the smallest μ.
        held = 1.01 * (max(least) * min(asked) ** 2) ** (1 / 3)
        raise ValueError(
            f"Argument `scene` must have coefficients of friction of {held:.3g} or more, or 0, for "
            f"MuJoCo with these masses, speeds and durations of contact, but has {min(asked):g}. "
            f"Its friction is only right to {_LOOSE:g} in units of {unit:.3g} N."
        )


def _friction(mu: float, steps: EqualSteps) -> str:
    """Return the attributes of a pair for friction that may stop a slip within one step."""
    if not mu > 0:
        return 'condim="1"'
    return (
        f'condim="3" friction="{mu:.12g} {mu:.12g}" '
        f'solreffriction="-1 {-_IMPEDANCE / steps.length:.12g}"'
    )
