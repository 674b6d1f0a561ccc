"""A function of one lane, of which a CPU computes a large batch in chunks of lanes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun, new_jaxpr_eqn
from jax.interpreters import batching, mlir, partial_eval

Out = TypeVar("Out")

_CHUNK = 64
"""Lanes that a CPU solves together. More do not fit its caches, and wait for the slowest one."""
_LEAST = 4 * _CHUNK
"""The size of a batch from which on chunks pay, the last of which may be nearly empty."""

_in_chunks = Primitive("in_chunks")
_in_chunks.multiple_results = True
# `jax.custom_batching.custom_vmap` would compute outcomes that nobody needs.


def in_chunks(function: Callable[..., Out], lanes: int = 1) -> Callable[..., Out]:
    """Return a function of arrays, which is a batch of `lanes` already. Its loops stay loops over
    one chunk after another; XLA runs two of them side by side on one core, too. Derivatives are
    left to the caller's rules.
    """
    if jax.default_backend() != "cpu":
        return function

    def call(*arrays: jax.Array) -> Out:
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arrays)
        if any(isinstance(x, jax.core.Tracer) for x in traced.consts):
            return function(*arrays)
        outcome = _in_chunks.bind(*arrays, traced=traced, lanes=lanes)
        return jax.tree.unflatten(jax.tree.structure(shapes), outcome)

    return call


def _inline(*arrays: jax.Array, traced: ClosedJaxpr, lanes: int) -> list[jax.Array]:
    return jaxpr_as_fun(traced)(*arrays)


def _batched(
    arrays: Sequence[jax.Array], axes: Sequence[int | None], *, traced: ClosedJaxpr, lanes: int
) -> tuple[list[jax.Array], list[int]]:
    moves = [axis is not None for axis in axes]
    arrays = [x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arrays, axes, strict=True)]
    size = next(x.shape[0] for x in itertools.compress(arrays, moves))
    batch = jax.vmap(jaxpr_as_fun(traced), in_axes=[0 if moved else None for moved in moves])
    if lanes * size < _LEAST:
        outcome = in_chunks(batch, lanes * size)(*arrays)
        return outcome, [0] * len(outcome)
    chunk = max(1, _CHUNK // lanes)

    def cut(array: jax.Array) -> jax.Array:
        padding = ((0, -size % chunk),) + ((0, 0),) * (array.ndim - 1)
        return jnp.pad(array, padding, mode="edge").reshape(-1, chunk, *array.shape[1:])

    def of_chunk(moving: list[jax.Array]) -> list[jax.Array]:
        now = iter(moving)
        return batch(*(next(now) if moved else x for x, moved in zip(arrays, moves, strict=True)))

    outcome = jax.lax.map(of_chunk, [cut(x) for x in itertools.compress(arrays, moves)])
    outcome = [out.reshape(-1, *out.shape[2:])[:size] for out in outcome]
    return outcome, [0] * len(outcome)


def _of_needed(needed: Sequence[bool], equation: Any) -> tuple[list[bool], Any]:
    """Return which inputs are needed for the needed outcomes, and the equation of both."""
    traced, lanes = equation.params["traced"], equation.params["lanes"]
    if not any(needed):
        return [False] * len(equation.invars), None
    lean, used = partial_eval.dce_jaxpr(traced.jaxpr, list(needed))
    params = {"traced": ClosedJaxpr(lean, traced.consts), "lanes": lanes}
    given = list(itertools.compress(equation.invars, used))
    outcome = list(itertools.compress(equation.outvars, needed))
    about = equation.effects, equation.source_info, equation.ctx
    return used, new_jaxpr_eqn(given, outcome, _in_chunks, params, *about)


_in_chunks.def_impl(jax.jit(_inline, static_argnames=("traced", "lanes")))
_in_chunks.def_abstract_eval(lambda *_, traced, lanes: traced.out_avals)
mlir.register_lowering(_in_chunks, mlir.lower_fun(_inline, multiple_results=True))
batching.primitive_batchers[_in_chunks] = _batched
partial_eval.dce_rules[_in_chunks] = _of_needed
