"""The choice of cells before a run: whether to use them, their number and their capacity."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Array

from ..._program import quick
from ..arrays.arrays import Numbers, SceneLayout
from ..result import traced
from .cells import AROUND, SKIN, CellGrid, Lattice, cells_of, lattice_of, row_of

MANY = 256
"""The least number of spheres for cells. Measured: with so few in a three-dimensional box cells
save almost nothing. With 2048 discs an impact is six times cheaper."""

FILLING = {1: 3.0, 2: 3.0, 3: 1.0}
"""The average number of spheres in a cell, by the number of divided axes."""

_DENSEST = {1: (1.0, 1.0), 2: (0.9069, math.pi / 4), 3: (0.7405, math.pi / 6)}
"""The densest packing of equal spheres, and the volume of a sphere of diameter one."""

_BLOCK = 4
"""Capacities are multiples of this number, so that runs share their programs."""


def grid_of(
    layout: SceneLayout,
    numbers: Numbers,
    position: Array | None = None,
    full: CellGrid | None = None,
) -> CellGrid | None:
    """Return cells for spheres at their positions, by default those at the start.

    Returns None if there are few spheres, or if cells as wide as the largest of them need would
    hold too many. After `full` cells there is more room. With traced numbers equal spheres that
    fill a space evenly are assumed.
    """
    position = numbers.position if position is None else position
    count, dimensions = layout.visible, layout.dimensions
    if count < MANY:
        return None
    cut = (True,) * dimensions
    if traced((numbers.radius, numbers.period, position)):
        filling = FILLING[dimensions]
        cells = _power_of_two(2**dimensions * count / filling)
        return _worth(layout, CellGrid(cut, cells, _blocks(4 * filling + 4), filling))
    least = np.where(layout.periodic, AROUND, 3)
    while any(cut):
        grid = CellGrid(cut, 2**30, 0, FILLING[sum(cut)])
        lattice = _lattice_of(layout, numbers, grid, position)
        enough = np.asarray(lattice.number) >= least
        if np.all(enough | ~np.array(cut)):
            break
        cut = tuple(bool(x) for x in enough & np.array(cut))
    else:
        return None
    row = np.asarray(_rows_of(lattice, layout, grid, position))[:count]
    most = int(np.max(np.bincount(row)))
    width = np.asarray(lattice.width)[np.array(cut)] * (1 + 2 * SKIN)
    density, volume = _DENSEST[sum(cut)]
    diameter = 2 * float(np.min(np.asarray(numbers.radius)[:count]))
    packed = density * float(np.prod(width + diameter)) / (volume * diameter ** sum(cut))
    if sum(cut) < dimensions:
        packed = math.inf
    capacity = _blocks(max(most + 2, min(packed, 1.5 * most + 1)))
    cells = _power_of_two(lattice.needed)
    if full is not None and full.axes == cut:
        # No smaller than before, so that the programs can be reused.
        cells, capacity = max(cells, full.cells), max(capacity, full.capacity)
    return _worth(layout, CellGrid(cut, cells, capacity, FILLING[sum(cut)]))


_lattice_of = quick(lattice_of)


@quick
def _rows_of(lattice: Lattice, layout: SceneLayout, grid: CellGrid, position: Array) -> Array:
    return row_of(lattice, layout, grid, cells_of(lattice, layout, position))


def _worth(layout: SceneLayout, grid: CellGrid) -> CellGrid | None:
    """Return the grid, unless neighbours are nearly all spheres."""
    visited = 3 ** sum(grid.axes) * grid.capacity
    return grid if 2 * visited <= layout.visible else None


def _power_of_two(number: float | Array) -> int:
    return 1 << max(math.ceil(number) - 1, 1).bit_length()


def _blocks(number: float) -> int:
    return _BLOCK * math.ceil(number / _BLOCK)
