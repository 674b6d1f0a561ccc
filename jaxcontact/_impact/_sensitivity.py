"""Derivatives that are carried forward with a solution and serve both modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

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
        kinds = jax.eval_shape(solve, problem)

        # Flags and counts travel as numbers: a derivative rule has no good word for integers. And
        # all of it depends on the input, if only in form: a rule whose outcome is in part constant
        # fails under jit of vmap (jax 0.10.2).
        def on_leaves(*leaves: jax.Array) -> Out:
            outcome = solve(jax.tree.unflatten(structure, leaves))
            form = jnp.isnan(leaves[0])
            return jax.tree.map(
                lambda out: jnp.where(form, out, out).astype(leaves[0].dtype), outcome
            )

        solved = jax.custom_jvp(on_leaves)

        def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Out, Out]:
            varying = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]

            def sensitivity(direction: jax.Array) -> tuple[Out, Out]:
                pushed = [jnp.zeros_like(primal) for primal in primals]
                for i, component in zip(varying, direction, strict=True):
                    pushed[i] = component
                return jax.jvp(on_leaves, primals, tuple(pushed))

            basis = jnp.eye(len(varying), dtype=primals[0].dtype)
            outcome, slopes = jax.vmap(sensitivity, out_axes=(None, 0))(basis)
            weights = jnp.stack([tangents[i] for i in varying])
            return outcome, jax.tree.map(lambda s: jnp.tensordot(weights, s, axes=1), slopes)

        solved.defjvp(rule, symbolic_zeros=True)
        return jax.tree.map(lambda out, kind: out.astype(kind.dtype), solved(*leaves), kinds)

    return differentiable
