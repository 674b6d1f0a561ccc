"""Compiled functions: what runs once is compiled quickly, what runs long as well as it can be."""

from __future__ import annotations

import concurrent.futures
import functools
import math
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.extend.core

Out = TypeVar("Out")


FEW = 256
"""Numbers whose computation takes less time than the compiler needs to make it faster."""


def untraced() -> bool:
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
        return jit(function, compiler_options=soon_options())

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        return compiled()(*arguments)

    return call


def quick(function: Callable[..., Out], most: float = math.inf) -> Callable[..., Out]:
    """`equinox.filter_jit` for what runs once or a few times: compiled in a quarter of the time.

    Within another program, or a derivative, it is part of what is compiled there. For more numbers
    than `most` among the arguments it is compiled as usual.
    """

    @functools.cache
    def compiled(alone: bool) -> Callable[..., Out]:
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=quick_options()) if alone else jit(function)

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        size = sum(leaf.size for leaf in jax.tree.leaves(arguments) if isinstance(leaf, jax.Array))
        return compiled(size <= most and untraced())(*arguments)

    return call


@functools.cache
def soon_options() -> dict[str, Any] | None:
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
def quick_options() -> dict[str, Any] | None:
    """As `soon_options`, without LLVM's passes and moving out of loops, which help long runs."""
    soon = soon_options()
    if soon is None:
        return None
    return soon | {
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_parallel_codegen_split_count": 1,
        "xla_disable_hlo_passes": "while-loop-invariant-code-motion,while-loop-constant-sinking",
    }
