"""Solving lane by lane what is written for one lane."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

In = TypeVar("In")
Out = TypeVar("Out")


def over_lanes(solve: Callable[[In], Out], problem: In) -> Out:
    """`solve` for every lane of `problem`, whose leaves broadcast against each other.

    The outcome has the broadcast shape. Leaves that are the same in all lanes are not repeated by
    the caller, so that a batch costs as many solves as there are different problems.
    """
    leaves, structure = jax.tree.flatten(problem)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in leaves))
    if shape == ():
        return solve(problem)
    count = math.prod(shape)
    flat = [jnp.broadcast_to(leaf, shape).reshape(count) for leaf in leaves]
    outcome = jax.vmap(solve)(jax.tree.unflatten(structure, flat))
    return jax.tree.map(lambda out: out.reshape(shape + out.shape[1:]), outcome)
