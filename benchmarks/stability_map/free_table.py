"""Free impacts in extended precision: what depends on the damping and n alone, from a table.

Chebyshev polynomials over the decades of the damping (and over n where it is traced), through values
of the collocation oracle. They give the derivatives, too. The restitution is a formula.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from .collocation import EXTENDED, Array
from .kinds import KINDS
from .motion_oracle import QUANTITIES, solve

NODES = 22
"""Chebyshev nodes in half a decade of the damping; 16 leave 2e-14 near critical damping."""
TABLE_TOLERANCE = 1e-15
"""Of the oracle at the nodes: its largest force has a hundred times that."""
NODES_IN_N = 22
LOWEST, HIGHEST = -34, 7
"""Decades of the damping. What is weaker changes no outcome by 1e-16."""
FROM, TO = EXTENDED(1), EXTENDED(3)


class Free(NamedTuple):
    """Outcomes by name, and their derivatives by ln(damping) and by n."""

    value: dict[str, Array]
    by_damping: dict[str, Array]
    by_n: dict[str, Array]


def _chebyshev(count: int) -> tuple[Array, Array, Array]:
    """Nodes on [-1, 1], barycentric weights and the matrix of the derivative."""
    k = np.arange(count)
    x = np.cos((2 * k + 1) * np.arccos(EXTENDED(-1)) / (2 * count))
    weights = (-1.0) ** k * np.sin((2 * k + 1) * np.arccos(EXTENDED(-1)) / (2 * count))
    gap = x[:, None] - x[None] + np.eye(count)
    derivative = weights[None] / weights[:, None] / gap
    derivative[np.diag_indices(count)] = 0
    derivative[np.diag_indices(count)] = -derivative.sum(1)
    return x, weights, derivative


def _basis(x: Array, count: int) -> Array:
    """The Lagrange polynomials at x: shape (count, lanes)."""
    nodes, weights, _ = _chebyshev(count)
    gap = x[None] - nodes[:, None]
    hit = gap == 0
    share = weights[:, None] / np.where(hit, 1, gap)
    share = np.where(hit.any(0), hit, share)
    return share / share.sum(0)


@functools.lru_cache
def _table(kind: str, n: float | None, panel: int) -> dict[str, Array]:
    """ln of the outcomes in half a decade: (nodes in n, nodes); one row where n is concrete."""
    x, *_ = _chebyshev(NODES)
    damping = 10 ** (EXTENDED(panel) / 2 + (1 + x) / 4)
    z, *_ = _chebyshev(NODES_IN_N)
    ns = np.array([EXTENDED(n)]) if n is not None else (FROM + TO) / 2 + z * (TO - FROM) / 2
    at, of = np.meshgrid(ns, damping, indexing="ij")
    problem = KINDS[kind].problem(KINDS[kind].from_free(of.ravel()), at.ravel(), 0)
    truth = solve(problem, TABLE_TOLERANCE)
    return {q: np.log(getattr(truth, q)).reshape(at.shape) for q in QUANTITIES}


def free(kind: str, damping: Array, n: Array | float) -> Free:
    """The free impacts of lanes, by the damping number of the kind."""
    described = KINDS[kind]
    variable, slope = described.to_free(np.asarray(damping, EXTENDED))
    floor = EXTENDED(10) ** LOWEST
    safe = np.maximum(variable, floor)
    position = 2 * np.log10(safe)
    panels = np.clip(np.floor(position), 2 * LOWEST, 2 * HIGHEST).astype(int)
    concrete = float(n) if np.ndim(n) == 0 else None
    where_n = np.broadcast_to(np.asarray(n, EXTENDED), safe.shape)
    _, _, d_damping = _chebyshev(NODES)
    _, _, d_n = _chebyshev(NODES_IN_N)
    shape = safe.shape
    value, by_damping, by_n = ({q: np.zeros(shape, EXTENDED) for q in QUANTITIES} for _ in range(3))
    for panel in np.unique(panels):
        k = np.flatnonzero(panels == panel)
        along = _basis(2 * (position[k] - panel) - 1, NODES)
        if concrete is None:
            across = _basis((where_n[k] - (FROM + TO) / 2) / ((TO - FROM) / 2), NODES_IN_N)
        else:
            across = np.ones((1, k.size), EXTENDED)
        for q, table in _table(kind, concrete, int(panel)).items():
            log = np.einsum("il,ij,jl->l", across, table, along)
            out = np.exp(log)
            value[q][k] = out
            # A panel is half a decade, [-1, 1] in its own variable: d x/d ln = 4/ln 10.
            rate = np.einsum("il,ij,jl->l", across, table @ d_damping.T, along)
            by_damping[q][k] = out * rate * 4 / np.log(EXTENDED(10)) * slope[k]
            if concrete is None:
                rate = np.einsum("il,ij,jl->l", across, d_n @ table, along)
                by_n[q][k] = out * rate * 2 / (TO - FROM)
    return Free(value, by_damping, by_n)
