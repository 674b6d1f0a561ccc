"""Impacts solved for a figure, the two impacts of Eq. 15, and the result of figure functions."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .. import AbstractHuntCrossley, ConstantDamping, Contact, impact, trajectory
from ..extend import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class SolvedImpacts(NamedTuple):
    """A batch of impacts in SI units, from touch to separation.

    Paths (..., samples): `time`, `indentation`, `velocity` and `force`. The other fields (...) are
    α, the outcome, and the force at the turn.
    """

    time: np.ndarray
    indentation: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    alpha: np.ndarray
    turning_force: np.ndarray
    restitution: np.ndarray
    rebound_velocity: np.ndarray
    duration: np.ndarray
    compression_time: np.ndarray
    max_indentation: np.ndarray
    max_force: np.ndarray
    energy_loss: np.ndarray


def cache_by_precision(make: Callable[[], SolvedImpacts]) -> Callable[[], SolvedImpacts]:
    """Return `make` as a function that runs once for each precision of JAX."""
    once = functools.cache(lambda precision: make())
    return functools.wraps(make)(lambda: once(jnp.result_type(float)))


def solve(
    law: AbstractHuntCrossley, contact: Contact, velocity: ArrayLike, samples: int
) -> SolvedImpacts:
    """Solve the impacts of a batch of laws or speeds, with `samples` points each."""
    path = trajectory(law, contact, velocity, samples=samples)
    hit = impact(law, contact, velocity)
    turn = law.force(hit.max_indentation, 0.0, contact, velocity)
    moments = [path.time, path.indentation, path.velocity, path.force]
    moments += [law.damping_factor(contact, velocity), turn]
    outcome = [getattr(hit, name) for name in SolvedImpacts._fields[len(moments) :]]
    return SolvedImpacts(*map(np.asarray, moments + outcome))


class Case(NamedTuple):
    """A hysteresis damping factor c in N s/m^2.5, a closing speed in m/s, the published β."""

    label: str
    c: float
    velocity: float
    beta: float


CASES = (
    Case("case 1, 0.8 m/s", c=2.0e9, velocity=0.8, beta=2.408),
    Case("case 2, 0.1 m/s", c=2.0e10, velocity=0.1, beta=2.395),
)

MASS, STIFFNESS = 0.033, 1.07e10
"""Mass and stiffness of both cases, in kg and N/m^1.5: a steel sphere of radius 10 mm."""

RADIUS, YOUNGS_MODULUS, POISSON_RATIO = 0.01, 2.07e11, 0.3
"""Radius, modulus and Poisson's ratio of the steel sphere, in m, Pa and 1, which determine K."""

SAMPLES = 801
"""Samples of each impact: cubics through them give δ' to 7e-9 of v0, worst next to touch."""


@cache_by_precision
def impacts() -> SolvedImpacts:
    """Solve the two cases in JAX's precision, with the outcome in closed form."""
    law = ConstantDamping(c=jnp.asarray([case.c for case in CASES]))
    speed = jnp.asarray([case.velocity for case in CASES])
    return solve(law, Contact(mass=MASS, stiffness=STIFFNESS), speed, SAMPLES)


Table = dict[str, np.ndarray]
"""Named columns of equal length; names end in their SI unit if they have one: `time_s`."""


def long_table(columns: Mapping[str, np.typing.ArrayLike]) -> Table:
    """Return a table of columns that broadcast: one row per element, the last axis fastest."""
    arrays = np.broadcast_arrays(*map(np.asarray, columns.values()))
    return dict(zip(columns, map(np.ravel, arrays), strict=True))


class Reproduction(NamedTuple):
    """A figure, and its numbers as named tables, which the command writes as CSV."""

    figure: Figure
    tables: dict[str, Table]

    def __repr__(self) -> str:
        lines = [
            [name, f"{len(next(iter(table.values())))} rows", ", ".join(table)]
            for name, table in self.tables.items()
        ]
        header = ["tables", "", "columns"]
        return "\n".join(["Reproduction", *text_table(lines, header=header, align="<><", indent=2)])
