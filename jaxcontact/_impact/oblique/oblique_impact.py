"""The public function `oblique_impact`."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..._contact import Contact
from ..._entry import refuses_unknown, require_flag, sanitised
from ..._friction import AbstractFriction
from ..._friction.base import Tangential, TangentialOutcome
from ..._friction.scaled import spring_of
from ..._laws import AbstractLaw
from ..._program import program
from ..._text.failure import checked
from ..front_door import Lanes, lanes_of, uniform
from ..impact import summary
from ..methods.auto import method_of
from ..methods.event import Event
from ..methods.method import AbstractMethod
from ..result import Impact, Status
from .bodies import RoundBodies
from .front_door import Given, SlidingStart, given_of, sliding_of
from .result import ObliqueImpact, Slip


@refuses_unknown
def oblique_impact(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: AbstractFriction,
    bodies: RoundBodies | str | None = None,
    spin: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    method: str | AbstractMethod = "auto",
    throw: bool = True,
) -> ObliqueImpact:
    """Solve an oblique impact of two round bodies: δ'' as in `impact`, and u' = -λ f/m.

    u = v_t + R1 ω1 + R2 ω2 is the velocity of the contact point along the surface, f the friction,
    and λ = 1 + m (R1²/I1 + R2²/I2): 7/2 for solid spheres, 5/2 for shells, 3 for discs.

    - `law`, `contact`, `velocity`: as for `impact`, the normal motion.
    - `tangential_velocity`: v_t of the centres relative to each other, in m/s, of any sign.
    - `friction`: a friction law. One with a spring takes its stiffness ratio from a contact of
      materials, if it has none of its own.
    - `bodies`: a `RoundBodies`; or "sphere", "shell" or "disc" without radii; None for spheres.
    - `spin`: ω1 and ω2 in rad/s about the axis normal to the plane of motion; other than zero they
      need radii.
    - `method`: as for `impact`. "auto" takes formulas, tables and phases; "event", or a `jc.Event`
      with options, also follows a `SpringSlider`, which "auto" does for other forces than K δ^1.5
      (1 + α δ'/v0). The other laws have formulas for every force, or none.

    All numbers broadcast. The normal is that at touch, which holds as far as the bodies move little
    beside their radii during the contact. Spin about the normal is kept.

    Returns an `ObliqueImpact`. Lanes fail as in `impact`. Raises ValueError for a Python scalar out
    of range, a spin without radii and a spring without a stiffness ratio. It also raises it for a
    friction law that has no solution for the normal force. Source: Maw, Barber & Fawcett (1976),
    doi 10.1016/0043-1648(76)90201-5, and the references of the friction laws.
    """
    given = given_of(law, contact, velocity, tangential_velocity, friction, bodies, spin)
    throw = require_flag("throw", throw)
    result = _oblique(given, method_of(method))
    return checked(result, throw, "oblique_impact", lambda: _uncovered(given, result))


def _uncovered(given: Given, result: ObliqueImpact) -> str | None:
    """Return why a friction law has no outcome, in words; None if the failure is another one."""
    given, normal = uniform(given), result.normal
    sliding = sliding_of(given)
    if not sliding.valid or normal.status != int(Status.SEPARATED):
        return None
    lanes = lanes_of(given.problem)
    why = given.friction.uncovered(sliding.problem(lanes, normal.restitution, given.ratio))
    return why and f"{Status(int(result.status)).name}. {why}"


@program
def _oblique(given: Given, method: AbstractMethod) -> ObliqueImpact:
    given, whole = uniform(given), given.shape
    lanes = dataclasses.replace(lanes_of(given.problem), shape=whole)
    how = method.chosen(lanes.form, pushed=False)
    normal = summary(lanes, how, how.solve(lanes))
    sliding = sliding_of(given)
    # A failed normal impact has no e; its lanes are flagged below.
    e = jnp.where(normal.ok, normal.restitution, 0)
    problem = sliding.problem(lanes, e, given.ratio)
    friction = sanitised(given.friction)
    held = friction.held
    followed = isinstance(method, Event) or not friction.has_formula(problem)
    if held is not None and followed:
        # Imported here, because formulas need no steps.
        from .follow import follow

        spring = spring_of(friction, problem)
        found = follow(lanes, spring, held, method if isinstance(method, Event) else Event(), e)
    else:
        found = friction.rebound(problem)
    status = status_of(normal, found, sliding.valid)
    good = (status != int(Status.INVALID_INPUT)) & (status != int(Status.NOT_CONVERGED))
    name = "event" if held and followed else "formula" if found.converged is None else "phase"
    return Readout(lanes, sliding, problem, found, normal, status, good, whole, name).impact()


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
