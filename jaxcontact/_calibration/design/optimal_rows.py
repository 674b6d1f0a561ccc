"""The readings that best determine the parameters of a linear model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

_STARTS = 8
_GAIN = 1e-9
"""Least improvement of a criterion."""

_FLOOR = 1e-12
"""Regularisation for too few readings, relative to the information of all candidates."""

Matrices = Float[np.ndarray, "m k k"]
Criterion = Callable[[Matrices], Float[np.ndarray, " m"]]
"""A function of information matrices that is minimised."""


def by_volume(information: Matrices) -> Float[np.ndarray, " m"]:
    """Return -ln det M/k: the mean logarithm of the squared axes of the error ellipsoid."""
    return -np.linalg.slogdet(information)[1] / information.shape[-1]


def by_parameter(index: int) -> Criterion:
    """Return the criterion ln (M⁻¹)_ii, of the squared standard error of one parameter."""

    def criterion(information: Matrices) -> Float[np.ndarray, " m"]:
        return np.log(np.linalg.inv(information)[:, index, index])

    return criterion


def best_rows(
    slopes: Float[np.ndarray, "m k"], count: int, criterion: Criterion
) -> Int[np.ndarray, " count"]:
    """Return the `count` rows of `slopes`, which may repeat, whose Σ x xᵀ has the least criterion.

    Exchanges rows for better ones while possible, from several starts (Fedorov 1972, Theory of
    Optimal Experiments; Nguyen & Miller 1992, doi 10.1016/0167-9473(92)90064-M).
    """
    scale = np.linalg.norm(slopes, axis=0)
    rows = slopes / scale
    products = rows[:, :, None] * rows[:, None, :]
    floor = _FLOOR * np.eye(rows.shape[1])
    random = np.random.default_rng(0)
    best, lowest = np.zeros(count, int), np.inf
    for _ in range(_STARTS):
        chosen = random.integers(len(rows), size=count)
        value = np.inf
        while True:
            before = value
            for place in range(count):
                others = products[np.delete(chosen, place)].sum(axis=0) + floor
                values = criterion(others + products)
                better = int(np.argmin(values))
                if values[better] < value - _GAIN:
                    chosen[place], value = better, float(values[better])
            if not value < before - _GAIN:
                break
        if value < lowest - _GAIN:
            best, lowest = np.sort(chosen), value
    return best


def shared_out(weights: Float[np.ndarray, " m"], count: int) -> Int[np.ndarray, " m"]:
    """Return integers that add up to `count`, nearly in proportion to weights.

    The efficient rounding of Pukelsheim & Rieder (1992), doi 10.1093/biomet/79.4.763.
    """
    support = np.flatnonzero(weights)
    # With more places than readings, use the heaviest.
    support = support[np.argsort(-weights[support], kind="stable")[:count]]
    share = weights[support] / weights[support].sum()
    whole = np.ceil((count - len(support) / 2) * share).astype(int)
    while whole.sum() < count:
        whole[np.argmin(whole / share)] += 1
    while whole.sum() > count:
        whole[np.argmax((whole - 1) / share)] -= 1
    result = np.zeros(len(weights), int)
    result[support] = whole
    return result
