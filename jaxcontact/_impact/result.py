"""The result of an impact."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from .._entry import shown, traced
from .._text.columns import in_lines
from .._text.failure import Flagged, WordedEnum
from .._text.units import quantity

NUMBERS = (
    *("restitution", "rebound_velocity", "duration", "compression_time"),
    *("max_indentation", "max_force", "energy_loss"),
)
"""The physical quantities of an `Impact`, in order."""


class Status(WordedEnum):
    """The outcomes of an impact. NOT_CONVERGED and INVALID_INPUT are failures, with NaN."""

    SEPARATED = 0, "The bodies separated."
    SETTLED = 1, "They stay in contact: e and rebound are zero, the duration is infinite."
    NOT_CONVERGED = 2, "The solve did not converge. Try another method, or more steps."
    INVALID_INPUT = 3, "A parameter is out of its range."
    GAINED = 4, "e > 1 without a push: the law adds energy. Check the sign of its damping."


class Impact(Flagged, eqx.Module):
    """The summary of an impact; every array has the broadcast shape of law, contact and speed.

    - `restitution`: e = -v(+)/v(-), dimensionless, with v(+) at the end of the contact: where its
      force vanishes for good, at δ = 0 or before.
    - `rebound_velocity` of that moment in m/s, and `max_indentation` in m.
    - `duration` up to it, `compression_time` until the indentation is largest, in s.
    - `max_force`: in N, the largest force of the whole contact.
    - `energy_loss`: in J.
    - `min_force`: in N, the least force, negative if the contact pulls. None for laws that cannot
      pull.
    - `status`: see `Status`. `ok`: where it is not failed.
    - `error_estimate`: the larger one of the estimated relative errors of restitution and duration.
      None for methods without an estimate.
    - `steps`: the number of accepted steps. None for closed forms.
    - `method`: the name of the method used. `solver`: what took its steps, in words; None for
      methods without a choice.
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
    solver: str | None = eqx.field(static=True, default=None)
    _failures = Status.NOT_CONVERGED, Status.INVALID_INPUT

    def __repr__(self) -> str:
        texts = {name: quantity(name, show(getattr(self, name))) for name in NUMBERS}
        if self.min_force is not None:
            texts["min_force"] = quantity("min_force", show(self.min_force))
        texts["status"] = Status.names_of(self.status)
        solver = "" if self.solver is None else f", {self.solver}"
        return in_lines(f"Impact by method {self.method!r}{solver}", texts, 17)


def show(value: Array) -> str:
    """Return a number in words, or the shape of an array and its range."""
    if traced(value) or not eqx.is_array(value) or value.ndim == 0:
        return shown(value)
    array = np.asarray(value)
    good = array[np.isfinite(array)]
    if good.size == 0:
        return f"shape {array.shape}, none finite"
    return f"shape {array.shape}, from {good.min():.6g} to {good.max():.6g}"
