"""The checked data of a fit: one vector, and the weight of each point."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from ..._entry import as_array, as_numbers, as_weights, concrete, refusal, rendered
from ..._text.words import first_few

_ROUNDED = 1e-9


def target_of(data: Any, sigma: Any, weights: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return measured values y (n,), and the factor √w or 1/σ (n,) of each residual."""
    name, value = spread_of(sigma, weights)
    y = _vector(data, "data")
    if y.size == 0:
        raise refusal("data", "hold a number", data)
    given = np.ones_like(y) if value is None else _spread(value, y.size, name)
    known = name == "sigma"
    factor, good = factor_of(given, known)
    allowed = "positive (inf leaves a point out)" if known else "finite and not negative"
    _refuse(~good, given, name, allowed)
    used = factor > 0
    if not used.any():
        must = f"not be {'infinite' if known else 'zero'} everywhere"
        raise refusal(name, must, sigma if known else weights)
    allowed = "finite; give a point the weight 0 to leave it out"
    _refuse(used & ~np.isfinite(y), y, "data", allowed)
    return np.where(used, y, 0.0), factor


def spread_of(sigma: Any, weights: Any) -> tuple[str, Any]:
    """Return the name and the value of the one that is given; raise ValueError for both."""
    if sigma is not None and weights is not None:
        raise ValueError("Argument `weights` must be None with `sigma`, but both are given.")
    return ("weights", as_weights(weights)) if sigma is None else ("sigma", sigma)


def factor_of(spread: np.ndarray, known: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return 1/σ of a known σ, or √w of a weight w, and which of them are valid."""
    with np.errstate(all="ignore"):
        factor = 1 / spread if known else np.sqrt(spread)
    return factor, spread > 0 if known else (spread >= 0) & np.isfinite(spread)


def groups_of(names: Any, count: int, argument: str = "groups") -> np.ndarray | None:
    """Return the group number (n,) of each point; raise ValueError unless each has a name."""
    if names is None:
        return None
    given = None if isinstance(names, np.ma.MaskedArray) else as_array(names)
    try:
        if given is None or given.dtype.kind in "Vc":
            raise TypeError("no names")
        given = given.ravel()
        if given.dtype == object and not all(isinstance(x, str | int | float) for x in given):
            raise TypeError("names of other types")
        if given.dtype.kind in "fO" and any(x != x for x in given):
            raise TypeError("a missing name, which is NaN")
        number = np.unique(given, return_inverse=True)[1]  # mixed texts and numbers have no order
    except TypeError as error:
        raise ValueError(
            f"Argument `{argument}` must have one name for each of the {count} points, all numbers "
            f"or all texts, but is {rendered(names)}."
        ) from error
    if number.size != count:
        raise ValueError(
            f"Argument `{argument}` must have one name for each of the {count} points, but has "
            f"{number.size}: it is {rendered(names)}."
        )
    return number


def whitener_of(correlation: Any, used: np.ndarray) -> np.ndarray | None:
    """Return the inverse (n, n) of the lower factor of a correlation, of the points `used`."""
    if correlation is None:
        return None
    given, n = as_numbers(correlation, "correlation"), used.size
    good = given.shape == (n, n) and np.isfinite(given).all()
    good = good and np.allclose(given, given.T, rtol=0, atol=_ROUNDED)
    if not good or not np.allclose(np.diag(given), 1, rtol=0, atol=_ROUNDED):
        must = f"be a symmetric matrix of shape ({n}, {n}) with 1 on its diagonal"
        raise refusal("correlation", must, correlation)
    whole = np.where(used[:, None] & used, given, np.eye(n))
    try:
        factor = np.linalg.cholesky(whole)
    except np.linalg.LinAlgError as error:
        raise refusal("correlation", "be positive definite", correlation) from error
    return np.linalg.solve(factor, np.eye(n))


def _vector(tree: Any, name: str) -> np.ndarray:
    """Return all numbers of a tree as one vector."""
    try:
        leaves = [as_numbers(leaf, name).ravel() for leaf in jax.tree.leaves(tree)]
    except (TypeError, ValueError) as error:
        raise refusal(name, "hold real numbers", tree) from error
    return np.concatenate(leaves) if leaves else np.zeros(0)


def _spread(value: Any, count: int, name: str) -> np.ndarray:
    """Return one number for each point, from a number for all or a tree like the data."""
    if concrete(value) is not None:
        return np.full(count, as_numbers(value, name))
    given = _vector(value, name)
    if given.size != count:
        raise ValueError(
            f"Argument `{name}` must have one number, or one for each of the {count} points of "
            f"`data`, but has {given.size}: it is {rendered(value)}."
        )
    return given


def _refuse(bad: np.ndarray, values: np.ndarray, name: str, allowed: str) -> None:
    if bad.any():
        named = first_few([f"{values[i]:g} at point {i}" for i in np.flatnonzero(bad)])
        raise ValueError(f"Argument `{name}` must be {allowed}, but is {named}.")
