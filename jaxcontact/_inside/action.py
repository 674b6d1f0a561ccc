"""The contact pairs of an engine's state, and what a law does on them in one time step."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from .._contact import Contact
from .._laws import AbstractLaw
from .interval import Gaps, PerPair, push_of


class EnginePairs(NamedTuple):
    """The pairs of a state, and the velocities that a unit impulse on each pair adds."""

    gaps: Gaps
    answers: Float[Array, "nv pairs"]


class Action(NamedTuple):
    """What the law does in a step: the mean forces in N, and the velocities times s by which the
    positions have to move after the engine's step. `touch_speed` is to be carried.
    """

    force: PerPair
    shift: Float[Array, " nv"]
    touch_speed: PerPair


def pairs_of(
    depth: PerPair,
    speed: PerPair,
    acceleration: PerPair,
    jacobian: Float[Array, "pairs nv"],
    mass: Float[Array, "nv nv"],
) -> EnginePairs:
    """Return the pairs of a state, by the derivatives of closing speeds by velocities."""
    answers = jax.scipy.linalg.solve(mass, jacobian.T, assume_a="pos")
    return EnginePairs(Gaps(depth, speed, acceleration, jacobian @ answers), answers)


def first_speeds(pairs: EnginePairs) -> PerPair:
    """Return the v0 of a start: bodies that overlap touch with their speed."""
    return jnp.where(pairs.gaps.depth > 0, jnp.maximum(pairs.gaps.speed, 0), 0)


def action_of(
    law: AbstractLaw,
    contact: Contact,
    pairs: EnginePairs,
    touch_speed: PerPair,
    step: Float[Array, ""],
    substeps: int,
    part: float,
) -> Action:
    """Follow the contacts through a step of an engine.

    The engine moves a body of constant acceleration a by h v + `part` h² a: 1 in semi-implicit
    steps, ½ in those of Runge and Kutta.
    """
    gaps = pairs.gaps
    # Such a body is on an exact parabola, on which its speed is that of another time.
    gaps = gaps._replace(speed=gaps.speed + (part - 0.5) * step * gaps.acceleration)
    push = push_of(law, contact, gaps, touch_speed, step, substeps)
    # The engine moves the bodies as if the mean force had acted all the time.
    shift = pairs.answers @ (part * step * push.impulse - push.shift)
    return Action(push.impulse / step, shift, push.touch_speed)


@contextlib.contextmanager
def relaxed() -> Iterator[None]:
    """Engines mix precisions and shapes, which a user's settings may forbid."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield
