"""Exudyn: its connector, and a script with one for each pair of bodies of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import (
    AbstractHuntCrossley,
    AbstractLaw,
    CarvalhoMartins,
    Contact,
    Gonthier,
    HuntCrossley,
    Luding,
    RegularizedCoulomb,
    exact_damping_factor,
)
from ...extend import RESTITUTION, concrete, parameter, refusal, rendered
from ..engine import Draft, Wanted, as_luding, register_engine
from ..result import Export
from ..scenes.engine import EqualSteps, SceneEngine, refuse_all, refuse_friction, script
from ..scenes.model import SceneModel, Touch
from .dashpots import PULLS, pasted, pulling_dashpot

_MOST = 30
"""Largest number of spheres: each pair of bodies has a connector of its own."""

_WIDE = 1000.0
"""Half the width of a wall over the size of the scene: it is a triangle."""

_ROUND = 1e6
"""Radius of a sphere in place of a wall over the size of the scene; a gap rounds to 1e-10 of it."""

_RUN = """
container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.CreateGround()
bodies = []
for k, mass in enumerate(MASS):
    if not numpy.isfinite(mass):
        bodies.append(None)
        continue
    inertia = RigidBodyInertia(mass=mass, inertiaTensor=INERTIA[k] * numpy.eye(3))
    bodies.append(
        system.CreateRigidBody(
            inertia=inertia,
            nodeType=exudyn.NodeType.RotationEulerParameters if SPINS
            else exudyn.NodeType.RotationRxyz,
            referencePosition=PLACE[k],
            initialVelocity=VELOCITY[k],
            initialAngularVelocity=SPIN[k],
            gravity=numpy.pad(GRAVITY, (0, 3 - AXES)),
        )
    )
balls = [
    system.AddMarker(
        MarkerBodyRigid(bodyNumber=ground, localPosition=PLACE[k])
        if body is None
        else MarkerBodyRigid(bodyNumber=body)
    )
    for k, body in enumerate(bodies)
]


def memory(gap):
    data = NodeGenericData(initialCoordinates=[gap, 0, 0, 0], numberOfDataCoordinates=4)
    return system.AddNode(data)


for first, second, gap, contact in PAIRS:
    system.AddObject(
        ObjectContactSphereSphere(
            markerNumbers=[balls[first], balls[second]],
            nodeNumber=memory(gap),
            spheresRadii=[RADIUS[first], RADIUS[second]],
            **contact,
        )
    )
for ball, centre, radius, hollow, gap, contact in ROUND:
    wall = system.AddMarker(MarkerBodyRigid(bodyNumber=ground, localPosition=centre))
    system.AddObject(
        ObjectContactSphereSphere(
            markerNumbers=[balls[ball], wall],
            nodeNumber=memory(gap),
            spheresRadii=[RADIUS[ball], radius],
            isHollowSphere1=hollow,
            **contact,
        )
    )
for ball, corners, gap, contact in WALLS:
    wall = system.AddMarker(MarkerBodyRigid(bodyNumber=ground))
    system.AddObject(
        ObjectContactSphereTriangle(
            markerNumbers=[balls[ball], wall],
            nodeNumber=memory(gap),
            sphereRadius=RADIUS[ball],
            trianglePoints=exudyn.Vector3DList(corners),
            includeEdges=0,
            **contact,
        )
    )
kinds = [exudyn.OutputVariableType.Position, exudyn.OutputVariableType.Velocity]
if SPINS:
    kinds.append(exudyn.OutputVariableType.AngularVelocity)
sensors = {
    k: [
        system.AddSensor(SensorBody(bodyNumber=body, outputVariableType=kind, storeInternal=True))
        for kind in kinds
    ]
    for k, body in enumerate(bodies)
    if body is not None
}
system.Assemble()
settings = exudyn.SimulationSettings()
settings.timeIntegration.endTime = STEP * BETWEEN * OUTPUTS
settings.timeIntegration.numberOfSteps = BETWEEN * OUTPUTS
# It shortens a step to end at touch; its own shortest step is 1e-8 s.
settings.timeIntegration.minimumStepSize = 1e-9 * STEP
settings.timeIntegration.verboseMode = 0
settings.solution.file.write = False
settings.solution.sensors.writePeriod = STEP * BETWEEN
system.SolveDynamic(settings)
found = {k: [system.GetSensorStoredData(s) for s in of] for k, of in sensors.items()}
table = Table()
for row, time in enumerate(next(iter(found.values()))[0][:, 0]):
    position, velocity, spin = PLACE.copy(), numpy.zeros_like(PLACE), numpy.zeros_like(PLACE)
    for k, stored in found.items():
        position[k], velocity[k] = stored[0][row, 1:], stored[1][row, 1:]
        spin[k] = stored[2][row, 1:] if SPINS else 0
    table.add(time, position, velocity, spin if AXES == 3 else spin[:, 2:])
