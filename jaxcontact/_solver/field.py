"""A motion that is solved until an event ends it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .._varying import varying
from .lanes import ByLanes
from .runge_kutta import step_in_loop, step_written_out

Number = Float[Array, ""]
Flags = Bool[Array, " guards"]
State = TypeVar("State")
Kept = TypeVar("Kept")

Record = Any
"""A moment as a solve keeps it: one vector, or a `Moment`."""


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

    def jumps(self, inside: State, end: State, closed: Flags) -> Bool[Array, ""]:
        """Whether the force of a `continued` motion jumps to zero at its end, where it is clamped.

        The guards that `closed` then say nothing of the end from the state `inside` before it.
        """
        ...


class Moment(NamedTuple, Generic[State]):
    """A time, and the state then."""

    tau: Number
    state: State


class Packed(NamedTuple, Generic[State]):
    """How a solve keeps its moments, from a `start` on.

    As one vector a moment costs a loop one instruction where a state costs several. `many`: they
    stay as they are, and the stages of a step are written out: longer to compile, and a fraction
    of the time in a batch. `moment`: the moment that a record keeps. `backwards`: whether
    derivatives may go back through the steps.
    """

    start: Record
    moment: Callable[[Record], Moment[State]]
    many: bool
    backwards: bool

    @staticmethod
    def of(start: State, many: bool = False, backwards: bool = False) -> Packed[State]:
        """That of all moments from a state on, the first at time zero."""
        first = jax.tree.leaves(start)[0].reshape(-1)[0]
        begun = varying(first, Moment(jnp.zeros_like(first), start))
        if many:
            return Packed(begun, lambda record: record, many, backwards)
        return Packed(*ravel_pytree(begun), many, backwards)

    def record(self, moment: Moment[State]) -> Record:
        """What is kept of a moment."""
        return moment if self.many else ravel_pytree(moment)[0]

    def tau(self, record: Record) -> Number:
        """The time in a record."""
        return record.tau if self.many else record[0]

    def state(self, record: Record) -> State:
        """The state in a record."""
        return self.moment(record).state

    def guards(self, field: Field[State], record: Record) -> Float[Array, " guards"]:
        """All guards."""
        return jnp.stack(field.guards(self.state(record)))

    def each(self, function: Callable[[Record], Array], *records: Record) -> Sequence[Array]:
        """`function` of several records, compiled once where compiling counts."""
        if self.many:
            return [function(record) for record in records]
        return list(jax.vmap(function)(jnp.stack(records)))

    def step(
        self, rate: Callable[[Any, Moment[State]], Moment[State]]
    ) -> Callable[[Any, Record, Number], tuple[Record, Record]]:
        """`step(field, record, size)`: the record a step later, and its error."""

        def few(field: Any, record: Record, size: Number) -> tuple[Record, Record]:
            def slope(record: Record) -> Record:
                return self.record(rate(field, self.moment(record)))

            return step_in_loop(slope, record, size)

        def many(field: Any, record: Record, size: Number) -> tuple[Record, Record]:
            one = jax.lax.stop_gradient(jnp.where(jnp.isnan(size), size, 1))

            def slope(_: int, moment: Moment[State]) -> Moment[State]:
                # XLA computes a quotient once. What it takes for cheap it would compute again for
                # every later stage, which is four times the work.
                tau, state = rate(field, moment)
                return Moment(tau, jax.tree.map(lambda leaf: leaf / one, state))

            moments = step_written_out(slope, self.moment(record), size)
            after, error = map(self.record, moments)
            return after, error

        if self.many:
            return many
        # Under `vmap` a record stays a vector, but the stages are written out all the same.
        return few if self.backwards else ByLanes(few, many)


def chosen(first: Bool[Array, ""], yes: Kept, no: Kept) -> Kept:
    """`yes` or `no`, leaf by leaf."""
    return jax.tree.map(functools.partial(jnp.where, first), yes, no)


def in_time(field: Field[State], moment: Moment[State]) -> Moment[State]:
    """The slope of a motion, whose time passes at the rate 1."""
    return Moment(jnp.ones_like(moment.tau), field.rate(moment.state))
