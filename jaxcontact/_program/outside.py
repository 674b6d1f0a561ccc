"""Derivatives outside of the trace: what is differentiated runs as from Python.

Beneath `jax.grad`, `jax.jvp`, `jax.jacfwd` or `jax.hessian`, outside of `jit` and `vmap`, the
numbers that a derivative is taken at are known. These are the rules:

- `grad`, `jvp`, `jacfwd`, `jacrev`: a function looks at its numbers, loops in Python and uses
  programs that are compiled quickly. Its derivative is a linear map: of a few scalars the product
  with slopes, found by the same program as the outcome (`program`); else a `Map`, whose data are
  what the function knows, applied by a program of its own in the mode that is asked for.
- Second derivatives: beneath two of them the outcome is still found as from Python, and a `Map` is
  differentiated by its data. A `program` of scalars is differentiated as any other function.
- `jit`, `vmap`: nothing is known. A function is differentiated as any other, or by a rule for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
from jax.custom_derivatives import SymbolicZero

from .linear import Map

Out = TypeVar("Out")


def traced(tree: Any) -> bool:
    """Whether a tree holds a traced number."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def known_beneath(leaves: list[Any]) -> bool:
    """Whether numbers are known beneath one derivative that is taken of some of them.

    The rule of a derivative sees them. In a program that is traced it is not called; in a batch, or
    for a second derivative, it sees tracers.
    """
    known = []

    def rule(primals: tuple, along: tuple) -> tuple[tuple, tuple]:
        known.append(not traced(primals))
        return primals, along

    look = with_rule(lambda *numbers: numbers, rule)
    look(*(leaf for leaf in leaves if isinstance(leaf, jax.core.Tracer)))
    return known == [True]


def with_rule(
    function: Callable[..., Out], rule: Callable[[tuple, tuple], tuple[Out, Any]]
) -> Callable[..., Out]:
    """`function` with the derivative of a `rule`: from arguments and their tangents, None where
    they are zero, to the outcome and its tangents, None for what does not move.
    """
    found = jax.custom_jvp(function)

    def jvp(primals: tuple, tangents: tuple) -> tuple[Out, Any]:
        outcome, moved = rule(primals, jax.tree.map(_or_none, tangents))
        return outcome, eqx.combine(moved, jax.tree.map(SymbolicZero.from_primal_value, outcome))

    found.defjvp(jvp, symbolic_zeros=True)
    return found


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

    def rule(primals: tuple, tangents: tuple) -> tuple[Found, Found]:
        (arrays,), (along,) = primals, tangents
        # Of what is known another transformation, as `vmap`, would make tracers.
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
    # A tangent may be a Python float.
    nothing = getattr(tangent, "dtype", None) == jax.dtypes.float0
    return None if nothing or isinstance(tangent, SymbolicZero) else tangent