table.write()
"""


class GonthierCarvalhoMartins(AbstractHuntCrossley):
    """Exudyn's impactModel 2: α of Carvalho and Martins for e > 1/3, of Gonthier et al. below.

    `e` in (0, 1] is the restitutionCoefficient of the connector. The two formulas agree at e = 1/3.
    Source: ObjectContactSphereSphere in Exudyn's documentation, exudyn.readthedocs.io.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    def damping_factor(
        self, contact: Contact | None = None, velocity: Any = None
    ) -> Float[Array, "..."]:
        above = CarvalhoMartins(e=self.e).damping_factor()
        return jnp.where(self.e > 1 / 3, above, Gonthier(e=self.e).damping_factor())


def _of_both(alpha: float) -> float:
    """Return the e whose α is that of Carvalho and Martins (above 1/3) or of Gonthier et al."""
    # Both are quadratic in e: 3(1-e)(11-e) = 2α(1+9e), and 1-e² = αe. Their α agree at e = 1/3.
    if alpha < 8 / 3:
        half = 6 + 3 * alpha
        constant = 11 - 2 * alpha / 3
        return constant / (half + math.sqrt(half**2 - constant))
    return 2 / (alpha + math.sqrt(alpha**2 + 4))


# For each impactModel: its law, the e for a given α, and its source.
_MODELS = {
    1: (HuntCrossley, lambda alpha: 1 - alpha / 1.5, "Hunt & Crossley 1975, doi 10.1115/1.3423596"),
    2: (
        GonthierCarvalhoMartins,
        _of_both,
        "Gonthier et al. 2004, doi 10.1023/B:MUBO.0000029392.21648.bc; "
        "Carvalho & Martins 2019, doi 10.1016/j.mechmachtheory.2019.04.018",
    ),
}


def _plastic(wanted: Wanted, law: Luding) -> Draft:
    """Return Exudyn's model 0: K δ, back K (δ - λ δ_m)/(1-λ), and at least -k_adh δ."""
    if float(law.slope) != 0:
        raise ValueError(
            "Argument `law` must have the slope 0 for engine 'exudyn', but has "
            f"{float(law.slope):g} 1/m; to match its restitution alone, give `impact_model=2`."
        )
    parameters = {
        "contactStiffness": wanted.stiffness,
        "contactStiffnessExponent": 1.0,
        "contactPlasticityRatio": 1 - 1 / float(law.ratio),
        "adhesionCoefficient": float(law.adhesion) * wanted.stiffness,
        "adhesionExponent": 1.0,
    }
    return Draft(
        model="ObjectContactSphereSphere, impactModel 0",
        law=law,
        contact=Contact(wanted.mass, wanted.stiffness, 1.0),
        parameters=parameters,
        units=dict(zip(parameters, ("N/m", "", "", "N/m", ""), strict=True)),
        snippet=f"{pasted(parameters)}, contactDamping=0, impactModel=0",
        steps=200,
        expected_error=0.004,
        limit="The same law at all speeds, for all masses. The bodies must start apart.",
        source=(
            "ObjectContactSphereSphere, exudyn.readthedocs.io; Luding 2008, "
            "doi 10.1007/s10035-008-0099-x"
        ),
    )


