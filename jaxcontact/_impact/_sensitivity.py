"""Forward sensitivities that serve both modes of differentiation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from .._forms import slopes_along

In = TypeVar("In")
Out = TypeVar("Out")


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
            outcome = solve(jax.tree.unflatten(structure, leaves))
            kinds[:] = [out.dtype for out in jax.tree.leaves(outcome)]
            either = jnp.isnan(leaves[0])
            return jax.tree.map(
                lambda out: jnp.where(either, out, out).astype(leaves[0].dtype), outcome
            )

        solved = jax.custom_jvp(on_leaves)

        def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Out, Out]:
            outcome, slopes, along = slopes_along(on_leaves, primals, tangents)
            weights = jnp.stack(along)
            return outcome, jax.tree.map(lambda s: jnp.tensordot(weights, s, axes=1), slopes)

        solved.defjvp(rule, symbolic_zeros=True)
        outs, shape = jax.tree.flatten(solved(*leaves))
        return shape.unflatten([out.astype(kind) for out, kind in zip(outs, kinds, strict=True)])

    return differentiable
