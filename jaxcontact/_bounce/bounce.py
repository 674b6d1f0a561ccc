"""The public function `bounce`."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from .._contact import EXPONENT, Contact, require_contact
from .._entry import (
    POSITIVE,
    Range,
    as_parameter,
    refuses_unknown,
    require_broadcast,
    require_choice,
    require_count,
    require_flag,
    sanitised,
)
from .._flight import Flight
from .._impact import (
    AbstractMethod,
    Landing,
    Status,
    common_shape,
    landing,
    method_of,
    problem_of,
    restitution_is_constant,
    uniform,
)
from .._laws import VELOCITY_THRESHOLD, AbstractLaw, require_law
from .._program import FEW, quick, traced
from .._text.failure import checked
from .result import TOUCHES, Bounce
from .touches import BounceRun, Left, Touches, alike, begin, one_by_one

_REST = Range(low=VELOCITY_THRESHOLD, inside=1.0)
# Under the weight, the force of a law may differ from the weight by rounding.
_STATIC = 1e-4

ROOM = 20
"""Touches in a traced run, and touches solved between two checks in Python."""

_MOST = 10_000
"""Largest number of touches of a run to rest."""


@refuses_unknown
def bounce(
    law: AbstractLaw,
    contact: Contact,
    height: ArrayLike,
    *,
    gravity: ArrayLike = 9.81,
    bounces: int | None = None,
    gravity_in_contact: bool = False,
    rest_velocity: ArrayLike | None = None,
    v0: str = "peak",
    method: str | AbstractMethod = "auto",
    throw: bool = True,
) -> Bounce:
    """Drop a ball and follow its touches: v_1 = √(2gh), v_(k+1) = e(v_k) v_k, h_k = v_(k+1)²/(2g).

    Arguments: the law; the contact of ball and ground (whose mass is the ball's); the drop `height`
    h in m of the ball's lowest point; `gravity` g in m/s²; the number of `bounces` to follow. They
    broadcast. Each impact uses its own speed, so a restitution that depends on speed changes from
    bounce to bounce. Flights are in vacuum. `method` as in `impact`.

    With `gravity_in_contact` the weight m g also acts during contact. The impacts are then event
    solves, and restitution falls as the ball slows down until the ball no longer leaves the ground:
    it has come to rest. Without it gravity acts in flight only. This is a good approximation while
    the impact speed is much larger than √(g δ_s), with the static indentation δ_s = (m g/K)^(1/n).
    The bounces would then never end, each contact longer than the one before (for n > 1). Rest is
    therefore a threshold, `rest_velocity` in m/s. Its default is √(g δ_s), or `VELOCITY_THRESHOLD`
    with `gravity_in_contact`.

    The damping of a law refers to the largest closing speed since touch (`v0="peak"`). In a free
    impact this is the speed at touch. A contact that is pressed together keeps a finite damping,
    even if it begins at rest. With `v0="touch"` the damping refers to the speed at touch. The two
    differ with `gravity_in_contact`, for laws of the Hunt-Crossley family whose force depends on
    v0. Your own law outside this family receives the speed at touch.

    A force that only pushes vanishes while δ > 0. The ball then rises from that depth: under its
    weight with `gravity_in_contact`, at constant speed without. Restitution is the ratio of the
    speeds at δ = 0.

    By default each ball is followed to rest, through up to 10,000 touches. A ball that would need
    more, such as an elastic one, is followed for 20. Under tracing the run has 20 touches. With
    `bounces` the run has exactly that many. If a ball is not at rest by then, `at_rest` is False,
    and `rest_time` and its derivative are NaN.

    Returns a `Bounce`. A ball fails at a touch that is NOT_CONVERGED, INVALID_INPUT or GAINED, not
    by rest or the end of its `bounces`. A single one raises `NumericalError` unless `throw` is
    False. Lanes of arrays and traced calls are NaN from there on, flagged in `.status` and `.ok`.
    Raises ValueError for a Python scalar out of range. Source: elementary ballistics, and `impact`.
    """
    require_law(law)
    require_contact(contact)
    bounces = None if bounces is None else require_count("bounces", bounces, 1)
    require_choice("v0", v0, ("peak", "touch"))
    gravity_in_contact = require_flag("gravity_in_contact", gravity_in_contact)
    throw = require_flag("throw", throw)
    height = as_parameter(height, "height", POSITIVE)
    gravity = as_parameter(gravity, "gravity", POSITIVE)
    if rest_velocity is not None:
        rest_velocity = as_parameter(rest_velocity, "rest_velocity", _REST)
    how = method_of(method)
    require_broadcast(
        law=law, contact=contact, height=height, gravity=gravity, rest_velocity=rest_velocity
    )
    drop = _BallAndGround(
        law, contact, height, gravity, rest_velocity, gravity_in_contact, v0 == "peak"
    )
    run = _to_rest(drop, how) if bounces is None else _bounce(drop, bounces, how)
    return checked(run, throw, "bounce")


def _to_rest(drop: _BallAndGround, how: AbstractMethod) -> Bounce:
    """Follow every ball to rest if it comes to rest within `_MOST` touches.

    Traced numbers, and a caller that compiles, get `ROOM` touches.
    """
    if traced(drop):
        return _bounce(drop, ROOM, how)
    run, first = _start_compiled(drop, how)
    if traced(run):
        return _bounce(drop, ROOM, how)
    if first is not None:
        count = _count_needed(np.asarray(first.impact.restitution), run)
        return _trim(_constant(drop.contact, run, first, count))
    left, falls, parts = begin(run), True, []
    while falls:
        speed = left.speed
        left, touches = one_by_one(drop.law, drop.contact, run, left, how, drop.peak, ROOM)
        parts.append(touches)
        falls = _falls(speed, left, run, len(parts) * ROOM)
    touches = jax.tree.map(lambda *part: np.concatenate(part, axis=-1), *parts)
    return _trim(_assemble(touches, run, None))


def _count_needed(e: np.ndarray, run: BounceRun) -> int:
    """Return the number of touches of the balls with constant e that rest within `_MOST`."""
    with np.errstate(all="ignore"):
        touches = np.log(np.asarray(run.rest) / np.asarray(run.speed)) / np.log(e)
    least = np.max(touches, where=(touches < _MOST) & (e < 1), initial=0)
    return ROOM * math.ceil((least + 3) / ROOM)


def _falls(speed: Array, left: Left, run: BounceRun, listed: int) -> bool:
    """Return whether a ball still bounces and may come to rest within `_MOST` touches.

    The number of missing touches is extrapolated from the last `ROOM` ones.
    """
    before, now = np.asarray(speed), np.asarray(left.speed)
    flying = np.asarray(left.status) == int(Status.SEPARATED)
    # Under its weight a ball comes to rest before its speed falls to a tenth of √(g δ_s).
    felt = np.nan_to_num(np.sqrt(np.asarray(run.gravity * run.static))) / 10
    target = np.maximum(felt, np.asarray(run.rest))
    with np.errstate(all="ignore"):
        blocks = np.log(target / now) / np.log(now / before)
    return bool(np.any(flying & (now < before) & (ROOM * blocks + listed < _MOST)))


def _trim(run: Bounce) -> Bounce:
    """Return a run without touches at which all balls rest already, and `ROOM` for endless ones."""
    status = np.asarray(run.status)
    lasts = np.argmax(status == int(Status.SETTLED), axis=-1) + 1  # 1 without rest
    endless = np.any(status[..., -1] == int(Status.SEPARATED))
    count = max(int(np.max(lasts)), ROOM if endless else 1)
    listed = {name: np.asarray(getattr(run, name))[..., :count] for name in TOUCHES}
    return dataclasses.replace(run, **jax.device_put(listed))


class _BallAndGround(NamedTuple):
    """A ball and its ground, as given.

    `felt` is True if gravity acts in contact, `peak` if damping refers to the largest closing speed
    since touch.
    """

    law: AbstractLaw
    contact: Contact
    height: Array
    gravity: Array
    rest: Array | None
    felt: bool
    peak: bool


def _start(drop: _BallAndGround, method: AbstractMethod) -> tuple[BounceRun, Landing | None]:
    """Return the shared data of the touches, and the first touch if it determines all others."""
    run = _run(drop)
    if drop.felt or not restitution_is_constant(drop.law, drop.contact):
        return run, None
    return run, landing(problem_of(drop.law, drop.contact, run.speed), method)


_start_compiled = quick(_start, FEW)


@functools.partial(quick, most=FEW)
def _constant(contact: Contact, run: BounceRun, first: Landing, count: int) -> Bounce:
    n = _exponent(contact)
    power = (1 - n) / (1 + n)
    power = power if isinstance(power, float) else jnp.expand_dims(power, -1)
    e = jnp.where(first.impact.status == int(Status.SEPARATED), first.impact.restitution, 0)
    return _assemble(alike(first, run, power, count), run, e)


@functools.partial(quick, most=FEW)
def _bounce(drop: _BallAndGround, count: int, method: AbstractMethod) -> Bounce:
    run, first = _start(drop, method)
    if first is not None:
        return _constant(drop.contact, run, first, count)
    about = drop.law, drop.contact, run
    _, touches = one_by_one(*about, begin(run), method, drop.peak, count)
    return _assemble(touches, run, None)


def _exponent(contact: Contact) -> float | Array:
    n = contact.exponent
    return n if isinstance(n, float) else jnp.where(EXPONENT.holds(n), n, EXPONENT.inside)


def _run(drop: _BallAndGround) -> BounceRun:
    law, contact, height, gravity, rest, gravity_in_contact, _ = drop
    valid = POSITIVE.holds(height) & POSITIVE.holds(gravity)
    height, gravity = jnp.where(valid, height, 1), jnp.where(valid, gravity, 1)
    speed = Flight.speed_after_drop(height, gravity, None)
    # The shape and precision of the result of `impact`.
    problem = uniform(problem_of(law, contact, speed))
    shape, dtype = common_shape((problem, rest)), problem.velocity.dtype

    def fill(value: Array) -> Array:
        return jnp.broadcast_to(value, shape).astype(dtype)

    height, gravity, speed = fill(height), fill(gravity), fill(speed)
    safe = sanitised(contact)
    mass = fill(safe.mass)
    weight = mass * gravity
    static = fill((weight / safe.stiffness.astype(dtype)) ** (1 / _exponent(contact)))
    if rest is None:
        felt = jnp.zeros_like(static) if gravity_in_contact else jnp.sqrt(gravity * static)
        rest = jnp.maximum(felt, VELOCITY_THRESHOLD)
    else:
        valid = valid & _REST.holds(rest)
        rest = jnp.where(_REST.holds(rest), rest, _REST.inside)
    held = law.force(static, jnp.zeros_like(static), contact, jnp.ones_like(static))
    static = jnp.where(jnp.abs(held - weight) <= _STATIC * weight, static, jnp.nan)
    return BounceRun(
        height=height,
        gravity=gravity,
        speed=speed,
        rest=fill(rest),
        static=static,
        mass=mass,
        weight=weight if gravity_in_contact else None,
        valid=fill(valid).astype(bool),
    )


@jax.custom_jvp
def _nan_unless(value: Array, mask: Array) -> Array:
    """Return `value` and its derivative, with NaN in lanes that are not good."""
    return jnp.where(mask, value, jnp.nan)


@_nan_unless.defjvp
def _nan_unless_jvp(
    values: tuple[Array, Array], tangents: tuple[Array, Any]
) -> tuple[Array, Array]:
    (value, mask), (change, _) = values, tangents
    # inf - inf is NaN, but zero stays zero. A zero cotangent must not turn into NaN, which would
    # spoil the numbers that a lane shares with its neighbours.
    huge = jnp.where(mask, 1, jnp.finfo(value.dtype).max)
    minus = jnp.where(mask, 0, -huge)
    return _nan_unless(value, mask), change * huge * huge + change * minus * huge


def _margin(touches: Touches, run: BounceRun, leaves: Array, settled: Array) -> Array:
    """Return the smallest change of a speed, in m/s, that adds or removes a touch."""
    rest = run.rest[..., None]
    rebound = jnp.abs(touches.restitution * touches.speed - rest)
    with_lack = settled & (touches.lack > 0)
    distance = jnp.where(leaves, rebound, jnp.where(with_lack, touches.lack, jnp.inf))
    return jnp.minimum(jnp.min(distance, axis=-1), jnp.abs(run.speed - run.rest))


@functools.partial(quick, most=FEW)
def _assemble(touches: Touches, run: BounceRun, constant_e: Array | None) -> Bounce:
    """Return the record of a run; `constant_e` is the restitution if it is independent of speed."""
    status = jnp.where(run.valid[..., None], touches.status, int(Status.INVALID_INPUT))
    leaves = status == int(Status.SEPARATED)
    settled = status == int(Status.SETTLED)
    gravity = run.gravity[..., None]
    rebound = touches.restitution * touches.speed
    away = touches.return_time + Flight.duration(rebound, gravity, None)
    # The first touch ends the fall; each later one ends a contact and a flight.
    fall = Flight.time_to_fall(run.height, run.gravity, None)[..., None]
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
        remaining = jnp.where(ends, Flight.duration(launches, run.gravity, None), jnp.inf)
    # Without a last touch, a time after all touches depends on the whole run.
    rest_time = jnp.take_along_axis(time, first_rest, axis=-1)[..., 0]
    rest_time = jnp.where(rests, rest_time, time[..., -1] + away[..., -1])
    defined = leaves | settled
    at_rest = rests & jnp.all(defined, axis=-1)

    def of_touches(value: Array) -> Array:
        return jnp.where(defined, value, jnp.nan)

    def of_run(value: Array) -> Array:
        return jnp.where(jnp.all(defined, axis=-1), value, jnp.nan)

    return Bounce(
        time=of_touches(time),
        duration=of_touches(jnp.where(leaves, touches.duration, jnp.inf)),
        return_time=of_touches(jnp.where(leaves, touches.return_time, jnp.inf)),
        impact_velocity=of_touches(touches.speed),
        restitution=of_touches(touches.restitution),
        height=of_touches(Flight.height_reached(rebound, gravity, None)),
        status=status,
        at_rest=at_rest,
        rest_time=_nan_unless(rest_time, at_rest),
        margin=of_run(_margin(touches, run, leaves, settled)),
        rest_velocity=of_run(run.rest),
        rest_indentation=of_run(run.static),
        remaining_flight=None if remaining is None else of_run(remaining),
        drop_height=of_run(run.height),
        gravity=of_run(run.gravity),
    )
