"""Impacts solved for a figure, and the two impacts of Eq. 15 with Fig. 3."""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .. import AbstractHuntCrossley, ConstantDamping, Contact, impact, trajectory
from ..extend import NUMBERS, label
from ._drawing import VELOCITY, Panel, Reproduction, drawn, long_table


def cache_by_precision(make: Callable[[], SimpleNamespace]) -> Callable[[], SimpleNamespace]:
    """Return `make` as a function that runs once for each precision of JAX."""
    once = functools.cache(lambda precision: make())
    return functools.wraps(make)(lambda: once(jnp.result_type(float)))


def solve(
    law: AbstractHuntCrossley, contact: Contact, velocity: ArrayLike, samples: int
) -> SimpleNamespace:
    """Return a batch of impacts in SI units, from touch to separation, as NumPy arrays.

    Paths (..., samples): `time`, `indentation`, `velocity` and `force`. The others (...) are
    `alpha`, the numbers of an `Impact`, and `turning_force`, that at the turn.
    """
    path, hit = trajectory(law, contact, velocity, samples=samples), impact(law, contact, velocity)
    found = {name: getattr(path, name) for name in ("time", "indentation", "velocity", "force")}
    found |= {name: getattr(hit, name) for name in NUMBERS}
    found["alpha"] = law.damping_factor(contact, velocity)
    found["turning_force"] = law.force(hit.max_indentation, 0.0, contact, velocity)
    return SimpleNamespace(**{name: np.asarray(value) for name, value in found.items()})


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
NUMBER = np.arange(1, len(CASES) + 1)

MASS, STIFFNESS = 0.033, 1.07e10
"""Mass and stiffness of both cases, in kg and N/m^1.5: a steel sphere of radius 10 mm."""

RADIUS, YOUNGS_MODULUS, POISSON_RATIO = 0.01, 2.07e11, 0.3
"""Radius, modulus and Poisson's ratio of the steel sphere, in m, Pa and 1, which determine K."""

SAMPLES = 801
"""Samples of each impact: cubics through them give δ' to 7e-9 of v0, worst next to touch."""

MICRO = 1e6
_DEFORMATION = label("indentation", "deformation", prefix="µ")


@cache_by_precision
def impacts() -> SimpleNamespace:
    """Solve the two cases in JAX's precision, with the outcome in closed form."""
    law = ConstantDamping(c=jnp.asarray([case.c for case in CASES]))
    speed = jnp.asarray([case.velocity for case in CASES])
    return solve(law, Contact(mass=MASS, stiffness=STIFFNESS), speed, SAMPLES)


def fig3() -> Reproduction:
    """Plot the whole impact of both cases, with the turn as a dotted line.

    Tables: "motion" (case, time, deformation, velocity) and "impact". The latter lists for each
    case α = c v0/K, the delivered restitution, the duration, and the time and depth of the turn.
    """
    solved, above, below = impacts(), [], []
    for i, case in enumerate(CASES):
        time, v0 = MICRO * solved.time[i], case.velocity
        black = {"color": "black", "linewidth": 1.2}
        zero = None, 0, {"color": "0.7", "linewidth": 0.6}
        turn = MICRO * solved.compression_time[i], None, {"color": "0.5", "ls": ":", "lw": 0.8}
        frame = {"xlim": (0, time[-1]), "ylim": (-1.1 * v0, 1.1 * v0), "yticks": [-v0, 0, v0]}
        above.append(Panel([zero, (time, solved.velocity[i], black), turn], frame, case.label))
        frame = {"xlim": (0, time[-1]), "ylim": (0, None), "xlabel": label("time", prefix="µ")}
        below.append(Panel([(time, MICRO * solved.indentation[i], black), turn], frame))
    figure = drawn([*above, *below], 2, height=3.0)
    for ax in figure.axes:
        ax.locator_params(axis="x", nbins=4)
    for ax, words in zip(figure.axes[::2], (VELOCITY, _DEFORMATION), strict=True):
        ax.set_ylabel(words)
    for ax in figure.axes[:2]:
        ax.tick_params(labelbottom=False)
    motion = {
        "case": NUMBER[:, None],
        "time_s": solved.time,
        "deformation_m": solved.indentation,
        "velocity_m_per_s": solved.velocity,
    }
    outcome = {
        "case": NUMBER,
        "impact_velocity_m_per_s": np.array([case.velocity for case in CASES]),
        "alpha": solved.alpha,
        "restitution": solved.restitution,
        "duration_s": solved.duration,
        "compression_time_s": solved.compression_time,
        "max_deformation_m": solved.max_indentation,
    }
    return Reproduction(figure, {"motion": long_table(motion), "impact": outcome})
