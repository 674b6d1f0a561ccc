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

from .program import Constant, Place, Program, Step, slots_in

Dims = frozenset[int]


@dataclass(eq=False, slots=True)
class SlotFact:
    """Fact about an array: the number that all of it is, or the dimensions it may depend on."""

    dims: Dims = frozenset()
    value: Any = None

    @property
    def known(self) -> bool:
        return self.value is not None

    def __eq__(self, other: Any) -> bool:
        """Return whether facts are the same: NaN equals NaN, zeros of different sign differ."""
        if self.known and other.known:
            return bool(_same(self.value, other.value))
        return self.known == other.known and self.dims == other.dims

    __hash__ = None  # pyright: ignore[reportAssignmentType]


def dims_of(*facts: SlotFact) -> Dims:
    """Return the dimensions that one or several facts together may depend on."""
    return frozenset().union(*(fact.dims for fact in facts))


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


def of_constant(value: Any) -> SlotFact:
    # A key of random numbers, for example, is not a number, so it has no known value.
    if not isinstance(jnp.result_type(value), np.dtype):
        return SlotFact()
    plain = np.asarray(value)
    if plain.dtype.kind not in "biuf" or plain.size == 0:
        return SlotFact()
    first = plain.reshape(-1)[0]
    return SlotFact(value=first) if bool(np.all(_same(plain, first))) else SlotFact()


def after(step: Step, reads: list[SlotFact]) -> list[SlotFact]:
    """Return the facts about what a step writes, by the first rule that applies."""
    rules = _RULES.get(step.primitive.name), _general
    found = (rule(step, reads) for rule in rules if rule is not None)
    facts = next((facts for facts in found if facts is not None), None)
    return [SlotFact(dims_of(*reads))] * len(step.writes) if facts is None else facts


def _general(step: Step, reads: list[SlotFact]) -> list[SlotFact] | None:
    name, constants = step.primitive.name, [fact.value for fact in reads if fact.known]
    if name in _PASS_NAN and any(map(np.isnan, constants)):
        return [SlotFact(value=constants[0].dtype.type("nan"))]
    if constants and name in _RESHAPES:
        return reads
    if len(constants) < len(reads) or name not in _FOLDED:
        return None
    with np.errstate(all="ignore"):
        value = _FOLDED[name](*constants)
    return [SlotFact(value=value)] if _machines_agree(name, [*constants, value]) else None


def _selected(step: Step, reads: list[SlotFact]) -> list[SlotFact] | None:
    """Return the selected case, if it is known or makes no difference."""
    which, *cases = reads
    if which.known:
        return [cases[int(which.value)]]
    alike = cases[0].known and all(cases[0] == case for case in cases)
    return cases[:1] if alike else None


def _decided(step: Step, reads: list[SlotFact]) -> list[SlotFact] | None:
    """Return the outcome of a conjunction or disjunction, if one operand decides it."""
    decisive = np.bool_(step.primitive.name == "or")
    flags = (fact.value for fact in reads if fact.known and fact.value.dtype == bool)
    return [SlotFact(value=decisive)] if any(flag == decisive for flag in flags) else None


def _converted(step: Step, reads: list[SlotFact]) -> list[SlotFact] | None:
    if not reads[0].known:
        return None
    value, dtype = reads[0].value, np.dtype(step.params["new_dtype"])
    # A fraction or a NaN converted to a whole number depends on the machine.
    if dtype.kind != "f" and not (dtype.kind in "biu" and value.dtype.kind in "biu"):
        return None
    with np.errstate(over="ignore"):
        return [SlotFact(value=value.astype(dtype))]


_RULES: dict[str, Callable[[Step, list[SlotFact]], list[SlotFact] | None]] = {
    "optimization_barrier": lambda step, reads: reads,
    "select_n": _selected,
    "and": _decided,
    "or": _decided,
    "convert_element_type": _converted,
}
"""The facts after a primitive; None where only the general rules say more."""


