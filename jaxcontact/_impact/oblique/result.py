"""The result of an oblique impact."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Float, Int

from ..._text.columns import in_lines
from ..._text.failure import Flagged, WordedEnum
from ..._text.units import quantity
from ..result import Impact, Status, show

NUMBERS = (
    *("tangential_velocity", "slip_velocity", "impulse_ratio"),
    *("sliding_loss", "damping_loss", "spring_energy"),
)
"""The physical quantities of an `ObliqueImpact` that every law has, in order."""


class Slip(WordedEnum):
    """What the contact point did in an oblique impact."""

    SLID = 0, "It slid throughout."
    STUCK = 1, "It stuck for a time, or in a part of the contact."
    REVERSED = 2, "It stuck, and left in the opposite direction."


class ObliqueImpact(Flagged, eqx.Module):
    """The summary of an oblique impact; every array has the broadcast shape of the arguments.

    - `tangential_velocity`: of the centres relative to each other, in m/s.
    - `slip_velocity`: u' of the contact point, v_t + R1 ω1 + R2 ω2, in m/s.
    - `spin`: (ω1, ω2) in rad/s; None without radii.
    - `impulse_ratio`: the tangential impulse over the normal one, at most μ.
    - `sliding_loss`: the kinetic energy that the tangential motion loses, in J. It is negative
      where a law creates energy.
    - `damping_loss`: the energy that the normal motion loses, in J.
    - `spring_energy`: the energy left in the tangential spring, in J: zero, since the force of
      friction vanishes with the normal one.
    - `slip`: see `Slip`, the regime of the contact point.
    - `sliding_time`, `sticking_time`, `final_sliding_time`: the durations of the phases in s; None
      for laws or forces that do not say.
    - `margin`: |u0/u_jump - 1|, the distance to the nearest speed at which the outcome's slope
      jumps; None for laws without jumps.
    - `normal`: the `Impact` in the normal direction.
    - `status`, `ok`: as in `Impact`. `method`: how the tangential motion was solved.
    """

    tangential_velocity: Float[Array, "..."]
    slip_velocity: Float[Array, "..."]
    spin: tuple[Float[Array, "..."], Float[Array, "..."]] | None
    impulse_ratio: Float[Array, "..."]
    sliding_loss: Float[Array, "..."]
    damping_loss: Float[Array, "..."]
    spring_energy: Float[Array, "..."]
    slip: Int[Array, "..."]
    sliding_time: Float[Array, "..."] | None
    sticking_time: Float[Array, "..."] | None
    final_sliding_time: Float[Array, "..."] | None
    margin: Float[Array, "..."] | None
    normal: Impact
    status: Int[Array, "..."]
    method: str = eqx.field(static=True)
    _failures = Status.NOT_CONVERGED, Status.INVALID_INPUT

    def __repr__(self) -> str:
        texts = {name: quantity(name, show(getattr(self, name))) for name in NUMBERS}
        if self.spin is not None:
            texts["spin"] = f"({', '.join(show(x) for x in self.spin)}) rad/s"
        texts["restitution"] = show(self.normal.restitution)
        texts["slip"] = Slip.names_of(self.slip)
        texts["status"] = Status.names_of(self.status)
        return in_lines(f"ObliqueImpact by method {self.method!r}", texts, 20)
