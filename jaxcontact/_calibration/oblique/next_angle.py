"""The angle of impact at which friction laws that describe the data alike differ most."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._fit import Fit
from .measurements import Measurements
from .model import ObliqueModel

_DEGREES = np.arange(1.0, 86.0)

_ALIKE = 2e-3
"""Difference of v_t'/v_t that no measurement resolves."""

_curve = eqx.filter_jit(ObliqueModel.__call__)


def next_angle(best: Fit, rivals: Sequence[Fit], there: Measurements) -> str:
    """Return where to measure next, in words; "" without rivals."""
    if not rivals:
        return ""
    speed = float(np.median(np.hypot(*there.x.values())))
    angle = np.radians(_DEGREES)
    x = {"velocity": speed * np.cos(angle), "tangential_velocity": speed * np.sin(angle)}
    model = dataclasses.replace(there.model, fields=("tangential_restitution",))
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        places = {name: jnp.asarray(values) for name, values in x.items()}
        curves = [
            np.asarray(_curve(model, fit.params, places)["tangential_restitution"])
            for fit in (best, *rivals)
        ]
    apart = np.min([np.abs(curve - curves[0]) for curve in curves[1:]], axis=0)
    i = int(np.nanargmax(apart))
    if not apart[i] > _ALIKE:
        return "These laws differ at no angle by more than a measurement resolves."
    return (
        f"They differ most at an angle of impact of {_DEGREES[i]:.0f} degrees from the normal, by "
        f"{apart[i]:.2g} in v_t'/v_t: measure there."
    )
