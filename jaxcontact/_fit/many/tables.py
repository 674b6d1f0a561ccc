"""The tables of many balls as arrays with one row for each ball, and the start of each ball: one
for all, or one for each.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ..._entry import POSITIVE, as_array, as_numbers, concrete, refusal, rendered, require_number
from ..problem.problem import as_place
from ..problem.space import Space, space_of
from ..problem.target import factor_of, groups_of, spread_of


class Tables(NamedTuple):
    """Data of B balls with n numbers each; shorter tables repeat their last point with weight 0.

    `factor` is √w or 1/σ, which is known if `absolute`. `real` marks what is not repeated. `shapes`
    are those of the data of one ball. Balls that are not `valid` have weights of 0 only.
    """

    balls: np.ndarray
    y: Float[np.ndarray, "B n"]
    factor: Float[np.ndarray, "B n"]
    x: Any
    real: Bool[np.ndarray, "B n"]
    length: Int[np.ndarray, " B"] | None
    shapes: tuple[tuple[int, ...], ...]
    valid: Bool[np.ndarray, " B"]
    absolute: bool


def tables_of(balls: Any, data: Any, x: Any, sigma: Any, weights: Any) -> Tables:
    """Return the data of every ball."""
    name, value = spread_of(sigma, weights)
    columns = [as_numbers(leaf, "data") for leaf in jax.tree.leaves(data)]
    if not columns or not columns[0].size:
        raise refusal("data", "hold a number", data)
    count = len(columns[0]) if columns[0].ndim else 0
    _refuse_other_lengths("data", data, columns, count)
    if balls is None and any(column.ndim < 2 for column in columns):
        raise refusal("data", "have the axes (balls, points) without `balls`", data)
    names, rows, length = _layout_of(balls, count)
    given = _spread(name, value, data, columns)
    spread, y = (
        np.concatenate([column[rows].reshape(len(rows), -1) for column in parts], axis=1)
        for parts in (given, columns)
    )
    factor, good = factor_of(spread, name == "sigma")
    real = np.ones(y.shape, bool)
    if length is not None:
        inside = np.arange(length.max()) < length[:, None]
        parts = [np.repeat(inside, math.prod(c.shape[1:]), axis=1) for c in columns]
        real = np.concatenate(parts, axis=1)
    good &= (factor == 0) | np.isfinite(y)
    valid = (good | ~real).all(axis=1) & ((factor > 0) & real).any(axis=1)
    factor = np.where(real & valid[:, None], factor, 0.0)
    shapes = tuple((*rows.shape[1:], *c.shape[1:]) or (1,) for c in columns)
    y, places = np.where(factor > 0, y, 0.0), _places(x, rows, count)
    return Tables(names, y, factor, places, real, length, shapes, valid, name == "sigma")


def _layout_of(
    balls: Any, count: int
) -> tuple[np.ndarray, Int[np.ndarray, "B ..."], Int[np.ndarray, " B"] | None]:
    """Return the balls, the rows (B, width) of their points, and how many; (B,) and None if each
    row of the columns is a ball.
    """
    number = groups_of(balls, count, "balls")
    if number is None:
        return np.arange(count), np.arange(count), None
    # In the order in which they first appear.
    first = np.sort(np.unique(number, return_index=True)[1])
    place = np.empty(len(first), int)
    place[number[first]] = np.arange(len(first))
    length = np.bincount(place[number])
    order, start = np.argsort(place[number], kind="stable"), np.cumsum(length) - length
    within = np.minimum(np.arange(length.max()), length[:, None] - 1)
    names = as_array(balls)
    assert names is not None
    return names.ravel()[first], order[start[:, None] + within], length


def _refuse_other_lengths(name: str, value: Any, columns: list[np.ndarray], count: int) -> None:
    if not all(column.ndim and len(column) == count for column in columns):
        like = "the same" if name == "data" else f"as long as that of `data`, {count}"
        must = f"hold arrays, no lists, whose first axis is {like}, that of the balls or points"
        raise refusal(name, must, value)


def _spread(name: str, value: Any, data: Any, columns: list[np.ndarray]) -> list[np.ndarray]:
    """Return one σ or weight for each number, from one for all or a tree like the data."""
    if value is None:
        return [np.ones_like(column) for column in columns]
    if concrete(value) is not None:
        number = require_number(name, value, POSITIVE)
        return [np.full_like(column, number) for column in columns]
    leaves = [as_numbers(leaf, name) for leaf in jax.tree.leaves(value)]
    try:
        if jax.tree.structure(value) != jax.tree.structure(data):
            raise ValueError(name)
        # Fewer axes could be those of the balls or those of the points.
        if any(x.size > 1 and x.ndim != c.ndim for x, c in zip(leaves, columns, strict=True)):
            raise ValueError(name)
        return [np.broadcast_to(x, c.shape) for x, c in zip(leaves, columns, strict=True)]
    except ValueError as error:
        raise ValueError(
            f"Argument `{name}` must be a number, or have the shapes of `data` "
            f"({', '.join(str(c.shape) for c in columns)}) with a length of 1 where all are alike, "
            f"but has the shape {', '.join(str(x.shape) for x in leaves)}: {rendered(value)}."
        ) from error


def _places(x: Any, rows: np.ndarray, count: int) -> Any:
    # In NumPy: JAX would compile a program for each new shape.
    try:
        columns = jax.tree.map(lambda leaf: np.asarray(as_place(leaf)), x)
    except TypeError as error:  # an array of JAX without numbers
        raise refusal("x", "hold numbers", x) from error
    _refuse_other_lengths("x", x, jax.tree.leaves(columns), count)
    return jax.tree.map(lambda column: column[rows], columns)


def starts_of(
    start: Any, transforms: Any, own: bool, count: int
) -> tuple[Space, Float[np.ndarray, "B k"], list[np.ndarray | None], Bool[np.ndarray, " B"]]:
    """Return the space of `count` balls, the coordinates of their starts, and which are valid.

    With `own`, arrays have a first axis of the balls. Third come the leaves that are not fitted,
    with None for those that all balls share.
    """
    if not own:
        space, theta = space_of(start, transforms)
        shared: list[np.ndarray | None] = [None] * len(space.others)
        return space, np.tile(theta, (count, 1)), shared, np.ones(count, bool)
    leaves, structure = jax.tree.flatten(start)
    arrays = [np.asarray(leaf) if np.ndim(leaf) else None for leaf in leaves]
    for array in arrays:
        if array is not None and len(array) != count:
            raise ValueError(
                f"Argument `start` must hold arrays whose first axis is that of the {count} balls "
                f"if each has its own, but holds {rendered(array)}."
            )

    def of(ball: int) -> Any:
        own = [x if a is None else a[ball] for x, a in zip(leaves, arrays, strict=True)]
        return jax.tree.unflatten(structure, own)

    refused = None
    for ball in range(count):
        try:
            space = space_of(of(ball), transforms)[0]
            break
        except ValueError as error:
            refused = refused or error
    else:
        assert refused is not None  # for the type checker
        raise refused
    columns = [
        np.broadcast_to(x if a is None else a, (count, *(shape or ()))).reshape(count, -1)
        for x, a, shape in zip(leaves, arrays, space.shapes, strict=True)
        if shape is not None
    ]
    values = np.concatenate(columns, axis=1).astype(float)
    low, high = np.asarray(space.low), np.asarray(space.high)
    valid = np.all((values > low) & (values < high), axis=1)
    ends = list(zip(space.coordinates, low.tolist(), high.tolist(), strict=True))
    theta = np.array([
        [c._to_free(v, *end) for (c, *end), v in zip(ends, row, strict=True)]
        for row in np.where(valid[:, None], values, values[np.argmax(valid)]).tolist()
    ])  # fmt: skip
    others = [a for a, shape in zip(arrays, space.shapes, strict=True) if shape is None]
    return space, theta, others, valid
