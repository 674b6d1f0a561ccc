"""Facts about each number of a program: its value, or the dimensions it may depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from .program import Step

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
