"""The friction of an impact: the tangential impulse of a law, and its effect on both bodies.

The normal is that of the touch. With the effective mass m, 1/m_t = 1/m + R1²/I1 + R2²/I2 and the
slip velocity u of the contact point, the impulse is J = m_t (u' - u), where u' = u |u'|/|u| follows
from the law. The friction takes the energy m_t (u² - u'²)/2. See `arrays/movers.py` for the signs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of
from ..._friction import AbstractFriction
from ..._friction.base import Tangential, TangentialOutcome, own_ratio
from ..._functions import cross, swept
from ..arrays.arrays import SceneArrays, SceneLayout, contact_of, laws_of, least_speed
from ..bodies.mixed_law import one_of_each

Lane = Float[Array, "..."]

_AT_REST = 1e-8
"""The slip, relative to the closing speed, below which it only gives the direction's derivative."""

_USUAL_RATIO = 14 / 17
"""4G*/E* of two bodies with Poisson's ratio 0.3."""


class SlipSpeeds(NamedTuple):
    """The slip speeds before and after an impact in m/s; `after` is negative after a reversal."""

    before: Number
    after: Number


class Arms(NamedTuple):
    """The numbers of two bodies at a contact: `radius` and 1/I (2,), 1/m (2,) and 1/m_t."""

    radius: Float[Array, "2"]
    inverse_inertia: Float[Array, "2"]
    inverse_mass: Float[Array, "2"]
    tangential: Number

    def slip(self, normal: Lane, relative: Lane, spin: Lane) -> Lane:
        """Return the slip velocity (D,) of the contact point, from v1 - v2 and the spins (2, S)."""
        turned = swept(jnp.sum(self.radius[:, None] * spin, axis=0), normal)
        return relative - jnp.sum(relative * normal) * normal - turned

    def kick(self, normal: Lane, impulse: Lane) -> tuple[Lane, Lane]:
        """Return the changes of the velocities (2, D) and spins (2, S) by an impulse (D,)."""
        signs = jnp.asarray([1.0, -1.0], impulse.dtype)
        turn = cross(normal, impulse)
        share = -self.radius * self.inverse_inertia
        return (signs * self.inverse_mass)[:, None] * impulse[None], share[:, None] * turn[None]

    def lost(self, slip: Lane, impulse: Lane) -> Number:
        """Return the energy that an impulse takes at a slip before it, in J."""
        return -jnp.sum(impulse * (slip + self.tangential * impulse / 2))


def arms_of(model: SceneArrays, i: Index, j: Index, depth: Number | None = None) -> Arms:
    """Return the numbers of bodies i and j; a wall has none. A `depth` shortens the arms."""
    assert model.rotation is not None
    two = jnp.stack([i, j])
    flat = jnp.zeros(model.walls, model.dtype)
    radius = rows_of(jnp.concatenate([model.radius, flat]), two)
    if depth is not None:
        curved = two < model.spheres
        radius = radius - jnp.where(curved, depth / jnp.sum(curved, dtype=depth.dtype), 0)
    turns, inverse = rows_of((model.rotation.inverse_inertia, model.inverse_mass), two)
    return Arms(radius, turns, inverse, jnp.sum(inverse) + jnp.sum(jnp.square(radius) * turns))


def friction_impulse(
    model: SceneArrays,
    i: Index,
    j: Index,
    arms: Arms,
    slip: Lane,
    closing: Number,
    restitution: Number,
) -> tuple[Lane, SlipSpeeds, Flag]:
    """Return the impulse (D,) on body i in N s, the slip speeds, and whether the law has one."""
    # A closing speed of zero has no impulse.
    speed = jnp.maximum(closing, least_speed(model))
    square, least = jnp.sum(jnp.square(slip)), jax.lax.stop_gradient(_AT_REST * speed)
    slow = square <= jnp.square(least)
    size = jnp.where(slow, least, jnp.sqrt(jnp.where(slow, 1, square)))
    inverse = jnp.sum(arms.inverse_mass)
    problem = Tangential(
        slip=size / speed,
        mobility=arms.tangential / jnp.where(inverse > 0, inverse, 1),
        restitution=restitution,
        alpha=_damping_of(model, i, j, speed),
        exponent=model.exponent.value,
        ratio=_ratio_of(model, i, j),
        speed=speed,
    )
    assert model.rotation is not None and model.frictions is not None
    laws, kind = model.rotation.laws, jnp.asarray(0)
    if len(laws) > 1:
        laws, kind = one_of_each(laws, model.chosen(model.frictions, i, j))

    def of(law: AbstractFriction) -> Callable[[], tuple[Number, Flag]]:
        if not law.has_formula(problem):
            raise ValueError(
                "Argument `friction` of a scene must have a formula for its contacts, but a "
                f"`{type(law).__name__}` has one for forces K δ^1.5 (1 + α δ'/v0) only. Use a law "
                "of the Hunt-Crossley family and the exponent 1.5, or `RigidCoulomb`."
            )

        # As an argument of a branch a known exponent would be traced.
        def rebound() -> tuple[Number, Flag]:
            outcome: TangentialOutcome = law.rebound(problem)
            fine = jnp.isfinite(outcome.slip)
            return outcome.slip, fine if outcome.converged is None else fine & outcome.converged

        return rebound

    rebounds = [of(law) for law in laws]
    left, converged = rebounds[0]() if len(laws) == 1 else jax.lax.switch(kind, rebounds)
    kept = left * speed / size
    # No impulse without a normal one.
    impulse = (kept - 1) * slip / jnp.where(arms.tangential > 0, arms.tangential, 1)
    impulse = impulse * (closing / speed)
    before = jnp.where(slow, 0, size)
    return impulse, SlipSpeeds(before, kept * before), converged


