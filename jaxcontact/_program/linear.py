"""Linear maps with data as one JAX primitive, applied by quickly compiled programs. A derivative
outside of any trace applies its map only a few times, so that compilation is its main cost. Of a
transposed map only the requested part is compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

from .compiled import quick

Apply = Callable[[list[Array], list[Array]], list[Array]]
"""A function of data and tangents, linear in the tangents; equal ones share their programs."""


class Map(NamedTuple):
    """A linear map `function(static, known, along)` of tangents. `known` is a tree of data, and
    `along` one of tangents, with None for zeros. It returns the tangents of floats.
    """

    function: Callable[[Any, Any, Any], Any]
    static: Any

    def __call__(self, known: Any, along: Any, like: Any) -> Any:
        """Apply the map to tangents, so that it transposes; `like` has its output's structure."""
        data, structure = jax.tree.flatten(known)
        tangents, shape = jax.tree.flatten(along)
        floats, out = jax.tree.flatten(like)
        apply = _OfTrees(self, structure, shape)
        if not tangents:
            return jax.tree.map(lambda _: None, like)
        found = _bound(apply, data, tangents, _kinds(floats))
        return jax.tree.unflatten(out, found)


class _OfTrees(NamedTuple):
    map: Map
    known: Any
    along: Any

    def __call__(self, known: list[Array], along: list[Array]) -> list[Array]:
        given = jax.tree.unflatten(self.known, known), jax.tree.unflatten(self.along, along)
        return jax.tree.leaves(self.map.function(self.map.static, *given))


class _Transposed(NamedTuple):
    """The map from cotangents of the outcomes `asked` to those of the `inputs`."""

    apply: Apply
    inputs: tuple[jax.core.ShapedArray, ...]
    asked: tuple[bool, ...]

    def __call__(self, known: list[Array], along: list[Array]) -> list[Array]:
        def some(*inputs: Array) -> list[Array]:
            found = self.apply(known, list(inputs))
            return [x for x, asked in zip(found, self.asked, strict=True) if asked]

        kinds = [jax.ShapeDtypeStruct(kind.shape, kind.dtype) for kind in self.inputs]
        return list(jax.linear_transpose(some, *kinds)(along))


class _Batched(NamedTuple):
    apply: Apply
    axes: tuple[tuple[int | None, ...], tuple[int | None, ...]]

    def __call__(self, known: list[Array], along: list[Array]) -> list[Array]:
        in_axes = tuple(list(axes) for axes in self.axes)
        return jax.vmap(self.apply, in_axes=in_axes)(known, along)


class _Varied(NamedTuple):
    """The derivative of a map with respect to some of its data, with fixed tangents. Both the data
    and the tangents of the map are data to it.
    """

    apply: Apply
    moves: tuple[bool, ...]

    def __call__(self, known: list[Array], along: list[Array]) -> list[Array]:
        count = len(self.moves)
        places = [k for k, moves in enumerate(self.moves) if moves]

        def of(*moving: Array) -> list[Array]:
            data = list(known[:count])
            for k, value in zip(places, moving, strict=True):
                data[k] = value
            return self.apply(data, known[count:])

        return jax.jvp(of, tuple(known[k] for k in places), tuple(along))[1]


def _kinds(arrays: list[Any]) -> tuple[jax.core.ShapedArray, ...]:
    return tuple(jax.core.ShapedArray(x.shape, x.dtype) for x in arrays)


@quick
def _applied(apply: Apply, known: list[Array], along: list[Array]) -> list[Array]:
    return apply(known, along)


def _run(*args: Array, apply: Apply, count: int, outcomes: Any) -> list[Array]:
    return apply(list(args[:count]), list(args[count:]))


def _at_once(*args: Array, apply: Apply, count: int, outcomes: Any) -> list[Array]:
    with jax.core.eval_context():
        return _applied(apply, list(args[:count]), list(args[count:]))


def _transpose(cotangents: list, *args: Any, apply: Apply, count: int, outcomes: Any) -> list:
    asked = tuple(not isinstance(x, ad.Zero) for x in cotangents)
    nothing: list[Any] = [None] * len(args)
    if not any(asked):
        return nothing
    along = args[count:]
    linear = [ad.is_undefined_primal(x) for x in along]
    inputs = _kinds([x.aval if yes else x for x, yes in zip(along, linear, strict=True)])
    given = [x for x, yes in zip(cotangents, asked, strict=True) if yes]
    found = _bound(_Transposed(apply, inputs, asked), list(args[:count]), given, inputs)
    kept = [x if yes else None for x, yes in zip(found, linear, strict=True)]
    return [*nothing[:count], *kept]


def _batch(args: Any, dims: Any, *, apply: Apply, count: int, outcomes: Any) -> tuple:
    moved = [
        x if dim is None else jnp.moveaxis(x, dim, 0) for x, dim in zip(args, dims, strict=True)
    ]
    axes = tuple(None if dim is None else 0 for dim in dims)
    size = next(x.shape[0] for x, axis in zip(moved, axes, strict=True) if axis == 0)
    kinds = tuple(jax.core.ShapedArray((size, *x.shape), x.dtype) for x in outcomes)
    found = _bound(
        _Batched(apply, (axes[:count], axes[count:])), moved[:count], moved[count:], kinds
    )
    return found, [0] * len(found)


def _derived(primals: Any, tangents: Any, *, apply: Apply, count: int, outcomes: Any) -> tuple:
    known, along = list(primals[:count]), list(primals[count:])
    found = _bound(apply, known, along, outcomes)
    moves = tuple(_moves(t) for t in tangents)
    parts = []
    if any(moves[:count]):
        varied = [t for t, yes in zip(tangents[:count], moves, strict=False) if yes]
        parts.append(_bound(_Varied(apply, moves[:count]), [*known, *along], varied, outcomes))
    if any(moves[count:]):
        whole = [ad.instantiate_zeros(t) for t in tangents[count:]]
        parts.append(_bound(apply, known, whole, outcomes))
    if not parts:
        return found, [ad.Zero(kind) for kind in outcomes]
    return found, parts[0] if len(parts) == 1 else list(map(ad.add_jaxvals, *parts))


def _moves(tangent: Any) -> bool:
    return not isinstance(tangent, ad.Zero) and tangent.dtype != jax.dtypes.float0


def _bound(apply: Apply, known: list, along: list, outcomes: tuple) -> list[Array]:
    return _linear_p.bind(*known, *along, apply=apply, count=len(known), outcomes=outcomes)


_linear_p = Primitive("linear_with_data")
_linear_p.multiple_results = True
_linear_p.def_impl(_at_once)
_linear_p.def_abstract_eval(lambda *args, apply, count, outcomes: list(outcomes))
ad.primitive_transposes[_linear_p] = _transpose
ad.primitive_jvps[_linear_p] = _derived
batching.primitive_batchers[_linear_p] = _batch
mlir.register_lowering(_linear_p, mlir.lower_fun(_run, multiple_results=True))
