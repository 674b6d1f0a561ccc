"""A run as an xarray dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Array

from ..bodies.scene import Scene
from ..result import Ending, Impacts, SolvedBy, States

if TYPE_CHECKING:
    import xarray

_MEANING = {
    "time": ("time", "s"),
    "position": ("position of the centre", "m"),
    "velocity": ("velocity", "m/s"),
    "spin": ("spin", "rad/s"),
    "slip": ("sliding speed before", "m/s"),
    "slip_after": ("sliding speed after, negative after a reversal", "m/s"),
    "energy": ("energy: kinetic, weight, stored in contacts", "J"),
    "radius": ("radius", "m"),
    "mass": ("mass, infinite where fixed", "kg"),
    "sphere": ("number among the bodies", ""),
    "impact_time": ("time of touch", "s"),
    "first": ("number of one body", ""),
    "second": ("number of the other body", ""),
    "face": ("face of a box, -1 where there is none", ""),
    "closing_speed": ("closing speed", "m/s"),
    "restitution": ("restitution delivered", "1"),
    "duration": ("duration of contact", "s"),
    "max_force": ("largest force", "N"),
    "energy_loss": ("energy lost", "J"),
    "turn": ("turn of the line of centres", "rad"),
    "error_estimate": ("estimated error, relative to the closing speed", "1"),
    "tied": ("another impact of one of the bodies at the same time", ""),
    "body_name": ("name of a body", ""),
    "name": ("name of a sphere", ""),
}


def dataset(
    scene: Scene,
    states: States,
    impacts: Impacts,
    *,
    bodies: tuple[int, ...],
    status: Array,
    reached: Array,
    wall_work: Array,
) -> xarray.Dataset:
    """Return the states and impacts of a single run as a dataset. `bodies` are the numbers of its
    spheres. Raises ImportError without xarray, ValueError for a batch of runs.
    """
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    columns = impacts.to_dict()
    arrays: dict[str, Any] = {
        "position": (("time", "sphere", "axis"), np.asarray(states.position)),
        "velocity": (("time", "sphere", "axis"), np.asarray(states.velocity)),
        "energy": (("time",), np.asarray(states.energy)),
        "body_name": (("body",), list(impacts.names)),
    }
    arrays |= {name: (("impact",), column) for name, column in columns.items() if name != "time"}
    if states.spin is not None:
        axes = ("time", "sphere", "axis")[: states.spin.ndim]
        arrays["spin"] = (axes, np.asarray(states.spin))
    masses = [sphere.known_mass() for sphere in scene.spheres]
    coordinates: dict[str, Any] = {
        "time": (("time",), np.asarray(states.time)),
        "sphere": (("sphere",), list(bodies)),
        "axis": (("axis",), list("xyz"[: scene.dimensions])),
        "name": (("sphere",), [impacts.names[k] for k in bodies]),
        "radius": (("sphere",), [float(sphere.radius) for sphere in scene.spheres]),
        "mass": (("sphere",), [np.inf if mass is None else float(mass) for mass in masses]),
        "body": (("body",), np.arange(len(impacts.names))),
        "impact_time": (("impact",), columns["time"]),
    }
    arrays, coordinates = (
        {name: (*column, _attributes(name)) for name, column in group.items()}
        for group in (arrays, coordinates)
    )
    attributes: dict[str, Any] = {"status": Ending.names_of(status).replace("_", " ")}
    attributes |= {"reached": float(reached), "wall_work": float(wall_work)}
    return xarray.Dataset(arrays, coordinates, attributes)


def _attributes(name: str) -> dict[str, Any]:
    """Return the attributes of a quantity: long name and unit, or the names of its flags."""
    if name == "solved_by":
        return {
            "long_name": "how the impact was solved",
            "flag_values": [int(way) for way in SolvedBy],
            "flag_meanings": " ".join(way.name.lower() for way in SolvedBy),
        }
    words, unit = _MEANING.get(name, ("", ""))
    return ({"long_name": words} if words else {}) | ({"units": unit} if unit else {})
