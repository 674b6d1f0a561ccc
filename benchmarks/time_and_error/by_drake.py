"""Drake: point contact, by its discrete plant and by error-controlled integrators."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from .rebounds import MASS, RADIUS, SPEED, Drop

_MODEL = """<sdf version="1.7" xmlns:drake="drake.mit.edu"><model name="{name}">{static}
  <link name="body"><inertial><mass>{mass}</mass></inertial><collision name="shape">
  <pose>0 0 {z} 0 0 0</pose><geometry>{shape}</geometry><drake:proximity_properties>
  <drake:hunt_crossley_dissipation>{dissipation!r}</drake:hunt_crossley_dissipation>
  <drake:point_contact_stiffness>{stiffness!r}</drake:point_contact_stiffness>
  </drake:proximity_properties></collision></link></model></sdf>"""
COARSEST = 20
"""Steps a contact by which a continuous plant must not miss it."""


def simulator_of(drop: Drop, step: float, approximation: str = "") -> tuple[Any, Any, Any]:
    """A simulator of a ball over a plane; discrete with a step, continuous without."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    config = MultibodyPlantConfig(time_step=step)
    if step:
        config.discrete_contact_approximation = approximation
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    shapes = (
        ("ball", f"<sphere><radius>{RADIUS}</radius></sphere>", 0, ""),
        ("ground", "<box><size>4 4 2</size></box>", -1, "<static>true</static>"),
    )
    for name, shape, z, static in shapes:
        text = _MODEL.format(
            name=name,
            shape=shape,
            z=z,
            static=static,
            mass=MASS,
            dissipation=drop.numbers["hunt_crossley_dissipation"],
            stiffness=drop.numbers["point_contact_stiffness"],
        )
        Parser(plant).AddModelsFromString(text, "sdf")
    plant.Finalize()
    body = plant.GetBodyByName("body", plant.GetModelInstanceByName("ball"))
    return Simulator(builder.Build()), plant, body


def _thrown(simulator: Any, plant: Any, body: Any, height: float, until: float) -> float:
    from pydrake.math import RigidTransform
    from pydrake.multibody.math import SpatialVelocity

    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    root.SetTime(0.0)
    plant.SetFreeBodyPose(context, body, RigidTransform([0, 0, height]))
    plant.SetFreeBodySpatialVelocity(context, body, SpatialVelocity([0, 0, 0], [0, 0, -SPEED]))
    simulator.Initialize()
    simulator.AdvanceTo(until)
    return plant.EvalBodySpatialVelocityInWorld(context, body).translational()[2] / SPEED


def discrete(drops: list[Drop], *, approximation: str) -> Any:
    """Steps of one length; simulators are made once a ladder's step."""

    @functools.cache
    def built(steps: float) -> list[Any]:
        return [simulator_of(drop, drop.ladder(steps)[0], approximation) for drop in drops]

    def run(steps: float) -> np.ndarray:
        found = []
        for made, drop in zip(built(steps), drops, strict=True):
            step, count = drop.ladder(steps)
            found.append(_thrown(*made, RADIUS + drop.gap(steps), step * count))
        return np.array(found)

    return run


def continuous(drops: list[Drop], *, scheme: str) -> Any:
    """An integrator by its name, to an accuracy."""
    from pydrake.systems.analysis import ResetIntegratorFromFlags

    @functools.cache
    def built(accuracy: float) -> list[Any]:
        made = [simulator_of(drop, 0.0) for drop in drops]
        for (simulator, *_), drop in zip(made, drops, strict=True):
            ResetIntegratorFromFlags(simulator, scheme, drop.duration / COARSEST)
            integrator = simulator.get_mutable_integrator()
            integrator.set_fixed_step_mode(False)
            integrator.set_target_accuracy(accuracy)
            integrator.request_initial_step_size_target(drop.duration / 100)
        return made

    def run(accuracy: float) -> np.ndarray:
        found = []
        for made, drop in zip(built(accuracy), drops, strict=True):
            until = 1.4 * drop.duration
            found.append(_thrown(*made, RADIUS + drop.gap(COARSEST), until))
        return np.array(found)

    return run
