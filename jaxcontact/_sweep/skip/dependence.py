"""Dependence of the outputs of a program on the dimensions of a sweep, with conditions.

Each number of a program has a fact: its value, or the dimensions it may depend on. Every output of
an impact depends on the mass, if only because a negative mass makes it NaN. A finer statement is
needed: "the restitution is NaN where the mass is invalid, and does not depend on it elsewhere". The
program itself proves it. Assume that a flag of the program is false. If an output is then the same
known number for all inputs, it is computed as if the flag were true. Afterwards that number is
filled in where the flag is false.
"""

from __future__ import annotations

import functools
import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from .program import Constant, Place, Program, Step

Dims = frozenset[int]


@dataclass(frozen=True, eq=False)
class Known:
    """A number, or a non-empty array of copies of this number."""

    value: Any

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is the same number: NaN equals NaN, zeros of different sign
        differ.
        """
        return isinstance(other, Known) and bool(_same(self.value, other.value))

    __hash__ = None  # pyright: ignore[reportAssignmentType]


Fact = Known | Dims
"""Fact about a slot: its value, or else the dimensions it may depend on."""


def dims_of(*facts: Fact) -> Dims:
    """Return the dimensions that one or several facts together may depend on."""
    return frozenset(d for fact in facts if not isinstance(fact, Known) for d in fact)


def _same(first: Any, second: Any) -> Any:
    signs = first.dtype.kind != "f" or second.dtype.kind != "f"
    same = signs or np.signbit(first) == np.signbit(second)
    return ((first == second) & same) | ((first != first) & (second != second))


_RESHAPES = {"reshape", "squeeze", "broadcast_in_dim", "transpose", "copy", "slice", "rev"}
_FOLDED: dict[str, Callable[..., Any]] = {
    **{"and": np.bitwise_and, "or": np.bitwise_or, "not": np.bitwise_not, "xor": np.bitwise_xor},
    **{"lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal},
    **{"eq": np.equal, "ne": np.not_equal, "is_finite": np.isfinite},
    **{"add": np.add, "sub": np.subtract, "mul": np.multiply, "neg": np.negative},
    **{"abs": np.abs, "max": np.maximum, "min": np.minimum},
}
# Primitives whose result is NaN if one operand is NaN. pow is excluded: 1 to any power is 1.
_PASS_NAN = {
    *("add", "sub", "mul", "div", "rem", "neg", "abs", "max", "min", "add_any", "square", "sign"),
    *("exp", "exp2", "expm1", "log", "log1p", "sqrt", "rsqrt", "cbrt", "logistic", "atan2"),
    *("sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "floor", "ceil"),
    *("round", "reduce_sum", "reduce_max", "reduce_min", "cumsum"),
}


def of_constant(value: Any) -> Fact:
    # A key of random numbers, for example, is not a number, so it has no known value.
    if not isinstance(jnp.result_type(value), np.dtype):
        return frozenset()
    plain = np.asarray(value)
    if plain.dtype.kind not in "biuf" or plain.size == 0:
        return frozenset()
    first = plain.reshape(-1)[0]
    return Known(first) if bool(np.all(_same(plain, first))) else frozenset()


def after(step: Step, reads: list[Fact]) -> list[Fact]:
    name = step.primitive.name
    if name == "optimization_barrier":
        return reads
    if name == "select_n" and (chosen := _chosen(*reads)) is not None:
        return [chosen]
    constants = [fact for fact in reads if isinstance(fact, Known)]
    if name in ("and", "or"):
        decisive = np.bool_(name == "or")
        if any(fact.value.dtype == bool and fact.value == decisive for fact in constants):
            return [Known(decisive)]
    if name in _PASS_NAN and any(fact.value != fact.value for fact in constants):
        return [Known(constants[0].value.dtype.type("nan"))]
    if constants and name in _RESHAPES:
        return reads
    if constants and name == "convert_element_type":
        value, dtype = constants[0].value, np.dtype(step.params["new_dtype"])
        # A fraction or a NaN converted to a whole number depends on the machine.
        if dtype.kind == "f" or (dtype.kind in "biu" and value.dtype.kind in "biu"):
            with np.errstate(over="ignore"):
                return [Known(value.astype(dtype))]
    if len(constants) == len(reads) and name in _FOLDED:
        operands = [fact.value for fact in constants]
        with np.errstate(all="ignore"):
            value = _FOLDED[name](*operands)
        if _machines_agree(name, [*operands, value]):
            return [Known(value)]
    return [dims_of(*reads)] * len(step.writes)


def _machines_agree(name: str, numbers: list[Any]) -> bool:
    """Return whether all machines agree; some flush subnormal numbers to zero."""
    floats = [x for x in numbers if x.dtype.kind == "f"]
    if any(x != 0 and abs(x) < np.finfo(x.dtype).tiny for x in floats):
        return False
    if any(x == 0 for x in floats[-1:]) and name in ("mul", "max", "min"):
        # A product may have underflowed; which of two zeros is larger is undefined.
        return all(x == floats[0] == 0 and np.signbit(x) == np.signbit(floats[0]) for x in floats)
    return True


def _chosen(which: Fact, *cases: Fact) -> Fact | None:
    """Return the selected case, if it is known or makes no difference."""
    if isinstance(which, Known):
        return cases[int(which.value)]
    alike = isinstance(cases[0], Known) and all(cases[0] == case for case in cases)
    return cases[0] if alike else None


_COMPARISONS = {"gt", "ge", "lt", "le", "is_finite"}
_SAME_NUMBER = {"abs", "convert_element_type", "reshape", "squeeze", "broadcast_in_dim", "copy"}


@dataclass(frozen=True)
class Dependence:
    """An output: the program with all `conditions` true where they hold, else `otherwise`."""

    dims: Dims
    conditions: tuple[int, ...] = ()
    otherwise: Any = None


class ProgramFacts:
    """The facts of a program; an assumption is propagated through the steps that it changes."""

    def __init__(self, program: Program, inputs: Sequence[Dims]):
        self.program = program
        self._constants: dict[Constant, Fact] = {}
        self._made: dict[Any, Constant] = {}
        self._users: dict[int, list[int]] = {}
        for number, step in enumerate(program.steps):
            for where in step.reads:
                if isinstance(where, int):
                    self._users.setdefault(where, []).append(number)
        self.facts: dict[int, Fact] = dict(enumerate(inputs))
        for step in program.steps:
            self.facts.update(self._after(step, {}))

    def dims(self, slot: int) -> Dims:
        """Return the dimensions that a slot may depend on."""
        return dims_of(self.facts[slot])

    def _after(self, step: Step, changed: Mapping[int, Fact]) -> dict[int, Fact]:
        """Return the facts about the values written by a step; an array without elements has no
        value.
        """
        reads = [self._fact(where, changed) for where in step.reads]
        return {
            slot: dims_of(*reads) if 0 in self.program.shapes[slot].shape else fact
            for slot, fact in zip(step.writes, after(step, reads), strict=True)
        }

    def _fact(self, where: Place, changed: Mapping[int, Fact]) -> Fact:
        if isinstance(where, Constant):
            if where not in self._constants:
                self._constants[where] = of_constant(where.value)
            return self._constants[where]
        return changed[where] if where in changed else self.facts[where]

    def assume(self, slots: Iterable[int], value: bool = True) -> dict[int, Fact]:
        """Return the facts that change if the flags `slots` have the given value."""
        changed: dict[int, Fact] = dict.fromkeys(slots, Known(np.bool_(value)))
        assumed = set(changed)
        waiting = [number for slot in assumed for number in self._users.get(slot, ())]
        heapq.heapify(waiting)
        last = -1
        while waiting:
            number = heapq.heappop(waiting)
            if number == last:
                continue
            last, step = number, self.program.steps[number]
            for slot, fact in self._after(step, changed).items():
                if slot not in assumed and fact != self.facts[slot]:
                    changed[slot] = fact
                    for user in self._users.get(slot, ()):
                        heapq.heappush(waiting, user)
        return changed

    def outputs(self, slots: Iterable[int] = (), value: bool = True) -> list[Fact]:
        """Return the facts about the outputs if the flags `slots` have the given value."""
        changed = self.assume(slots, value)
        return [self._fact(where, changed) for where in self.program.outputs]

    def _constant(self, slot: int, fact: Known) -> Constant:
        kind = self.program.shapes[slot]
        value = np.full(kind.shape, fact.value, kind.dtype)
        # The same object for the same constant, so that equal steps compare equal.
        return self._made.setdefault((kind.shape, kind.dtype, value.tobytes()), Constant(value))

    def specialise(self, conditions: Iterable[int], output: Place) -> tuple[list[Step], Place]:
        """Return the steps and the `output` of the program with all `conditions` true.

        A selection that the conditions decide is replaced by the chosen case, so that the other
        case is not computed.
        """
        changed = self.assume(conditions)
        instead: dict[int, Place] = {}
        steps = []

        def resolve(where: Place) -> Place:
            if isinstance(where, Constant):
                return where
            fact = self._fact(where, changed)
            if isinstance(fact, Known):
                return self._constant(where, fact)
            return instead.get(where, where)

        for step in self.program.steps:
            reads = tuple(resolve(where) for where in step.reads)
            if step.primitive.name == "select_n":
                which = self._fact(step.reads[0], changed)
                if isinstance(which, Known):
                    instead[step.writes[0]] = reads[1 + int(which.value)]
                    continue
            if step.primitive.name == "optimization_barrier":
                # Its operands are independent: one may be needed without the others.
                steps += [
                    Step(step.primitive, step.params, (read,), (write,))
                    for read, write in zip(reads, step.writes, strict=True)
                ]
                continue
            steps.append(Step(step.primitive, step.params, reads, step.writes))
        return steps, resolve(output)


def dependences(reading: ProgramFacts) -> list[Dependence]:
    """Return the fewest proven dimensions of every output, and their conditions."""

    @functools.cache
    def dims_left(conditions: frozenset[int]) -> list[Dims]:
        return list(map(dims_of, reading.outputs(conditions)))

    everything = dims_left(frozenset())
    flags = {slot: dims for slot in _flags(reading.program) if (dims := reading.dims(slot))}
    # The best case has all flags true. Only flags that lead to it are analysed.
    best = dims_left(frozenset(flags))
    better = [i for i, dims in enumerate(best) if dims < everything[i]]
    worth = [slot for slot in flags if any(not flags[slot] <= best[i] for i in better)]
    refuted = {slot: reading.outputs([slot], False) for slot in worth}
    results = [Dependence(dims) for dims in everything]
    for i in better:
        conditions, otherwise = _common({slot: ends[i] for slot, ends in refuted.items()})
        dims = dims_left(frozenset(conditions))[i]
        # Prefer few and cheap conditions: remove those without effect, the widest first.
        for slot in sorted(conditions, key=lambda slot: -len(flags[slot])):
            fewer = [other for other in conditions if other != slot]
            if dims_left(frozenset(fewer))[i] == dims:
                conditions = fewer
        if dims < everything[i]:
            results[i] = Dependence(dims, tuple(conditions), otherwise)
    return results


def range_checks(reading: ProgramFacts) -> list[int]:
    """Return flags that compare an input with a number, and without which every output is NaN."""
    program = reading.program
    bare = set(range(program.inputs))
    checks = []
    for step in program.steps:
        numbers = [where for where in step.reads if isinstance(where, int)]
        if not numbers or not bare.issuperset(numbers):
            continue
        if step.primitive.name in _SAME_NUMBER:
            bare.update(step.writes)
        elif step.primitive.name in _COMPARISONS:
            checks += step.writes
    floats = [
        i
        for i, where in enumerate(program.outputs)
        if isinstance(where, int) and jnp.issubdtype(program.shapes[where].dtype, jnp.inexact)
    ]
    nan = Known(np.float64("nan"))

    def decides(slot: int) -> bool:
        outputs = reading.outputs([slot], False)
        return bool(floats) and all(nan == outputs[i] for i in floats)

    return [slot for slot in checks if program.shapes[slot].shape == () and decides(slot)]


def _flags(program: Program) -> list[int]:
    # Conjunctions are excluded: their parts serve as well, and each has fewer dimensions.
    return [
        slot
        for step in program.steps
        if step.primitive.name != "and"
        for slot in step.writes
        if program.shapes[slot].shape == () and program.shapes[slot].dtype == bool
    ]


def _common(ends: Mapping[int, Fact]) -> tuple[list[int], Any]:
    """Return the flags that lead to the most common known number, and that number."""
    constants = {slot: fact for slot, fact in ends.items() if isinstance(fact, Known)}
    if not constants:
        return [], None
    counts = Counter(str(fact.value) for fact in constants.values())
    commonest = counts.most_common(1)[0][0]
    slots = [slot for slot, fact in constants.items() if str(fact.value) == commonest]
    return slots, constants[slots[0]].value
