"""An oblique impact in SI units."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._friction.base import Tangential, TangentialOutcome
from ..front_door import Lanes
from ..result import Impact, Status
from .front_door import SlidingStart
from .result import ObliqueImpact, Slip


def status_of(
    normal: Impact, found: TangentialOutcome, valid: Bool[Array, "..."]
) -> Int[Array, "..."]:
    """Return the status: that of the normal impact, unless the tangential motion failed."""
    status = jnp.where(valid, normal.status, int(Status.INVALID_INPUT))
    parted = status == int(Status.SEPARATED)
    if found.converged is not None:
        status = jnp.where(parted & ~found.converged, int(Status.NOT_CONVERGED), status)
    # Out of the range of a table the outcome is not a number.
    lost = parted & ~jnp.isfinite(found.slip)
    return jnp.where(lost, int(Status.INVALID_INPUT), status)


class Readout(NamedTuple):
    """A solved problem, to be written in SI units."""

    lanes: Lanes
    sliding: SlidingStart
    problem: Tangential
    found: TangentialOutcome
    normal: Impact
    status: Int[Array, "..."]
    good: Bool[Array, "..."]
    shape: tuple[int, ...]
    method: str

    def result(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return numbers in the shape of the problem, NaN in failed lanes."""
        return jnp.broadcast_to(jnp.where(self.good, value, jnp.nan), self.shape)

    def impact(self) -> ObliqueImpact:
        """Return the result in SI units."""
        sliding, normal = self.sliding, self.normal
        problem, scale = self.problem, self.lanes.scale
        after = jnp.where(self.good, self.found.slip, 0)
        change = (after - problem.slip) / problem.mobility
        along = sliding.sign * scale.speed * change
        impulse = sliding.mass * along
        # Both bodies turn the same way: the arms point to opposite sides, as the impulses do.
        turned = [
            spin + arm * impulse for spin, arm in zip(sliding.spins, sliding.arms, strict=False)
        ]
        turned += sliding.spins[len(sliding.arms) :]
        regime = jnp.where(after < 0, int(Slip.REVERSED), int(Slip.STUCK))
        regime = jnp.where(self.found.slid, int(Slip.SLID), regime)
        times = self.phases()
        loss = scale.energy * (problem.slip - after) * (problem.slip + after) / problem.mobility
        return ObliqueImpact(
            tangential_velocity=self.result(sliding.velocity + along),
            slip_velocity=self.result(sliding.sign * scale.speed * after),
            spin=(self.result(turned[0]), self.result(turned[1])) if sliding.arms else None,
            impulse_ratio=self.result(-change / (1 + problem.restitution)),
            sliding_loss=self.result(loss),
            damping_loss=normal.energy_loss,
            spring_energy=self.result(jnp.zeros_like(after)),
            slip=jnp.broadcast_to(regime, self.shape),
            sliding_time=times[0],
            sticking_time=times[1],
            final_sliding_time=times[2],
            margin=None if self.found.margin is None else self.result(self.found.margin),
            normal=normal,
            status=jnp.broadcast_to(self.status, self.shape),
            method=self.method,
        )

    def phases(self) -> list[Array | None]:
        """Return the durations of sliding, sticking and sliding again; None if unknown."""
        stop, start, form = self.found.stop, self.found.start, self.lanes.form
        if stop is None or start is None or form.hysteresis_factor is None:
            return [None, None, None]
        speeds = jnp.stack(jnp.broadcast_arrays(stop, start))
        unit = self.lanes.scale.time
        # One quadrature for both moments.
        moments = form.time_at(speeds, self.lanes.n, self.normal.duration / unit)
        assert moments is not None
        first, last = unit * moments[0], unit * moments[1]
        lasts = (first, last - first, self.normal.duration - last)
        return [self.result(jnp.maximum(duration, 0)) for duration in lasts]
