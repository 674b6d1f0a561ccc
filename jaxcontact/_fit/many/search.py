"""The searches of all balls, in blocks that one program advances."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Int

from ..._program import in_double, quick, side_by_side
from ..problem.problem import FitProblem
from ..search.minimum import SearchEnd, SearchOptions, assessed, end_of, in_numpy
from ..search.trust_region import Search, begin, least_squares

_FIRST, _MORE = 8, 1.5
"""Steps after which finished lanes leave their block, and the growth of this number."""

_BLOCK, _GROUP, _BLOCK_ON_GPU = 64, 8, 4096

_PORTION = 32
"""Blocks whose lanes are repacked together, which bounds the memory."""


class Balls(NamedTuple):
    """What differs between balls: data, start, and numbers that are not fitted."""

    x: Any
    y: Any
    factor: Any
    theta: Any
    others: list[Any]

    def problem(self, shared: FitProblem) -> FitProblem:
        """Return the problem of one ball."""
        space = dataclasses.replace(shared.space, others=self.others_in(shared))
        return dataclasses.replace(shared, x=self.x, y=self.y, factor=self.factor, space=space)

    def others_in(self, shared: FitProblem) -> list[Any]:
        """Return the numbers that are not fitted, with those that all balls share."""
        pairs = zip(self.others, shared.space.others, strict=True)
        return [x if own is None else own for own, x in pairs]


def rows_of(tree: Any, rows: Any) -> Any:
    """Return some rows of all arrays."""
    return jax.tree.map(lambda x: x[rows], tree)


@quick
def _begun(shared: FitProblem, lanes: Balls, max_steps: int) -> Search:
    return jax.vmap(lambda lane: begin(lane.problem(shared), lane.theta, max_steps))(lanes)


@eqx.filter_jit
def _advanced(
    shared: FitProblem,
    lanes: Balls,
    search: Search,
    limit: Any,
    options: SearchOptions,
    group: int,
) -> tuple[Search, SearchEnd]:
    def one(given: tuple[Balls, Search]) -> tuple[Search, SearchEnd]:
        lane, search = given
        problem = lane.problem(shared)
        search = least_squares(problem, search, limit, options.report)
        return search, assessed(problem, end_of(problem, search), options.rtol)

    return jax.lax.map(one, (lanes, search), batch_size=group)


def block_sizes(count: int, asked: int | None) -> tuple[int, int]:
    """Return the numbers of balls that one call advances, and of those in lockstep, a divisor.

    They are those for this kind of device, or for blocks of `asked` balls. A call holds the
    interpreter for about a millisecond. In lockstep each ball waits for the slowest.
    """
    device = _default_device()
    on_cpu = getattr(device, "platform", device or jax.default_backend()) == "cpu"
    block, group = (_BLOCK, _GROUP) if on_cpu else (_BLOCK_ON_GPU, _BLOCK_ON_GPU)
    block = block if asked is None else asked
    # Few balls fill no block: a power of two does not compile again for one more.
    block = min(block, 1 << (count - 1).bit_length())
    return block, math.gcd(block, group)


def _default_device() -> Any:
    """Return the device chosen for this thread; None for JAX's own choice."""
    config: Any = jax.config
    return config.jax_default_device


def search_all(
    shared: FitProblem,
    lanes: Balls,
    options: SearchOptions,
    blocks: tuple[int, int],
    tell: Callable[[int, int], None],
) -> tuple[SearchEnd, list[np.ndarray]]:
    """Return the ends of the searches of all lanes, and the loss after each step of each lane.

    `tell` is called with the number of finished lanes and of all. The ends hold no history.
    """
    count, portion = len(lanes.y), _PORTION * blocks[0]
    ends: list[SearchEnd] = []
    histories: list[np.ndarray] = []
    for first in range(0, count, portion):
        end = _portion(shared, rows_of(lanes, slice(first, first + portion)), options, blocks)
        histories += [h[:n].copy() for h, n in zip(end.history, end.steps, strict=True)]
        ends.append(end._replace(history=None))
        tell(min(first + portion, count), count)
    return jax.tree.map(lambda *parts: np.concatenate(parts), *ends), histories


def _portion(
    shared: FitProblem, lanes: Balls, options: SearchOptions, blocks: tuple[int, int]
) -> SearchEnd:
    """Return the ends of some lanes, which are packed into blocks again and again."""
    (block, group), count = blocks, len(lanes.y)
    known: Any = ()
    device = _default_device()
    active, limit = np.arange(count), _FIRST

    def advanced(some: Int[np.ndarray, " m"]) -> Any:
        rows = np.concatenate([some, np.repeat(some[-1:], block - len(some))])
        mine = rows_of(lanes, rows)
        with in_double(), jax.default_device(device):
            if known:
                search = rows_of(known[0], rows)
            else:
                # Through NumPy: the types of later rounds, which compile no second program.
                search = in_numpy(_begun(shared, mine, options.max_steps))
            # Lanes that only fill the block make no step.
            search = search._replace(ended=search.ended | (np.arange(block) >= len(some)))
            moved = _advanced(shared, mine, search, np.asarray(limit), options, group)
        return rows_of(in_numpy(moved), slice(len(some)))

    while active.size:
        limit = min(limit, options.max_steps)
        every = [active[first : first + block] for first in range(0, len(active), block)]
        # The first block compiles for the others.
        jobs = [functools.partial(advanced, some) for some in every[1:]]
        moved = itertools.chain([advanced(every[0])], side_by_side(jobs, os.cpu_count() or 1))
        parts = list(moved)
        known = known or jax.tree.map(lambda x: np.empty((count, *x.shape[1:]), x.dtype), parts[0])
        for some, part in zip(every, parts, strict=True):
            for whole, x in zip(jax.tree.leaves(known), jax.tree.leaves(part), strict=True):
                whole[some] = x
        search = known[0]
        active = active[~search.ended[active] & (search.step[active] < options.max_steps)]
        limit = math.ceil(_MORE * limit)
    return known[1]
