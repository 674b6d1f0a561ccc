"""Drake: contact properties, and a world in SDF with a script that runs it and writes the table."""

from __future__ import annotations

import math
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ... import Contact, Damped, MarhefkaOrin, RigidCoulomb, exact_damping_factor
from ...extend import require_choice
from ..at_time_step import Scheme
from ..engine import Draft, Wanted, matched_stiffness, register_engine
from ..result import Export
from ..scenes.engine import EqualSteps, SceneEngine, refuse_all, refuse_friction, script, spaced
from ..scenes.model import SceneModel
from .dashpots import LINEAR, SpringAndDashpot, pushing_dashpot

_DRAKE = "drake.mit.edu/doxygen_cxx/group__compliant__contact.html"
_APPROXIMATIONS = "lagged", "similar", "sap"

_SAME = 1e-6
"""Largest relative difference of parameters that count as the same."""

_STICKS = 1e-4
"""Slip over the largest closing speed below which friction is less than μF."""

_RUN = """
config = MultibodyPlantConfig(
    time_step=STEP, discrete_contact_approximation="lagged", stiction_tolerance=STICKS
)
builder = DiagramBuilder()
plant, _ = AddMultibodyPlant(config, builder)
Parser(plant).AddModels("scene.sdf")
plant.mutable_gravity_field().set_gravity_vector(numpy.pad(GRAVITY, (0, 3 - AXES)))
plant.Finalize()
simulator = Simulator(builder.Build())
context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
balls = {
    k: plant.GetBodyByName("link", plant.GetModelInstanceByName(f"sphere{k}"))
    for k in numpy.flatnonzero(numpy.isfinite(MASS))
}
for k, ball in balls.items():
    plant.SetFreeBodySpatialVelocity(context, ball, SpatialVelocity(SPIN[k], VELOCITY[k]))
table = Table()


def add(time):
    position, velocity, spin = PLACE.copy(), numpy.zeros_like(PLACE), numpy.zeros_like(PLACE)
    for k, ball in balls.items():
        position[k] = plant.EvalBodyPoseInWorld(context, ball).translation()
        moves = plant.EvalBodySpatialVelocityInWorld(context, ball)
        velocity[k], spin[k] = moves.translational(), moves.rotational()
    table.add(time, position, velocity, spin if AXES == 3 else spin[:, 2:])


simulator.Initialize()
add(0.0)
for output in range(1, OUTPUTS + 1):
    simulator.AdvanceTo(output * BETWEEN * STEP)
    add(output * BETWEEN * STEP)
table.write()
"""


