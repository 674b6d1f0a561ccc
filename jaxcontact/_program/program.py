"""Compiled functions with little call overhead, with derivatives of concrete scalars."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp

from .._entry import traced
from .compiled import FEW, quick_options, soon_options, untraced
from .outside import known_beneath, with_rule

Out = TypeVar("Out")


def program(function: Callable[..., Out]) -> Callable[..., Out]:
    """Return `function(numbers, *choices)`, compiled for the types of its arguments.

    Leaves that are not arrays are static choices, as in `equinox.filter_jit`; a float among the
    `numbers` is a number. Without such choices `jax.jit` takes the arguments leaf by leaf, which is
    several times faster. The outcome must hold only arrays.

    A few numbers are computed by a program that compiles in half the time. A derivative of concrete
    scalars, as by `jax.grad` outside of `jit`, needs one such program for the outcome and its
    slopes. The derivative is the product of the slopes with the tangents.

    With `again=True` it returns None, unless all numbers are scalars outside of any trace and were
    computed in the same structure before. What belongs to the structure needs no new check then.
    """
    with_choices = eqx.filter_jit(function)
    computed: dict[Any, Callable[..., Out]] = {}

    @functools.lru_cache(maxsize=_MOST_STRUCTURES)
    def with_numbers(structure: Any, soon: bool) -> Callable[..., Out]:
        options = soon_options() if soon else None
        return jax.jit(_of_leaves(function, structure), compiler_options=options)

    @functools.lru_cache(maxsize=_MOST_STRUCTURES)
    def with_slopes(structure: Any, kinds: tuple[Any, ...]) -> Callable[..., Out] | None:
        return _differentiable(_of_leaves(function, structure), kinds)

    def repeated(structure: Any, leaves: list) -> Any:
        known = computed.get(structure) if untraced() else None
        # `leaf.shape` takes five times as long.
        several = known and any(type(x) is not float and x.aval.shape for x in leaves)
        return known(*leaves) if known and not several else None

    def of_numbers(structure: Any, leaves: list) -> Out:
        few = sum(1 if type(leaf) is float else leaf.size for leaf in leaves) <= FEW
        soon = few and untraced()
        run = with_numbers(structure, soon)
        found = run(*leaves)
        if soon and len(computed) < _MOST_STRUCTURES:
            computed[structure] = run
        return found

    @functools.wraps(function)
    def call(numbers: Any, *choices: Any, again: bool = False) -> Any:
        leaves, structure = jax.tree.flatten((numbers, *choices))
        plain = _are_numbers(*map(type, leaves))
        if again:
            return repeated(structure, leaves) if plain else None
        if all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(choices)):
            if plain:
                return of_numbers(structure, leaves)
            if all(map(_is_single, leaves)) and known_beneath(leaves):
                differentiable = with_slopes(structure, tuple(map(jax.typeof, leaves)))
                if differentiable is not None:
                    return differentiable(*leaves)
        given = jax.tree.map(lambda x: jnp.asarray(x) if type(x) is float else x, numbers)
        return with_choices(given, *choices)

    return call


def _is_single(leaf: Any) -> bool:
    return type(leaf) is float or (isinstance(leaf, jax.Array) and leaf.ndim == 0)


def _of_leaves(function: Callable[..., Out], structure: Any) -> Callable[..., Out]:
    """Return `function` as a function of the leaves of its arguments. JAX takes as long to flatten
    Python classes as to run a small program.
    """

    @functools.wraps(function)
    def of_leaves(*leaves: Any) -> Out:
        return function(*jax.tree.unflatten(structure, leaves))

    return of_leaves


def _differentiable(
    function: Callable[..., Out], kinds: tuple[Any, ...]
) -> Callable[..., Out] | None:
    """Return `function` of concrete scalars, with outcome and slopes from one program. Returns None
    if it depends on tracers that are not arguments, which would have no slopes. An example is a law
    that a user defines under a derivative.
    """
    solved = jax.jit(function)
    if traced(jax.make_jaxpr(solved)(*kinds).consts):
        return None

    @functools.cache
    def with_slopes(moves: tuple[bool, ...]) -> Callable[..., tuple[Out, list[list[jax.Array]]]]:
        return jax.jit(functools.partial(_slopes, solved, moves), compiler_options=quick_options())

    def rule(primals: tuple, along: tuple) -> tuple[Out, Out]:
        moving = [_plain(tangent) for tangent in along if tangent is not None]
        with jax.core.eval_context():
            solve = with_slopes(tuple(tangent is not None for tangent in along))
            outcome, slopes = solve(*map(_plain, primals))
        structure = jax.tree.structure(eqx.filter(outcome, eqx.is_inexact_array))
        return outcome, jax.tree.unflatten(structure, _sums(slopes, moving))

    return with_rule(lambda *numbers: solved(*numbers), rule)


def _plain(number: Any) -> Any:
    # The fast path into a compiled function rejects subclasses of float, and JAX has one.
    return float(number) if isinstance(number, float) else number


@jax.jit
def _sums(slopes: list[list[jax.Array]], along: list[jax.Array]) -> list[jax.Array]:
    """Return the product of each column of slopes with the tangents."""
    return [
        functools.reduce(operator.add, (s * t for s, t in zip(column, along, strict=True)))
        for column in zip(*slopes, strict=True)
    ]


def _slopes(
    function: Callable[..., Out], moves: tuple[bool, ...], *numbers: Any
) -> tuple[Out, list[list[jax.Array]]]:
    """Return the outcome, and the slopes of its floats by each of the varying scalars."""
    moving = tuple(itertools.compress(numbers, moves))

    def of_moving(*moving: Any) -> tuple[list[jax.Array], Out]:
        rest = iter(moving)
        out = function(*(next(rest) if m else x for x, m in zip(numbers, moves, strict=True)))
        return [x for x in jax.tree.leaves(out) if eqx.is_inexact_array(x)], out

    def along(direction: Any) -> tuple[Out, list[jax.Array]]:
        pushed = (d.astype(x.dtype) for d, x in zip(direction, moving, strict=True))
        _, slopes, out = jax.jvp(of_moving, moving, tuple(pushed), has_aux=True)
        return out, slopes

    if len(moving) == 1:
        outcome, slopes = along(jnp.ones(1))
        return outcome, [slopes]
    outcome, slopes = jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(moving)))
    return outcome, [[slope[k] for slope in slopes] for k in range(len(moving))]


_MOST_STRUCTURES = 256
"""The number of programs kept for a function; a user's law adds one for each function in it."""


@functools.lru_cache(maxsize=_MOST_STRUCTURES)
def _are_numbers(*kinds: type) -> bool:
    return all(issubclass(kind, jax.Array | float) for kind in kinds)
