"""The public function `oblique_impact`."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..._contact import Contact
from ..._entry import (
    Range,
    as_number,
    is_valid,
    refuses_unknown,
    require_broadcast,
    require_flag,
    sanitised,
)
from ..._friction import AbstractFriction
from ..._friction.base import Outcome, Tangential, require_friction
from ..._friction.scaled import spring_of
from ..._laws import AbstractLaw
from ..._program import program
from ..._text.failure import checked
from ..front_door import Lanes, Problem, lanes_of, problem_of, uniform
from ..impact import summary
from ..methods.auto import method_of
from ..methods.event import Event
from ..methods.method import AbstractMethod
from ..result import Status
from .bodies import RoundBodies, mobility_of, require_bodies
from .result import ObliqueImpact, Slip

TANGENTIAL = Range(inside=0.0)


class _Given(NamedTuple):
    """An oblique impact as given. Numbers are leaves."""

    problem: Problem
    friction: AbstractFriction
    bodies: RoundBodies | None
    ratio: Float[Array, "..."] | None
    velocity: float | Float[Array, "..."]
    spin: tuple[float | Float[Array, "..."], float | Float[Array, "..."]]


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
    of range, a spin without radii, a spring without a stiffness ratio, and a friction law that has
    no solution for the normal force. Source: Maw, Barber & Fawcett (1976), doi
    10.1016/0043-1648(76)90201-5, and the references of the friction laws.
    """
    problem = problem_of(law, contact, velocity)
    require_friction(friction)
    shape = require_bodies(bodies)
    round_bodies = None if isinstance(shape, str) else shape
    if round_bodies is not None:
        round_bodies.require_mass(contact.mass)
    slip = as_number(tangential_velocity, "tangential_velocity", TANGENTIAL)
    turning = _spins(spin, round_bodies)
    ratio = contact.tangential_ratio
    require_broadcast(
        law=law,
        contact=contact,
        velocity=problem.velocity,
        tangential_velocity=slip,
        friction=friction,
        bodies=round_bodies,
        spin=turning,
    )
    given = _Given(problem, friction, round_bodies, ratio, slip, turning)
    throw = require_flag("throw", throw)
    how = method_of(method)
    return checked(_oblique(given, None if round_bodies else shape, how), throw, "oblique_impact")


def _spins(spin: Any, bodies: RoundBodies | None) -> tuple[Any, Any]:
    """Return both spins as numbers; ValueError if they need radii that are not given."""
    if not isinstance(spin, tuple | list) or len(spin) != 2:
        raise ValueError(f"Argument `spin` must be two numbers (ω1, ω2), but is {spin!r}.")
    first, second = (as_number(one, "spin", TANGENTIAL) for one in spin)
    known = 0 if bodies is None else 1 if bodies.other_radius is None else 2
    for k, one in enumerate((first, second)):
        if k >= known and not (isinstance(one, float) and one == 0):
            where = "`bodies` with radii" if known == 0 else "`other_radius` of the bodies"
            raise ValueError(f"Argument `spin` must be 0 for ω{k + 1} without {where}.")
    return first, second


