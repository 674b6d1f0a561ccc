"""The searches of all balls, in blocks that one program advances."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..._program import quick
from ..problem.problem import FitProblem
from ..search.levenberg_marquardt import SearchOptions, end_of
from ..search.minimum import SearchEnd, assessed, in_numpy
from ..search.trust_region import Search, begin, least_squares

_FIRST, _MORE = 8, 1.5
"""Steps after which finished lanes leave their block, and the growth of this number.

A block lasts as long as its slowest lane.
"""

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
        pairs = zip(self.others, shared.space.others, strict=True)
        others = [x if own is None else own for own, x in pairs]
        space = dataclasses.replace(shared.space, others=others)
        return dataclasses.replace(shared, x=self.x, y=self.y, factor=self.factor, space=space)


def rows_of(tree: Any, rows: Any) -> Any:
    """Return some rows of all arrays."""
    return jax.tree.map(lambda x: x[rows], tree)


@quick
def _begun(shared: FitProblem, lanes: Balls, max_steps: int) -> Search:
    return jax.vmap(lambda lane: begin(lane.problem(shared), lane.theta, max_steps))(lanes)


@eqx.filter_jit
def _advanced(
    shared: FitProblem, lanes: Balls, search: Search, limit: Array, options: SearchOptions
) -> tuple[Search, SearchEnd]:
    def one(lane: Balls, search: Search) -> tuple[Search, SearchEnd]:
        problem = lane.problem(shared)
        search = least_squares(problem, search, limit, options.report)
        return search, assessed(problem, *end_of(search), options)

    return jax.vmap(one)(lanes, search)


def search_all(
    shared: FitProblem,
    lanes: Balls,
    options: SearchOptions,
    block: int,
    devices: Sequence[Any],
    tell: Callable[[int, int], None],
) -> tuple[SearchEnd, list[np.ndarray]]:
    """Return the ends of the searches of all lanes, and the loss after each step of each lane.

    Each block of `block` lanes runs on one of the `devices`, in turn. `tell` is called with the
    number of finished lanes and of all. The ends hold no history.
    """
    count, portion = len(lanes.y), _PORTION * block
    ends: list[SearchEnd] = []
    histories: list[np.ndarray] = []
    for first in range(0, count, portion):
        some = rows_of(lanes, slice(first, first + portion))
        end = _portion(shared, some, options, block, devices)
        histories += [h[:n].copy() for h, n in zip(end.history, end.steps, strict=True)]
        ends.append(end._replace(history=None))
        tell(min(first + portion, count), count)
    return jax.tree.map(lambda *parts: np.concatenate(parts), *ends), histories


def _portion(
    shared: FitProblem, lanes: Balls, options: SearchOptions, block: int, devices: Sequence[Any]
) -> SearchEnd:
    known: Any = ()
    active, limit = np.arange(len(lanes.y)), _FIRST
    while active.size:
        limit = min(limit, options.max_steps)
        started = []
        for turn, rows in enumerate(_padded(active, block)):
            device = devices[turn % len(devices)]
            mine = jax.device_put(rows_of(lanes, rows), device)
            if not known:
                # Through NumPy: the types of later rounds, which compile no second program.
                search = in_numpy(_begun(shared, mine, options.max_steps))
            else:
                search = rows_of(known[0], rows)
            search = jax.device_put(search, device)
            started.append((rows, _advanced(shared, mine, search, jnp.asarray(limit), options)))
        for rows, moved in started:
            parts = in_numpy(moved)
            if not known:
                known = _space_for(parts, len(lanes.y))
            for whole, part in zip(jax.tree.leaves(known), jax.tree.leaves(parts), strict=True):
                whole[rows] = part
        search = known[0]
        active = active[~search.ended[active] & (search.step[active] < options.max_steps)]
        limit = math.ceil(_MORE * limit)
    return known[1]


def _space_for(parts: Any, count: int) -> Any:
    """Return arrays for `count` rows like those of `parts`."""
    return jax.tree.map(lambda x: np.empty((count, *x.shape[1:]), x.dtype), parts)


def _padded(rows: Int[np.ndarray, " m"], block: int) -> Iterator[Int[np.ndarray, " block"]]:
    """Yield blocks of rows; the last one repeats its last row."""
    for first in range(0, len(rows), block):
        some = rows[first : first + block]
        yield np.concatenate([some, np.repeat(some[-1:], block - len(some))])
