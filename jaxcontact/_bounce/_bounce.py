"""The public function `bounce`."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from .. import _flight as flight
from .._contact import EXPONENT, Contact, require_contact
from .._impact import (
    AbstractMethod,
    Status,
    impact,
    method_of,
    problem_of,
    restitution_is_constant,
    uniform,
)
from .._laws import VELOCITY_THRESHOLD, AbstractLaw, require_law
from .._parameter import (
    POSITIVE,
    Range,
    as_parameter,
    refuses_unknown,
    require_broadcast,
    require_count,
    require_flag,
    sanitised,
)
from ._result import Bounce
from ._touches import Touches, alike, one_by_one

_REST = Range(low=VELOCITY_THRESHOLD, inside=1.0)
# A law's own force under the weight may differ from the weight by its rounding.
_STATIC = 1e-4


@refuses_unknown
def bounce(
    law: AbstractLaw,
    contact: Contact,
    height: ArrayLike,
    *,
    gravity: ArrayLike = 9.81,
    bounces: int = 20,
    gravity_in_contact: bool = False,
    rest_velocity: ArrayLike | None = None,
    method: str | AbstractMethod = "auto",
) -> Bounce:
    """Drop a ball and follow its touches: v_1 = √(2gh), v_(k+1) = e(v_k) v_k, h_k = v_(k+1)²/(2g).

    Arguments: the law and the contact of ball and ground (whose mass is then the ball's); the drop
    `height` h in m of the ball's lowest point; `gravity` g in m/s²; how many `bounces` to follow.
    They broadcast. Each impact has its own speed: a law whose restitution depends on speed changes
    from bounce to bounce. Flights are in vacuum. `method` as in `impact`.

    With `gravity_in_contact` the weight m g pushes during contact, too: the impacts are event
    solves, their restitution falls as the ball slows down, and at last it does not leave the
    ground: it has come to rest. Without, gravity acts in flight only, which is good while the
    ball hits much faster than √(g δ_s), δ_s = (m g/K)^(1/n) its static indentation. The bounces
    would then go on for ever, each contact longer than the one before (for n > 1): rest is a
    threshold, `rest_velocity` in m/s, √(g δ_s) if not given (`VELOCITY_THRESHOLD` where gravity
    acts in contact).

    Returns a `Bounce`; a bad lane is NaN and flagged. Raises ValueError for a Python scalar out of
    range. Source: elementary ballistics, and `impact`.
    """
    require_law(law)
    require_contact(contact)
    bounces = require_count("bounces", bounces, 1)
    gravity_in_contact = require_flag("gravity_in_contact", gravity_in_contact)
    height = as_parameter(height, "height", POSITIVE)
    gravity = as_parameter(gravity, "gravity", POSITIVE)
    if rest_velocity is not None:
        rest_velocity = as_parameter(rest_velocity, "rest_velocity", _REST)
    how = method_of(method)
    require_broadcast(
        law=law, contact=contact, height=height, gravity=gravity, rest_velocity=rest_velocity
    )
    return _bounce(law, contact, height, gravity, rest_velocity, bounces, gravity_in_contact, how)


class _Run(eqx.Module):
    """What the touches of a run share, in one shape and precision; invalid numbers replaced."""

    height: Array
    gravity: Array
    speed: Array
    rest: Array
    static: Array
    weight: Array
    valid: Array


@eqx.filter_jit
def _bounce(
    law: AbstractLaw,
    contact: Contact,
    height: Array,
    gravity: Array,
    rest: Array | None,
    bounces: int,
    gravity_in_contact: bool,
    method: AbstractMethod,
) -> Bounce:
    run = _run(law, contact, height, gravity, rest, gravity_in_contact)
    if not gravity_in_contact and restitution_is_constant(law, contact):
        first = impact(law, contact, run.speed, method=method)
        n = _exponent(contact)
        power = (1 - n) / (1 + n)
        power = power if isinstance(power, float) else jnp.expand_dims(power, -1)
        touches = alike(first, run.speed, power, run.rest, bounces)
        e = jnp.where(first.status == int(Status.SEPARATED), first.restitution, 0)
        return _assembled(touches, run, e)
    weight = run.weight if gravity_in_contact else None
    touches = one_by_one(law, contact, run.speed, run.rest, weight, method, bounces)
    return _assembled(touches, run, None)


def _exponent(contact: Contact) -> float | Array:
    n = contact.exponent
    return n if isinstance(n, float) else jnp.where(EXPONENT.holds(n), n, EXPONENT.inside)


def _run(
    law: AbstractLaw,
    contact: Contact,
    height: Array,
    gravity: Array,
    rest: Array | None,
    gravity_in_contact: bool,
) -> _Run:
    valid = POSITIVE.holds(height) & POSITIVE.holds(gravity)
    height, gravity = jnp.where(valid, height, 1), jnp.where(valid, gravity, 1)
    speed = flight.speed_after_drop(height, gravity, None)
    # The shape and the precision that `impact` will answer in.
    problem = uniform(problem_of(law, contact, speed))
    shape, dtype = problem.shape, problem.velocity.dtype
    if rest is not None:
        shape = np.broadcast_shapes(shape, rest.shape)

    def fill(value: Array) -> Array:
        return jnp.broadcast_to(value, shape).astype(dtype)

    height, gravity, speed = fill(height), fill(gravity), fill(speed)
    safe = sanitised(contact)
    weight = safe.mass.astype(dtype) * gravity
    static = fill((weight / safe.stiffness.astype(dtype)) ** (1 / _exponent(contact)))
    if rest is None:
        felt = jnp.zeros_like(static) if gravity_in_contact else jnp.sqrt(gravity * static)
        rest = jnp.maximum(felt, VELOCITY_THRESHOLD)
    else:
        valid = valid & _REST.holds(rest)
        rest = jnp.where(_REST.holds(rest), rest, _REST.inside)
    held = law.force(static, jnp.zeros_like(static), contact, jnp.ones_like(static))
    static = jnp.where(jnp.abs(held - weight) <= _STATIC * weight, static, jnp.nan)
    return _Run(height, gravity, speed, fill(rest), static, weight, fill(valid).astype(bool))


def _assembled(touches: Touches, run: _Run, constant_e: Array | None) -> Bounce:
    """The record of a run; `constant_e` is the restitution where it is the same at all speeds."""
    status = jnp.where(run.valid[..., None], touches.status, int(Status.INVALID_INPUT))
    leaves = status == int(Status.SEPARATED)
    settled = status == int(Status.SETTLED)
    gravity = run.gravity[..., None]
    rebound = touches.restitution * touches.speed
    away = touches.duration + flight.duration(rebound, gravity, None)
    # The first touch ends the fall; each other one ends a contact and a flight.
    fall = flight.time_to_fall(run.height, run.gravity, None)[..., None]
    time = jnp.cumsum(jnp.concatenate([fall, away[..., :-1]], axis=-1), axis=-1)
    rests = jnp.any(settled, axis=-1)
    first_rest = jnp.argmax(settled, axis=-1, keepdims=True)
    remaining = None
    if constant_e is not None:
        last = jnp.where(rests[..., None], first_rest, touches.speed.shape[-1] - 1)
        speed = jnp.take_along_axis(touches.speed, last, axis=-1)[..., 0]
        ends = constant_e < 1
        lost = jnp.where(ends, 1 - constant_e, 1)
        # The launch speeds e v, e² v, ... add up to e v/(1 - e).
        launches = constant_e * speed / lost
        remaining = jnp.where(ends, flight.duration(launches, run.gravity, None), jnp.inf)
    rest_time = jnp.take_along_axis(time, first_rest, axis=-1)[..., 0]

    good = leaves | settled

    def flagged(value: Array) -> Array:
        return jnp.where(good, value, jnp.nan)

    def of_run(value: Array) -> Array:
        return jnp.where(jnp.all(good, axis=-1), value, jnp.nan)

    return Bounce(
        time=flagged(time),
        duration=flagged(jnp.where(leaves, touches.duration, jnp.inf)),
        impact_velocity=flagged(touches.speed),
        restitution=flagged(touches.restitution),
        height=flagged(flight.height_reached(rebound, gravity, None)),
        status=status,
        rest_time=of_run(jnp.where(rests, rest_time, jnp.inf)),
        rest_velocity=of_run(run.rest),
        rest_indentation=of_run(run.static),
        remaining_flight=None if remaining is None else of_run(remaining),
        drop_height=of_run(run.height),
        gravity=of_run(run.gravity),
    )
