"""Batched solves of single-lane functions, with derivatives for both modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._forms import slopes_along
from .._functions import contraction, nonzero
from .._solver.chunks import CHUNK, in_chunks

In = TypeVar("In")
Out = TypeVar("Out")

# Up to this count of varying numbers, a second derivative has slopes along all pairs of them. That
# is wasteful for the clusters of a scene, which have hundreds.
_FEW = 16


def common_shape(tree: Any) -> tuple[int, ...]:
    """Return the broadcast shape of all numbers in `tree`."""
    return np.broadcast_shapes(*map(np.shape, jax.tree.leaves(tree)))


def over_lanes(solve: Callable[[In], Out], problem: In) -> Out:
    """Apply `solve` to every lane of `problem`, whose leaves broadcast against each other. The
    outcome has the broadcast shape. Callers leave leaves that are equal in all lanes unbroadcast,
    so that a batch costs only its distinct problems.
    """
    leaves, structure = jax.tree.flatten(problem)
    shape = common_shape(leaves)
    if shape == ():
        return solve(problem)
    flat = [jnp.broadcast_to(leaf, shape).reshape(-1) for leaf in leaves]
    outcome = jax.vmap(solve)(jax.tree.unflatten(structure, flat))
    return jax.tree.map(lambda out: out.reshape(shape + out.shape[1:]), outcome)


@eqx.filter_jit
def _traced_once(solve: Callable[[In], Out], problem: In) -> Out:
    """Return `solve(problem)`; JAX traces equal solves once for all batches and derivatives."""
    return solve(problem)


def with_sensitivity(solve: Callable[[In], Out], chunk: int = CHUNK) -> Callable[[In], Out]:
    """Return `solve` with a derivative rule that is linear in the tangents, so that it transposes.

    `solve` must be differentiable in forward mode. The slopes with respect to all varying numbers
    are carried along in one solve. They multiply the tangents in forward mode and the cotangents in
    reverse mode. A while loop alone supports only forward mode. A scaled impact has one to four
    numbers; a leaf may also be an array. `chunk`: how many lanes a CPU solves at once.
    """

    def differentiable(problem: In) -> Out:
        leaves, structure = jax.tree.flatten(problem)
        place = next(k for k, leaf in enumerate(leaves) if eqx.is_inexact_array(leaf))
        kinds: list[Any] = []

        # A derivative rule cannot return integers, so flags and counts are returned as numbers.
        def as_numbers(*leaves: jax.Array) -> Out:
            outcome = _traced_once(solve, jax.tree.unflatten(structure, leaves))
            # The types are kept here, because another trace of the solve would take seconds.
            kinds[:] = [jax.tree.map(jnp.result_type, outcome)]
            return jax.tree.map(lambda out: out.astype(leaves[place].dtype), outcome)

        outcome = _transposable(as_numbers, place, chunk)(*leaves)
        return jax.tree.map(lambda out, kind: out.astype(kind), outcome, kinds[0])

    return differentiable


def _transposable(solve: Callable[..., Any], place: int, chunk: int) -> Callable[..., Any]:
    """Return `solve` with a rule. Its slopes by few numbers have one, too, to any order."""

    # Every output formally depends on the input: a rule with partly constant outcomes fails under
    # jit of vmap (jax 0.10.2).
    def plain(*leaves: jax.Array) -> Any:
        either = jnp.isnan(leaves[place].reshape(-1)[0])
        return jax.tree.map(lambda out: jnp.where(either, out, out), solve(*leaves))

    solved = jax.custom_jvp(in_chunks(plain, chunk))

    def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Any, Any]:
        varying = [i for i, t in enumerate(tangents) if nonzero(t)]
        along = jnp.concatenate([tangents[i].reshape(-1) for i in varying])

        def carried(*primals: jax.Array) -> tuple[Any, Any]:
            shapes = [primals[i].shape for i in varying]
            cuts = np.cumsum(list(map(math.prod, shapes)))

            def pushed(direction: jax.Array) -> tuple[jax.Array, ...]:
                parts = zip(jnp.split(direction, cuts[:-1]), shapes, strict=True)
                return tuple(part.reshape(shape) for part, shape in parts)

            return slopes_along(plain, primals, varying, along.size, pushed)

        few = along.size <= _FEW
        outcome, slopes = (_transposable(carried, place, chunk) if few else carried)(*primals)
        return outcome, jax.tree.map(lambda s: contraction(along, s), slopes)

    solved.defjvp(rule, symbolic_zeros=True)
    return solved
