"""An oblique impact as a function of time."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ..._contact import Contact
from ..._entry import refuses_unknown, require_count, sanitised
from ..._friction import AbstractFriction
from ..._friction.base import NormalPath
from ..._laws import AbstractLaw
from ..._program import program
from ..derivatives import common_shape
from ..front_door import ObliqueProblem, lanes_of, oblique_problem_of, sliding_of, uniform
from ..methods.method import AbstractMethod
from ..trajectory import Trajectory, trajectory
from .bodies import RoundBodies


class ObliqueTrajectory(eqx.Module):
    """An oblique impact sampled uniformly in time, from touch to separation; (..., samples).

    - `time` in s, `indentation` in m, `velocity` δ' in m/s, `force` in N: the normal motion.
    - `slip_velocity`: u of the contact point in m/s.
    - `tangential_velocity`: of the centres relative to each other, in m/s.
    - `friction`: in N, against the slip at touch.
    - `status`: as in `Impact`, shape (...).
    """

    time: Float[Array, "..."]
    indentation: Float[Array, "..."]
    velocity: Float[Array, "..."]
    force: Float[Array, "..."]
    slip_velocity: Float[Array, "..."]
    tangential_velocity: Float[Array, "..."]
    friction: Float[Array, "..."]
    status: Int[Array, "..."]


@refuses_unknown
def oblique_trajectory(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: AbstractFriction,
    bodies: RoundBodies | str | None = None,
    spin: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    samples: int = 200,
    method: str | AbstractMethod = "auto",
) -> ObliqueTrajectory:
    """Compute the motion of an oblique impact: δ'' as in `trajectory`, and u' = -λ f/m.

    The arguments are those of `oblique_impact`; `samples` and `method` are those of `trajectory`.
    Without a spring the slip is a formula of the normal motion. With one it is computed by steps of
    a sixteenth of a sample, of second order. With 200 samples the slip differs from the outcome of
    `oblique_impact` by up to 2e-5 of that at touch. A `MawBarberFawcett` is a row of springs.

    Returns an `ObliqueTrajectory`. Failed lanes are flagged in `.status`, and their numbers are
    NaN. Raises ValueError as `oblique_impact` does, and for a law without a force over time
    (`WaltonFriction`). Source: see `oblique_impact`.
    """
    samples = require_count("samples", samples, 2)
    given = oblique_problem_of(law, contact, velocity, tangential_velocity, friction, bodies, spin)
    fine = (samples - 1) * friction.substeps + 1
    normal = trajectory(law, contact, velocity, samples=fine, method=method)
    return _oblique_trajectory((given, normal))


@program
def _oblique_trajectory(both: tuple[ObliqueProblem, Trajectory]) -> ObliqueTrajectory:
    given, normal = both
    given, shape = uniform(given), common_shape(given)
    lanes, sliding = lanes_of(given.problem), sliding_of(given)
    friction, scale = sanitised(given.friction), lanes.scale
    units = (scale.time, scale.length, scale.speed, scale.force)
    numbers = (normal.time, normal.indentation, normal.velocity, normal.force)
    # The normal motion may have fewer axes than the lanes.
    path = NormalPath(
        *(
            jnp.moveaxis(jnp.broadcast_to(x, (*shape, x.shape[-1])), -1, 0)
            / jnp.broadcast_to(unit, shape)[None]
            for x, unit in zip(numbers, units, strict=True)
        )
    )
    problem = sliding.problem(lanes, -path.velocity[-1], given.ratio)

    def beside_path(number: Any) -> Any:
        array = eqx.is_array(number)
        return jnp.broadcast_to(number, shape)[None] if array else number

    problem, friction = jax.tree.map(beside_path, (problem, friction))
    found = friction.along(problem, path)
    if found is None:
        raise ValueError(
            f"Argument `friction` must be a law with a force over time, but is a "
            f"`{type(friction).__name__}`."
        )
    slip, force = found
    change = (slip - problem.slip) / problem.mobility
    sign, speed, force_unit, velocity = (
        beside_path(x) for x in (sliding.sign, scale.speed, scale.force, sliding.velocity)
    )
    step = friction.substeps

    def shown(value: Array) -> Array:
        value = jnp.where(beside_path(sliding.valid), value, jnp.nan)
        return jnp.moveaxis(value, 0, -1)[..., ::step]

    return ObliqueTrajectory(
        *(shown(number * beside_path(u)) for number, u in zip(path, units, strict=True)),
        slip_velocity=shown(sign * speed * slip),
        tangential_velocity=shown(velocity + sign * speed * change),
        friction=shown(sign * force_unit * force),
        status=jnp.broadcast_to(normal.status, shape),
    )
