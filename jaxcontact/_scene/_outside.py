"""Derivatives outside of the trace: what is differentiated runs as from Python.

Under plain `jax.grad`, `jax.jacfwd` or `jax.hessian` the numbers that a derivative is taken at are
concrete, below all levels of derivatives. There a function may look at its numbers, loop in Python
and use programs that are compiled quickly, and its derivative is a linear map with what it knows as
data. Under `jit` and `vmap` nothing is concrete, and a function is differentiated as any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ._linear import Map
from ._result import traced


class Found(eqx.Module):
    """What a function returns, and the `choice` that it made by its numbers (hashable); None where
    they are not concrete.
    """

    value: Any
    choice: Any = eqx.field(static=True)


def outside(
    find: Callable[[bool, Any], Found],
    slopes: Callable[[Any, Found], Callable[[Any], Any]],
    along_with: Callable[[Any, Found, Any], Any],
    given: Any,
) -> Found:
    """`find(traced, given)`, differentiable by every float in `given`.

    Where numbers are concrete the derivative of the value is the linear map that `slopes` returns,
    from tangents, None for those that are zero, to tangents, None for what does not move; elsewhere
    it is `along_with(given, found, tangents)`.
    """
    arrays, static = eqx.partition(given, eqx.is_array)

    def plainly(arrays: Any) -> Found:
        given = eqx.combine(arrays, static)
        if traced(given):
            return find(True, given)
        with jax.core.eval_context():
            return find(False, given)

    if not traced(given):
        return plainly(arrays)
    found = jax.custom_jvp(plainly)

    def rule(primals: tuple, tangents: tuple) -> tuple[Found, Found]:
        (arrays,), (along,) = primals, tangents
        # Of what is concrete another transformation, as `vmap`, would make tracers.
        known = (found if traced(arrays) else plainly)(arrays)
        given = eqx.combine(arrays, static)
        if known.choice is None:
            moved = along_with(given, known, jax.tree.map(_with_zeros, along))
        else:
            moved = slopes(given, known)(jax.tree.map(_or_none, along))
        still = jax.tree.map(SymbolicZero.from_primal_value, known.value)
        return known, Found(eqx.combine(moved, still), known.choice)

    found.defjvp(rule, symbolic_zeros=True)
    return found(arrays)


def derived(
    function: Callable[..., Any],
    *given: Any,
    decide: Callable[..., tuple[Any, Any]] | None = None,
) -> Any:
    """`function(choice, *given)`, with a derivative that is compiled quickly.

    Where numbers are concrete `decide(*given)` is that value in the way of Python, and the choice
    that it made; elsewhere the choice is None.
    """

    def find(traced: bool, given: Any) -> Found:
        if traced:
            return Found(function(None, *given), None)
        value, choice = (function(None, *given), None) if decide is None else decide(*given)
        return Found(value, (choice,))

    def slopes(given: Any, found: Found) -> Callable[[Any], Any]:
        data, static = eqx.partition(given, eqx.is_array)
        leaves, structure = jax.tree.flatten(static)
        map = Map(_pushed, (function, found.choice[0], tuple(leaves), structure))
        like = eqx.filter(found.value, eqx.is_inexact_array)
        return lambda along: map(data, along, like)

    def along_with(given: Any, found: Found, along: Any) -> Any:
        return _along(lambda given: function(None, *given), given, along)

    return outside(find, slopes, along_with, given).value


def _pushed(static: Any, known: Any, along: Any) -> Any:
    function, choice, leaves, structure = static
    given = eqx.combine(known, jax.tree.unflatten(structure, leaves))
    return _along(lambda given: function(choice, *given), given, along)


def _along(function: Callable[[Any], Any], given: Any, along: Any) -> Any:
    """The tangents of the floats of `function(given)`, along those that are not None."""
    moves = jax.tree.map(lambda t: t is not None, along, is_leaf=lambda t: t is None)
    moving, rest = eqx.partition(given, jax.tree.map(bool, moves))

    def floats(moving: Any) -> Any:
        return eqx.filter(function(eqx.combine(moving, rest)), eqx.is_inexact_array)

    return jax.jvp(floats, (moving,), (along,))[1]


def _or_none(tangent: Any) -> Any:
    still = isinstance(tangent, SymbolicZero) or tangent.dtype == jax.dtypes.float0
    return None if still else tangent


def _with_zeros(tangent: Any) -> Any:
    dtype: Any = tangent.dtype
    if dtype == jax.dtypes.float0:
        return None
    return jnp.zeros(tangent.shape, dtype) if isinstance(tangent, SymbolicZero) else tangent
