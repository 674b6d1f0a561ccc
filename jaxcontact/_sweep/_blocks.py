"""A grid cut into blocks of one shape."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cut:
    """A grid of lanes, cut into blocks that are compiled for one shape.

    Leading dimensions are cut first: in C order a block is then one piece of the result, and what
    depends on leading dimensions alone is computed for few of their values in each block.
    """

    shape: tuple[int, ...]
    block: tuple[int, ...]

    @property
    def blocks(self) -> list[tuple[slice, ...]]:
        """The lanes of every block; the last one along a dimension may be shorter."""
        edges = [
            [slice(start, min(start + step, length)) for start in range(0, length, step)]
            for length, step in zip(self.shape, self.block, strict=True)
        ]
        return list(itertools.product(*edges))


_FEW = 8


def cut(shape: Sequence[int], most: int) -> Cut:
    """Blocks of at most `most` lanes."""
    block = []
    left = max(most, 1)
    for length in reversed(shape):
        step = min(left, length)
        pieces = math.ceil(length / step)
        if pieces < _FEW:
            # Nearly equal pieces need little padding. Many pieces need little anyway: their length
            # then does not depend on that of the dimension, nor does the compiled function.
            step = math.ceil(length / pieces)
        block.append(step)
        left = left // step if pieces == 1 else 1
    return Cut(tuple(shape), tuple(reversed(block)))


def padded(values: np.ndarray, piece: slice, length: int) -> np.ndarray:
    """`values[piece]`, filled up to `length` with its last element."""
    part = values[piece]
    if len(part) == length:
        return part
    return np.concatenate([part, np.repeat(part[-1:], length - len(part), axis=0)])
