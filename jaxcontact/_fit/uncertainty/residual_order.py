"""Statistics of whether residuals follow the order of their points, and their null distribution."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

DRAWS = 1999
"""Draws of simulated noise; a probability cannot be below one in `DRAWS + 1`."""

_CLOSE, _MORE = (0.03, 0.08), 8000
"""Range of probabilities that need more draws, and their number.

`DRAWS` alone would leave an error of 0.5 % in 5 %, the same in every fit.
"""

_NUMBERS = 4_000_000
"""Numbers held at once while noise is simulated."""

_ORDERS = 2, 4
"""Numbers of slow waves in the statistics.

Two detect misfits that bend once or twice, four also those that turn back within the data.
"""

_NEW = 0.1
"""Part of a wave that the model and slower waves must leave for it to count.

A curve that the model almost describes is the first that it fails to describe.
"""

_LEAST = 2
"""Degrees of freedom that a statistic must leave to the noise."""

_ROUNDING = 1e-9
"""Relative rounding of a statistic or a sum of squares."""

_REPLICATED = 4
"""Least degrees of freedom between repeated points for an estimate of their scatter."""


@dataclasses.dataclass(frozen=True)
class Column:
    """Points measured along one variable: their indices in its order.

    `places`: where in this order each value of the variable starts.
    """

    order: Int[np.ndarray, " m"]
    places: Int[np.ndarray, " values"]


class Statistics:
    """Scale-free statistics that grow if residuals (draws, n) follow their order.

    They are shares of slow waves, F = (Σ_waves (zᵀq)²/m)/(rest/(ν-m)); the correlation of
    neighbours, Σ_l w_l Σ_i z_i z_(i+l) / Σ z²; and, for repeated points, the scatter between places
    over that within.
    """

    def __init__(
        self, columns: Sequence[Column], model: Float[np.ndarray, "n k"], factor: np.ndarray
    ) -> None:
        self._columns, n = columns, len(model)
        self._dof = n - model.shape[1]
        self._waves = [
            waves
            for count in _ORDERS
            if (waves := _slow_waves(columns, model, count)) is not None
            and self._dof - waves.shape[1] >= _LEAST
        ]
        self._factor = factor
        self.pure = n - sum(column.places.size for column in columns)
        self.repeated = self.pure >= _REPLICATED and self._dof > self.pure

    def __bool__(self) -> bool:
        return bool(self._waves)

    def __call__(self, z: Float[np.ndarray, "draws n"]) -> Float[np.ndarray, "kinds draws"]:
        # Root mean squares by column, because instruments differ in their noise.
        z = z.copy()
        for c in self._columns:
            size = np.sqrt(np.mean(z[:, c.order] ** 2, axis=1, keepdims=True))
            z[:, c.order] /= np.where(size > 0, size, 1)
        total, found = np.sum(z**2, axis=1), []
        for waves in self._waves:
            m, part = waves.shape[1], np.sum((z @ waves) ** 2, axis=1)
            found.append((part / m) / ((total - part) / (self._dof - m)))
        found.append(sum(_of_neighbours(z[:, c.order]) for c in self._columns) / total)
        if self.repeated:
            found.append(self.lack_of_fit(z))
        return np.stack(found)

    def lack_of_fit(self, z: Float[np.ndarray, "draws n"]) -> Float[np.ndarray, " draws"]:
        """Return the scatter between places over that within, each per degree of freedom.

        It is 0 if repeated points are the same to rounding, which does not determine their noise.
        """
        total, between = np.sum(z**2, axis=1), np.zeros(len(z))
        for c in self._columns:
            weight = self._factor[c.order]
            shared = np.add.reduceat(z[:, c.order] * weight, c.places, axis=1)
            between += np.sum(shared**2 / np.add.reduceat(weight**2, c.places), axis=1)
        within = total - between
        told = within > _ROUNDING * total
        within = np.where(told, within, 1) / self.pure
        return np.where(told, between / (self._dof - self.pure) / within, 0)


def _slow_waves(
    columns: Sequence[Column], model: Float[np.ndarray, "n k"], count: int
) -> Float[np.ndarray, "n m"] | None:
    """Return the slowest waves along each column that the model does not describe, orthonormal."""
    n, k = model.shape
    found: list[np.ndarray] = []
    for column in columns:
        m, new = len(column.order), 0
        place = (np.arange(m) + 0.5) / m
        for turns in range(1, min(count + k + 2, m)):
            wave = np.zeros(n)
            wave[column.order] = np.cos(np.pi * turns * place) * np.sqrt(2 / m)
            for known in (model, *(q[:, None] for q in found)):
                wave -= known @ (known.T @ wave)
            size = np.linalg.norm(wave)
            if size > _NEW:
                found.append(wave / size)
                new += 1
            if new == count:
                break
        if new < count:
            return None
    return np.stack(found, axis=1)


def share_left(
    columns: Sequence[Column], model: Float[np.ndarray, "n k"], more: Float[np.ndarray, "n m"]
) -> float:
    """Return the mean part of the slowest waves that neither the model nor `more` describes.

    The waves are those that the model does not describe, and `more` includes the model. The result
    is 0 without such waves.
    """
    waves = _slow_waves(columns, model, _ORDERS[0])
    if waves is None:
        return 0.0
    return float(np.mean(1 - np.sum((more.T @ waves) ** 2, axis=0)))


def _of_neighbours(z: Float[np.ndarray, "draws m"]) -> Float[np.ndarray, " draws"]:
    """Return weighted products of neighbours up to about √m/2 apart; the nearest weigh most."""
    m = z.shape[1]
    far = max(1, min(round(math.sqrt(m) / 2), m - 1))
    return sum(
        ((1 - (lag - 1) / far) * np.sum(z[:, lag:] * z[:, :-lag], axis=1))
        for lag in range(1, far + 1)
    ) + np.zeros(len(z))


def chance(
    statistics: Statistics,
    z: Float[np.ndarray, " n"],
    model: Float[np.ndarray, "n k"],
    noise: Callable[[int], Float[np.ndarray, "draws n"]],
) -> float:
    """Return the probability that noise alone shows as much structure as z.

    It is that of the smallest of the probabilities of all statistics, from residuals of fits to
    `noise(draws)`.
    """
    every, p, at_once = [statistics(z[None, :])], 0.0, max(1, _NUMBERS // len(model))
    for count in (DRAWS, _MORE):
        for done in range(0, count, at_once):
            draws = noise(min(at_once, count - done))
            every.append(statistics(draws - (draws @ model) @ model.T))
        # If the model is right, the measurement is one of the draws: all are ranked alike.
        least = _rank(np.concatenate(every, axis=1)).min(axis=0)
        p = float(np.mean(least <= least[0]))
        if not _CLOSE[0] < p < _CLOSE[1]:
            break
    return p


def _rank(values: Float[np.ndarray, "kinds draws"]) -> Float[np.ndarray, "kinds draws"]:
    """Return for each statistic the share of draws that are as large, up to rounding."""
    below = np.empty_like(values)
    for row, ranks in zip(values, below, strict=True):
        order = np.argsort(row)
        # Drawn signs may repeat the residuals themselves, and leave some statistics unchanged.
        ranks[order] = np.searchsorted(row[order], row[order] - _ROUNDING * np.abs(row[order]))
    return 1 - below / values.shape[1]
