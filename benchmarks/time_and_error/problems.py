"""The impacts that are solved by all methods, and their truth in 40 digits.

Scaled: `x'' = a(x, v)`, `x(0) = 0`, `x'(0) = 1`, until x is back at zero. For the package this is a
contact with m = K = v0 = 1. It still scales the problem; the other methods do not need to.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mpmath import mpf

import jaxcontact as jc
from tests.oracle import hunt_crossley, kuwabara_kono, oscillator, with_gravity
from tests.oracle._taylor import Phase, shoot

SEED = 0
CHECKED = 17
"""Lanes of a batch whose truth is known; they come first."""
_SPREAD = (0, 16, 8, 4, 12, 2, 14, 6, 10, 1, 15, 3, 13, 5, 11, 7, 9)


@dataclass(frozen=True)
class Problem:
    """One law, with one number that differs from lane to lane.

    `acceleration` is Python in x, s = √x, v and the number p: it is written once, and read by JAX,
    numba and SciPy with what each has for a root. `number` maps [0, 1] to p; `law` makes the
    package's law of it; `truth` gives e and duration in 40 digits.
    """

    name: str
    title: str
    acceleration: str
    number: Callable[[Any], Any]
    law: Callable[[Any], jc.AbstractLaw]
    truth: Callable[[float], tuple[Any, Any]]
    exponent: float = 1.5
    pushed: bool = False
    whole: bool = False
    """Times are told for one impact."""

    def lanes(self, count: int) -> np.ndarray:
        """`count` numbers p, of which the first are those with a known truth; one is the middle.

        The known ones lie evenly, and so do about as many of them as one wants to take.
        """
        if count == 1:
            return np.array([self.number(0.5)])
        others = np.random.default_rng(SEED).uniform(0, 1, max(count - CHECKED, 0))
        places = np.concatenate([np.array(_SPREAD) / (CHECKED - 1), others])[:count]
        return np.array([self.number(u) for u in places])

    def errors(self, lanes: np.ndarray, answer: Any) -> dict[str, float]:
        """Of e and, where there is one, of the duration."""
        want = truth(self.name, tuple(lanes[:CHECKED].tolist()))
        names = ("error_e", "error_duration")
        return {
            name: worst(got, true)
            for name, got, true in zip(names, answer, want, strict=True)
            if got is not None
        }

    def impact(self, p: jax.Array, **how: Any) -> jc.Impact:
        """The package's answer."""
        contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=self.exponent)
        if self.pushed:
            return jc.impact(self.law(p), contact, 1.0, external_force=p, **how)
        return jc.impact(self.law(p), contact, 1.0, **how)


class OwnLaw(jc.AbstractLaw):
    """A law of a user's own: K (δ^(3/2) + δ^(5/2)) + c δ δ'."""

    c: jax.Array
    tension = True

    def force(self, indentation, velocity, contact, impact_velocity):
        elastic = jc.power(indentation, 1.5) + jc.power(indentation, 2.5)
        return contact.stiffness * elastic + self.c * jnp.maximum(indentation, 0) * velocity


def _ends(found: Any) -> tuple[Any, Any]:
    return found.e, found.duration


@functools.cache
def _own(c: float) -> tuple[Any, Any]:
    # In w = √x: w³ + w⁵ + c w² v.
    force = [(mpf(1), 3, 0), (mpf(1), 5, 0), (mpf(c), 2, 1)]
    found = shoot(2, [Phase(force, {"separation": [(mpf(1), 1, 0)]})])
    return -found.velocity, found.duration


PROBLEMS = {
    problem.name: problem
    for problem in (
        Problem(
            "hunt_crossley",
            "Hunt-Crossley",
            "-x * s * (1 + p * v)",
            # Hu and Guo's relation: e from 1 to 0.1.
            lambda u: 1.5 * 0.9 * u / (1 - 0.9 * u),
            lambda p: jc.Damped(alpha=p),
            lambda p: _ends(hunt_crossley(p, 1.5)),
        ),
        Problem(
            "oscillator",
            "linear spring and dashpot",
            "-(x + 2 * p * v)",
            lambda u: 0.6 * u,
            # The parameter of the law is e.
            lambda p: jc.KelvinVoigt(e=jnp.exp(-jnp.pi * p / jnp.sqrt(1 - p * p))),
            lambda p: _ends(oscillator(p, 1)),
            exponent=1.0,
        ),
        Problem(
            "kuwabara_kono",
            "Kuwabara-Kono",
            "-s * (x + 1.5 * p * v)",
            lambda u: 1.5 * u,
            lambda p: jc.KuwabaraKono(A=p),
            lambda p: _ends(kuwabara_kono(p)),
        ),
        Problem(
            "own",
            "a law of the user's own",
            "-(x * s * (1 + x) + p * x * v)",
            lambda u: 3 * u,
            lambda p: OwnLaw(p),
            _own,
        ),
        Problem(
            "pushed",
            "Hertz with a push",
            "p - x * s",
            lambda u: 2 * u,
            lambda p: jc.Hertz(),
            lambda p: _ends(with_gravity(0, 1.5, p)),
            pushed=True,
        ),
    )
}


def function_of(text: str, arguments: str = "x, s, v, p", **names: Any) -> Callable[..., Any]:
    """The function that a problem's text spells."""
    return eval(f"lambda {arguments}: {text}", names)


@functools.cache
def truth(name: str, p: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """e and duration of some lanes, from 40 digits."""
    found = [PROBLEMS[name].truth(number) for number in p]
    return tuple(np.array([[float(x) for x in pair] for pair in found]).T)


def worst(got: Any, want: Any) -> float:
    """The largest relative error; infinite where there is no number."""
    got, want = np.asarray(got)[: len(want)], np.asarray(want)
    error = np.max(np.abs(got / want - 1))
    return float(error) if math.isfinite(error) else math.inf
