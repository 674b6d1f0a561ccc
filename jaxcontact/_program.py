"""Compiled functions that are called with little delay."""

from __future__ import annotations

import concurrent.futures
import functools
import math
import operator
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.core
import jax.extend.core
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jax.dtypes import float0

Out = TypeVar("Out")


def program(function: Callable[..., Out]) -> Callable[..., Out]:
    """`function(numbers, *choices)`, compiled for the types of its arguments.

    Leaves that are no arrays are choices for which it is compiled anew, as by `equinox.filter_jit`;
    but a float among the `numbers` is one more number. Where there are no such choices `jax.jit`
    takes the arguments leaf by leaf, which is several times faster. The outcome holds arrays alone.

    A few numbers are computed by a program that is compiled in half the time. Where a derivative is
    taken of known scalars, as by `jax.grad` outside of `jit`, one such program computes the outcome
    and its slopes, and the derivative is their product with the tangents.
    """
    with_choices = eqx.filter_jit(function)

    @functools.lru_cache(maxsize=_MOST_STRUCTURES)
    def with_numbers(structure: Any, few: bool) -> Callable[..., Out]:
        options = _soon() if few else None
        return jax.jit(_of_leaves(function, structure), compiler_options=options)

    @functools.lru_cache(maxsize=_MOST_STRUCTURES)
    def with_slopes(structure: Any, kinds: tuple[Any, ...]) -> Callable[..., Out] | None:
        return _differentiable(_of_leaves(function, structure), kinds)

    @functools.wraps(function)
    def call(numbers: Any, *choices: Any) -> Out:
        leaves, structure = jax.tree.flatten((numbers, *choices))
        if all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(choices)):
            if all(_is_number(type(leaf)) for leaf in leaves):
                few = sum(1 if type(leaf) is float else leaf.size for leaf in leaves) <= FEW
                return with_numbers(structure, few and _untraced())(*leaves)
            if _are_known_scalars(leaves):
                differentiable = with_slopes(structure, tuple(map(jax.typeof, leaves)))
                if differentiable is not None:
                    return differentiable(*leaves)
        return with_choices(jax.tree.map(_as_number, numbers), *choices)

    return call


def _of_leaves(function: Callable[..., Out], structure: Any) -> Callable[..., Out]:
    """`function` of the leaves of its arguments.

    Of classes in Python, JAX takes as long to flatten them as to run a small program.
    """

    @functools.wraps(function)
    def of_leaves(*leaves: Any) -> Out:
        return function(*jax.tree.unflatten(structure, leaves))

    return of_leaves


def _are_known_scalars(leaves: list[Any]) -> bool:
    """Whether scalars are known beneath a derivative that is taken of some of them.

    The rule of a derivative sees them. In a program that is traced it is not called; in a batch, or
    for a second derivative, it sees tracers.
    """
    if not all(
        type(leaf) is float or (isinstance(leaf, jax.Array) and leaf.ndim == 0) for leaf in leaves
    ):
        return False
    known = []

    @jax.custom_jvp
    def look(*numbers: Any) -> Any:
        return numbers

    @look.defjvp
    def rule(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
        known.append(not any(isinstance(primal, jax.core.Tracer) for primal in primals))
        return primals, tangents

    look(*(leaf for leaf in leaves if isinstance(leaf, jax.core.Tracer)))
    return known == [True]


def _differentiable(
    function: Callable[..., Out], kinds: tuple[Any, ...]
) -> Callable[..., Out] | None:
    """`function` of known scalars, differentiated by the program of its outcome and its slopes.

    None where it depends on tracers that are no arguments, such as those in a law that a user
    defines beneath a derivative: they would have no slopes.
    """
    traced = jax.jit(function)
    if any(isinstance(x, jax.core.Tracer) for x in jax.make_jaxpr(traced)(*kinds).consts):
        return None
    solved = jax.custom_jvp(lambda *numbers: traced(*numbers))

    @functools.cache
    def with_slopes(moves: tuple[bool, ...]) -> Callable[..., tuple[Out, list[Out]]]:
        return jax.jit(functools.partial(_slopes, traced, moves), compiler_options=_quick())

    def rule(primals: tuple, tangents: tuple) -> tuple[Out, Out]:
        moves = tuple(not isinstance(tangent, SymbolicZero) for tangent in tangents)
        with jax.core.eval_context():
            outcome, slopes = with_slopes(moves)(*primals)
        values, structure = jax.tree.flatten(outcome)
        varies = [jnp.issubdtype(value.dtype, jnp.inexact) for value in values]
        along = [tangent for move, tangent in zip(moves, tangents, strict=True) if move]
        sums = iter(
            _sums(
                [
                    [s for s, v in zip(jax.tree.leaves(row), varies, strict=True) if v]
                    for row in slopes
                ],
                along,
            )
        )
        changes = [
            next(sums) if v else np.zeros(value.shape, float0)
            for value, v in zip(values, varies, strict=True)
        ]
        return outcome, jax.tree.unflatten(structure, changes)

    solved.defjvp(rule, symbolic_zeros=True)
    return solved


@jax.jit
def _sums(slopes: list[list[jax.Array]], along: list[jax.Array]) -> list[jax.Array]:
    """Of each column of slopes, its product with the tangents."""
    columns = zip(*slopes, strict=True)
    return [
        functools.reduce(operator.add, (s * t for s, t in zip(column, along, strict=True)))
        for column in columns
    ]


def _slopes(
    function: Callable[..., Out], moves: tuple[bool, ...], *numbers: Any
) -> tuple[Out, list[Out]]:
    """The outcome, and its slopes by each of the scalars that move."""
    moving = tuple(x for x, moves_ in zip(numbers, moves, strict=True) if moves_)

    def of_moving(*moving: Any) -> Out:
        rest = iter(moving)
        return function(*(next(rest) if m else x for x, m in zip(numbers, moves, strict=True)))

    def along(direction: Any) -> tuple[Out, Out]:
        pushed = (d.astype(x.dtype) for d, x in zip(direction, moving, strict=True))
        return jax.jvp(of_moving, moving, tuple(pushed))

    if len(moving) == 1:
        outcome, slope = along(jnp.ones(1))
        return outcome, [slope]
    outcome, slopes = jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(moving)))
    rows = [jax.tree.map(lambda slope, k=k: slope[k], slopes) for k in range(len(moving))]
    return outcome, rows


FEW = 256
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


def quick(function: Callable[..., Out], most: float = math.inf) -> Callable[..., Out]:
    """`equinox.filter_jit` for what runs once or a few times: compiled in a quarter of the time.

    Within another program, or a derivative, it is part of what is compiled there. For more numbers
    than `most` among the arguments it is compiled as usual.
    """

    @functools.cache
    def compiled(alone: bool) -> Callable[..., Out]:
        jit: Any = eqx.filter_jit
        return jit(function, compiler_options=_quick()) if alone else jit(function)

    @functools.wraps(function)
    def call(*arguments: Any) -> Out:
        size = sum(leaf.size for leaf in jax.tree.leaves(arguments) if isinstance(leaf, jax.Array))
        return compiled(size <= most and _untraced())(*arguments)

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
