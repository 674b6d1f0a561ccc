"""Exudyn: spheres that touch, by its explicit and its implicit integrators."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from .rebounds import MASS, RADIUS, SPEED, Drop


def touch(system: Any, ball: Any, other: Any, gap: float, radii: list[float], **law: Any) -> None:
    """A contact of a ball with another one; None: with one that is held still, for a plane."""
    from exudyn.utilities import (
        MarkerBodyPosition,
        MarkerBodyRigid,
        NodeGenericData,
        ObjectContactSphereSphere,
    )

    moving = system.AddMarker(MarkerBodyPosition(bodyNumber=ball))
    if other is None:
        held = system.AddMarker(MarkerBodyRigid(bodyNumber=system.CreateGround()))
        markers = [held, moving]
    else:
        markers = [moving, system.AddMarker(MarkerBodyPosition(bodyNumber=other))]
    memory = NodeGenericData(initialCoordinates=[gap, 0, 0, 0], numberOfDataCoordinates=4)
    system.AddObject(
        ObjectContactSphereSphere(
            markerNumbers=markers,
            nodeNumber=system.AddNode(memory),
            spheresRadii=radii,
            dynamicFriction=0.0,
            **law,
        )
    )


def ball(drop: Drop, gap: float) -> tuple[Any, int]:
    """A ball over one that is held still, which stands for the plane: the force knows no radius."""
    import exudyn

    system = exudyn.SystemContainer().AddSystem()
    moving = system.CreateMassPoint(
        referencePosition=[0, 0, 2 * RADIUS + gap],
        initialVelocity=[0, 0, -SPEED],
        mass=MASS,
        gravity=[0, 0, 0],
    )
    touch(system, moving, None, gap, [RADIUS, RADIUS], impactModel=2, **drop.numbers)
    system.Assemble()
    return system, moving


def settings_of(step: float, count: int) -> Any:
    """Steps of one length, without a file and without words."""
    import exudyn

    settings = exudyn.SimulationSettings()
    settings.timeIntegration.endTime = step * count
    settings.timeIntegration.numberOfSteps = count
    # It shortens a step to end at touch; its own shortest step is 1e-8 s.
    settings.timeIntegration.minimumStepSize = 1e-9 * step
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.solutionSettings.sensorsWritePeriod = step * count
    return settings


def solver(drops: list[Drop], *, scheme: str) -> Any:
    """Every drop's system is built once a ladder's step, and starts anew with every solve."""
    import exudyn

    kind = getattr(exudyn.DynamicSolverType, scheme)

    @functools.cache
    def built(steps: float) -> list[Any]:
        return [(*ball(drop, drop.gap(steps)), drop.ladder(steps)) for drop in drops]

    def run(steps: float) -> np.ndarray:
        found = []
        for system, moving, ladder in built(steps):
            system.SolveDynamic(settings_of(*ladder), solverType=kind)
            found.append(system.GetObjectOutputBody(moving, exudyn.OutputVariableType.Velocity)[2])
        return np.array(found) / SPEED

    return run