def _dashpot(wanted: Wanted) -> Draft:
    """Return Exudyn's model 0 with damping: K δ + d δ', which may pull."""
    law, stiffness, damping = pulling_dashpot(wanted)
    parameters = {
        "contactStiffness": stiffness,
        "contactStiffnessExponent": 1.0,
        "contactDamping": damping,
    }
    return Draft(
        model="ObjectContactSphereSphere, impactModel 0",
        law=law,
        contact=Contact(wanted.mass, stiffness, 1.0),
        parameters=parameters,
        units=dict(zip(parameters, ("N/m", "", "N s/m"), strict=True)),
        snippet=f"{pasted(parameters)}, impactModel=0",
        steps=800,
        expected_error=0.008,
        limit=(
            f"{PULLS}. e is the same at all speeds, for this mass. The bodies must start apart."
        ),
        source=(
            "ObjectContactSphereSphere, exudyn.readthedocs.io; Anagnostopoulos 1988, "
            "doi 10.1002/eqe.4290160311"
        ),
    )


@register_engine
class Exudyn(SceneEngine):
    """Exudyn's ObjectContactSphereSphere, with the coefficient for which its α is α(e).

    A `Luding` or `WaltonBraun` is exported as it is, unless an `impact_model` of 1 or 2 is given. A
    scene has a rigid body for each sphere; walls are large triangles, or large spheres if plastic.
    """

    name = "exudyn"
    adhesive: ClassVar[tuple[type[AbstractLaw], ...]] = (Luding,)

    def draft(self, wanted: Wanted, *, impact_model: int | None = None) -> Draft:
        if impact_model is not None and concrete(impact_model) not in (0, *_MODELS):
            raise refusal("impact_model", "be 0, 1 or 2", impact_model)
        if not impact_model and (law := as_luding(wanted.law)) is not None:
            return _plastic(wanted, law)
        if impact_model == 0:
            return _dashpot(wanted)
        impact_model = 2 if impact_model is None else int(impact_model)
        alpha = float(exact_damping_factor(wanted.restitution))
        kind, inverse, source = _MODELS[impact_model]
        nominal = inverse(alpha)
        if not nominal > 0:
            raise ValueError(
                "Argument `impact_model` must be 2 here, but is 1, which delivers at least "
                f"0.48774: {wanted.restitution:g} is wanted."
            )
        return Draft(
            model=f"ObjectContactSphereSphere, impactModel {impact_model}",
            law=kind(e=jnp.asarray(nominal)),
            contact=Contact(wanted.mass, wanted.stiffness, wanted.exponent),
            parameters={
                "restitutionCoefficient": nominal,
                "contactStiffness": wanted.stiffness,
                "contactStiffnessExponent": wanted.exponent,
            },
            units={
                "restitutionCoefficient": "",
                "contactStiffness": f"N/m^{wanted.exponent:g}",
                "contactStiffnessExponent": "",
            },
            snippet=(
                f"contactStiffness={wanted.stiffness:.12g}, "
                f"contactStiffnessExponent={wanted.exponent:.12g}, contactDamping=0, "
                f"restitutionCoefficient={nominal:.12g}, impactModel={impact_model}"
            ),
            steps=50,
            expected_error=0.002,
            limit=(
                "e does not depend on speed, down to minimumImpactVelocity: the connector stores "
                "the speed at touch. The bodies must start apart: a ball that starts in touch is "
                "never damped."
            ),
            source=f"ObjectContactSphereSphere, exudyn.readthedocs.io; {source}",
        )

    def refuse(self, model: SceneModel) -> None:
        refuse_all(model, "Exudyn", periodic=True, motion=True)
        refuse_friction(model, "Exudyn", RegularizedCoulomb)
        for law in model.scene.law.values:
            if isinstance(law, Luding) and float(law.slope) != 0:
                raise ValueError(
                    "Argument `scene` must have a `Luding` of slope 0 for Exudyn, but has "
                    f"{rendered(law)}."
                )
        if len(model.radius) > _MOST:
            raise ValueError(
                f"Argument `scene` must have at most {_MOST} spheres for Exudyn, where each pair "
                f"has a connector, but has {len(model.radius)}."
            )

    def options(self, touch: Touch, constant: bool) -> Iterable[Mapping[str, Any]]:
        law = as_luding(touch.law)
        own = law is not None and float(law.slope) == 0
        return ({"impact_model": 0 if own else 2},)

    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        numbers = {
            "PLACE": model.position,
            "VELOCITY": model.velocity,
            "SPIN": model.spin,
            "RADIUS": model.radius.tolist(),
            "PAIRS": _pairs(model, exports),
            "ROUND": _shells(model, exports) + _plastic_walls(model, exports),
            "WALLS": _flat(model, exports),
        }
        for entries in (numbers["PAIRS"], numbers["ROUND"], numbers["WALLS"]):
            for entry in entries:
                if not entry[-2] > 0:
                    raise ValueError(
                        "Argument `scene` must have bodies that start apart for Exudyn, which does "
                        "not damp a contact that is closed at the start, but sphere "
                        f"{entry[0]} touches."
                    )
        imports = [
            "import exudyn",
            "from exudyn.utilities import (",
            "    MarkerBodyRigid,",
            "    NodeGenericData,",
            "    ObjectContactSphereSphere,",
            "    ObjectContactSphereTriangle,",
            "    RigidBodyInertia,",
            "    SensorBody,",
            ")",
        ]
        title = "Run a scene in Exudyn and write run.csv: python run.py"
        return {"run.py": script(title, imports, numbers, _RUN, model, steps)}


