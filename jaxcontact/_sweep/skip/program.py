"""A traced function as a flat list of steps that can be analysed, reduced and run again."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.extend.core as core
import jax.numpy as jnp

# Calls that are replaced by their body: only values are needed, no further derivative.
_CALLS = {
    *("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call"),
    *("remat2", "checkpoint"),
}


@dataclass(frozen=True, eq=False)
class Constant:
    """A number that was known while tracing."""

    value: Any


Place = int | Constant
"""Location of a number: a slot, or a constant."""


def slots_in(places: Iterable[Place]) -> list[int]:
    """Return the slots among places."""
    return [place for place in places if isinstance(place, int)]


@dataclass(frozen=True, eq=False)
class Step:
    """One primitive: the places it reads, and the slots it writes."""

    primitive: core.Primitive
    params: dict[str, Any]
    reads: tuple[Place, ...]
    writes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Program:
    """Steps in order. The first slots are the inputs; `outputs` name slots or constants."""

    steps: tuple[Step, ...]
    shapes: tuple[jax.ShapeDtypeStruct, ...]
    """Shape and type of every slot."""
    inputs: int
    outputs: tuple[Place, ...]
    pure: bool
    """True if it has no side effects."""

    def is_float(self, where: Place) -> bool:
        """Return whether a place is a slot for floats."""
        return any(jnp.issubdtype(self.shapes[k].dtype, jnp.inexact) for k in slots_in([where]))

    def holds(self, primitive: str) -> bool:
        """Return whether the program contains this primitive, also in a loop or a branch."""
        inner = programs_in(step.params for step in self.steps)
        every = itertools.chain(self.steps, *(program.eqns for program in inner))
        return any(step.primitive.name == primitive for step in every)


def program_of(function: Callable[..., Any], inputs: Sequence[jax.ShapeDtypeStruct]) -> Program:
    """Trace `function` once, and inline the calls inside it."""
    closed = jax.make_jaxpr(function)(*inputs)
    steps: list[Step] = []
    shapes: list[jax.ShapeDtypeStruct] = []

    def slots(variables: Sequence[Any]) -> tuple[int, ...]:
        first = len(shapes)
        shapes.extend(jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in variables)
        return tuple(range(first, len(shapes)))

    def add(jaxpr: core.Jaxpr, consts: Sequence[Any], inputs: Sequence[Place]) -> tuple[Place, ...]:
        # Two calls of one body share its variables, so each call gets its own slots.
        where: dict[core.Var, Place] = dict(zip(jaxpr.invars, inputs, strict=True))
        where.update(zip(jaxpr.constvars, map(Constant, consts), strict=True))

        def read(atom: Any) -> Place:
            return Constant(atom.val) if isinstance(atom, core.Literal) else where[atom]

        for eqn in jaxpr.eqns:
            reads = tuple(map(read, eqn.invars))
            body = _body(eqn)
            if body is None:
                writes = slots(eqn.outvars)
                steps.append(Step(eqn.primitive, eqn.params, reads, writes))
            else:
                writes = add(*body, reads)
            where.update(zip(eqn.outvars, writes, strict=True))
        return tuple(map(read, jaxpr.outvars))

    input_slots = slots(closed.jaxpr.invars)
    outputs = add(closed.jaxpr, closed.consts, input_slots)
    return Program(tuple(steps), tuple(shapes), len(input_slots), outputs, not closed.jaxpr.effects)


def _body(eqn: core.JaxprEqn) -> tuple[core.Jaxpr, Sequence[Any]] | None:
    if eqn.primitive.name not in _CALLS:
        return None
    body = eqn.params.get("jaxpr", eqn.params.get("call_jaxpr"))
    if isinstance(body, core.ClosedJaxpr):
        return body.jaxpr, body.consts
    return (body, ()) if isinstance(body, core.Jaxpr) and not body.constvars else None


def programs_in(params: Iterable[Any]) -> Iterator[core.ClosedJaxpr | core.Jaxpr]:
    """Yield the programs in parameters of primitives (loops and branches), and those in these."""
    for part in filter(_is_program, jax.tree.leaves(list(params), is_leaf=_is_program)):
        yield part
        for eqn in part.eqns:
            yield from programs_in(eqn.params.values())


def _is_program(part: Any) -> bool:
    return isinstance(part, core.ClosedJaxpr | core.Jaxpr)


def steps_needed(steps: Sequence[Step], outputs: Iterable[Place]) -> tuple[set[int], set[int]]:
    """Return the numbers of the steps that `outputs` need, and the input slots that they need."""
    wanted = set(slots_in(outputs))
    numbers = set()
    for number, step in reversed(list(enumerate(steps))):
        if not wanted.isdisjoint(step.writes):
            numbers.add(number)
            wanted.difference_update(step.writes)
            wanted.update(slots_in(step.reads))
    return numbers, wanted


class SharedSteps:
    """Steps of several versions of a program, in which equal steps of two versions are shared."""

    def __init__(self, inputs: int):
        self.steps: list[Step] = []
        self._slots = itertools.count(inputs)
        self._seen: dict[Any, tuple[int, ...]] = {}

    def add(self, steps: Sequence[Step], output: Place) -> Place:
        """Add one version; return its output as a slot of the shared steps."""
        where: dict[Place, Place] = {}

        def share(place: Place) -> Place:
            return where.get(place, place)

        for step in steps:
            reads = tuple(map(share, step.reads))
            # The slots that a step writes identify it within its program.
            key = step.writes, reads
            if key not in self._seen:
                self._seen[key] = tuple(next(self._slots) for _ in step.writes)
                self.steps.append(Step(step.primitive, step.params, reads, self._seen[key]))
            where.update(zip(step.writes, self._seen[key], strict=True))
        return share(output)


def run(steps: Sequence[Step], outputs: Sequence[Place], inputs: dict[int, jax.Array]) -> list[Any]:
    """Run `steps` on `inputs`; can be traced by jit and vmap like any function."""
    values: dict[int, Any] = dict(inputs)

    def read(where: Place) -> Any:
        return where.value if isinstance(where, Constant) else values[where]

    for step in steps:
        params = step.primitive.get_bind_params(step.params)
        out = step.primitive.bind(*map(read, step.reads), **params)
        out = out if step.primitive.multiple_results else [out]
        values.update(zip(step.writes, out, strict=True))
    return [jnp.asarray(read(where)) for where in outputs]
