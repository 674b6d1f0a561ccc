"""Scalar roots with implicit derivatives, lane by lane: in a bracket, or from a guess; and
constants that count as different in every lane, so that such loops are traced once.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

Tree = TypeVar("Tree")


def varying(number: Float[Array, ""], tree: Tree) -> Tree:
    """Return `tree` unchanged, but formally dependent on `number` and thus on its lane.

    The start of a loop is often a constant that differs between lanes from the first pass on. Under
    `vmap` JAX detects that by tracing the body, and all loops in it, once more for each loop. The
    compiler removes the choice between equal values.
    """
    either = jnp.isnan(jax.lax.stop_gradient(number))
    return jax.tree.map(lambda leaf: jnp.where(either, leaf, leaf), tree)


def moving(numbers: Any, tree: Tree) -> Tree:
    """Return `tree` unchanged, but its floats formally have slopes if any of `numbers` does.

    Like `varying`: without slopes at the start JAX takes the derivative of a loop once more.
    """
    given, floats = (eqx.filter(x, eqx.is_inexact_array) for x in (numbers, tree))
    same = jax.custom_jvp(lambda given, floats: floats)

    def slopes(primals: Any, tangents: Any) -> Any:
        along = [t for t in jax.tree.leaves(tangents[0]) if type(t) is not SymbolicZero and t.size]
        none = 0 * along[0].ravel()[0] if along else 0

        def slope(tangent: Any) -> Any:
            blank = bool(along) and type(tangent) is SymbolicZero
            return jnp.broadcast_to(none, tangent.shape) if blank else tangent

        return primals[1], jax.tree.map(slope, tangents[1])

    same.defjvp(slopes, symbolic_zeros=True)
    return eqx.combine(same(given, floats), tree)


Lane = Float[Array, "..."]


def implicit_root(
    residual: Callable[..., Lane], guess: Callable[..., Lane], iterations: int
) -> Callable[..., Lane]:
    """Return a function `x(*parameters)` that solves `residual(x, *parameters) = 0` lane by lane.
    It takes a fixed number of Newton steps from a good guess, without a branch. They are a loop, so
    that the residual is compiled once. Derivatives are as in `with_implicit_derivative`.
    """

    def newton(*parameters: Lane) -> Lane:
        def improved(_: int, x: Lane) -> Lane:
            value, slope = _with_slope(residual, x, parameters)
            return x - value / slope

        return jax.lax.fori_loop(0, iterations, improved, guess(*parameters))

    return with_implicit_derivative(newton, residual)


def expanded_root(
    expansion: Callable[..., tuple[Lane, Lane, Lane, Lane]],
    guess: Callable[..., Lane],
    iterations: int,
) -> Callable[..., Lane]:
    """Return `implicit_root` for a residual that comes with its first three derivatives in x. These
    derivatives are almost free if the residual is an integral. Householder's steps of order four
    then need half the evaluations.
    """

    def householder(*parameters: Lane) -> Lane:
        def improved(_: int, x: Lane) -> Lane:
            value, slope, second, third = expansion(x, *parameters)
            step, bend, twist = value / slope, second / slope, third / slope
            half = step * bend / 2
            return x - step * (1 - half) / (1 - 2 * half + jnp.square(step) * twist / 6)

        return jax.lax.fori_loop(0, iterations, improved, guess(*parameters))

    def residual(x: Lane, *parameters: Lane) -> Lane:
        return expansion(x, *parameters)[0]

    return with_implicit_derivative(householder, residual, lambda *x: expansion(*x)[:2])


def with_implicit_derivative(
    find: Callable[..., Lane],
    residual: Callable[..., Lane],
    with_slope: Callable[..., tuple[Lane, Lane]] | None = None,
) -> Callable[..., Lane]:
    """Return `find(*parameters)`, a root x of `residual(x, *parameters)`, made differentiable.

    The derivative is the implicit one, `dx = -(∂R/∂p dp)/(∂R/∂x)`. It is written in terms of the
    root itself, so that it is correct in both modes and to any order. `find` is never
    differentiated. Parameters are pytrees of arrays. `with_slope` returns R and ∂R/∂x together, if
    available.
    """
    root = jax.custom_jvp(find)

    @root.defjvp
    def root_jvp(parameters: tuple, tangents: tuple) -> tuple[Lane, Lane]:
        x = root(*parameters)
        if with_slope is None:
            _, forcing = jax.jvp(lambda *p: residual(x, *p), parameters, tangents)
            return x, -forcing / _with_slope(residual, x, parameters)[1]
        both = functools.partial(with_slope, x)
        _, forcing, slope = jax.jvp(both, parameters, tangents, has_aux=True)
        return x, -forcing / slope

    return root


def _with_slope(
    residual: Callable[..., Lane], x: Lane, parameters: tuple[Any, ...]
) -> tuple[Lane, Lane]:
    return jax.jvp(lambda x: residual(x, *parameters), (x,), (jnp.ones_like(x),))


def bracketed_root(
    function: Callable[[Lane], Lane], at_zero: Lane, at_one: Lane, iterations: int
) -> Lane:
    """Return the root in [0, 1] of a function with the values `at_zero` > 0 > `at_one` at the ends.

    Regula falsi, halving the value of an end that is kept twice (Illinois). It keeps the bracket,
    has order 1.4, and ends if the root no longer moves, at the latest after `iterations`. Not for
    differentiation.
    """
    zero = varying(at_zero, jnp.zeros_like(at_zero))
    rounding = jnp.finfo(zero.dtype).eps

    def unfinished(carry: tuple[Lane, ...]) -> Array:
        count, moved, *_ = carry
        return (count <= iterations) & (moved > rounding)

    # A value is used in the step after its computation. In the same step XLA may compute it once
    # for each use, and a value near zero may then differ in sign.
    def narrow(carry: tuple[Lane, ...]) -> tuple[Lane, ...]:
        count, _, middle, value, low, low_value, high, high_value, side = carry
        up = value > 0
        kept_low, kept_high = ~up & (side < 0), up & (side > 0)
        low_value = jnp.where(up, value, jnp.where(kept_low, low_value / 2, low_value))
        high_value = jnp.where(up, jnp.where(kept_high, high_value / 2, high_value), value)
        low, high = jnp.where(up, middle, low), jnp.where(up, high, middle)
        # The first step starts with the value at zero, which is no new information.
        side = jnp.where(count == 0, zero, jnp.where(up, zero + 1, zero - 1))
        chord = low + (high - low) * ratio(low_value, low_value - high_value)
        moved = jnp.where(count == 0, zero + 2, jnp.abs(chord - middle))
        return count + 1, moved, chord, function(chord), low, low_value, high, high_value, side

    first = (zero, zero + 2, zero, at_zero, zero, at_zero, zero + 1, at_one, zero)
    return jax.lax.while_loop(unfinished, narrow, first)[2]


def ratio(numerator: Lane | float, denominator: Lane) -> Lane:
    """Return the quotient, 0 if the denominator is 0."""
    nonzero = denominator != 0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1), 0)
