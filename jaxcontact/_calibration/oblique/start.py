"""Where the search for the numbers of a friction law starts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._entry import Range, ranges
from ..._friction import AbstractFriction
from .measurements import Measurements
from .model import ObliqueModel

Friction = TypeVar("Friction", bound=AbstractFriction)

_MU = np.geomspace(0.005, 3.0, 65)
"""Coefficients that are tried; neighbours differ by a tenth."""

_INSIDE = 9
_AROUND = np.array([0.125, 0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0])


@eqx.filter_jit
def _predicted(
    model: ObliqueModel,
    friction: AbstractFriction,
    names: tuple[str, ...],
    grid: Float[Array, "laws k"],
    x: dict[str, Array],
) -> dict[str, Float[Array, "laws n"]]:
    """Return the outcomes of a friction law with the numbers of each row of a grid."""
    return jax.vmap(lambda numbers: model(_with(friction, names, numbers), x))(grid)


def _with(friction: Friction, names: Sequence[str], numbers: Any) -> Friction:
    """Return a friction law with other numbers."""
    return eqx.tree_at(lambda law: [getattr(law, name) for name in names], friction, list(numbers))


def lowest(friction: Friction, there: Measurements, fixed: frozenset[str]) -> Friction:
    """Return the friction law whose numbers on a grid have the lowest loss.

    The loss of laws without a tangential spring has flat parts, where all impacts stick or all
    slide, and several minima. A search by derivatives from any start may end in one of them. The
    numbers of the given law are on the grid; `fixed` ones and arrays stay.
    """
    numbers = {
        name: allowed
        for name, allowed in ranges(friction).items()
        if name not in fixed and np.shape(getattr(friction, name)) == ()
        if getattr(friction, name) is not None
    }
    if not numbers:
        return friction
    axes = [_tried(name, float(getattr(friction, name)), one) for name, one in numbers.items()]
    grid = np.array(list(itertools.product(*axes)))
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        x = {name: jnp.asarray(values) for name, values in there.x.items()}
        outcome = _predicted(there.model, friction, tuple(numbers), jnp.asarray(grid), x)
    loss = np.zeros(len(grid))
    for name, values in there.table["data"].items():
        factor = there.factor[name]
        off = np.where(factor > 0, np.asarray(outcome[name]) - values, 0) * factor
        loss += np.sum(np.square(off), axis=1)
    if not np.isfinite(loss).any():
        return friction
    best = grid[int(np.nanargmin(loss))]
    return _with(friction, tuple(numbers), map(jnp.asarray, best))


def _tried(name: str, value: float, allowed: Range) -> np.ndarray:
    """Return the numbers to try for one parameter, its own among them if it can be fitted."""
    if name == "mu":
        tried = _MU
    elif math.isfinite(allowed.low) and math.isfinite(allowed.high):
        tried = np.linspace(allowed.low, allowed.high, _INSIDE + 2)[1:-1]
    else:
        return np.unique(value * _AROUND)
    inside = allowed.low < value < allowed.high
    return np.unique([*tried, value]) if inside else tried