@register_engine
class Drake(SceneEngine):
    """Drake's point contact F = k δ (1 + d δ'): α = d v0, so d = α(e)/v0, exactly.

    This is the law of Marhefka and Orin with a = (2/3) d. The approximation "sap" has the law F = k
    (δ + τ δ') while positive, which is Kelvin-Voigt without tension. A scene has a model for each
    body; every geometry has the same contact properties.
    """

    name = "drake"
    constant = False

    def draft(self, wanted: Wanted, *, discrete_contact_approximation: str = "lagged") -> Draft:
        name = "discrete_contact_approximation"
        if require_choice(name, discrete_contact_approximation, _APPROXIMATIONS) == "sap":
            return _sap(wanted)
        alpha = exact_damping_factor(wanted.restitution)
        dissipation = float(alpha) / wanted.velocity
        stiffness = matched_stiffness(wanted, 1.0, Damped(alpha=alpha))
        # Two geometries in series: each has twice the stiffness and the same dissipation.
        of_each = 2 * stiffness
        parameters = {"hunt_crossley_dissipation": dissipation, "point_contact_stiffness": of_each}
        return Draft(
            model="point contact",
            law=MarhefkaOrin(a=jnp.asarray(dissipation / 1.5)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units={"hunt_crossley_dissipation": "s/m", "point_contact_stiffness": "N/m"},
            snippet=_tags(parameters, "\n  "),
            steps=1000,
            expected_error=0.006,
            limit=(
                "for both geometries, each with these numbers. e falls with speed. A discrete "
                "plant adds damping of first order in the time step; a continuous one "
                "(time_step=0) does not. Contact approximation lagged or similar; for sap ask for "
                "discrete_contact_approximation=sap."
            ),
            scheme=Scheme.IMPLICIT,
            source=f"{_DRAKE}; Hunt & Crossley 1975, doi 10.1115/1.3423596",
        )

    def refuse(self, model: SceneModel) -> None:
        refuse_all(model, "Drake", shells=True, periodic=True, motion=True)
        if len(model.scene.law.values) > 1:
            raise ValueError(
                "Argument `scene` must have one `law` for Drake, whose contact properties are "
                "those of bodies and not of pairs, but has one by pair."
            )
        refuse_friction(model, "Drake", RigidCoulomb)
        if model.scene.friction is not None and len(model.scene.friction.values) > 1:
            raise ValueError(
                "Argument `scene` must have one `friction` for Drake, whose coefficients are those "
                "of bodies and not of pairs, but has one by pair."
            )

    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        fastest = max(float(np.max(made.velocity)) for made in exports.values())
        numbers = {
            "PLACE": model.position,
            "VELOCITY": model.velocity,
            "SPIN": model.spin,
            "STICKS": _STICKS * fastest,
        }
        imports = [
            "from pydrake.multibody.math import SpatialVelocity",
            "from pydrake.multibody.parsing import Parser",
            "from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig",
            "from pydrake.systems.analysis import Simulator",
            "from pydrake.systems.framework import DiagramBuilder",
        ]
        title = "Run scene.sdf in Drake and write run.csv: python run.py"
        run = script(title, imports, numbers, _RUN, model, steps)
        return {"scene.sdf": _sdf(model, exports), "run.py": run}


def _tags(parameters: Mapping[str, float], between: str = "") -> str:
    """Return contact properties in SDF."""
    tags = [f"{between}<drake:{name}>{x:.12g}</drake:{name}>" for name, x in parameters.items()]
    end = between.rstrip(" ") + "</drake:proximity_properties>"
    return f"<drake:proximity_properties>{''.join(tags)}{end}"


def _sap(wanted: Wanted) -> Draft:
    stiffness, zeta = pushing_dashpot(wanted)
    # δ'' = -ω² (δ + τ δ'), and 2 ζ ω = ω² τ.
    rate = math.sqrt(stiffness / wanted.mass)
    relaxation = max(0.0, 2 * zeta / rate)
    # Two geometries in series: their relaxation times add.
    parameters = {"relaxation_time": relaxation / 2, "point_contact_stiffness": 2 * stiffness}
    return Draft(
        model="point contact, discrete_contact_approximation sap",
        law=SpringAndDashpot(rate=jnp.asarray(relaxation * rate**2)),
        contact=Contact(wanted.mass, stiffness, 1.0),
        parameters=parameters,
        units={"relaxation_time": "s", "point_contact_stiffness": "N/m"},
        snippet=_tags(parameters, "\n  "),
        scheme=Scheme.IMPLICIT,
        limit=(
            f"for both geometries, each with these numbers. {LINEAR}. e is the same at all speeds, "
            "for this mass. Only for a discrete plant; sap lowers a stiffness that its "
            "time step does not resolve. Not run."
        ),
        source=(
            f"{_DRAKE}; contact_properties.cc of github.com/RobotLocomotion/drake; Castro et al. "
            "2021, arXiv 2110.10107; Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z"
        ),
    )


def _properties(model: SceneModel, exports: Mapping[tuple[int, int], Export]) -> str:
    """Return the contact properties of every geometry.

    e depends on the dissipation alone, which is the same for all pairs with the same law. The
    stiffness is the smallest of those of the pairs, so that no contact is shorter than asked for.
    """
    found = {
        name: np.array([made.parameters[name] for made in exports.values()])
        for name in ("hunt_crossley_dissipation", "point_contact_stiffness")
    }
    dissipation = found["hunt_crossley_dissipation"]
    if np.ptp(dissipation) > _SAME * dissipation.max():
        raise ValueError(
            "Argument `scene` must have a law whose e is the same for all pairs for Drake, but "
            f"asks for dissipations from {dissipation.min():.4g} to {dissipation.max():.4g} s/m."
        )
    stiffness = float(found["point_contact_stiffness"].min())
    friction = next(iter(model.touches.values())).friction
    # Of two surfaces Drake takes the harmonic mean, which for equal ones is that of each.
    mu = 0.0 if friction is None else float(friction.mu)
    entries = {
        "hunt_crossley_dissipation": float(dissipation[0]),
        "point_contact_stiffness": stiffness,
        "mu_dynamic": mu,
        "mu_static": mu,
    }
    return _tags(entries)


def _sdf(model: SceneModel, exports: Mapping[tuple[int, int], Export]) -> str:
    properties = _properties(model, exports)
    lines = [
        '<sdf version="1.7" xmlns:drake="drake.mit.edu">',
        '<world name="scene">',
    ]

    def add(name: str, title: str, place: np.ndarray, shape: str, inertial: str | None) -> None:
        still = "<static>true</static>" if inertial is None else ""
        lines.append(
            f'<model name="{name}">{still}<pose>{spaced(place)} 0 0 0</pose>  <!-- {title} -->\n'
            f'  <link name="link">{inertial or ""}<collision name="shape"><geometry>{shape}'
            f"</geometry>\n  {properties}</collision></link>\n</model>"
        )

    for k, wall in enumerate(model.flat):
        shape = f"<plane><normal>{spaced(wall.normal)}</normal></plane>"
        add(f"wall{k}", model.name(wall.body), wall.point, shape, None)
    for k, radius in enumerate(model.radius):
        inertial = None
        if k not in model.motions:
            inertia = f"{model.inertia[k]:.17g}"
            inertial = (
                f"<inertial><mass>{model.mass[k]:.17g}</mass><inertia><ixx>{inertia}</ixx>"
                f"<iyy>{inertia}</iyy><izz>{inertia}</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz>"
                "</inertia></inertial>"
            )
        shape = f"<sphere><radius>{radius:.17g}</radius></sphere>"
        add(f"sphere{k}", model.name(int(model.body[k])), model.position[k], shape, inertial)
    return "\n".join([*lines, "</world>", "</sdf>"]) + "\n"
