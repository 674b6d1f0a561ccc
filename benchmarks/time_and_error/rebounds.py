"""The task of the engines: a ball that must rebound with a given e, and their settings.

One ball, one plane, no gravity. Engines with a restitution parameter receive it. The others receive
its conversion by their documentation or the paper cited there. Alternatively all receive the result
of `jc.export`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

import jaxcontact as jc
from tests.engines.test_export import engines as documented

MASS, STIFFNESS, SPEED, RADIUS = 1.0, 1.4e8, 4.2, 0.1
"""The ball of Hu and Guo's paper: kg, N/m^(3/2), m/s, and m."""
ASKED = (0.9, 0.7, 0.5, 0.3, 0.15)
PHASES = (0.5, 0.1, 0.9, 0.3, 0.7)
"""By which part of a step the ball starts above the plane, each e its own."""
IMPEDANCE = 0.9

Numbers = Mapping[str, float]


class Drop(NamedTuple):
    """One ball for an engine: the numbers of its law, how long that contact lasts, in s, and where
    in a step it touches.
    """

    numbers: Numbers
    duration: float
    phase: float

    def gap(self, steps: float) -> float:
        """Height in m over the plane at the start."""
        return self.phase * SPEED * self.duration / steps

    def ladder(self, steps: float) -> tuple[float, int]:
        """The step in s, and how many: the contact, a third more of it, and the start."""
        return self.duration / steps, math.ceil(4 * steps / 3) + 3


def _exudyn(e: float, duration: float) -> Numbers:
    # It takes e; impactModel 2, the default, is by Carvalho and Martins.
    return {
        "restitutionCoefficient": e, "contactStiffness": STIFFNESS, "contactStiffnessExponent": 1.5
    }  # fmt: skip


def _mujoco(e: float, duration: float) -> Numbers:
    # It takes a damping ratio, which e determines for an oscillator.
    zeta = -math.log(e) / math.hypot(math.pi, math.log(e))
    rate = math.pi / duration / math.sqrt(1 - zeta**2)
    return {"stiffness": rate**2, "damping": 2 * zeta * rate, "impedance": IMPEDANCE}


def _drake(e: float, duration: float) -> Numbers:
    # It takes a dissipation. Hunt and Crossley's paper, cited in its documentation, determines it
    # by e.
    stiffness = MASS * (math.pi / duration) ** 2
    return {
        "hunt_crossley_dissipation": 1.5 * (1 - e) / SPEED, "point_contact_stiffness": 2 * stiffness
    }  # fmt: skip


def _jaxsim(e: float, duration: float) -> Numbers:
    # The same paper, with the exponents for which JaxSim's force is that of the paper.
    return {"K": STIFFNESS, "D": 1.5 * (1 - e) * STIFFNESS / SPEED}


def _jaxsim_exported(e: float) -> Numbers:
    # `jc.export` has no JaxSim. The law is Hunt and Crossley's, with damping in closed form.
    contact = jc.Contact(MASS, STIFFNESS)
    alpha = float(jc.ExactRestitution(e=e).damping_factor(contact, SPEED))
    return {"K": STIFFNESS, "D": alpha * STIFFNESS / SPEED}


def jaxsim_law(p: Numbers, mass: float, radius: float) -> Callable[..., float]:
    """K δ^(3/2) + D δ^(3/2) δ', pushing only; from JaxSim's code of its soft contacts."""
    return lambda x, v, v0: -max(0.0, x**1.5 * (p["K"] + p["D"] * v)) / mass


class _Engine(NamedTuple):
    own: Callable[[float, float], Numbers]
    law: Callable[..., Callable[..., float]]
    pulls: bool = True


ENGINES = {
    "exudyn": _Engine(_exudyn, documented.exudyn),
    "mujoco": _Engine(_mujoco, documented.mujoco, pulls=False),
    "drake": _Engine(_drake, documented.drake),
    "jaxsim": _Engine(_jaxsim, jaxsim_law),
}


@functools.cache
def _free(e: float) -> float:
    """How long the contact of Hu and Guo's ball lasts at this restitution."""
    contact = jc.Contact(MASS, STIFFNESS)
    return float(jc.impact(jc.ExactRestitution(e=e), contact, SPEED).duration)


@functools.cache
def numbers(engine: str, e: float, exported: bool) -> tuple[Numbers, float]:
    """What an engine is given for e, and about how long its contact lasts."""
    if not exported:
        return ENGINES[engine].own(e, _free(e)), _free(e)
    if engine == "jaxsim":
        return _jaxsim_exported(e), _free(e)
    found = jc.export(jc.ExactRestitution(e=e), jc.Contact(MASS, STIFFNESS), SPEED, engine=engine)
    more = {"contactStiffnessExponent": 1.5} if engine == "exudyn" else {}
    return {**more, **found.parameters}, found.duration


@functools.cache
def converged(engine: str, e: float, exported: bool) -> float:
    """e of the engine's law by SciPy, from the documented formula: the engine with no step."""
    kind = ENGINES[engine]
    given, duration = numbers(engine, e, exported)
    law = kind.law(given, MASS, RADIUS)
    return documented.bounce(law, SPEED, duration, pulls=kind.pulls)[0]


def lanes(count: int) -> np.ndarray:
    """Restitutions that are asked for, again and again."""
    return np.resize(ASKED, count)


def drops(engine: str, asked: np.ndarray, exported: bool) -> list[Drop]:
    """One for every lane."""
    made = [numbers(engine, float(e), exported) for e in asked]
    return [Drop(*pair, PHASES[k % len(PHASES)]) for k, pair in enumerate(made)]


class Rebound:
    """e that was asked, by the engine's own way to it or by the package's numbers."""

    whole = False

    def __init__(self, exported: bool):
        self.exported = exported
        self.name = "exported" if exported else "asked"
        self.title = "numbers by jaxcontact" if exported else "as its documents say"

    def lanes(self, count: int) -> np.ndarray:
        return lanes(count)

    def errors(self, asked: np.ndarray, answer: Any) -> dict[str, float]:
        """Relative: of the law, of the step, and of what comes out.

        `answer`: e that was delivered, and that of the law.
        """
        delivered, law = (np.asarray(x)[: len(ASKED)] for x in answer)
        want = asked[: len(ASKED)]

        def worst(got, right):
            return float(np.max(np.abs(got / right - 1)))

        return {
            "error_law": worst(law, want),
            "error_step": worst(delivered, law),
            "error_asked": worst(delivered, want),
        }
