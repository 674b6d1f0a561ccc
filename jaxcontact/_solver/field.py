"""The interface of a motion that is solved until an event ends it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .._functions import product_in_place, varying
from .few_or_many import ByLanes
from .runge_kutta import step_in_loop, step_written_out

Number = Float[Array, ""]
Flags = Bool[Array, " guards"]
State = TypeVar("State")
Kept = TypeVar("Kept")

Record = Any
"""A moment as a solve stores it: one vector, or a `Moment`."""


class Field(Protocol[State]):
    """An autonomous motion: a pytree, whose arrays a solve is differentiable by. States are pytrees
    of arrays of one precision.
    """

    def rate(self, state: State) -> State:
        """Return the slope of a state."""
        ...

    def guards(self, state: State) -> tuple[Number, ...]:
        """Return guards, each positive until it ends the motion, and negative shortly after. Only
        their signs at the ends of a step are checked. A guard that may close and open again within
        a step needs another one beside it that does not.
        """
        ...

    @property
    def smooth(self) -> bool:
        """True if all guards are smooth up to their zeros, with a slope there."""
        ...

    @property
    def clamped(self) -> bool:
        """True if a force may be clamped to zero at the end of the motion."""
        ...

    def continued(self, inside: State) -> Field[State]:
        """Return the motion under the unclamped force, from a state shortly before the end."""
        ...

    def jumps(self, inside: State, end: State, closed: Flags) -> Bool[Array, ""]:
        """Return whether the force of a `continued` motion jumps to zero at its end by a clamp. The
        guards that `closed` then do not determine the end from the state `inside` before it.
        """
        ...


class Moment(NamedTuple, Generic[State]):
    """A time, and the state then."""

    tau: Number
    state: State


class Packed(NamedTuple, Generic[State]):
    """The storage of moments in a solve, from a `start` on.

    A moment stored as one vector costs a loop one instruction; a state costs several. With `many`
    lanes moments stay pytrees, and the stages of a step are written out. This takes longer to
    compile, but a fraction of the run time in a batch. `moment` recovers a moment from its record.
    `backwards`: whether derivatives may go back through the steps.
    """

    start: Record
    moment: Callable[[Record], Moment[State]]
    many: bool
    backwards: bool

    @staticmethod
    def of(start: State, many: bool = False, backwards: bool = False) -> Packed[State]:
        """Return the storage for moments from a state on, the first one at time zero."""
        first = jax.tree.leaves(start)[0].reshape(-1)[0]
        begun = varying(first, Moment(jnp.zeros_like(first), start))
        if many:
            return Packed(begun, lambda record: record, many, backwards)
        return Packed(*ravel_pytree(begun), many, backwards)

    def record(self, moment: Moment[State]) -> Record:
        """Return the record of a moment."""
        return moment if self.many else ravel_pytree(moment)[0]

    def tau(self, record: Record) -> Number:
        """Return the time in a record."""
        return record.tau if self.many else record[0]

    def state(self, record: Record) -> State:
        """Return the state in a record."""
        return self.moment(record).state

    def guards(self, field: Field[State], record: Record) -> Float[Array, " guards"]:
        """Return all guards of a record."""
        return jnp.stack(field.guards(self.state(record)))

    def each(self, function: Callable[[Record], Array], *records: Record) -> Sequence[Array]:
        """Apply `function` to several records, compiled once if compile time matters."""
        if self.many:
            return [function(record) for record in records]
        return list(jax.vmap(function)(jnp.stack(records)))

    def step(
        self, rate: Callable[[Any, Moment[State]], Moment[State]]
    ) -> Callable[[Any, Record, Number], tuple[Record, Record]]:
        """Return `step(field, record, size)`: the record a step later, and its error."""

        def slope(field: Any, record: Record) -> Record:
            return self.record(rate(field, self.moment(record)))

        def few(field: Any, record: Record, size: Number) -> tuple[Record, Record]:
            return step_in_loop(functools.partial(slope, field), record, size)

        def batched(
            lanes: int, along: Any, field: Any, record: Record, size: Number
        ) -> tuple[Record, Record]:
            # `vmap` puts lanes first, where a CPU does not work on several at once: ten times
            # slower, measured.
            arrays, fixed = eqx.partition(field, eqx.is_array)
            axes = jax.tree.map(lambda flag: 0 if flag else None, along[0])
            each = jax.vmap(
                lambda arrays, record: slope(eqx.combine(arrays, fixed), record),
                in_axes=(axes, -1),
                out_axes=-1,
                axis_size=lanes,
            )
            sizes = jnp.broadcast_to(size, (1, lanes))
            if not along[1]:
                record = jnp.broadcast_to(record[None], (lanes, record.size))
            # Each lane has a step of its own, so the steps scale the slopes.
            one = jnp.ones((), record.dtype)
            after, error = step_in_loop(
                lambda record: sizes * each(arrays, record), record.T, one, product_in_place
            )
            return after.T, error.T

        def many(field: Any, record: Record, size: Number) -> tuple[Record, Record]:
            one = jax.lax.stop_gradient(jnp.where(jnp.isnan(size), size, 1))

            def slope(_: int, moment: Moment[State]) -> Moment[State]:
                # XLA computes a quotient only once. It would recompute cheap expressions for every
                # later stage, which is four times the work.
                tau, state = rate(field, moment)
                return Moment(tau, jax.tree.map(lambda leaf: leaf / one, state))

            moments = step_written_out(slope, self.moment(record), size)
            after, error = map(self.record, moments)
            return after, error

        if self.many:
            return many
        # Under `vmap` a record stays a vector; with many lanes the stages are still written out.
        return few if self.backwards else ByLanes(few, many, batched)


def chosen(first: Bool[Array, ""], yes: Kept, no: Kept) -> Kept:
    """Return `yes` or `no`, leaf by leaf."""
    return jax.tree.map(functools.partial(jnp.where, first), yes, no)


def in_time(field: Field[State], moment: Moment[State]) -> Moment[State]:
    """Return the slope of a motion, with time passing at the rate 1."""
    return Moment(jnp.ones_like(moment.tau), field.rate(moment.state))
