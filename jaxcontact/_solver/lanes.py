"""One computation in two forms: for a few lanes and for many."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
from jax.custom_derivatives import SymbolicZero

Out = TypeVar("Out")

# From this number of lanes on, faster execution outweighs the longer compilation.
MANY = 1000


class ByLanes(eqx.Module, Generic[Out]):
    """The same function in two forms: `few`, which compiles quickly, or `many`, for large batches.
    `vmap` alone does not give a function the number of lanes. Differentiable in forward mode to any
    order, like both forms.
    """

    few: Callable[..., Out]
    many: Callable[..., Out]

    def __call__(self, *arguments: Any) -> Out:
        numbers, rest = eqx.partition(arguments, eqx.is_inexact_array)
        rest, fixed = eqx.partition(rest, eqx.is_array)

        def of(function: Callable[..., Out]) -> Callable[..., Out]:
            return lambda numbers, rest: function(*eqx.combine(numbers, rest, fixed))

        return _Choice(of(self.few), of(self.many), lanes=1, vary=_any)(numbers, rest)


@dataclasses.dataclass(frozen=True)
class _Choice:
    """The choice of `few(numbers, rest)` or `many`, within `lanes` so far. `vary` maps flags of the
    arguments that differ along an axis to those of the outcomes. A derivative is taken of both
    functions, not of their batched forms.
    """

    few: Callable[..., Any]
    many: Callable[..., Any]
    lanes: int
    vary: Callable[[Any, Any], Any]

    def __call__(self, numbers: Any, rest: Any) -> Any:
        batched = jax.custom_batching.custom_vmap(self.few)
        batched.def_vmap(self._in_a_batch)
        leaves, structure = jax.tree.flatten(numbers)

        @jax.custom_jvp
        def call(leaves: Any, rest: Any) -> Any:
            return batched(jax.tree.unflatten(structure, leaves), rest)

        call.defjvp(functools.partial(self._with_slopes, structure), symbolic_zeros=True)
        return call(leaves, rest)

    def _in_a_batch(self, size: int, along: Any, *given: Any) -> Any:
        vary = self.vary(*along)
        axes, out_axes = (
            jax.tree.map(lambda flag: 0 if flag else None, flags) for flags in (tuple(along), vary)
        )
        few, many = (
            jax.vmap(form, in_axes=axes, out_axes=out_axes, axis_size=size)
            for form in (self.few, self.many)
        )
        lanes = self.lanes * size if any(jax.tree.leaves(along)) else self.lanes
        if lanes < MANY:
            many = _Choice(few, many, lanes, self.vary)
        out = many(*given)
        return out, jax.tree.broadcast(vary, out)

    def _with_slopes(self, structure: Any, given: Any, tangents: Any) -> Any:
        (leaves, rest), (changes, _) = given, tangents
        moves = [not isinstance(change, SymbolicZero) for change in changes]

        def split(leaves: list) -> tuple[list, list]:
            pairs = list(zip(leaves, moves, strict=True))
            return [x for x, moved in pairs if moved], [x for x, moved in pairs if not moved]

        def whole(moving: list, still: list) -> Any:
            parts = iter(still), iter(moving)
            return jax.tree.unflatten(structure, [next(parts[moved]) for moved in moves])

        def pushed(form: Callable[..., Any]) -> Callable[..., Any]:
            def along(numbers: Any, rest: Any) -> Any:
                still, rest = rest
                return jax.jvp(lambda *moving: form(whole(list(moving), still), rest), *numbers)

            return along

        def vary(numbers: Any, rest: Any) -> Any:
            # A value does not vary if only its tangents do.
            (values, changes), (still, rest) = numbers, rest
            either = list(map(operator.or_, values, changes))
            return tuple(self.vary(whole(list(moving), still), rest) for moving in (values, either))

        moving, still = split(leaves)
        slopes = _Choice(pushed(self.few), pushed(self.many), self.lanes, vary)
        return slopes((tuple(moving), tuple(split(list(changes))[0])), (still, rest))


def _any(numbers: Any, rest: Any) -> bool:
    return any(jax.tree.leaves((numbers, rest)))
