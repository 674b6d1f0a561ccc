"""Solving lane by lane what is written for one lane, with sensitivities for both modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._elementary import contraction
from .._forms import slopes_along

In = TypeVar("In")
Out = TypeVar("Out")


def over_lanes(solve: Callable[[In], Out], problem: In) -> Out:
    """`solve` for every lane of `problem`, whose leaves broadcast against each other.

    The outcome has the broadcast shape. Leaves that are the same in all lanes are not repeated by
    the caller, so that a batch costs as many solves as there are different problems.
    """
    leaves, structure = jax.tree.flatten(problem)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in leaves))
    if shape == ():
        return solve(problem)
    flat = [jnp.broadcast_to(leaf, shape).reshape(-1) for leaf in leaves]
    outcome = jax.vmap(solve)(jax.tree.unflatten(structure, flat))
    return jax.tree.map(lambda out: out.reshape(shape + out.shape[1:]), outcome)


@eqx.filter_jit
def _traced_once(solve: Callable[[In], Out], problem: In) -> Out:
    """`solve(problem)`, which JAX traces once for all batches and derivatives of equal solves."""
    return solve(problem)


def with_sensitivity(solve: Callable[[In], Out]) -> Callable[[In], Out]:
    """`solve` with a derivative rule that is linear in the tangents, so that it transposes.

    `solve` must be differentiable in forward mode and takes few scalars: a scaled impact has one to
    four. Their sensitivities are carried along the one solve, and multiply tangents going forward
    or cotangents going back. A while loop alone could do only one of the two.
    """

    def differentiable(problem: In) -> Out:
        leaves, structure = jax.tree.flatten(problem)
        kinds: list[Any] = []

        # Flags and counts are returned as numbers: a derivative rule cannot return integers. And
        # every output depends on the input, if only formally: a rule whose outcome is constant in
        # part fails under jit of vmap (jax 0.10.2).
        def on_leaves(*leaves: jax.Array) -> Out:
            outcome = _traced_once(solve, jax.tree.unflatten(structure, leaves))
            # Kept here, because another trace of the solve for its types would take seconds.
            kinds[:] = [jax.tree.map(jnp.result_type, outcome)]
            either = jnp.isnan(leaves[0])
            return jax.tree.map(
                lambda out: jnp.where(either, out, out).astype(leaves[0].dtype), outcome
            )

        solved = jax.custom_jvp(on_leaves)

        def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Out, Out]:
            outcome, slopes, along = slopes_along(on_leaves, primals, tangents)
            weights = jnp.stack(along)
            return outcome, jax.tree.map(lambda s: contraction(weights, s), slopes)

        solved.defjvp(rule, symbolic_zeros=True)
        outcome = solved(*leaves)
        return jax.tree.map(lambda out, kind: out.astype(kind), outcome, kinds[0])

    return differentiable
