"""Compiled functions that are called with little delay."""

from __future__ import annotations

import concurrent.futures
import functools
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.extend.core
import jax.numpy as jnp

Out = TypeVar("Out")


def program(function: Callable[..., Out]) -> Callable[..., Out]:
    """`function(numbers, *choices)`, compiled for the types of its arguments.

    Leaves that are no arrays are choices for which it is compiled anew, as by `equinox.filter_jit`;
    but a float among the `numbers` is one more number. Where there are no such choices `jax.jit`
    takes the arguments leaf by leaf, which is several times faster. The outcome holds arrays alone.

    A few numbers are computed by a program that is compiled in half the time.
    """
    with_choices = eqx.filter_jit(function)

    # Of classes in Python, JAX takes as long to flatten them as to run a small program.
    @functools.lru_cache(maxsize=_MOST_STRUCTURES)
    def with_numbers(structure: Any, few: bool) -> Callable[..., Out]:
        @functools.wraps(function)
        def of_leaves(*leaves: Any) -> Out:
            return function(*jax.tree.unflatten(structure, leaves))

        return jax.jit(of_leaves, compiler_options=_soon() if few else None)

    @functools.wraps(function)
    def call(numbers: Any, *choices: Any) -> Out:
        leaves, structure = jax.tree.flatten((numbers, *choices))
        plain = all(_is_number(type(leaf)) for leaf in leaves)
        if plain and all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(choices)):
            few = sum(1 if type(leaf) is float else leaf.size for leaf in leaves) <= _FEW
            return with_numbers(structure, few and _untraced())(*leaves)
        return with_choices(jax.tree.map(_as_number, numbers), *choices)

    return call


_FEW = 256
"""Numbers whose computation takes less time than the compiler needs to make it faster."""

_MOST_STRUCTURES = 256
"""Programs of a function that are kept: for laws of a user's own, one for each function in them."""


@functools.cache
def _is_number(kind: type) -> bool:
    return issubclass(kind, jax.Array | float)


def _untraced() -> bool:
    """Whether what is computed now is no part of another program, nor of a derivative.

    Options of the compiler belong to whole programs.
    """
    return jax.extend.core.get_opaque_trace_state(convention="") == _OUTERMOST


with jax.core.eval_context():
    _OUTERMOST = jax.extend.core.get_opaque_trace_state(convention="")


def side_by_side(jobs: Iterable[Callable[[], Out]]) -> Generator[Out, None, None]:
    """The outcomes of jobs in their order, of which two run at a time.

    What takes most of a job is the compiler, which leaves Python free for another one. Settings of
    JAX that hold for the caller's thread alone do not hold in a job.
    """
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        running = [pool.submit(job) for job in jobs]
        try:
            for one in running:
                yield one.result()
        finally:
            for one in running:
                one.cancel()


def soon_compiled(function: Callable[..., Out]) -> Callable[..., Out]:
    """`equinox.filter_jit` for what takes longer to compile than to run, and is not traced itself.

    On a processor XLA makes each loop by way of MLIR; its older way, direct, compiles in half the
    time. Searches compiled so run 1.4 times as long.
    """

    @functools.cache
    def compiled() -> Callable[..., Out]:
        # It passes what it does not name on to `jax.jit`, which its type leaves out.
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=_soon())

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        return compiled()(*arguments)

    return call


def quick(function: Callable[..., Out]) -> Callable[..., Out]:
    """`equinox.filter_jit` for what runs once or a few times: compiled in a quarter of the time.

    Within another program, or a derivative, it is part of what is compiled there.
    """

    @functools.cache
    def compiled(alone: bool) -> Callable[..., Out]:
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=_quick()) if alone else jit(function)

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        return compiled(_untraced())(*arguments)

    return call


@functools.cache
def _soon() -> dict[str, Any] | None:
    """Options of the compiler for processors; none where this version of JAX does not know them."""
    if jax.default_backend() != "cpu":
        return None
    options: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return None
    return options


@functools.cache
def _quick() -> dict[str, Any] | None:
    """As `_soon`, and without what makes long runs faster: LLVM's passes, moving out of loops."""
    soon = _soon()
    if soon is None:
        return None
    return soon | {
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_parallel_codegen_split_count": 1,
        "xla_disable_hlo_passes": "while-loop-invariant-code-motion,while-loop-constant-sinking",
    }


def _as_number(leaf: Any) -> Any:
    return jnp.asarray(leaf) if type(leaf) is float else leaf
