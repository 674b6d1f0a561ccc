"""Compiled functions: short runs compile quickly, long runs are optimised fully."""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import math
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.extend.core
import numpy as np

Out = TypeVar("Out")


FEW = 256
"""Up to this count of numbers, full optimisation takes longer than the computation."""


@contextlib.contextmanager
def in_double() -> Iterator[None]:
    """Compute in double precision and with the usual promotion of types, whatever JAX's setting."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        yield


def untraced() -> bool:
    """Return whether the current computation is outside of any other program or derivative.
    Compiler options belong to whole programs.
    """
    return jax.extend.core.get_opaque_trace_state(convention="") == _OUTERMOST


with jax.core.eval_context():
    _OUTERMOST = jax.extend.core.get_opaque_trace_state(convention="")


def side_by_side(jobs: Iterable[Callable[[], Out]], at_once: int = 2) -> Generator[Out, None, None]:
    """Yield the results of jobs in order, running some at once. Most of a job is compilation or
    computation, which leaves Python free for another one. Of the JAX settings that hold only for
    the caller's thread, the precision holds in a job.
    """
    x64 = bool(jax.dtypes.canonicalize_dtype(float) == np.float64)

    def run(job: Callable[[], Out]) -> Out:
        with jax.enable_x64(x64):
            return jax.block_until_ready(job())

    with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
        running = [pool.submit(run, job) for job in jobs]
        try:
            for one in running:
                yield one.result()
        finally:
            for one in running:
                one.cancel()


@functools.cache
def soon_options() -> dict[str, Any] | None:
    """Return CPU compiler options; None for other devices, or if this JAX has no such options.

    XLA compiles each loop through MLIR. Its older, direct way takes half the time; searches
    compiled so run 1.4 times as long.
    """
    return _known({"xla_cpu_use_fusion_emitters": False})


@functools.cache
def quick_options() -> dict[str, Any] | None:
    """Return `soon_options` without LLVM passes and loop hoisting, which only help long runs."""
    options = {
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_parallel_codegen_split_count": 1,
        "xla_disable_hlo_passes": "while-loop-invariant-code-motion,while-loop-constant-sinking",
    }
    # A JAX that lacks the option of `soon_options` may have these.
    soon = soon_options()
    return _known(options) if soon is None else soon | options


@functools.cache
def swift_options() -> dict[str, Any] | None:
    """Return `quick_options` with the cheap passes of LLVM, for loops that run longer. They take
    half the time of all passes, and the code of a loop over few numbers is as fast.
    """
    options = quick_options()
    return None if options is None else options | {"xla_backend_optimization_level": 1}


def quick(
    function: Callable[..., Out], most: float = math.inf, options: Callable[[], Any] = quick_options
) -> Callable[..., Out]:
    """Return `equinox.filter_jit` of a function that runs a few times, compiled four times faster,
    or by other `options`. Within another program or a derivative, it is compiled as a part of it.
    If the arguments hold more numbers than `most`, it is compiled as usual.
    """

    @functools.cache
    def compiled(alone: bool) -> Callable[..., Out]:
        # It passes unknown arguments on to `jax.jit`, which its type omits.
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=options()) if alone else jit(function)

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        size = sum(leaf.size for leaf in jax.tree.leaves(arguments) if isinstance(leaf, jax.Array))
        return compiled(size <= most and untraced())(*arguments)

    return call


def _known(options: dict[str, Any]) -> dict[str, Any] | None:
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return None
    return options