def _contact(model: SceneModel, exports: Mapping, first: int, second: int) -> dict | None:
    """Return the keyword arguments of a connector; None for groups that cannot meet."""
    pair = min(first, second), max(first, second)
    if pair not in exports:
        return None
    made = exports[pair]
    words = {**made.parameters, "contactDamping": 0.0, "impactModel": 0 if _is_plastic(made) else 2}
    friction: Any = model.touches[pair].friction
    if friction is not None and friction.kind == "ramp":
        words["dynamicFriction"] = float(friction.mu)
        words["frictionProportionalZone"] = float(friction.v_d)
    return words


def _pairs(model: SceneModel, exports: Mapping) -> list[tuple]:
    found = []
    for b in range(len(model.radius)):
        for a in range(b):
            contact = _contact(model, exports, int(model.group[a]), int(model.group[b]))
            if contact is not None and not {a, b} <= set(model.motions):
                apart = float(np.linalg.norm(model.position[b] - model.position[a]))
                found.append((a, b, apart - float(model.radius[a] + model.radius[b]), contact))
    return found


def _shells(model: SceneModel, exports: Mapping) -> list[tuple]:
    found = []
    for shell in model.round:
        for k in range(len(model.radius)):
            contact = _contact(model, exports, int(model.group[k]), shell.group)
            if contact is not None:
                off = float(np.linalg.norm(model.position[k] - shell.centre))
                gap = shell.radius - off - float(model.radius[k])
                found.append((k, shell.centre.tolist(), shell.radius, True, gap, contact))
    return found


def _is_plastic(made: Export) -> bool:
    return "contactPlasticityRatio" in made.parameters


def _at_walls(model: SceneModel, exports: Mapping, plastic: bool) -> Iterable[tuple]:
    """Return the flat walls with a ball that may touch, its gap and contact, plastic or not."""
    for wall in model.flat:
        for k in range(len(model.radius)):
            contact = _contact(model, exports, int(model.group[k]), wall.group)
            if contact is not None and (contact["impactModel"] == 0) == plastic:
                gap = float((model.position[k] - wall.point) @ wall.normal - model.radius[k])
                yield wall, k, gap, contact


def _plastic_walls(model: SceneModel, exports: Mapping) -> list[tuple]:
    """Return large spheres in place of walls, as a triangle has no plasticity."""
    low, high = model.extent()
    radius = _ROUND * float(np.max(high - low))
    return [
        (k, (wall.point - radius * wall.normal).tolist(), radius, False, gap, contact)
        for wall, k, gap, contact in _at_walls(model, exports, plastic=True)
    ]


def _flat(model: SceneModel, exports: Mapping) -> list[tuple]:
    low, high = model.extent()
    wide = _WIDE * float(np.max(high - low))
    found = []
    for wall, k, gap, contact in _at_walls(model, exports, plastic=False):
        # Any vector that is not parallel gives two directions along the wall.
        other = np.eye(3)[int(np.argmin(np.abs(wall.normal)))]
        along = np.cross(wall.normal, other)
        along /= np.linalg.norm(along)
        across = np.cross(wall.normal, along)
        corners = [along, -along / 2 + across, -along / 2 - across]
        points = [(wall.point + wide * corner).tolist() for corner in corners]
        found.append((k, points, gap, contact))
    return found
