"""A sweep in a few lines."""

from __future__ import annotations

import math

import numpy as np

from .._impact import Status
from .._text_table import wrapped
from .._units import quantity
from ._table import Table


def shown(sweep: Table) -> str:
    """The axes with their ranges, the fields with what they depend on, and how lanes ended."""
    lengths = " × ".join(f"{name} {n}" for name, n in zip(sweep.dims, sweep.shape, strict=True))
    lines = [f"Sweep of {sweep.function}: {lengths or 'no axes'}, {math.prod(sweep.shape):,} lanes"]
    for name, values in sweep.axes.items():
        lines += _entry(name, quantity(name, _range(values)))
    if sweep.fixed:
        fixed = ", ".join(f"{k} = {_number(value)}" for k, value in sweep.fixed.items())
        lines += _entry("fixed", fixed)
    fields = []
    for name, column in sweep.columns().items():
        dims = {d for part in (column, *column.masks) for d in part.dims}
        over = ", ".join(sweep.dims[d] for d in sorted(dims))
        own = f" {column.own_shape}" if column.own_shape else ""
        fields.append(f"{name}({over}){own}")
    lines += _entry("fields", ", ".join(fields) or "none")
    counts = ", ".join(f"{n:,} {_status(code)}" for code, n in sweep.status_counts().items())
    lines += _entry("status", counts)
    if not sweep.complete:
        lines += _entry(
            "stopped", f"{100 * sweep.done:.0f} % of the work is done; the other lanes are NaN"
        )
    return "\n".join(lines)


def _status(code: int) -> str:
    return Status(code).name.lower() if code in set(Status) else f"of status {code}"


def _range(values: np.ndarray) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "none finite"
    if len(values) <= 4:
        return ", ".join(f"{value:.6g}" for value in values)
    return f"{finite.min():.6g} to {finite.max():.6g}"


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)


def _entry(head: str, text: str) -> list[str]:
    return wrapped(head, text, indent=10, lead="  ")
