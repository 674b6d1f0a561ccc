"""The two impacts of Eq. 15 in Figs. 3 and 4, solved once for both."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from .._contact import Contact
from .._laws import ConstantDamping
from ._impacts import SolvedImpacts, cache_by_precision, solve


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
