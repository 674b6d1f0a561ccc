"""Cells: only spheres of neighbouring cells are searched, and no contact is missed.

Space is divided into cells at least as wide as two of the largest spheres. Touching bodies are
therefore in the same cell or in neighbouring ones. A sphere belongs to its cell until it is a skin
beyond its faces. This hysteresis keeps it from alternating between two cells. Leaving is an event:
the sphere is moved to its new cell and searched among its new neighbours. For every pair in
neighbouring cells the body searched last therefore stores the impact. Other pairs cannot meet
before one of them leaves its cell.

Along an axis that is not periodic the outermost cells extend to infinity, so that cells need no
box. The choice of cells, their number and their capacity are made before a run and stay fixed. A
full cell stops the run.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Index
from ..._program import quick
from ..arrays.arrays import SceneArrays, SceneLayout
from ..result import traced
from .touch import wall_time

SKIN = 1 / 16
"""The distance beyond the faces of its cell that a sphere may go, in widths of the cell."""

CLEAR = 1.001
"""The factor by which cells are wider than necessary, so that rounding does not matter."""

AROUND = 5
"""The least number of cells along a periodic axis. With fewer, a cell's neighbours might have more
than one nearest image."""


class CellGrid(eqx.Module):
    """The static part of cells. `axes` marks the axes along which space is divided. `cells` is the
    largest number of cells, `capacity` that of spheres in each, and `filling` the average number of
    spheres in each.
    """

    axes: tuple[bool, ...] = eqx.field(static=True)
    cells: int = eqx.field(static=True)
    capacity: int = eqx.field(static=True)
    filling: float = eqx.field(static=True)


class Lattice(eqx.Module):
    """The geometry of cells: the corner `low` of the first, `width` and `number`, (D,) each. An
    undivided axis has one cell. `fits`: whether that many cells are available.
    """

    low: Float[Array, " D"]
    width: Float[Array, " D"]
    number: Float[Array, " D"]
    needed: Index
    fits: Flag


class Cells(eqx.Module):
    """The spheres in their cells. `cell` (N, D) is the cell of every sphere, counted along each
    axis without wrapping. `table` lists the spheres of each cell, -1 for free places. `full`:
    whether a cell had no room; then neither is valid.
    """

    grid: CellGrid
    lattice: Lattice
    cell: Float[Array, "N D"]
    table: Int[Array, "cells capacity"]
    full: Flag


def lattice_of(model: SceneArrays, grid: CellGrid, position: Float[Array, "N D"]) -> Lattice:
    """Return cells around the spheres, as wide as the filling of the grid requires."""
    position = position[: model.visible]
    cut, periodic = jnp.asarray(grid.axes), jnp.asarray(model.periodic)
    least = CLEAR * 2 * jnp.max(model.radius) / (1 - 2 * SKIN)
    low, high = jnp.min(position, axis=0), jnp.max(position, axis=0)
    length = jnp.where(periodic, model.period, high - low)
    length = jnp.where(cut, jnp.maximum(length, least), 1)
    volume = jnp.prod(length) * (grid.filling / model.visible)
    width = jnp.maximum(least, volume ** (1 / max(sum(grid.axes), 1)))
    # An invalid scene may have NaN here. The count is limited to the number of cells.
    ratio = jnp.clip(length / width, 1, grid.cells)
    number = jnp.where(cut, jnp.where(periodic, jnp.floor(ratio), jnp.ceil(ratio)), 1.0)
    around = jnp.all(~cut | ~periodic | (number >= AROUND))
    needed = jnp.prod(number + jnp.where(cut & ~periodic, 2, 0))
    return Lattice(
        low=jnp.where(periodic, 0, low),
        width=jnp.where(periodic, length / number, width),
        number=number,
        needed=jnp.minimum(needed, 2.0**30).astype(int),
        fits=around & (needed <= grid.cells),
    )


def cells_of(
    lattice: Lattice, layout: SceneLayout, position: Float[Array, "M D"]
) -> Float[Array, "M D"]:
    """Return the cells of positions along each axis; 0 along an undivided axis."""
    cell = jnp.floor((position - lattice.low[None]) / lattice.width[None])
    inside = jnp.clip(cell, 0, lattice.number[None] - 1)
    many = (lattice.number > 1)[None]
    return jnp.where(many, jnp.where(jnp.asarray(layout.periodic)[None], cell, inside), 0)


def row_of(
    lattice: Lattice, layout: SceneLayout, grid: CellGrid, cell: Float[Array, "M D"]
) -> Int[Array, " M"]:
    """Return the row of the table that belongs to a cell. A divided axis that is not periodic has a
    border of cells that are always empty.
    """
    row = jnp.zeros(cell.shape[0], int)
    for axis, periodic in enumerate(layout.periodic):
        if not grid.axes[axis]:
            continue
        number, along = lattice.number[axis], cell[:, axis]
        if periodic:
            row = row * number.astype(int) + jnp.mod(along, number).astype(int)
        else:
            row = row * (number.astype(int) + 2) + along.astype(int) + 1
    return row


def fill_cells(model: SceneArrays, grid: CellGrid, position: Float[Array, "N D"]) -> Cells:
    """Return all spheres in their cells; shells are in none."""
    count = model.visible
    lattice = lattice_of(model, grid, position)
    cell = cells_of(lattice, model, position)
    row = jnp.where(lattice.fits, row_of(lattice, model, grid, cell[:count]), 0)
    order = jnp.argsort(row, stable=True)
    ranked = row[order]
    place = jnp.arange(count) - jnp.searchsorted(ranked, ranked, side="left").astype(int)
    table = jnp.full((grid.cells, grid.capacity), -1, int)
    table = table.at[ranked, place].set(order, mode="drop")
    full = ~lattice.fits | jnp.any(place >= grid.capacity)
    return Cells(grid, lattice, cell, table, full)


class Shift(NamedTuple):
    """A move of a sphere to a `cell` (D,). `row` and `place` give its old and new place in the
    table, and `entry` the value written there. `full`: whether there is no room.
    """

    cell: Float[Array, " D"]
    row: Int[Array, "2"]
    place: Int[Array, "2"]
    entry: Index
    full: Flag


def shift_of(
    layout: SceneLayout, cells: Cells, i: Index, position: Float[Array, "1 D"], leaves: Array
) -> Shift:
    """Return the move of sphere i to its current cell. If it leaves and is in the same cell, cells
    are useless: their skin is less than a rounding error.
    """
    cell = cells_of(cells.lattice, layout, position)
    both = jnp.concatenate([cells.cell[i][None], cell])
    row = row_of(cells.lattice, layout, cells.grid, both)
    stays = row[0] == row[1]
    held = cells.table[row]
    old = jnp.argmax(held[0] == i)
    new = jnp.where(stays, old, jnp.argmax(held[1] < 0))
    room = stays | (held[1][new] < 0)
    entry = jnp.where(room, i, held[1][new])
    return Shift(cell[0], row, jnp.stack([old, new]), entry, ~room | (leaves & stays))


def staying(cells: Cells, i: Index) -> Shift:
    """Return a move of sphere i to where it is; it writes to a row that does not exist."""
    nowhere, place = jnp.full(2, cells.grid.cells), jnp.zeros(2, int)
    return Shift(cells.cell[i], nowhere, place, i, jnp.zeros_like(cells.full))


def move_sphere(cells: Cells, i: Index, shift: Shift) -> Cells:
    """Return the cells after the move of sphere i."""
    (old, new), (out, into) = shift.row, shift.place
    table = cells.table.at[old, out].set(-1).at[new, into].set(shift.entry)
    cell = cells.cell.at[i].set(shift.cell)
    return Cells(cells.grid, cells.lattice, cell, table, cells.full | shift.full)


def everywhere(layout: SceneLayout) -> tuple[int, ...]:
    """Return the bodies that can be met from any cell: shells, and steadily moving fixed spheres.
    The latter do not search, so that spheres in the cells that they enter would not find them.
    """
    shells = range(layout.visible, layout.spheres)
    return tuple(sorted({*shells, *layout.driven} - {*layout.shaken}))


def neighbours(
    layout: SceneLayout, cells: Cells, who: Int[Array, " M"]
) -> tuple[Int[Array, "M C"], Bool[Array, "M C"]]:
    """Return the spheres of the cells around some spheres, and a mask of the valid entries. The
    bodies met `everywhere` come last.
    """
    ranges = [(-1, 0, 1) if cut else (0,) for cut in cells.grid.axes]
    steps = np.array(list(itertools.product(*ranges)), float)
    dtype, dimensions = cells.cell.dtype, layout.dimensions
    around = cells.cell[who][:, None] + jnp.asarray(steps, dtype)[None]
    row = row_of(cells.lattice, layout, cells.grid, around.reshape(-1, dimensions))
    spheres = cells.table[row].reshape(who.shape[0], -1)
    more = jnp.asarray(everywhere(layout), spheres.dtype)[None]
    more = jnp.broadcast_to(more, (who.shape[0], more.shape[1]))
    spheres = jnp.concatenate([spheres, more], axis=1)
    return jnp.maximum(spheres, 0), spheres >= 0


def leaving(
    layout: SceneLayout,
    cells: Cells,
    who: Int[Array, " M"],
    position: Float[Array, "M D"],
    velocity: Float[Array, "M D"],
    pull: Float[Array, "M D"],
) -> Float[Array, " M"]:
    """Return the time until spheres are a skin beyond the faces of their cells."""
    lattice, cell = cells.lattice, cells.cell[who]
    middle = lattice.low[None] + (cell + 0.5) * lattice.width[None]
    reach = (0.5 + SKIN) * lattice.width[None]
    away, zero = position - middle, jnp.zeros_like(position)
    up = wall_time(reach - away, -velocity, -pull, zero)
    down = wall_time(reach + away, velocity, pull, zero)
    open_end = ~jnp.asarray(layout.periodic)[None]
    up = jnp.where(open_end & (cell >= lattice.number[None] - 1), jnp.inf, up)
    down = jnp.where(open_end & (cell <= 0), jnp.inf, down)
    cut = jnp.asarray(cells.grid.axes)[None]
    return jnp.min(jnp.where(cut, jnp.minimum(up, down), jnp.inf), axis=-1)


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
    model: SceneArrays, position: Array | None = None, full: CellGrid | None = None
) -> CellGrid | None:
    """Return cells for spheres at their positions, by default those at the start.

    Returns None if there are few spheres, or if cells as wide as the largest of them need would
    hold too many. After `full` cells there is more room. With traced numbers equal spheres that
    fill a space evenly are assumed.
    """
    position = model.position if position is None else position
    count, dimensions = model.visible, model.dimensions
    if count < MANY:
        return None
    cut = (True,) * dimensions
    if traced((model.radius, model.period, position)):
        filling = FILLING[dimensions]
        cells = _power_of_two(2**dimensions * count / filling)
        return _worth(model, CellGrid(cut, cells, _blocks(4 * filling + 4), filling))
    least = np.where(model.periodic, AROUND, 3)
    while any(cut):
        grid = CellGrid(cut, 2**30, 0, FILLING[sum(cut)])
        lattice = _lattice_of(model, grid, position)
        enough = np.asarray(lattice.number) >= least
        if np.all(enough | ~np.array(cut)):
            break
        cut = tuple(bool(x) for x in enough & np.array(cut))
    else:
        return None
    row = np.asarray(_rows_of(lattice, model, grid, position))[:count]
    most = int(np.max(np.bincount(row)))
    width = np.asarray(lattice.width)[np.array(cut)] * (1 + 2 * SKIN)
    density, volume = _DENSEST[sum(cut)]
    diameter = 2 * float(np.min(np.asarray(model.radius)[:count]))
    packed = density * float(np.prod(width + diameter)) / (volume * diameter ** sum(cut))
    if sum(cut) < dimensions:
        packed = math.inf
    capacity = _blocks(max(most + 2, min(packed, 1.5 * most + 1)))
    cells = _power_of_two(lattice.needed)
    if full is not None and full.axes == cut:
        # No smaller than before, so that the programs can be reused.
        cells, capacity = max(cells, full.cells), max(capacity, full.capacity)
    return _worth(model, CellGrid(cut, cells, capacity, FILLING[sum(cut)]))


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
