"""Batches of oblique impacts in scaled numbers, and how errors are stated.

ψ = κu/(μ v0) of the slip speed u, χ = λκ/2, α of the normal force x^1.5 (1 + αx').
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import jaxcontact as jc

CHI = 49 / 34
"""Solid spheres of one material with ν = 0.3."""
MU = 0.3
MOBILITY = 3.5
TARGET = 1e-9


class Lanes(NamedTuple):
    """ψ1, χ, e and α of each impact."""

    psi: np.ndarray
    chi: np.ndarray
    e: np.ndarray
    alpha: np.ndarray

    def first(self, count: int) -> Lanes:
        return Lanes(*(x[:count] for x in self))


def spheres(count: int) -> Lanes:
    """Impacts of unequal spheres: every lane has its own ψ1, χ and e."""
    draw = np.random.default_rng(0)
    psi, chi = draw.uniform(0, 6, count), draw.uniform(1.1, 1.75, count)
    e = draw.uniform(0.84, 1, count)
    return Lanes(psi, chi, e, np.asarray(jc.exact_damping_factor(e)))


def elastic(count: int) -> np.ndarray:
    """ψ1 of elastic impacts of one kind of spheres: 16 % of them slide throughout."""
    return np.random.default_rng(1).uniform(0, 4.764706 / 0.84, count)


def errors(found: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """The worst and the median error of ψ2, the share of lanes above the target, and of failed."""
    wrong = np.abs(np.asarray(found) - exact)
    failed = ~np.isfinite(wrong)
    there = wrong[~failed] if not failed.all() else np.ones(1)
    return {
        "error": float(there.max()),
        "median": float(np.median(there)),
        "above": float(np.mean(failed | (wrong > TARGET))),
        "failed": float(np.mean(failed)),
    }