def _machines_agree(name: str, numbers: list[Any]) -> bool:
    """Return whether all machines agree; some flush subnormal numbers to zero."""
    floats = [x for x in numbers if x.dtype.kind == "f"]
    if any(0 < abs(x) < np.finfo(x.dtype).tiny for x in floats):
        return False
    if floats and floats[-1] == 0 and name in ("mul", "max", "min"):
        # A product may have underflowed; which of two zeros is larger is undefined.
        return all(x == floats[0] == 0 and np.signbit(x) == np.signbit(floats[0]) for x in floats)
    return True


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
        self._constants: dict[Constant, SlotFact] = {}
        self._made: dict[Any, Constant] = {}
        self._users: dict[int, list[int]] = {}
        for number, step in enumerate(program.steps):
            for slot in slots_in(step.reads):
                self._users.setdefault(slot, []).append(number)
        self.facts: dict[int, SlotFact] = dict(enumerate(map(SlotFact, inputs)))
        for step in program.steps:
            self.facts.update(self._after(step, {}))

    def dims(self, slot: int) -> Dims:
        """Return the dimensions that a slot may depend on."""
        return self.facts[slot].dims

    def _after(self, step: Step, changed: Mapping[int, SlotFact]) -> dict[int, SlotFact]:
        """Return the facts about the values written by a step; an array without elements has no
        value.
        """
        reads = [self._fact(where, changed) for where in step.reads]
        return {
            slot: SlotFact(dims_of(*reads)) if 0 in self.program.shapes[slot].shape else fact
            for slot, fact in zip(step.writes, after(step, reads), strict=True)
        }

    def _fact(self, where: Place, changed: Mapping[int, SlotFact]) -> SlotFact:
        if isinstance(where, Constant):
            if where not in self._constants:
                self._constants[where] = of_constant(where.value)
            return self._constants[where]
        return changed[where] if where in changed else self.facts[where]

    def assume(self, slots: Iterable[int], value: bool = True) -> dict[int, SlotFact]:
        """Return the facts that change if the flags `slots` have the given value."""
        changed: dict[int, SlotFact] = dict.fromkeys(slots, SlotFact(value=np.bool_(value)))
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

    def outputs(self, slots: Iterable[int] = (), value: bool = True) -> list[SlotFact]:
        """Return the facts about the outputs if the flags `slots` have the given value."""
        changed = self.assume(slots, value)
        return [self._fact(where, changed) for where in self.program.outputs]

    def _constant(self, slot: int, fact: SlotFact) -> Constant:
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
            if fact.known:
                return self._constant(where, fact)
            return instead.get(where, where)

        for step in self.program.steps:
            reads = tuple(resolve(where) for where in step.reads)
            if step.primitive.name == "select_n":
                which = self._fact(step.reads[0], changed)
                if which.known:
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
        return [fact.dims for fact in reading.outputs(conditions)]

    everything = dims_left(frozenset())
    flags = _flags(reading)
    # The best case has all flags true. Only flags that lead to it are analysed.
    best = dims_left(frozenset(flags))
    better = [i for i, dims in enumerate(best) if dims < everything[i]]
    worth = [slot for slot in flags if any(not flags[slot] <= best[i] for i in better)]
    refuted = {slot: reading.outputs([slot], False) for slot in worth}
    results = list(map(Dependence, everything))
    for i in better:
        conditions, otherwise = _common(i, refuted)
        # Prefer few and cheap conditions: remove those without effect, the widest first.
        widest = sorted(conditions, key=lambda slot: -len(flags[slot]))
        conditions = _fewest(i, conditions, widest, dims_left)
        dims = dims_left(frozenset(conditions))[i]
        if dims < everything[i]:
            results[i] = Dependence(dims, tuple(conditions), otherwise)
    return results


def _fewest(i: int, slots: list[int], order: list[int], dims_left: Callable) -> list[int]:
    """Return the slots without those that have no effect on the dimensions left of output i."""
    dims = dims_left(frozenset(slots))[i]
    for slot in order:
        fewer = [other for other in slots if other != slot]
        slots = fewer if dims_left(frozenset(fewer))[i] == dims else slots
    return slots


def range_checks(reading: ProgramFacts) -> list[int]:
    """Return flags that compare an input with a number, and without which every output is NaN."""
    program, nan = reading.program, SlotFact(value=np.float64("nan"))
    floats = [i for i, where in enumerate(program.outputs) if program.is_float(where)]

    def decides(slot: int) -> bool:
        outputs = reading.outputs([slot], False)
        return bool(floats) and all(nan == outputs[i] for i in floats)

    checks = _comparisons_in(program)
    return [slot for slot in checks if program.shapes[slot].shape == () and decides(slot)]


def _comparisons_in(program: Program) -> list[int]:
    """Return the flags that compare an input, unchanged but for its shape or type."""
    bare, checks = set(range(program.inputs)), []
    for step in program.steps:
        numbers = slots_in(step.reads)
        if numbers and bare.issuperset(numbers):
            if step.primitive.name in _SAME_NUMBER:
                bare.update(step.writes)
            elif step.primitive.name in _COMPARISONS:
                checks += step.writes
    return checks


def _flags(reading: ProgramFacts) -> dict[int, Dims]:
    """Return the flags that depend on a dimension, with their dimensions."""
    # Conjunctions are excluded: their parts serve as well, and each has fewer dimensions.
    shapes, steps = reading.program.shapes, reading.program.steps
    slots = [slot for step in steps if step.primitive.name != "and" for slot in step.writes]
    flags = (slot for slot in slots if shapes[slot].shape == () and shapes[slot].dtype == bool)
    return {slot: reading.dims(slot) for slot in flags if reading.dims(slot)}


def _common(i: int, ends: Mapping[int, list[SlotFact]]) -> tuple[list[int], Any]:
    """Return the flags that lead to the most common known number of output i, and that number."""
    constants = {slot: facts[i] for slot, facts in ends.items() if facts[i].known}
    if not constants:
        return [], None
    counts = Counter(str(fact.value) for fact in constants.values())
    commonest = counts.most_common(1)[0][0]
    slots = [slot for slot, fact in constants.items() if str(fact.value) == commonest]
    return slots, constants[slots[0]].value
