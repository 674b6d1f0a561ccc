"""The outcomes of oblique impacts that are measured, as a prediction of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._contact import Contact
from ..._friction import AbstractFriction
from ..._friction.base import Tangential
from ..._impact import RoundBodies, oblique_impact, restitution
from ..._impact.front_door import lanes_of, uniform
from ..._impact.oblique.bodies import NamedShape
from ..._impact.oblique.front_door import Given, SlidingStart, given_of, sliding_of
from ..._laws import AbstractLaw
from ..._text.units import Shown

Column = Float[Array, "..."]


class MeasuredRebound(NamedTuple):
    """After an impact: v_t' and v_n' in m/s, -ω1 in rad/s (None without a radius), the tangential
    impulse over the normal one, and the distance to a jump (None without jumps).
    """

    tangential: Column
    normal: Column
    spin: Column | None
    impulse_ratio: Column
    margin: Column | None


class ObliqueModel(eqx.Module):
    """The outcomes in `fields` of the impacts of one contact, by their friction law.

    - `tangential_restitution`: v_t'/v_t.
    - `rebound_angle`: arctan(v_t'/v_n') in rad.
    - `rebound_spin`: -ω1 in rad/s, positive in the sense of rolling.

    x holds the columns `velocity` and `tangential_velocity` in m/s.
    """

    law: AbstractLaw
    contact: Contact
    bodies: RoundBodies | NamedShape
    fields: tuple[str, ...] = eqx.field(static=True)
    shown: ClassVar[Mapping[str, Shown]] = {
        name: Shown(name) for name in ("tangential_restitution", "rebound_angle", "rebound_spin")
    }

    def __call__(
        self, friction: AbstractFriction, x: Mapping[str, Float[Array, " n"]]
    ) -> dict[str, Column]:
        after, before = self.rebound(friction, x), x["tangential_velocity"]
        outcome = {
            # Head on there is no ratio; such rows have none.
            "tangential_restitution": lambda: after.tangential / jnp.where(before > 0, before, 1),
            "rebound_angle": lambda: jnp.arctan2(after.tangential, after.normal),
            "rebound_spin": lambda: jnp.asarray(after.spin),
        }
        return {field: outcome[field]() for field in self.fields}

    def rebound(self, friction: AbstractFriction, x: Mapping[str, Array]) -> MeasuredRebound:
        """Return the rebounds of impacts at the speeds x, as `oblique_impact` does.

        A friction law with a formula needs nothing of the normal motion but e and α. The fit then
        compiles the formula alone.
        """
        velocity, before = x["velocity"], x["tangential_velocity"]
        given, sliding, problem = self._problem(friction, x)
        e = problem.restitution
        if not friction.has_formula(problem):
            speeds, bodies = (self.law, self.contact, velocity, before), self._bodies
            hit = oblique_impact(*speeds, friction=friction, bodies=bodies, throw=False)
            spin = None if hit.spin is None else -hit.spin[0]
            return MeasuredRebound(
                hit.tangential_velocity, velocity * e, spin, hit.impulse_ratio, hit.margin
            )
        found = given.friction.rebound(problem)
        slip = found.slip
        if found.converged is not None:
            slip = jnp.where(found.converged, slip, jnp.nan)
        lost = (problem.slip - slip) / problem.mobility
        return MeasuredRebound(
            tangential=before - velocity * lost,
            normal=velocity * e,
            spin=sliding.arms[0] * sliding.mass * velocity * lost if sliding.arms else None,
            impulse_ratio=lost / (1 + e),
            margin=found.margin,
        )

    def formula(self, friction: AbstractFriction, x: Mapping[str, Array]) -> Column:
        """Return the scaled slip after impacts; ValueError without a formula for it."""
        given, _, problem = self._problem(friction, x)
        if not friction.has_formula(problem):
            raise ValueError(
                "beside this normal force its motion is followed by event solves, which take long; "
                "name it in `friction` to compare it"
            )
        return given.friction.rebound(problem).slip

    @property
    def _bodies(self) -> RoundBodies | str:
        return self.bodies.name if isinstance(self.bodies, NamedShape) else self.bodies

    def _problem(
        self, friction: AbstractFriction, x: Mapping[str, Array]
    ) -> tuple[Given, SlidingStart, Tangential]:
        speeds = self.law, self.contact, x["velocity"], x["tangential_velocity"]
        given = uniform(given_of(*speeds, friction, self._bodies, (0.0, 0.0)))
        e = restitution(self.law, self.contact, x["velocity"])
        sliding = sliding_of(given)
        return given, sliding, sliding.problem(lanes_of(given.problem), e, given.ratio)
