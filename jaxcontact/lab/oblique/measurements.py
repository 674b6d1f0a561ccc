"""Measured oblique impacts: checks of their columns, and their outcomes as predictions of a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import (
    AbstractFriction,
    AbstractLaw,
    Contact,
    RoundBodies,
    Tangential,
    oblique_impact,
    restitution,
)
from ...extend import (
    NOT_NEGATIVE,
    POSITIVE,
    REAL,
    Floats,
    Range,
    Shown,
    as_numbers,
    column,
    measured,
    refusal,
    require_bodies,
    require_contact,
    require_law,
    sliding_problem,
)

Lane = Float[Array, "..."]


class MeasuredRebound(NamedTuple):
    """After an impact: v_t' and v_n' in m/s, -ω1 in rad/s (None without a radius), the tangential
    impulse over the normal one, and the distance to a jump (None without jumps).
    """

    tangential: Lane
    normal: Lane
    spin: Lane | None
    impulse_ratio: Lane
    margin: Lane | None


class ObliqueModel(eqx.Module):
    """The outcomes in `fields` of the impacts of one contact, by their friction law.

    - `tangential_restitution`: v_t'/v_t.
    - `rebound_angle`: arctan(v_t'/v_n') in rad.
    - `rebound_spin`: -ω1 in rad/s, positive in the sense of rolling.

    x holds the columns `velocity` and `tangential_velocity` in m/s.
    """

    law: AbstractLaw
    contact: Contact
    bodies: Any  # as `require_bodies` returns them
    fields: tuple[str, ...] = eqx.field(static=True)
    shown: ClassVar[Mapping[str, Shown]] = {
        name: Shown(name) for name in ("tangential_restitution", "rebound_angle", "rebound_spin")
    }

    def __call__(
        self, friction: AbstractFriction, x: Mapping[str, Float[Array, " n"]]
    ) -> dict[str, Lane]:
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

        A friction law with a formula needs only e and α of the normal motion; it compiles alone.
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
        found = given.rebound(problem)
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

    def formula(self, friction: AbstractFriction, x: Mapping[str, Array]) -> Lane:
        """Return the scaled slip after impacts; ValueError without a formula for it."""
        given, _, problem = self._problem(friction, x)
        if not friction.has_formula(problem):
            raise ValueError(
                "beside this normal force its motion is followed by event solves, which take long; "
                "name it in `friction` to compare it"
            )
        return given.rebound(problem).slip

    @property
    def _bodies(self) -> RoundBodies | str:
        return getattr(self.bodies, "name", self.bodies)

    def _problem(
        self, friction: AbstractFriction, x: Mapping[str, Array]
    ) -> tuple[AbstractFriction, Any, Tangential]:
        speeds = self.law, self.contact, x["velocity"], x["tangential_velocity"]
        e = restitution(*speeds[:3])
        return sliding_problem(*speeds, friction, self._bodies, e)


_ANGLE = Range(low=-np.pi / 2, high=np.pi / 2, inside=0.0)
_RATIO = Range(low=-2.0, high=2.0, inside=0.5)
"""Range of a measured v_t'/v_t: friction alone keeps it in [-1, 1]."""


@dataclasses.dataclass(frozen=True)
class Measurements:
    """The `model` of the outcomes, the speeds `x`, and `table`, the data and weights of `fit`."""

    model: ObliqueModel
    x: dict[str, Floats]
    table: dict[str, Any]

    @property
    def factor(self) -> dict[str, Floats]:
        """The factor (n,) of each residual, by column; 0 for missing readings."""
        if "sigma" in self.table:
            return {name: 1 / sigma for name, sigma in self.table["sigma"].items()}
        return {name: np.sqrt(weight) for name, weight in self.table["weights"].items()}

    @property
    def unlike(self) -> bool:
        """True if there are several columns, with unknown errors."""
        return len(self.table["data"]) > 1 and "sigma" not in self.table

    def reweighed(self, residuals: Floats) -> Measurements:
        """Return the measurements with the noise of each column from residuals of all points."""
        parts = np.split(residuals, len(self.factor))
        weights = {}
        for name, off in zip(sorted(self.factor), parts, strict=True):
            used, size = self.factor[name] > 0, _inverse_size(off)
            weights[name] = np.where(used, size, 0.0)
        return dataclasses.replace(self, table=self.table | {"weights": weights})


def measurements(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    bodies: Any,
    columns: dict[str, tuple[Any, Any]],
) -> Measurements:
    """Return checked measurements; `columns` holds values and standard deviations by name.

    Without standard deviations the error of each column is taken as the same fraction of its size.
    """
    require_law(law)
    require_contact(contact)
    shapes = require_bodies(bodies)
    if isinstance(shapes, RoundBodies):
        shapes.require_mass(contact.mass)
    v = column(velocity, "velocity", POSITIVE)
    beside = "velocity", v
    slip = column(tangential_velocity, "tangential_velocity", NOT_NEGATIVE, beside)
    ranges = {"tangential_restitution": _RATIO, "rebound_angle": _ANGLE, "rebound_spin": REAL}
    given = {name: (*columns[name], allowed) for name, allowed in ranges.items()}
    _require_radians(given["rebound_angle"][0])
    table = measured(given, beside, gaps=True, weight=_inverse_size)
    data = table["data"]
    _require_slip(data, slip)
    if "rebound_spin" in data:
        _require_spin(data["rebound_spin"], shapes, bodies)
    model = ObliqueModel(law, contact, shapes, tuple(data))
    return Measurements(model, {"velocity": v, "tangential_velocity": slip}, table)


def _inverse_size(values: Floats) -> float:
    """Return the weight of a column, the inverse of its mean square."""
    size = float(np.mean(np.square(values[np.isfinite(values)])))
    return 1 / size if size > 0 else 1.0


def _require_radians(angle: Any) -> None:
    """Raise ValueError for angles of rebound that seem to be in degrees."""
    if angle is None:
        return
    values = as_numbers(angle, "rebound_angle")
    beyond = np.abs(values) > _ANGLE.high
    if beyond.any():
        i = int(np.argmax(beyond.ravel()))
        raise ValueError(
            f"Argument `rebound_angle` must be in {_ANGLE} rad, but is {values.ravel()[i]:g} at "
            f"point {i}. Is it in degrees? Then use `np.radians`."
        )


def _require_slip(data: dict[str, Floats], slip: Floats) -> None:
    """Raise ValueError for a ratio v_t'/v_t of a head-on impact."""
    if "tangential_restitution" not in data:
        return
    without = (slip == 0) & np.isfinite(data["tangential_restitution"])
    if without.any():
        i = int(np.argmax(without))
        raise ValueError(
            "Argument `tangential_restitution` must be NaN where `tangential_velocity` is 0, but "
            f"is {data['tangential_restitution'][i]:g} at point {i}."
        )


def _require_spin(spin: Floats, shapes: Any, bodies: Any) -> None:
    """Raise ValueError for a spin without a radius, and for one of the other sign."""
    if not shapes.radii:
        must = "have a radius with `rebound_spin`, as in `bodies=jc.RoundBodies(radius=0.01)`"
        raise refusal("bodies", must, bodies)
    middle = float(np.nanmedian(spin))
    if middle < 0:
        raise ValueError(
            "Argument `rebound_spin` must be positive in the sense of rolling, into which friction "
            f"turns a body, but its median is {middle:g}. `oblique_impact` counts ω1 the other "
            "way: then change the sign."
        )
