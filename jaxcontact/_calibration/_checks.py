"""Checks of measured columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from .._parameter import RESTITUTION, Range

Column = Float[np.ndarray, " n"]


def column(
    value: ArrayLike,
    name: str,
    allowed: Range,
    length: int | None = None,
    *,
    least: int = 1,
    gaps: bool = False,
) -> Column:
    """A measured column (n,), every number of it in its range; with `gaps`, NaN is no measurement.

    Raises ValueError that names the first bad point.
    """
    array = np.asarray(value, float)
    if array.ndim != 1 or array.size < least:
        enough = f" with at least {least} points" if least > 1 else ""
        raise ValueError(
            f"Argument `{name}` must have the shape (points,){enough}, but is of shape "
            f"{array.shape}."
        )
    if length is not None and array.size != length:
        raise ValueError(
            f"Argument `{name}` must have one number for each of the {length} points, but has "
            f"{array.size}."
        )
    bad = ~(allowed.holds(array) | (gaps & np.isnan(array)))
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"Argument `{name}` must be in {allowed}, but is {array[i]:g} at point {i}."
        )
    return array


def asked_and_delivered(e_in: ArrayLike, e_out: ArrayLike | None) -> tuple[Column, Column]:
    """The columns `e_in` and `e_out` in (0, 1]; without `e_out`, what is asked for twice."""
    asked = column(e_in, "e_in", RESTITUTION)
    return asked, asked if e_out is None else column(e_out, "e_out", RESTITUTION, len(asked))


def measured(
    given: Mapping[str, tuple[Any, Any, Range]],
    length: int,
    *,
    gaps: bool = False,
    weight: Callable[[Column], float] = lambda values: 1.0,
) -> dict[str, Any]:
    """The arguments `data` and `sigma` or `weights` of `fit`, from two columns by name.

    `given` holds values, standard deviations and range of each; None where there are none. Without
    standard deviations a column counts with its `weight`. Raises ValueError without a column, for
    bad ones, and for standard deviations of only one of them.
    """
    there = {name: one for name, one in given.items() if one[0] is not None}
    if not there:
        either = " or ".join(f"`{name}`" for name in given)
        raise ValueError(f"Argument {either} must be given, but both are None.")
    data = {
        name: column(values, name, allowed, length, gaps=gaps)
        for name, (values, _, allowed) in there.items()
    }
    sigmas = {name: sigma for name, (_, sigma, _) in there.items() if sigma is not None}
    if sigmas and len(sigmas) < len(data):
        both = " and ".join(f"`sigma_{name}`" for name in given)
        raise ValueError(f"Arguments {both} must be given for both columns or for none.")
    if sigmas:
        return {"data": data, "sigma": _filled(data, sigmas, np.inf)}
    weights = {name: weight(values) for name, values in data.items()}
    return {"data": data, "weights": _filled(data, weights, 0.0)}


def _filled(
    data: dict[str, Column], numbers: Mapping[str, Any], missing: float
) -> dict[str, Column]:
    """`numbers` for each point of the columns, and `missing` where nothing was measured."""
    return {name: np.where(np.isnan(data[name]), missing, numbers[name]) for name in data}


def one_of(value: str, name: str, choices: Iterable[str]) -> None:
    """Raise ValueError for a choice that is none."""
    if value not in choices:
        shown = ", ".join(map(repr, choices))
        raise ValueError(f"Argument `{name}` must be one of {shown}, but is {value!r}.")