def _by_pair(layout: SceneLayout, each: list[Any], i: Array, j: Array, dtype: Any = None) -> Array:
    """Return the number of the friction law of bodies i and j, from `each` law."""
    assert layout.frictions is not None
    if not layout.frictions:
        return jnp.asarray(each[0], dtype)
    column = jnp.stack([jnp.asarray(one, dtype) for one in each])
    return rows_of(column, layout.chosen(layout.frictions, i, j))


def coefficient_of(model: SceneArrays, i: Index, j: Index) -> Number:
    """Return the friction coefficient μ of bodies i and j."""
    assert model.rotation is not None
    return _by_pair(model, [law.mu for law in model.rotation.laws], i, j)


def is_followed(model: SceneArrays) -> bool:
    """Return whether all friction laws act alike in isolated and in coupled contacts."""
    return model.rotation is None or all(law.is_followed for law in model.rotation.laws)


def has_impulse(model: SceneArrays, i: Index, j: Index) -> Flag:
    """Return whether the friction of bodies i and j is the impulse of a law's formula."""
    assert model.rotation is not None
    return _by_pair(model, [not law.is_followed for law in model.rotation.laws], i, j)


def spring_ratio_of(model: SceneArrays, i: Index, j: Index) -> Number:
    """Return the ratio κ of the tangential spring of bodies i and j in a coupled contact.

    Laws without a ratio have that of the materials, or of Poisson's ratio 0.3 if these are unknown.
    """
    assert model.rotation is not None
    usual, known = jnp.asarray(_USUAL_RATIO, model.dtype), _ratio_of(model, i, j)
    if known is not None:
        usual = jnp.where(known > 0, known, usual)
    own = map(own_ratio, model.rotation.laws)
    return _by_pair(model, [usual if ratio is None else ratio for ratio in own], i, j)


def _damping_of(model: SceneArrays, i: Index, j: Index, speed: Number) -> Number | None:
    """Return the α of the normal force; None if a law of the scene has none."""
    laws, kind = laws_of(model, i, j)
    contact = contact_of(model, i, j)
    try:
        each = [jnp.asarray(law.damping_factor(contact, speed), speed.dtype) for law in laws]
    except ValueError:
        return None
    return each[0] if len(each) == 1 else rows_of(jnp.stack(each), kind)


def _ratio_of(model: SceneArrays, i: Index, j: Index) -> Number | None:
    """Return 4G*/E* of the materials; None if they are not known."""
    shear = None if model.rotation is None else model.rotation.shear_compliance
    if shear is None or model.compliance is None:
        return None
    (soft, sheared), (softer, more) = (rows_of((model.compliance, shear), k) for k in (i, j))
    both = sheared + more
    return 4 * (soft + softer) / jnp.where(both > 0, both, 1)


def ramps_of(
    model: SceneArrays, one: Int[Array, " P"], other: Int[Array, " P"]
) -> Float[Array, " P"] | None:
    """Return the speeds v_d of regularised laws, 0 for pairs of other laws."""
    assert model.rotation is not None
    laws, none = model.rotation.laws, jnp.zeros((), model.dtype)
    ramps = [getattr(law, "v_d", None) if law.kind == "ramp" else None for law in laws]
    if all(speed is None for speed in ramps):
        return None
    each = [none if speed is None else speed for speed in ramps]
    return jax.vmap(lambda i, j: _by_pair(model, each, i, j))(one, other)


def wall_drift(model: SceneArrays, wall: Index, time: Number, normal: Lane) -> Lane:
    """Return the velocity (D,) of a wall along itself, in m/s."""
    drift = None if model.rotation is None else model.rotation.drift
    if drift is None:
        return jnp.zeros_like(normal)
    velocity = rows_of(drift.velocity(time), wall)
    return velocity - jnp.sum(velocity * normal) * normal
