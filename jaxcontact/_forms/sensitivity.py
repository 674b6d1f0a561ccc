"""Derivatives of quadratures with respect to the few numbers they depend on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .base import Exponent, Lane
from .quadrature import UNROLL

Out = TypeVar("Out")


def slopes_along(
    function: Callable[..., Out], primals: tuple[jax.Array, ...], tangents: tuple
) -> tuple[Out, Out, list[jax.Array]]:
    """Return the value of a function of few numbers, its slopes by the varying ones, and tangents.

    This is a rule for `custom_jvp` that is linear in the tangents and therefore transposes. The
    slopes are computed forward together with the value. They multiply tangents in forward mode and
    cotangents in reverse mode. Every primal is one number, or one number per lane.
    """
    varying = [i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero)]
    along = [tangents[i] for i in varying]

    def of_varying(*numbers: jax.Array) -> Out:
        given = list(primals)
        for i, number in zip(varying, numbers, strict=True):
            given[i] = number
        return function(*given)

    def sensitivity(direction: jax.Array) -> tuple[Out, Out]:
        numbers = tuple(primals[i] for i in varying)
        pushed = (jnp.broadcast_to(d, x.shape) for d, x in zip(direction, numbers, strict=True))
        return jax.jvp(of_varying, numbers, tuple(pushed))

    basis = jnp.eye(len(varying), dtype=primals[0].dtype)
    if len(varying) == 1:
        # A batch of one direction would be traced once more and compiled with an axis of length
        # one.
        outcome, slope = sensitivity(basis[0])
        return outcome, jax.tree.map(lambda s: s[None], slope), along
    outcome, slopes = jax.vmap(sensitivity, out_axes=(None, 0))(basis)
    return outcome, slopes, along


def lanewise(solve: Callable[..., Out], number: Lane, n: Exponent) -> Out:
    """Return `solve(number, n, UNROLL)`, lane by lane on arrays of one shape, differentiated
    forward.

    Reverse mode through a quadrature would store every node of every lane. The derivative of a
    lane's integral by its one or two numbers is one more integral, with `unroll` = 1, which
    compiles faster. A float n is a constant.
    """
    fixed = (n,) if isinstance(n, float) else ()

    def with_unroll(unroll: int) -> Callable[..., Out]:
        return lambda *numbers: solve(*numbers, *fixed, unroll)

    solved = jax.custom_jvp(with_unroll(UNROLL))

    def rule(primals: tuple[Lane, ...], tangents: tuple) -> tuple[Out, Out]:
        outcome, slopes, along = slopes_along(with_unroll(1), primals, tangents)
        return outcome, jax.tree.map(
            lambda slope: sum(s * t for s, t in zip(slope, along, strict=True)), slopes
        )

    solved.defjvp(rule, symbolic_zeros=True)
    return solved(number) if fixed else solved(number, jnp.asarray(n))
