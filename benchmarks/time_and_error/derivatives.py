"""Derivatives of restitution and duration by e, K and n: a 2 × 3 Jacobian per lane."""

from __future__ import annotations

import functools
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from tests.oracle import derivative, hunt_crossley

from . import by_diffrax, by_scipy
from .by_numba import in_parallel, kernel
from .measure import LADDER, Solve, Way
from .problems import SEED, function_of
from .running import Store, named, run_cases, sweep

STIFFNESS, EXPONENT = 2.0, 1.5
"""K ≠ 1, so that the derivative by n sees its unit."""
CHECKED = 9
_SPREAD = (4, 0, 8, 2, 6, 1, 7, 3, 5)
BATCHES = (1, 100, 100_000)
SMALL = ("exact, forward", "numba 5(4), differences")
SMALL_BATCH = 1
_FORCE = "-k * x**n * (1 + a * v)"


def alpha_of(e: Any) -> Any:
    """Hu and Guo's relation."""
    return 1.5 * (1 - e) / e


class Slopes:
    """Impacts of a Hunt-Crossley law of e from 0.1 to 0.95, all with the same K and n."""

    name = "slopes"
    title = "e and duration by e, K and n"
    whole = False

    def lanes(self, count: int) -> np.ndarray:
        checked = np.array(_SPREAD) / (CHECKED - 1)
        others = np.random.default_rng(SEED).uniform(0, 1, max(count - CHECKED, 0))
        return 0.1 + 0.85 * np.concatenate([checked, others])[:count]

    def errors(self, lanes: np.ndarray, answer: Any) -> dict[str, float]:
        """Of the two gradients, relative to their largest number over the lanes."""
        want = np.array([_truth(e) for e in lanes[:CHECKED].tolist()])
        miss = np.abs(np.asarray(answer)[: len(want)] - want).max(axis=(0, 2))
        size = np.abs(want).max(axis=(0, 2))
        return dict(zip(("error_e", "error_duration"), miss / size, strict=True))


@functools.cache
def _truth(e: float) -> np.ndarray:
    """The Jacobian of a lane: T = K^(-1/(n+1)) τ(α, n), and the scaled e and τ from 40 digits."""
    alpha, slope = alpha_of(e), -1.5 / e**2
    by_alpha, by_n = (derivative(hunt_crossley, (alpha, EXPONENT), i) for i in (0, 1))
    tau, m = float(hunt_crossley(alpha, EXPONENT).duration), EXPONENT + 1
    unit = STIFFNESS ** (-1 / m)
    return np.array(
        [
            [float(by_alpha["e"]) * slope, 0.0, float(by_n["e"])],
            [
                unit * float(by_alpha["duration"]) * slope,
                -unit * tau / (m * STIFFNESS),
                unit * (float(by_n["duration"]) + np.log(STIFFNESS) / m**2 * tau),
            ],
        ]
    )


def _jacobian(mode: Any, solve: Any) -> Any:
    """`run(lanes, setting)` of a function of (e, K, n): (lanes, 2, 3)."""

    def run(e: jax.Array, setting: Any) -> jax.Array:
        def one(e: jax.Array) -> jax.Array:
            numbers = jnp.stack([e, jnp.asarray(STIFFNESS), jnp.asarray(EXPONENT)])
            return mode(lambda y: jnp.stack(solve(*y, setting)))(numbers)

        return jax.vmap(one)(e)

    return run


def ours(task: Slopes, lanes: np.ndarray, *, mode: Any, how: Any) -> Solve:
    def solve(e, k, n, setting):
        contact = jc.Contact(mass=1.0, stiffness=k, exponent=n)
        hit = jc.impact(jc.Damped(alpha=alpha_of(e)), contact, 1.0, method=how(setting))
        return hit.restitution, hit.duration

    run = jax.jit(_jacobian(mode, solve), static_argnums=1)
    return lambda setting: run(jnp.asarray(lanes), setting)


def plain_diffrax(task: Slopes, lanes: np.ndarray, *, mode: Any, adjoint: Any, solver: Any):
    def acceleration(x, s, v, a, k, n):
        # The logarithm in the derivative by n has no value at 0.
        touching = x > 0
        power = jnp.where(touching, jnp.where(touching, x, 1.0) ** n, 0.0)
        return -k * power * (1 + a * v)

    def solve(e, k, n, rtol):
        numbers = alpha_of(e), k, n
        return by_diffrax.impact(acceleration, numbers, rtol, solver(), adjoint())

    run = jax.jit(_jacobian(mode, solve))
    return lambda rtol: run(jnp.asarray(lanes), jnp.asarray(rtol))


