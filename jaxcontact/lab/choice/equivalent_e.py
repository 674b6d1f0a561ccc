"""The parameter e with which each law of constant restitution delivers a requested value."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from ...extend import constant_laws, describe, restitutions

_GRID = 1001
"""Points of a grid, refined in one of its cells; linear interpolation is then accurate to 1e-12."""


@dataclasses.dataclass(frozen=True)
class Asked:
    """A law, the e to set in it, and its standard error; None if the law cannot deliver it.

    `least` and `most` are the delivered values at the ends of its range.
    """

    law: str
    e: float | None
    standard_error: float | None
    least: float
    most: float

    @property
    def sentence(self) -> str:
        """The law, and the e to set."""
        if self.e is None:
            return f"{self.law:20} out of range: it delivers {self.least:.3g} to {self.most:.3g}"
        error = "" if self.standard_error is None else f" ± {self.standard_error:.2g}"
        return f"{self.law:20} {self.e:.5f}{error}"


Grid = tuple[list[str], np.ndarray, np.ndarray]


def delivered_by_laws() -> Grid:
    """Return names of laws, a grid of e (laws, points) over the whole range, and the delivered e.

    A law is left out if its delivered e depends on more than e, or does not increase with it.
    """
    names = constant_laws()
    # 0 itself may be out of range; no real e is so small.
    low, high = np.full(len(names), np.finfo(np.float32).tiny), np.ones(len(names))
    place, rows = _on_grid(names, low, high)
    usable = [k for k, e in enumerate(rows) if e is not None and np.all(np.diff(e) > 0)]
    return [names[k] for k in usable], place[usable], np.array([rows[k] for k in usable])


def asked_of(delivered: float, standard_error: float | None, grid: Grid) -> tuple[Asked, ...]:
    """Return the e to set in each law to deliver the restitution `delivered` ± `standard_error`."""
    names, place, e = grid
    low, high, *_ = _around(place, e, delivered)
    place, rows = _on_grid(names, low, high)
    low, high, before, after = _around(place, np.array(rows), delivered)
    slope = (after - before) / (high - low)
    asked = low + (delivered - before) / slope
    found = []
    for k, name in enumerate(names):
        least, most = float(e[k, 0]), float(e[k, -1])
        able = least <= delivered <= most
        error = float(standard_error / slope[k]) if able and standard_error is not None else None
        found.append(Asked(name, float(asked[k]) if able else None, error, least, most))
    return tuple(found)


def _around(place: np.ndarray, e: np.ndarray, delivered: float) -> tuple[np.ndarray, ...]:
    """Return the ends of each law's grid cell that holds `delivered`, and their e."""
    rows = np.arange(len(e))
    cell = np.clip(np.sum(e < delivered, axis=1), 1, _GRID - 1)
    return place[rows, cell - 1], place[rows, cell], e[rows, cell - 1], e[rows, cell]


def _on_grid(
    names: list[str], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray | None]]:
    """Return a grid from `low` to `high` (laws,), and the e of each law on it."""
    place = np.linspace(low, high, _GRID, axis=1)
    # By class: a name may be registered again.
    classes = tuple(describe(name).cls for name in names)
    with jax.enable_x64(True):
        rows = restitutions(classes, jnp.asarray(place))
    return place, [None if row is None else np.asarray(row) for row in rows]
