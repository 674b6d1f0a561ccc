"""A motion that is solved until an event ends it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ..._varying import varying
from .lanes import by_lanes
from .runge_kutta import step_in_loop, step_written_out

Number = Float[Array, ""]
Vector = Float[Array, " numbers"]
State = TypeVar("State")


class Field(Protocol[State]):
    """An autonomous motion: a pytree, by whose arrays a solve is differentiable.

    States are pytrees of arrays of one precision.
    """

    def rate(self, state: State) -> State:
        """The slope of a state."""
        ...

    def guards(self, state: State) -> tuple[Number, ...]:
        """Each positive until it ends the motion, and negative shortly after.

        A step sees their signs at its ends. One that may close and open again within a step needs a
        guard beside it that does not.
        """
        ...

    @property
    def one_way(self) -> bool:
        """Whether the guard that closes falls all the way in the step before: then no search."""
        ...

    @property
    def clamped(self) -> bool:
        """Whether a force may be clamped to zero where the motion ends."""
        ...

    def continued(self, inside: State) -> Field[State]:
        """The motion under a force that no clamp ends, from a state shortly before the end."""
        ...


class Moment(NamedTuple, Generic[State]):
    """A time, and the state then."""

    tau: Number
    state: State


class Packed(NamedTuple, Generic[State]):
    """How a moment is one vector, which costs a loop one instruction where a state costs several.

    `start`: the first moment. `backwards`: whether derivatives may go back through the steps.
    """

    start: Vector
    moment: Callable[[Vector], Moment[State]]
    backwards: bool

    @staticmethod
    def of(start: State, backwards: bool = False) -> Packed[State]:
        """That of all moments from a state on, the first at time zero."""
        first = jax.tree.leaves(start)[0]
        vector, moment = ravel_pytree(Moment(jnp.zeros((), first.dtype), start))
        return Packed(varying(first.reshape(-1)[0], vector), moment, backwards)

    def state(self, vector: Vector) -> State:
        """The state in a vector."""
        return self.moment(vector).state

    def guards(self, field: Field[State], vector: Vector) -> Float[Array, " guards"]:
        """All guards."""
        return jnp.stack(field.guards(self.state(vector)))

    def slope(
        self, rate: Callable[[Any, Moment[State]], Moment[State]], field: Any, vector: Vector
    ) -> Vector:
        """The slope of a vector by a `rate` of moments."""
        return ravel_pytree(rate(field, self.moment(vector)))[0]

    def step(
        self, rate: Callable[[Any, Moment[State]], Moment[State]]
    ) -> Callable[[Any, Vector, Number], tuple[Vector, Vector]]:
        """`step(field, vector, size)`: the vector a step later, and its error."""

        def few(field: Any, vector: Vector, size: Number) -> tuple[Vector, Vector]:
            slope = functools.partial(self.slope, rate, field)
            return step_in_loop(slope, vector, size)[:2]

        def many(field: Any, vector: Vector, size: Number) -> tuple[Vector, Vector]:
            both = step_written_out(lambda _, at: rate(field, at), self.moment(vector), size)
            after, error = (ravel_pytree(part)[0] for part in both)
            return after, error

        return few if self.backwards else by_lanes(few, many)


def in_time(field: Field[State], moment: Moment[State]) -> Moment[State]:
    """The slope of a motion, whose time passes at the rate 1."""
    return Moment(jnp.ones_like(moment.tau), field.rate(moment.state))


Flags = Bool[Array, " guards"]