def _differences(solve: Any, lanes: np.ndarray, rtol: float, power: float) -> np.ndarray:
    """Central differences of `solve` of an (m, 3) table of (α, K, n), with steps rtol^power."""
    point = np.stack([lanes, 0 * lanes + STIFFNESS, 0 * lanes + EXPONENT], axis=1)
    step = rtol**power * point
    places = []
    for k in range(3):
        for sign in (1, -1):
            moved = point.copy()
            moved[:, k] += sign * step[:, k]
            places.append(moved)
    table = np.concatenate(places)
    table[:, 0] = alpha_of(table[:, 0])
    found = np.stack(solve(table)).reshape(2, 3, 2, -1)
    slopes = (found[:, :, 0] - found[:, :, 1]) / (2 * step.T)
    return np.moveaxis(slopes, -1, 0)


def scipy_differences(task: Slopes, lanes: np.ndarray, *, power: float) -> Solve:
    acceleration = function_of(_FORCE, "x, s, v, a, k, n")

    def solve(table, rtol):
        found = [by_scipy.impact(acceleration, tuple(row), rtol, "DOP853") for row in table]
        return np.array(found).T

    return lambda rtol: _differences(lambda t: solve(t, rtol), lanes, rtol, power)


def numba_differences(task: Slopes, lanes: np.ndarray, *, power: float, pair: str) -> Solve:
    run = kernel(_FORCE, "a, k, n", pair, False, in_parallel(lanes), True)
    return lambda rtol: _differences(lambda t: run(t, rtol), lanes, rtol, power)


_STEPS = {"steps of rtol^(1/3)": {"power": 1 / 3}, "steps of rtol^(1/4)": {"power": 1 / 4}}
_OURS = {
    "exact": (lambda setting: "exact", (0.0,), "", 100_000),
    "phase": (lambda s: jc.Phase(int(s), tolerance=0.1), (32, 64), "steps", 5_000),
    "event": (lambda rtol: jc.Event(rtol=rtol), (1e-9, 1e-11), "rtol", 1_000),
}
_MODES = {"forward": jax.jacfwd, "reverse": jax.jacrev}
_ADJOINTS = {
    "ForwardMode": (jax.jacfwd, diffrax.ForwardMode),
    "RecursiveCheckpointAdjoint": (jax.jacrev, diffrax.RecursiveCheckpointAdjoint),
}
_SOLVERS = {s.__name__: {"solver": s} for s in (diffrax.Tsit5, diffrax.Dopri8)}
_HERE = ("derivatives.py",)
WAYS = (
    *(
        Way(
            f"{name}, {direction}",
            "ours",
            functools.partial(ours, mode=mode, how=how),
            settings=settings,
            word=word,
            most=most,
            files=_HERE,
        )
        for name, (how, settings, word, most) in _OURS.items()
        for direction, mode in _MODES.items()
    ),
    *(
        Way(
            f"diffrax {name}",
            "diffrax",
            functools.partial(plain_diffrax, mode=mode, adjoint=adjoint),
            variants=_SOLVERS,
            most=1_000,
            files=_HERE,
        )
        for name, (mode, adjoint) in _ADJOINTS.items()
    ),
    Way(
        "scipy DOP853, differences",
        "scipy",
        scipy_differences,
        settings=(*LADDER, 1e-13),
        variants=_STEPS,
        most=5,
        compiled=False,
        files=_HERE,
    ),
    *(
        Way(
            f"numba {word}, differences",
            "numba",
            functools.partial(numba_differences, pair=pair),
            settings=(*LADDER, 1e-13),
            variants=_STEPS,
            most=5_000,
            needs="numba",
            files=_HERE,
        )
        for word, pair in (("5(4)", "fifth"), ("8(5,3)", "eighth"))
    ),
)


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks, options first."""
    ways = named(WAYS, only, SMALL if small else None)
    if not small:
        sweep(store, "slope options", Slopes(), ways, BATCHES[-1])
    batches = (SMALL_BATCH,) if small else BATCHES
    cases = [(Slopes(), way, batches) for way in ways]
    run_cases(store, "derivatives", cases, "slope options")
