"""One computation in two forms: for a few lanes and for many."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from .._functions import nonzero

Out = TypeVar("Out")

# From this number of lanes on, faster execution outweighs the longer compilation.
MANY = 1000
# From this number of lanes on, a batch has a layout of its own (`ByLanes.batched`).
SEVERAL = 8


class ByLanes(eqx.Module, Generic[Out]):
    """The same function in two forms: `few`, which compiles quickly, or `many`, for large batches.
    `vmap` alone does not give a function the number of lanes. Differentiable in forward mode to any
    order, like both forms. `batched(lanes, along, *arguments)`: a better batch of `few` than that
    of `vmap`; `along` flags the arrays that differ along their first axis.
    """

    few: Callable[..., Out]
    many: Callable[..., Out]
    batched: Callable[..., Out] | None = None

    def __call__(self, *arguments: Any) -> Out:
        numbers, rest = eqx.partition(arguments, eqx.is_inexact_array)
        rest, fixed = eqx.partition(rest, eqx.is_array)

        def of(function: Callable[..., Out]) -> Callable[..., Out]:
            return lambda numbers, rest: function(*eqx.combine(numbers, rest, fixed))

        def batch(lanes: int, along: tuple, numbers: Any, rest: Any) -> Out:
            assert self.batched is not None
            return self.batched(lanes, eqx.combine(*along), *eqx.combine(numbers, rest, fixed))

        few, many = of(self.few), of(self.many)
        return _FewOrMany(few, many, 1, _any, batch if self.batched else None)(numbers, rest)


@dataclasses.dataclass(frozen=True)
class _FewOrMany:
    """The choice of `few(numbers, rest)` or `many`, within `lanes` so far. `vary` maps flags of the
    arguments that differ along an axis to those of the outcomes. A derivative is taken of both
    functions, not of their batched forms. `batch`: see `ByLanes.batched`. `slopes`: a derivative,
    which has `few` in any batch if that has a batch of its own.
    """

    few: Callable[..., Any]
    many: Callable[..., Any]
    lanes: int
    vary: Callable[[Any, Any], Any]
    batch: Callable[..., Any] | None = None
    slopes: bool = False

    def __call__(self, numbers: Any, rest: Any) -> Any:
        leaves, structure = jax.tree.flatten(numbers)
        others, shape = jax.tree.flatten(rest)

        # JAX differentiates this again only if no argument has an empty branch.
        @jax.custom_batching.custom_vmap
        def batched(leaves: list, others: list) -> Any:
            return self.few(structure.unflatten(leaves), shape.unflatten(others))

        @batched.def_vmap
        def in_a_batch(size: int, along: list, leaves: list, others: list) -> Any:
            trees = structure.unflatten, shape.unflatten
            flags, given = (
                tuple(tree(part) for tree, part in zip(trees, parts, strict=True))
                for parts in (along, (leaves, others))
            )
            return self._in_a_batch(size, flags, *given)

        @jax.custom_jvp
        def call(leaves: list, others: list) -> Any:
            return batched(leaves, others)

        @functools.partial(call.defjvp, symbolic_zeros=True)
        def with_slopes(given: Any, tangents: Any) -> Any:
            (leaves, others), (changes, _) = given, tangents
            return self._with_slopes(structure, leaves, shape.unflatten(others), changes)

        return call(leaves, others)

    def _in_a_batch(self, size: int, along: Any, *given: Any) -> Any:
        vary = self.vary(*along)
        axes, out_axes = (
            jax.tree.map(lambda flag: 0 if flag else None, flags) for flags in (along, vary)
        )
        few, many = (
            jax.vmap(form, in_axes=axes, out_axes=out_axes, axis_size=size)
            for form in (self.few, self.many)
        )
        batch, lanes = None, self.lanes * size if any(jax.tree.leaves(along)) else self.lanes
        # Where only directions of a derivative differ, lanes may still follow.
        if self.batch is not None:
            if size >= SEVERAL and all(jax.tree.leaves(vary)):
                few = functools.partial(self.batch, size, along)
            else:
                batch = functools.partial(self._lanes_around, size, along, out_axes)
        if lanes < MANY or self.slopes:
            many = _FewOrMany(few, many, lanes, self.vary, batch, self.slopes)
        out = many(*given)
        return out, jax.tree.broadcast(vary, out)

    def _lanes_around(
        self, size: int, inner: Any, out_axes: Any, lanes: int, along: tuple, *given: Any
    ) -> Any:
        """Return the batch over `lanes` of what is a batch of `size` already, by `inner` flags."""
        assert self.batch is not None

        def axis(within: bool, lane: bool) -> int | None:
            return (1 if lane else 0) if within else None

        axes = jax.tree.map(axis, inner, along)
        # Lanes come first in all outcomes.
        out_axes = jax.tree.map(lambda axis: axis + 1, out_axes)
        batch = functools.partial(self.batch, lanes, along)
        return jax.vmap(batch, in_axes=axes, out_axes=out_axes, axis_size=size)(*given)

    def _with_slopes(self, structure: Any, leaves: list, rest: Any, changes: list) -> Any:
        moves = [nonzero(change) for change in changes]

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

        def batch(lanes: int, along: tuple, numbers: Any, rest: Any) -> Any:
            # The lanes of a value and of its change are the same.
            assert self.batch is not None
            (values, changes), rest_flags = along
            either = tuple(map(operator.or_, values, changes))

            def spread(part: tuple, flags: tuple) -> tuple:
                return tuple(
                    jnp.broadcast_to(x, (lanes, *x.shape)) if wanted and not flag else x
                    for x, flag, wanted in zip(part, flags, either, strict=True)
                )

            still_flags, others = rest_flags
            flags = whole(list(either), still_flags), others
            form = functools.partial(self.batch, lanes, flags)
            return pushed(form)((spread(numbers[0], values), spread(numbers[1], changes)), rest)

        moving, still = split(leaves)
        # Written-out slopes of 1,000 lanes by e, K and n took a minute instead of 0.07 s.
        own = self.batch is not None
        few, many = pushed(self.few), pushed(self.many)
        slopes = _FewOrMany(few, many, self.lanes, vary, batch if own else None, own)
        return slopes((tuple(moving), tuple(split(list(changes))[0])), (still, rest))


def _any(numbers: Any, rest: Any) -> bool:
    return any(jax.tree.leaves((numbers, rest)))
