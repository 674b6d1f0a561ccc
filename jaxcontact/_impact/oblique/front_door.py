"""Inputs of oblique impacts: checks, conversion, scaling."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..._contact import Contact
from ..._entry import (
    Range,
    as_number,
    is_list,
    is_valid,
    refusal,
    require_broadcast,
    sanitised,
    static_value,
)
from ..._friction import AbstractFriction
from ..._friction.base import Tangential, require_friction
from ..._laws import AbstractLaw
from ..front_door import Lanes, Problem, lanes_of, problem_of, uniform
from .bodies import NamedShape, RoundBodies, require_bodies

TANGENTIAL = Range(inside=0.0)


class Given(NamedTuple):
    """An oblique impact as given. Numbers are leaves."""

    problem: Problem
    friction: AbstractFriction
    bodies: RoundBodies | NamedShape
    ratio: Float[Array, "..."] | None
    velocity: float | Float[Array, "..."]
    spin: tuple[float | Float[Array, "..."], float | Float[Array, "..."]]

    @property
    def shape(self) -> tuple[int, ...]:
        """The broadcast shape of all inputs."""
        return np.broadcast_shapes(*map(np.shape, jax.tree.leaves(self)))


def given_of(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    friction: Any,
    bodies: Any,
    spin: Any,
) -> Given:
    """Check the arguments as far as possible without reading arrays; ValueError for a bad one."""
    problem = problem_of(law, contact, velocity)
    require_friction(friction)
    round_bodies = require_bodies(bodies)
    if isinstance(round_bodies, RoundBodies):
        round_bodies.require_mass(contact.mass)
    slip = as_number(tangential_velocity, "tangential_velocity", TANGENTIAL)
    spins = _spins(spin, len(round_bodies.radii))
    require_broadcast(
        law=law,
        contact=contact,
        velocity=problem.velocity,
        tangential_velocity=slip,
        friction=friction,
        bodies=round_bodies,
        spin=spins,
    )
    return Given(problem, friction, round_bodies, contact.tangential_ratio, slip, spins)


def _spins(spin: Any, turning: int) -> tuple[Any, Any]:
    """Return both spins as numbers; ValueError if one is of a body that has no radius."""
    if not is_list(spin) or len(spin) != 2:
        raise refusal("spin", "be two numbers (ω1, ω2)", spin)
    first, second = (as_number(one, "spin", TANGENTIAL) for one in spin)
    for k, one in enumerate((first, second)):
        if k >= turning and static_value(one) != 0:
            needs = "`bodies` with radii" if turning == 0 else "`other_radius` of the bodies"
            raise refusal("spin", f"be 0 for ω{k + 1} without {needs}", spin)
    return first, second


class SlidingStart(NamedTuple):
    """The tangential motion at touch, in SI units, with valid numbers in place of invalid input.

    `slip` is that of the contact point, and `sign` its sign; `mobility` is λ, `arms` are R/I of the
    bodies that turn, and `mass` is the effective one. `valid` marks valid input.
    """

    velocity: Float[Array, "..."]
    spins: list[Float[Array, "..."]]
    slip: Float[Array, "..."]
    sign: Float[Array, "..."]
    mobility: Float[Array, "..."]
    arms: list[Float[Array, "..."]]
    mass: Float[Array, "..."]
    valid: Bool[Array, "..."]

    def problem(self, lanes: Lanes, e: Array, ratio: Array | None) -> Tangential:
        """Return the problem in scaled units, for the restitution e of the normal motion."""
        return Tangential(
            slip=self.sign * self.slip / lanes.scale.speed,
            mobility=self.mobility,
            restitution=e,
            alpha=lanes.form.hysteresis_factor,
            exponent=lanes.n,
            ratio=ratio,
            speed=lanes.scale.speed,
        )


def sliding_of(given: Given) -> SlidingStart:
    """Return the tangential motion of numbers of one precision and rank."""
    numbers = (given.velocity, *given.spin)
    valid = is_valid(given.friction) & is_valid(given.bodies)
    for number in numbers:
        valid = valid & TANGENTIAL.holds(number)
    velocity, *spins = (jnp.where(TANGENTIAL.holds(x), x, 0) for x in numbers)
    mass, bodies = sanitised(given.problem.contact).mass, sanitised(given.bodies)
    slip = velocity
    for radius, spin in zip(bodies.radii, spins, strict=False):
        slip = slip + radius * spin
    sign = jnp.where(slip < 0, -1, 1).astype(slip.dtype)
    return SlidingStart(
        velocity, spins, slip, sign, bodies.mobility(mass), bodies.arms(mass), mass, valid
    )


def sliding_problem(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    friction: AbstractFriction,
    bodies: Any,
    e: Array,
) -> tuple[AbstractFriction, SlidingStart, Tangential]:
    """Return the friction law, and the tangential motion of impacts without spin: at touch, and as
    a scaled problem. `e` is the restitution of the normal motion.
    """
    speeds = law, contact, velocity, tangential_velocity
    given = uniform(given_of(*speeds, friction, bodies, (0.0, 0.0)))
    sliding = sliding_of(given)
    return given.friction, sliding, sliding.problem(lanes_of(given.problem), e, given.ratio)