@program
def _oblique(given: _Given, shape: str | None, method: AbstractMethod) -> ObliqueImpact:
    whole = np.broadcast_shapes(*map(np.shape, jax.tree.leaves(given)))
    given = uniform(given)
    lanes = dataclasses.replace(lanes_of(given.problem), shape=whole)
    how = method.chosen(lanes.form, pushed=False)
    normal = summary(lanes, how, how.solve(lanes))
    valid = is_valid(given.friction) & TANGENTIAL.holds(given.velocity)
    for one in given.spin:
        valid = valid & TANGENTIAL.holds(one)
    mass = sanitised(given.problem.contact).mass
    bodies = shape
    if given.bodies is not None:
        valid, bodies = valid & is_valid(given.bodies), sanitised(given.bodies)
    assert bodies is not None
    mobility, arms = mobility_of(bodies, mass)
    mobility = jnp.asarray(mobility, mass.dtype)
    velocity, *spins = (jnp.where(TANGENTIAL.holds(x), x, 0) for x in (given.velocity, *given.spin))
    slip = velocity
    if isinstance(bodies, RoundBodies):
        radii = (bodies.radius, bodies.other_radius)
        for radius, spin in zip(radii, spins, strict=True):
            slip = slip if radius is None else slip + radius * spin
    sign = jnp.where(slip < 0, -1, 1).astype(slip.dtype)
    # A failed normal impact has no e; its lanes are flagged below.
    e = jnp.where(normal.ok, normal.restitution, 0)
    problem = Tangential(
        slip=sign * slip / lanes.scale.speed,
        mobility=mobility,
        restitution=e,
        alpha=lanes.form.hysteresis_factor,
        exponent=lanes.n,
        ratio=given.ratio,
        speed=lanes.scale.speed,
    )
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
    status = jnp.where(valid, normal.status, int(Status.INVALID_INPUT))
    if found.converged is not None:
        failed = (status == int(Status.SEPARATED)) & ~found.converged
        status = jnp.where(failed, int(Status.NOT_CONVERGED), status)
    # Out of the range of a table the outcome is not a number.
    lost = (status == int(Status.SEPARATED)) & ~jnp.isfinite(found.slip)
    status = jnp.where(lost, int(Status.INVALID_INPUT), status)
    good = (status != int(Status.INVALID_INPUT)) & (status != int(Status.NOT_CONVERGED))
    how = "event" if held and followed else "formula" if found.converged is None else "phase"
    readout = _Readout(lanes, mass, problem, found, sign, good, whole, how)
    return readout.impact(normal, velocity, spins, arms, status)


class _Readout(NamedTuple):
    """A solved problem, to be written in SI units."""

    lanes: Lanes
    mass: Float[Array, "..."]
    problem: Tangential
    found: Outcome
    sign: Float[Array, "..."]
    good: Bool[Array, "..."]
    shape: tuple[int, ...]
    method: str

    def result(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return numbers in the shape of the problem, NaN in failed lanes."""
        return jnp.broadcast_to(jnp.where(self.good, value, jnp.nan), self.shape)

    def impact(
        self, normal: Any, velocity: Array, spins: list[Array], arms: list[Array], status: Array
    ) -> ObliqueImpact:
        problem, scale = self.problem, self.lanes.scale
        after = jnp.where(self.good, self.found.slip, 0)
        change = (after - problem.slip) / problem.mobility
        along = self.sign * scale.speed * change
        impulse = self.mass * along
        # Both bodies turn the same way: the arms point to opposite sides, as the impulses do.
        turned = [spin + arm * impulse for spin, arm in zip(spins, arms, strict=False)]
        turned += spins[len(arms) :]
        regime = jnp.where(after < 0, int(Slip.REVERSED), int(Slip.STUCK))
        regime = jnp.where(self.found.slid, int(Slip.SLID), regime)
        times = self.phases(normal)
        loss = scale.energy * (problem.slip - after) * (problem.slip + after) / problem.mobility
        return ObliqueImpact(
            tangential_velocity=self.result(velocity + along),
            slip_velocity=self.result(self.sign * scale.speed * after),
            spin=(self.result(turned[0]), self.result(turned[1])) if arms else None,
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
            status=jnp.broadcast_to(status, self.shape),
            method=self.method,
        )

    def phases(self, normal: Any) -> list[Array | None]:
        """Return the durations of sliding, sticking and sliding again; None if unknown."""
        stop, start, form = self.found.stop, self.found.start, self.lanes.form
        if stop is None or start is None or form.hysteresis_factor is None:
            return [None, None, None]
        moments = [form.time_at(jnp.asarray(v), self.lanes.n) for v in (stop, start)]
        first, last = (self.lanes.scale.time * moment for moment in moments if moment is not None)
        lasts = (first, last - first, normal.duration - last)
        return [self.result(jnp.maximum(duration, 0)) for duration in lasts]
