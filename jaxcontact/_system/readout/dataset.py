"""A run of a mechanism as an xarray dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Array

from .reading import SystemStates

if TYPE_CHECKING:
    import xarray

_STATES = {
    "position": ("coordinate", "position q", ""),
    "velocity": ("speed", "velocity v", ""),
    "gap": ("gap_number", "gap, negative in contact", "m"),
    "closing_speed": ("gap_number", "closing speed", "m/s"),
    "force": ("gap_number", "contact force", "N"),
    "energy": (None, "energy of the motion and of contacts", "J"),
    "work": (None, "work since the start", "J"),
}
_CONTACTS = {
    "gap": ("number of the gap", ""),
    "time": ("time of touch", "s"),
    "closing_speed": ("closing speed at touch", "m/s"),
    "restitution": ("restitution delivered", "1"),
    "duration": ("duration of contact", "s"),
    "max_force": ("largest force", "N"),
    "max_depth": ("largest indentation", "m"),
    "energy_loss": ("energy lost", "J"),
}


def dataset(
    states: SystemStates, contacts: dict[str, np.ndarray], status: str, reached: Array
) -> xarray.Dataset:
    """Return the states and contacts of a single run as a dataset. Raises ImportError without
    xarray.
    """
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    arrays: dict[str, Any] = {}
    for name, (axis, words, unit) in _STATES.items():
        axes = ("time",) if axis is None else ("time", axis)
        arrays[name] = (axes, np.asarray(getattr(states, name)), _attributes(words, unit))
    for name, (words, unit) in _CONTACTS.items():
        arrays[f"contact_{name}"] = (("contact",), contacts[name], _attributes(words, unit))
    time = (("time",), np.asarray(states.time), _attributes("time", "s"))
    return xarray.Dataset(arrays, {"time": time}, {"status": status, "reached": float(reached)})


def _attributes(words: str, unit: str) -> dict[str, str]:
    return {"long_name": words} | ({"units": unit} if unit else {})
