"""The sequence of touches: speed, restitution and times of each."""

from __future__ import annotations

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._contact import Contact
from .._impact import AbstractMethod, Landing, Status, landing, problem_of
from .._laws import AbstractLaw
from .._program import FEW, quick

_SEPARATED, _SETTLED = int(Status.SEPARATED), int(Status.SETTLED)


class BounceRun(eqx.Module):
    """Data shared by the touches of a run, in one shape and precision, with invalid numbers
    replaced.

    `speed` belongs to the first touch. `rest` is the speed below which a touch counts as rest.
    `static` is the indentation at rest. `weight` in N is None unless it acts in contact.
    """

    height: Array
    gravity: Array
    speed: Array
    rest: Array
    static: Array
    mass: Array
    weight: Array | None
    valid: Array


class Touches(NamedTuple):
    """The touches of a run, along the last axis.

    Restitution is that of the speeds at δ = 0, which the ball reaches after `return_time`.
    Restitution and the times are 0 if the ball does not leave; `status` gives the reason. `lack` is
    the missing speed at δ = 0 of such a ball, or 0 if unknown.
    """

    speed: Array
    restitution: Array
    duration: Array
    return_time: Array
    status: Array
    lack: Array


class Left(NamedTuple):
    """The state between two touches: the speed of the next touch, and the end of the last one."""

    speed: Array
    status: Array


def begin(run: BounceRun) -> Left:
    """Return the state before the first touch."""
    return Left(run.speed, jnp.full(run.speed.shape, _SEPARATED, jnp.int32))


def alike(first: Landing, run: BounceRun, power: float | Array, count: int) -> Touches:
    """Compute all touches from the first one, for a law whose e does not depend on the speed.

    In scaled units they are the same impact: v_k = e^k v_0, and times scale as v^power.
    """
    hit, rest = first.impact, run.rest[..., None]
    status = hit.status[..., None]
    leaves = status == _SEPARATED
    e = jnp.where(leaves, hit.restitution[..., None], 0)
    following = jnp.broadcast_to(e, (*e.shape[:-1], count - 1))
    ratio = jnp.cumprod(jnp.concatenate([jnp.ones_like(e), following], axis=-1), axis=-1)
    speeds = run.speed[..., None] * ratio
    moving = speeds >= rest
    begun = jnp.concatenate([jnp.ones_like(leaves), moving[..., :-1]], axis=-1)
    slower = jnp.where(moving, ratio, 1) ** power
    flown = leaves & moving
    duration = jnp.where(flown, hit.duration[..., None], 0) * slower
    return_time = duration
    if first.end_indentation is not None:
        back = jnp.where(leaves, hit.rebound_velocity[..., None], 1)
        return_time = duration + slower * jnp.where(
            flown, first.end_indentation[..., None] / back, 0
        )
    return Touches(
        speed=jnp.where(begun, speeds, 0),
        restitution=jnp.where(moving, e, 0),
        duration=duration,
        return_time=return_time,
        status=jnp.where(leaves & ~moving, _SETTLED, status),
        lack=jnp.zeros_like(speeds),
    )


@functools.partial(quick, most=FEW)
def one_by_one(
    law: AbstractLaw,
    contact: Contact,
    run: BounceRun,
    left: Left,
    method: AbstractMethod,
    peak: bool,
    count: int,
) -> tuple[Left, Touches]:
    """Solve `count` more touches, each with its own speed; return the state after them as well.

    If `peak`, damping refers to the largest closing speed since touch.
    """

    def step(left: Left, _: None) -> tuple[Left, Touches]:
        speed, state = left
        begun = state == _SEPARATED
        moving = begun & (speed >= run.rest)
        waits = jnp.where(begun, _SETTLED, state).astype(jnp.int32)

        def solve() -> tuple[Left, Touches]:
            # A lane that has ended repeats its first impact, whose outcome is finite.
            speed_here = jnp.where(moving, speed, run.speed)
            touch = landing(problem_of(law, contact, speed_here, run.weight), method, peak)
            hit = touch.impact
            status = jnp.where(moving, hit.status, waits).astype(jnp.int32)
            # Infinities and NaN are removed here: 0 times them would spoil the derivative of good
            # numbers.
            leaves = status == _SEPARATED
            rebound = jnp.where(leaves, hit.rebound_velocity, 0)
            duration = return_time = jnp.where(leaves, hit.duration, 0)
            depth = touch.end_indentation
            if law.ends_apart and run.weight is None:
                # Without weight in contact, a neck lifts no weight and the ball falls as far.
                depth = None
            if depth is not None:
                rebound, delay, leaves = _risen(run, rebound, jnp.where(leaves, depth, 0), leaves)
                return_time = duration + delay
                status = jnp.where((status == _SEPARATED) & ~leaves, _SETTLED, status)
            lack = jnp.zeros_like(speed)
            if touch.spare_energy is not None:
                missing = moving & (status == _SETTLED) & (touch.spare_energy < 0)
                square = jnp.where(missing, -2 * touch.spare_energy / run.mass, 1)
                lack = jnp.where(missing, jnp.sqrt(square), 0)
            restitution = rebound / jnp.where(leaves, speed, 1)
            before = jnp.where(begun, speed, 0)
            touches = Touches(before, restitution, duration, return_time, status, lack)
            return Left(rebound, status), touches

        def over() -> tuple[Left, Touches]:
            zero = jnp.zeros_like(speed)
            before = jnp.where(begun, speed, 0)
            return Left(zero, waits), Touches(before, zero, zero, zero, waits, zero)

        # Most runs are over long before there is no room.
        return jax.lax.cond(jnp.any(moving), solve, over)

    left, touches = jax.lax.scan(step, left, None, length=count)
    return left, jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), touches)


def _risen(run: BounceRun, speed: Array, depth: Array, leaves: Array) -> tuple[Array, Array, Array]:
    """Return the speed at δ = 0 after a rise from a depth, its time, and whether δ = 0 is reached.

    Without weight in contact, gravity acts above δ = 0 only. The depth at which a neck snaps is
    negative: then the speed is that of the fall to δ = 0, and so is the time.
    """
    square = jnp.square(speed)
    if run.weight is not None:
        square = square - 2 * run.gravity * depth
    leaves = leaves & (square > 0)
    risen = jnp.where(leaves, jnp.sqrt(jnp.where(leaves, square, 1)), 0)
    delay = jnp.where(leaves, 2 * depth / jnp.where(leaves, speed + risen, 1), 0)
    return risen, delay, leaves
