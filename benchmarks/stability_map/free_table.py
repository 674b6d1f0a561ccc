"""Free impacts in extended precision, which depend on the damping and n only, from a table.

Chebyshev polynomials interpolate values of the collocation oracle. They run over the damping where
it is weak, over parts of its decades elsewhere, and over n if it is traced. They also give the
derivatives; over the decades of weak damping these would be rounding of the values.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from .collocation import EXTENDED, Array
from .kinds import KINDS, QUANTITIES
from .motion_oracle import solve

NODES = 18
"""Chebyshev nodes in a panel of the damping."""
TABLE_TOLERANCE = 1e-15
"""Of the oracle at the nodes: its largest force has a hundred times that."""
NODES_IN_N = 32
"""Near critical damping 22 leave 1e-11."""
ROUNDING = {"damping": 1e-16, "n": 1e-14}
"""Of derivatives in units of the value, measured: they are differences of values at the nodes."""
_KINKS = np.log10([0.5, np.sqrt(1 / 3)])
EDGES = np.unique(
    np.concatenate(
        [np.arange(-34.0, -2.0), np.arange(-12, 12) / 6, _KINKS, np.arange(2.0, 7.5, 0.5)]
    )
)
"""Panels in log10 of the damping. What is weaker changes no outcome by 1e-16; the narrow ones keep
their distance from the complex dampings at which two extrema of the force meet. For n = 1 the force
of oscillators is largest at touch from ζ = 1/2 on, ζ/√(1-ζ²) = √(1/3): a kink."""
WEAK = EXTENDED("1e-2")
"""Below this there is one panel in the damping itself, from zero, for contacts that end at x = 0.
Others end at a power of their damping."""
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
    """ln of the outcomes in a panel: (nodes in n, nodes); one row where n is concrete."""
    x, *_ = _chebyshev(NODES)
    if panel < 0:
        damping = WEAK * (1 + x) / 2
    else:
        low, high = EXTENDED(EDGES[panel]), EXTENDED(EDGES[panel + 1])
        damping = 10 ** ((low + high) / 2 + x * (high - low) / 2)
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
    position = np.log10(np.maximum(variable, EXTENDED(10) ** EDGES[0]))
    panels = np.clip(np.searchsorted(EDGES, position, side="right") - 1, 0, EDGES.size - 2)
    if described.ends_at_touch:
        panels = np.where(variable < WEAK, -1, panels)
    concrete = float(n) if np.ndim(n) == 0 else None
    where_n = np.broadcast_to(np.asarray(n, EXTENDED), variable.shape)
    _, _, d_damping = _chebyshev(NODES)
    _, _, d_n = _chebyshev(NODES_IN_N)
    shape = variable.shape
    value, by_damping, by_n = ({q: np.zeros(shape, EXTENDED) for q in QUANTITIES} for _ in range(3))
    for panel in np.unique(panels):
        k = np.flatnonzero(panels == panel)
        if panel < 0:
            along = _basis(2 * variable[k] / WEAK - 1, NODES)
            by_log = 2 * variable[k] / WEAK
        else:
            low, high = EXTENDED(EDGES[panel]), EXTENDED(EDGES[panel + 1])
            along = _basis((2 * position[k] - low - high) / (high - low), NODES)
            by_log = 2 / (high - low) / np.log(EXTENDED(10))
        if concrete is None:
            across = _basis((where_n[k] - (FROM + TO) / 2) / ((TO - FROM) / 2), NODES_IN_N)
        else:
            across = np.ones((1, k.size), EXTENDED)
        for q, table in _table(kind, concrete, int(panel)).items():
            log = np.einsum("il,ij,jl->l", across, table, along)
            out = np.exp(log)
            value[q][k] = out
            rate = np.einsum("il,ij,jl->l", across, table @ d_damping.T, along)
            by_damping[q][k] = out * rate * by_log * slope[k]
            if concrete is None:
                rate = np.einsum("il,ij,jl->l", across, d_n @ table, along)
                by_n[q][k] = out * rate * 2 / (TO - FROM)
    return Free(value, by_damping, by_n)
