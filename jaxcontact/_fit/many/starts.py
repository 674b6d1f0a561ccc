"""The start of each ball: one for all, or one for each."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..._entry import rendered
from ..problem.space import Space, space_of


class Starts(NamedTuple):
    """The free coordinates of the start of each ball, and which are `valid`.

    `others` are the leaves that are not fitted, with None for those that all balls share.
    """

    space: Space
    theta: Float[np.ndarray, "B k"]
    others: list[np.ndarray | None]
    valid: Bool[np.ndarray, " B"]


def starts_of(start: Any, transforms: Any, own: bool, count: int) -> Starts:
    """Return the starts of `count` balls; with `own`, arrays have a first axis of the balls.

    Raises ValueError like `space_of`, if no ball has a valid start.
    """
    if not own:
        space, theta = space_of(start, transforms)
        shared: list[np.ndarray | None] = [None] * len(space.others)
        return Starts(space, np.tile(theta, (count, 1)), shared, np.ones(count, bool))
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

    space = _first_space(of, transforms, count)
    fitted = [shape is not None for shape in space.shapes]
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
        [c.to_free(v, *end) for (c, *end), v in zip(ends, row, strict=True)]
        for row in np.where(valid[:, None], values, values[np.argmax(valid)]).tolist()
    ])  # fmt: skip
    others = [a for a, is_fitted in zip(arrays, fitted, strict=True) if not is_fitted]
    return Starts(space, theta, others, valid)


def _first_space(of: Any, transforms: Any, count: int) -> Space:
    """Return the space of the first ball with a valid start."""
    refused = None
    for ball in range(count):
        try:
            return space_of(of(ball), transforms)[0]
        except ValueError as error:
            refused = refused or error
    assert refused is not None
    raise refused
