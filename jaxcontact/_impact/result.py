"""The result of an impact."""

from __future__ import annotations

import enum

import equinox as eqx
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from .._parameter import shown
from .._text.units import quantity

NUMBERS = (
    *("restitution", "rebound_velocity", "duration", "compression_time"),
    *("max_indentation", "max_force", "energy_loss"),
)
"""The physical quantities of an `Impact`, in order."""


class Status(enum.IntEnum):
    """The values of `Impact.status`: the outcomes of an impact."""

    SEPARATED = 0
    """The bodies separated."""
    SETTLED = 1
    """The bodies stay in contact: restitution and rebound are zero, the duration is infinite."""
    NOT_CONVERGED = 2
    """The solve did not converge; the numbers are NaN. Try another method, or more `steps`."""
    INVALID_INPUT = 3
    """A parameter of this lane is out of range; its numbers are NaN."""
    GAINED = 4
    """The bodies separated faster than they met, e > 1, without an external force. The law adds
    energy. The numbers are those of the law as written. Check the sign of its damping."""


class Impact(eqx.Module):
    """The summary of an impact; every array has the broadcast shape of law, contact and speed.

    - `restitution`: e = -v(+)/v(-), dimensionless.
    - `rebound_velocity` in m/s, and `max_indentation` in m.
    - `duration`, `compression_time`: of contact, and until the indentation is largest, in s.
    - `max_force`: in N, the largest force of the whole contact.
    - `energy_loss`: in J.
    - `min_force`: in N, the least force, negative if the contact pulls. None for laws that cannot
      pull.
    - `status`: see `Status`.
    - `error_estimate`: the larger one of the estimated relative errors of restitution and duration.
      None for methods without an estimate.
    - `steps`: the number of accepted steps. None for closed forms.
    - `method`: the name of the method used.
    """

    restitution: Float[Array, "..."]
    rebound_velocity: Float[Array, "..."]
    duration: Float[Array, "..."]
    compression_time: Float[Array, "..."]
    max_indentation: Float[Array, "..."]
    max_force: Float[Array, "..."]
    energy_loss: Float[Array, "..."]
    status: Int[Array, "..."]
    error_estimate: Float[Array, "..."] | None
    steps: Int[Array, "..."] | None
    method: str = eqx.field(static=True)
    min_force: Float[Array, "..."] | None = None

    def __repr__(self) -> str:
        texts = {name: quantity(name, _show(getattr(self, name))) for name in NUMBERS}
        if self.min_force is not None:
            texts["min_force"] = quantity("min_force", _show(self.min_force))
        texts["status"] = status_words(self.status)
        lines = (f"  {name:<17}{text}" for name, text in texts.items())
        return "\n".join([f"Impact by method {self.method!r}", *lines])


def _show(value: Array) -> str:
    if isinstance(value, Tracer) or not eqx.is_array(value) or value.ndim == 0:
        return shown(value)
    array = np.asarray(value)
    good = array[np.isfinite(array)]
    if good.size == 0:
        return f"shape {array.shape}, none finite"
    return f"shape {array.shape}, from {good.min():.6g} to {good.max():.6g}"


def status_words(value: Array | np.ndarray) -> str:
    """Return the names of `Status` values, with counts if there are several lanes."""
    if isinstance(value, Tracer) or not eqx.is_array(value):
        return str(value)
    kinds, counts = np.unique(np.asarray(value), return_counts=True)
    names = [Status(int(kind)).name.lower() for kind in kinds]
    if np.ndim(value) == 0:
        return names[0]
    return ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True))
