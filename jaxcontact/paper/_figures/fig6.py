"""Fig. 6: the output restitution against the input restitution."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..._impact import restitution
from ..._laws import get_law
from .._reproduction import Reproduction, Table
from .style import FOUR_LAWS, REFERENCE, legend_above, sheet

GRID = np.arange(2, 201) / 200
"""Values of e_in: every 0.005 from 0.01 to 1."""

_TENTHS = np.isin(GRID, np.arange(1, 11) / 10)

RANGES = (0.1, 0.01)
"""Errors are evaluated from each of these to 1: for the table, and for the plotted curve."""

_NAMES = (*(law.key for law in FOUR_LAWS), "exact")


def fig6() -> Reproduction:
    """Plot e_out(e_in) of the four laws and of the exact law, and below it the error e_out - e_in.

    Tables: "curves"; "restitution", e_out at e_in = 0.1, 0.2 ... 1; "errors", the mean and the
    largest |e_out - e_in| of each law.
    """
    curves: Table = {"e_in": GRID}
    for name in _NAMES:
        curves[name] = np.asarray(restitution(get_law(name, e=jnp.asarray(GRID))))
    figure, (top, bottom) = sheet(2, 1, height=4.4, sharex=True)
    for law in FOUR_LAWS:
        look = {"color": law.colour, "linestyle": law.style, "linewidth": 1.3}
        e_out = curves[law.key]
        top.plot(GRID, e_out, **look, label=law.name)
        bottom.plot(GRID, e_out - GRID, **look)
    top.plot(GRID, curves["exact"], **REFERENCE, label="exact")
    bottom.axhline(0, **REFERENCE)
    top.set_xlim(0, 1)
    top.set_ylim(0, 1)
    top.set_ylabel(r"output restitution $e_\mathrm{out}$")
    bottom.set_ylabel(r"error $e_\mathrm{out} - e_\mathrm{in}$")
    bottom.set_xlabel(r"input restitution $e_\mathrm{in}$")
    legend_above(figure, top)
    tables = {
        "curves": curves,
        "restitution": {name: values[_TENTHS] for name, values in curves.items()},
        "errors": _errors(curves),
    }
    return Reproduction(figure, tables)


def _errors(curves: Table) -> Table:
    errors: Table = {"law": np.array(_NAMES)}
    off = np.abs(np.array([curves[name] for name in _NAMES]) - GRID)
    for start in RANGES:
        inside = start <= GRID
        e = GRID[inside]
        # The mean over e_in, not over grid points: the ends have half weight.
        mean = np.trapezoid(off[:, inside], e, axis=1) / (e[-1] - e[0])
        errors[f"mean_error_from_{start:g}"] = mean
        errors[f"largest_error_from_{start:g}"] = off[:, inside].max(axis=1)
    return errors
