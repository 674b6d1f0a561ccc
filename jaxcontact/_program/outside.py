"""Derivatives outside of a trace: the differentiated function runs as from Python.

Under `jax.grad`, `jax.jvp`, `jax.jacfwd` or `jax.hessian`, outside of `jit` and `vmap`, the numbers
at which a derivative is taken are concrete. These are the rules:

- `grad`, `jvp`, `jacfwd`, `jacrev`: a function reads its numbers, loops in Python and uses quickly
  compiled programs. Its derivative is a linear map. For a few scalars it is the product with
  slopes, which the same program computes with the outcome (`program`). Otherwise it is a `Map` on
  the function's data, applied by a program of its own in the requested mode.
- Second derivatives: under two of them the outcome is still computed as from Python, and a `Map` is
  differentiated by its data. A `program` of scalars is differentiated like any other function.
- `jit`, `vmap`: no numbers are concrete. A function is differentiated like any other, or by its
  rule.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
from jax.custom_derivatives import SymbolicZero

from .._entry import traced
from .linear import Map

Out = TypeVar("Out")


def known_beneath(leaves: list[Any]) -> bool:
    """Return whether numbers are concrete under one derivative with respect to some of them. The
    rule of a derivative receives them. In a traced program it is not called. In a batch, or for a
    second derivative, it receives tracers.
    """
    known = []

    def rule(primals: tuple, along: tuple) -> tuple[tuple, tuple]:
        known.append(not traced(primals))
        return primals, along

    look = with_rule(lambda *numbers: numbers, rule)
    look(*filter(traced, leaves))
    return known == [True]


def with_rule(
    function: Callable[..., Out], rule: Callable[[tuple, tuple], tuple[Out, Any]]
) -> Callable[..., Out]:
    """Return `function` with the derivative given by a `rule`. The rule maps arguments and their
    tangents, None if zero, to the outcome and its tangents, None if zero.
    """
    found = jax.custom_jvp(function)

    def jvp(primals: tuple, tangents: tuple) -> tuple[Out, Any]:
        outcome, moved = rule(primals, jax.tree.map(_or_none, tangents))
        return outcome, eqx.combine(moved, jax.tree.map(SymbolicZero.from_primal_value, outcome))

    found.defjvp(jvp, symbolic_zeros=True)
    return found


class Found(eqx.Module):
    """The result of a function, and the hashable `choice` that it made by its numbers. The choice
    is None if the numbers are not concrete.
    """

    value: Any
    choice: Any = eqx.field(static=True)


def outside(
    find: Callable[[bool, Any], Found],
    slopes: Callable[[Any, Found], Callable[[Any], Any]],
    along_with: Callable[[Any, Found, Any], Any],
    given: Any,
) -> Found:
    """Return `find(traced, given)`, differentiable by every float in `given`. With concrete numbers
    the derivative is the linear map of tangents that `slopes` returns. Zero tangents are None in
    its input and output. Otherwise it is `along_with(given, found, tangents)`.
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

    def rule(primals: tuple, tangents: tuple) -> tuple[Found, Found]:
        (arrays,), (along,) = primals, tangents
        # Another transformation such as `vmap` would turn concrete numbers into tracers.
        known = (found if traced(arrays) else plainly)(arrays)
        given = eqx.combine(arrays, static)
        if known.choice is None:
            moved = along_with(given, known, along)
        else:
            moved = slopes(given, known)(along)
        return known, Found(moved, known.choice)

    found = with_rule(plainly, rule)
    return found(arrays)


def derived(
    function: Callable[..., Any],
    *given: Any,
    decide: Callable[..., tuple[Any, Any]] | None = None,
) -> Any:
    """Return `function(choice, *given)`, with a quickly compiled derivative. With concrete numbers
    `decide(*given)` returns the value as computed from Python, and the choice made. Otherwise the
    choice is None.
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
    """Return the tangents of the floats of `function(given)`, along those that are not None."""
    moves = jax.tree.map(lambda t: t is not None, along, is_leaf=lambda t: t is None)
    moving, rest = eqx.partition(given, jax.tree.map(bool, moves))

    def floats(moving: Any) -> Any:
        return eqx.filter(function(eqx.combine(moving, rest)), eqx.is_inexact_array)

    return jax.jvp(floats, (moving,), (along,))[1]


def _or_none(tangent: Any) -> Any:
    # A tangent may be a Python float.
    nothing = getattr(tangent, "dtype", None) == jax.dtypes.float0
    return None if nothing or isinstance(tangent, SymbolicZero) else tangent
