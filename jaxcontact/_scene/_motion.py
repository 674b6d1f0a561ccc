"""How walls move by themselves: what is prescribed, whoever they hit."""

from __future__ import annotations

import abc
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._parameter import POSITIVE, REAL, is_plain
from ._entry import one_number, vector


class Own(eqx.Module):
    """A function of the user's along one direction, in units of `length` m and `tick` s:
    n·d(began + tick t)/length, with |d''| ≤ `bound` in m/s².
    """

    displacement: Callable[[Any, Any], Any] = eqx.field(static=True)
    args: Any
    began: Array
    normal: Array
    bound: Array
    length: Array
    tick: Array

    def place(self, time: Array) -> Array:
        """At one time."""
        moved = self.displacement(self.began + self.tick * time, self.args)
        along = moved if jnp.ndim(moved) == 0 else jnp.sum(self.normal * moved)
        return along / self.length

    def velocity(self, time: Array) -> Array:
        """At one time."""
        return jax.jvp(self.place, (time,), (jnp.ones_like(time),))[1]

    def acceleration(self, time: Array) -> Array:
        """At one time."""
        return jax.jvp(self.velocity, (time,), (jnp.ones_like(time),))[1]

    def later(self, time: Array) -> Own:
        """From a time on."""
        return eqx.tree_at(lambda own: own.began, self, self.began + self.tick * time)

    def scaled(self, length: Array, tick: Array) -> Own:
        """In other units, for what was in m and s."""
        return eqx.tree_at(lambda own: (own.length, own.tick), self, (length, tick))


class Along(NamedTuple):
    """A motion along one direction: V t + A (sin(ω t + φ) - sin φ), from where it is at t = 0, or a
    function of the user's `own`.
    """

    speed: Any
    amplitude: Any
    rate: Any
    phase: Any
    own: Own | None = None


def still() -> Along:
    """No motion."""
    zero = np.zeros(())
    return Along(zero, zero, zero, zero)


class AbstractMotion(eqx.Module):
    """A prescribed motion of a wall: its displacement from the place it is given at."""

    @property
    @abc.abstractmethod
    def dimensions(self) -> int | None:
        """The number of dimensions of the space it is in; None where any will do."""

    @property
    @abc.abstractmethod
    def vibrates(self) -> bool:
        """Whether it is accelerated."""

    @abc.abstractmethod
    def start(self, normal: Array) -> Array:
        """The displacement along a normal at time zero, in m."""

    @abc.abstractmethod
    def along(self, normal: Array) -> Along:
        """The motion along a normal."""

    @abc.abstractmethod
    def after(self, time: Array) -> tuple[Array | None, AbstractMotion]:
        """What goes on after a time: the displacement of the place, and the motion from there."""


class Steady(AbstractMotion):
    """A wall that moves at constant velocity: displacement d(t) = V t.

    Argument: `velocity` V in m/s, as many numbers as the scene has dimensions. Raises ValueError
    for what is not finite.
    """

    velocity: Float[Array, " D"]

    def __init__(self, velocity: ArrayLike | Sequence[ArrayLike]):
        self.velocity = vector(velocity, "velocity")

    @property
    def dimensions(self) -> int:
        return self.velocity.shape[0]

    @property
    def vibrates(self) -> bool:
        return False

    def start(self, normal: Array) -> Array:
        return jnp.zeros((), self.velocity.dtype)

    def along(self, normal: Array) -> Along:
        return still()._replace(speed=jnp.sum(normal * self.velocity))

    def after(self, time: Array) -> tuple[Array, Steady]:
        return self.velocity * time, self


class Vibration(AbstractMotion):
    """A wall that shakes: displacement d(t) = A sin(2π f t + φ) from the place it is given at.

    Arguments: `amplitude` A in m, as many numbers as the scene has dimensions, or for a plane one
    number, along its normal; `frequency` f > 0 in Hz; `phase` φ in rad. Numbers are leaves. Raises
    ValueError for what is out of range or not finite.
    """

    amplitude: Float[Array, " D"] | Float[Array, ""]
    frequency: Float[Array, ""]
    phase: Float[Array, ""]

    def __init__(
        self,
        amplitude: ArrayLike | Sequence[ArrayLike],
        frequency: ArrayLike,
        phase: ArrayLike = 0.0,
    ):
        single = is_plain(amplitude) or getattr(amplitude, "ndim", None) == 0
        read = functools.partial(one_number, allowed=REAL) if single else vector
        self.amplitude = read(amplitude, "amplitude")
        self.frequency = one_number(frequency, "frequency", POSITIVE)
        self.phase = one_number(phase, "phase", REAL)

    @property
    def dimensions(self) -> int | None:
        return self.amplitude.shape[0] if self.amplitude.ndim else None

    @property
    def vibrates(self) -> bool:
        return True

    def _along(self, normal: Array) -> Array:
        return jnp.sum(normal * self.amplitude) if self.amplitude.ndim else self.amplitude

    def start(self, normal: Array) -> Array:
        return self._along(normal) * jnp.sin(self.phase)

    def along(self, normal: Array) -> Along:
        rate = 2 * np.pi * self.frequency
        return Along(np.zeros(()), self._along(normal), rate, self.phase)

    def after(self, time: Array) -> tuple[None, Vibration]:
        phase = self.phase + 2 * np.pi * self.frequency * time
        return None, eqx.tree_at(lambda motion: motion.phase, self, phase)
