"""Impacts solved for a figure: their paths and outcomes."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._contact import Contact
from .._impact import impact, trajectory
from .._laws import AbstractHuntCrossley


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
