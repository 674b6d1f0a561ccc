"""Columns of measurements at the door of a ready-made problem."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from .._parameter import Range

Column = Float[np.ndarray, " n"]


def column(
    value: ArrayLike, name: str, allowed: Range, length: int | None = None, *, gaps: bool = False
) -> Column:
    """A measured column (n,), every number of it in its range; with `gaps`, NaN is no measurement.

    Raises ValueError that names the first bad point.
    """
    array = np.asarray(value, float)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(
            f"Argument `{name}` must have the shape (points,), but is of shape {array.shape}."
        )
    if length is not None and array.size != length:
        raise ValueError(
            f"Argument `{name}` must have one number for each of the {length} points, but has "
            f"{array.size}."
        )
    bad = ~allowed.holds(array)
    if gaps:
        bad &= ~np.isnan(array)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"Argument `{name}` must be in {allowed}, but is {array[i]:g} at point {i}."
        )
    return array


def all_or_none(arguments: str, given: Iterable[Any]) -> bool:
    """Whether all are there, not None; ValueError that names the `arguments` if only some are."""
    known = [value is not None for value in given]
    if any(known) and not all(known):
        raise ValueError(f"Arguments {arguments} must be given for both columns or for none.")
    return all(known)


def one_of(value: str, name: str, choices: tuple[str, ...]) -> None:
    """Raise ValueError for a choice that is none."""
    if value not in choices:
        shown = ", ".join(map(repr, choices))
        raise ValueError(f"Argument `{name}` must be one of {shown}, but is {value!r}.")
