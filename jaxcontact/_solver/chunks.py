"""A function of one lane, of which a CPU computes a large batch in chunks of lanes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.core
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun, new_jaxpr_eqn
from jax.interpreters import batching, mlir, partial_eval

from .._entry import traced

Out = TypeVar("Out")

CHUNK = 64
"""Lanes that a CPU solves together. More do not fit its caches, and wait for the slowest one."""
_LEAST = 4
"""The number of chunks from which on they pay, the last of which may be nearly empty."""

_in_chunks = Primitive("in_chunks")
_in_chunks.multiple_results = True
# `jax.custom_batching.custom_vmap` would compute outcomes that nobody needs.


def in_chunks(
    function: Callable[..., Out], chunk: int = CHUNK, lanes: int = 1
) -> Callable[..., Out]:
    """Return a function of arrays, which is a batch of `lanes` already. On a CPU a large batch is a
    loop over `chunk` lanes at a time; XLA runs two such loops side by side on one core, too. A
    chunk of one lane keeps its branches, which are both computed in a batch, and pays for any
    number of lanes. Derivatives are left to the caller's rules.
    """
    if jax.default_backend() != "cpu":
        return function

    def call(*arrays: jax.Array) -> Out:
        jaxpr, shapes = jax.make_jaxpr(function, return_shape=True)(*arrays)
        if traced(jaxpr.consts):
            return function(*arrays)
        outcome = _in_chunks.bind(*arrays, traced=jaxpr, chunk=chunk, lanes=lanes)
        return jax.tree.unflatten(jax.tree.structure(shapes), outcome)

    return call


def _inline(*arrays: jax.Array, traced: ClosedJaxpr, chunk: int, lanes: int) -> list[jax.Array]:
    return jaxpr_as_fun(traced)(*arrays)


def _batched(
    arrays: Sequence[jax.Array], axes: Sequence[int | None], **given: Any
) -> tuple[list[jax.Array], list[int]]:
    one, lanes = jaxpr_as_fun(given["traced"]), given["lanes"]
    moves = [axis is not None for axis in axes]
    arrays = [x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arrays, axes, strict=True)]
    size = next(itertools.compress(arrays, moves)).shape[0]
    chunk = max(1, given["chunk"] // lanes)
    several = jax.vmap(one, in_axes=[0 if moved else None for moved in moves])
    if chunk > 1 and size < _LEAST * chunk:
        outcome = in_chunks(several, given["chunk"], lanes * size)(*arrays)
        return outcome, [0] * len(outcome)

    def cut(array: jax.Array) -> jax.Array:
        padding = ((0, -size % chunk),) + ((0, 0),) * (array.ndim - 1)
        return jnp.pad(array, padding, mode="edge").reshape(-1, chunk, *array.shape[1:])

    def of_chunk(moving: list[jax.Array]) -> list[jax.Array]:
        now, function = iter(moving), several if chunk > 1 else one
        whole = (next(now) if moved else x for x, moved in zip(arrays, moves, strict=True))
        return function(*whole)

    moving = list(itertools.compress(arrays, moves))
    if chunk == 1:
        outcome = jax.lax.map(of_chunk, moving)
    else:
        outcome = jax.lax.map(of_chunk, list(map(cut, moving)))
        outcome = [out.reshape(-1, *out.shape[2:])[:size] for out in outcome]
    return outcome, [0] * len(outcome)


def _of_needed(needed: Sequence[bool], equation: Any) -> tuple[list[bool], Any]:
    """Return which inputs are needed for the needed outcomes, and the equation of both."""
    traced = equation.params["traced"]
    if not any(needed):
        return [False] * len(equation.invars), None
    lean, used = partial_eval.dce_jaxpr(traced.jaxpr, list(needed))
    params = equation.params | {"traced": ClosedJaxpr(lean, traced.consts)}
    given = list(itertools.compress(equation.invars, used))
    outcome = list(itertools.compress(equation.outvars, needed))
    about = equation.effects, equation.source_info, equation.ctx
    return used, new_jaxpr_eqn(given, outcome, _in_chunks, params, *about)


_in_chunks.def_impl(jax.jit(_inline, static_argnames=("traced", "chunk", "lanes")))
_in_chunks.def_abstract_eval(lambda *_, traced, **__: traced.out_avals)
mlir.register_lowering(_in_chunks, mlir.lower_fun(_inline, multiple_results=True))
batching.primitive_batchers[_in_chunks] = _batched
partial_eval.dce_rules[_in_chunks] = _of_needed
