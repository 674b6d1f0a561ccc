"""Compiled functions that are called with little delay."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

Out = TypeVar("Out")


def program(function: Callable[..., Out]) -> Callable[..., Out]:
    """`function(numbers, *choices)`, compiled for the types of its arguments.

    Leaves that are no arrays are choices for which it is compiled anew, as by `equinox.filter_jit`;
    but a float among the `numbers` is one more number. Where there are no such choices `jax.jit`
    takes the arguments as they are, which is several times faster. The outcome holds arrays alone.
    """
    with_choices = eqx.filter_jit(function)
    with_numbers = jax.jit(function)

    @functools.wraps(function)
    def call(numbers: Any, *choices: Any) -> Out:
        plain = all(isinstance(leaf, jax.Array | float) for leaf in jax.tree.leaves(numbers))
        if plain and all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(choices)):
            return with_numbers(numbers, *choices)
        return with_choices(jax.tree.map(_as_number, numbers), *choices)

    return call


def soon_compiled(function: Callable[..., Out]) -> Callable[..., Out]:
    """`equinox.filter_jit` for what takes longer to compile than to run, and is not traced itself.

    On a processor XLA makes each loop by way of MLIR; its older way, direct, compiles in half the
    time. Searches compiled so run 1.4 times as long.
    """

    @functools.cache
    def compiled() -> Callable[..., Out]:
        options = _soon() if jax.default_backend() == "cpu" else {}
        # It passes what it does not name on to `jax.jit`, which its type leaves out.
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=options or None)

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        return compiled()(*arguments)

    return call


@functools.cache
def _soon() -> dict[str, Any]:
    """Options of the compiler for processors; none where this version of JAX does not know them."""
    options = {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return {}
    return options


def _as_number(leaf: Any) -> Any:
    return jnp.asarray(leaf) if type(leaf) is float else leaf
