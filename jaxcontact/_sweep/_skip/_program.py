"""A traced function as a flat list of steps that can be read, cut down and run again."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.extend.core as core
import jax.numpy as jnp

# Calls that are replaced by their body: only values are wanted, no further derivative.
_CALLS = {
    "jit",
    "pjit",
    "closed_call",
    "core_call",
    "custom_jvp_call",
    "custom_vjp_call",
    "remat2",
    "checkpoint",
}


@dataclass(frozen=True, eq=False)
class Step:
    """One primitive: it reads slots or constants, and writes slots."""

    primitive: core.Primitive
    params: dict[str, Any]
    reads: tuple[int | Constant, ...]
    writes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Constant:
    """A number that was known while tracing."""

    value: Any


@dataclass(frozen=True, eq=False)
class Program:
    """Steps in order. The first slots are the inputs; `outputs` name slots or constants."""

    steps: tuple[Step, ...]
    shapes: tuple[jax.ShapeDtypeStruct, ...]
    """Shape and type of every slot."""
    inputs: int
    outputs: tuple[int | Constant, ...]
    pure: bool
    """Whether it has no side effects."""

    @property
    def open_ended(self) -> bool:
        """Whether it has a loop of unknown length, as long in a block as for its slowest lane."""
        return self._holds("while")

    @property
    def branching(self) -> bool:
        """Whether it has branches; before each, all numbers of a block are written to memory."""
        return self._holds("cond")

    def _holds(self, primitive: str) -> bool:
        return any(
            step.primitive.name == primitive
            or any(_holds(part, primitive) for part in _parts(step.params))
            for step in self.steps
        )


def program_of(function: Callable[..., Any], inputs: Sequence[jax.ShapeDtypeStruct]) -> Program:
    """Trace `function` once, and inline the calls inside it."""
    closed = jax.make_jaxpr(function)(*inputs)
    builder = _Builder()
    slots = [builder.slot(var.aval) for var in closed.jaxpr.invars]
    outputs = builder.add(closed.jaxpr, closed.consts, slots)
    return Program(
        steps=tuple(builder.steps),
        shapes=tuple(builder.shapes),
        inputs=len(slots),
        outputs=tuple(outputs),
        pure=not closed.jaxpr.effects,
    )


class _Builder:
    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.shapes: list[jax.ShapeDtypeStruct] = []

    def slot(self, aval: Any) -> int:
        self.shapes.append(jax.ShapeDtypeStruct(aval.shape, aval.dtype))
        return len(self.shapes) - 1

    def add(
        self, jaxpr: core.Jaxpr, consts: Sequence[Any], inputs: Sequence[int | Constant]
    ) -> list[int | Constant]:
        # Two calls of one body share its variables: each call gets slots of its own.
        where: dict[core.Var, int | Constant] = dict(zip(jaxpr.invars, inputs, strict=True))
        where.update(zip(jaxpr.constvars, map(Constant, consts), strict=True))

        def read(atom: Any) -> int | Constant:
            return Constant(atom.val) if isinstance(atom, core.Literal) else where[atom]

        for eqn in jaxpr.eqns:
            reads = [read(atom) for atom in eqn.invars]
            body = _body(eqn)
            if body is None:
                writes = [self.slot(var.aval) for var in eqn.outvars]
                self.steps.append(Step(eqn.primitive, eqn.params, tuple(reads), tuple(writes)))
                where.update(zip(eqn.outvars, writes, strict=True))
            else:
                where.update(zip(eqn.outvars, self.add(*body, reads), strict=True))
        return [read(atom) for atom in jaxpr.outvars]


def _body(eqn: core.JaxprEqn) -> tuple[core.Jaxpr, Sequence[Any]] | None:
    if eqn.primitive.name not in _CALLS:
        return None
    body = eqn.params.get("jaxpr", eqn.params.get("call_jaxpr"))
    if isinstance(body, core.ClosedJaxpr):
        return body.jaxpr, body.consts
    return (body, ()) if isinstance(body, core.Jaxpr) and not body.constvars else None


def _holds(jaxpr: core.Jaxpr, primitive: str) -> bool:
    return any(
        eqn.primitive.name == primitive
        or any(_holds(part, primitive) for part in _parts(eqn.params))
        for eqn in jaxpr.eqns
    )


def _parts(params: dict[str, Any]) -> Iterable[core.Jaxpr]:
    """The programs that a primitive holds: bodies of loops, branches."""
    for value in jax.tree.leaves(params, is_leaf=lambda x: isinstance(x, core.ClosedJaxpr)):
        if isinstance(value, core.ClosedJaxpr):
            yield value.jaxpr
        elif isinstance(value, core.Jaxpr):
            yield value


def needed(
    steps: Sequence[Step], outputs: Iterable[int | Constant]
) -> tuple[tuple[Step, ...], set[int]]:
    """The steps that `outputs` are made of, and the slots that come from outside."""
    wanted = {out for out in outputs if isinstance(out, int)}
    kept = []
    for step in reversed(steps):
        if wanted.isdisjoint(step.writes):
            continue
        kept.append(step)
        wanted.difference_update(step.writes)
        wanted.update(read for read in step.reads if isinstance(read, int))
    return tuple(reversed(kept)), wanted


class Shared:
    """Steps of several versions of a program, numbered so that equal work has one number."""

    def __init__(self, inputs: int):
        self.steps: list[Step] = []
        self._slots = itertools.count(inputs)
        self._seen: dict[Any, int] = {}
        self._makers: dict[int, int] = {}

    def add(self, steps: Sequence[Step], outputs: Sequence[int | Constant]) -> list[int | Constant]:
        """Add one version; its outputs, as slots of the shared steps."""
        where: dict[int, int] = {}

        def shared(place: int | Constant) -> int | Constant:
            return place if isinstance(place, Constant) else where.get(place, place)

        for step in steps:
            reads = tuple(map(shared, step.reads))
            # The slots that a step writes identify it within its program.
            key = step.writes, reads
            if key not in self._seen:
                self._seen[key] = len(self.steps)
                writes = tuple(next(self._slots) for _ in step.writes)
                self._makers.update(dict.fromkeys(writes, len(self.steps)))
                self.steps.append(Step(step.primitive, step.params, reads, writes))
            where.update(zip(step.writes, self.steps[self._seen[key]].writes, strict=True))
        return [shared(place) for place in outputs]

    def numbers_of(self, output: int | Constant) -> set[int]:
        """The numbers of the steps that an output is made of."""
        found: set[int] = set()
        waiting = [output]
        while waiting:
            place = waiting.pop()
            maker = None if isinstance(place, Constant) else self._makers.get(place)
            if maker is not None and maker not in found:
                found.add(maker)
                waiting += self.steps[maker].reads
        return found


def run(
    steps: Sequence[Step], outputs: Sequence[int | Constant], inputs: dict[int, jax.Array]
) -> list[Any]:
    """What `steps` make of `inputs`; to be traced by jit and vmap like any function."""
    values: dict[int, Any] = dict(inputs)

    def read(where: int | Constant) -> Any:
        return where.value if isinstance(where, Constant) else values[where]

    for step in steps:
        params = step.primitive.get_bind_params(step.params)
        out = step.primitive.bind(*map(read, step.reads), **params)
        out = out if step.primitive.multiple_results else [out]
        values.update(zip(step.writes, out, strict=True))
    return [jnp.asarray(read(where)) for where in outputs]
