"""Derivatives of quadratures by the few numbers they depend on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ._base import Exponent, Lane
from ._quadrature import UNROLL

Out = TypeVar("Out")


def lanewise(solve: Callable[..., Out], number: Lane, n: Exponent) -> Out:
    """`solve(number, n, UNROLL)`, lane by lane on arrays of one shape, differentiated forward.

    Going backwards through a quadrature would keep every node of every lane; the derivative of a
    lane's integral by its one or two numbers is one more integral, with `unroll` = 1, which
    compiles faster. A float n is a constant.
    """
    fixed = (n,) if isinstance(n, float) else ()

    def direct(*numbers: Lane) -> Out:
        return solve(*numbers, *fixed, UNROLL)

    def in_rule(*numbers: Lane) -> Out:
        return solve(*numbers, *fixed, 1)

    solved = jax.custom_jvp(direct)

    def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Out, Out]:
        varying = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]

        def sensitivity(direction: jax.Array) -> tuple[Out, Out]:
            pushed = [jnp.zeros_like(primal) for primal in primals]
            for i, component in zip(varying, direction, strict=True):
                pushed[i] = jnp.broadcast_to(component, primals[i].shape)
            return jax.jvp(in_rule, primals, tuple(pushed))

        basis = jnp.eye(len(varying), dtype=primals[0].dtype)
        outcome, slopes = jax.vmap(sensitivity, out_axes=(None, 0))(basis)
        return outcome, jax.tree.map(
            lambda slope: sum(slope[j] * tangents[i] for j, i in enumerate(varying)), slopes
        )

    solved.defjvp(rule, symbolic_zeros=True)
    return solved(number) if fixed else solved(number, jnp.asarray(n))
