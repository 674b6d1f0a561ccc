"""The alternatives of users on a coarse grid: solve_ivp with an event, and plain diffrax.

All of them solve the scaled problem with m = K = v0 = 1, which favours them, because units cause no
difficulty there.
"""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from ..until_event import ending, until
from .collocation import Array
from .kinds import KINDS, SETTLED, Truth
from .motion_oracle import solve

EXPONENT = 1.5
DAMPINGS = np.array([0.0, *10.0 ** np.arange(-4.0, 6.5)])
PUSHES = np.array([-1e4, -1e2, -1.0, -1e-2, -1e-4, 0.0, 1e-4, 1e-2, 1.0, 1e2, 1e4])
LONGEST = 1e9
"""Scaled time after which a contact that has not ended counts as one that stays."""
MOST_CALLS = 8_000
"""Evaluations of the force after which a solve counts as failed: a hundred times the usual."""
# Its default tolerances, and the finest that it accepts.
SCIPY = {
    "scipy LSODA, default": ("LSODA", 1e-3, 1e-6),
    "scipy LSODA, finest": ("LSODA", 1e-12, 1e-14),
    "scipy DOP853, default": ("DOP853", 1e-3, 1e-6),
    "scipy DOP853, finest": ("DOP853", 1e-13, 1e-15),
}
DIFFRAX = {"diffrax Tsit5, 1e-6": 1e-6, "diffrax Tsit5, 1e-10": 1e-10}
KINDS_ASKED = ("hunt_crossley", "kuwabara_kono")


class TooManyCallsError(RuntimeError):
    """The solve goes nowhere."""


def _force(kind: str) -> Callable[..., Any]:
    n = EXPONENT
    if kind == "hunt_crossley":
        return lambda x, v, c, m: x**n * m.maximum(0.0, 1 + c * v)
    return lambda x, v, c, m: x ** (n - 1) * (x + n * c * v)


def _gap(kind: str, x: Any, v: Any, c: Any, m: Any) -> Any:
    """What vanishes where the contact is over: x, or a force that may not pull."""
    if kind != "hunt_crossley":
        return x
    return m.minimum(x, m.where(v < 0, 1 + c * v, 1.0))


def _grid() -> tuple[Array, Array]:
    damping, push = np.meshgrid(DAMPINGS, PUSHES, indexing="ij")
    return damping.ravel(), push.ravel()


def by_scipy(kind: str, way: str) -> tuple[Array, Array]:
    """e and duration over the grid; NaN where the solve failed.

    The time is infinite where the contact did not end.
    """
    method, rtol, atol = SCIPY[way]
    force = _force(kind)
    found = []
    for damping, push in zip(*_grid(), strict=True):
        calls = itertools.count()

        def rate(t, y, damping=damping, push=push, calls=calls):
            if next(calls) > MOST_CALLS:
                raise TooManyCallsError
            return y[1], push - force(max(y[0], 0.0), y[1], damping, np)

        apart = ending(lambda t, y, damping=damping: _gap(kind, y[0], y[1], damping, np))
        try:
            with np.errstate(all="ignore"):
                end = solve_ivp(
                    rate, (0, LONGEST), (0, 1), method, events=apart, rtol=rtol, atol=atol
                )
        except (TooManyCallsError, ValueError):
            found.append((np.nan, np.nan))
            continue
        if end.status == 1:
            found.append((-end.y_events[0][0, 1], end.t_events[0][0]))
        else:
            found.append((0.0, np.inf) if end.status == 0 else (np.nan, np.nan))
    return tuple(np.array(found).T)


def by_diffrax(kind: str, way: str) -> tuple[Array, Array]:
    """The same by a vmapped solve in indentation and velocity."""
    force, tolerance = _force(kind), DIFFRAX[way]

    def one(damping, push):
        def rate(t, y, args):
            # A power has no slope at 0, hence the usual guard.
            x = jnp.where(y[0] > 0, y[0], 1.0)
            pull = jnp.where(y[0] > 0, force(x, y[1], damping, jnp), 0.0)
            return jnp.stack([y[1], push - pull])

        def gap(t, y, args, **_):
            return _gap(kind, y[0], y[1], damping, jnp)

        how = {"atol": 1.0, "stop": LONGEST, "first": 1e-3, "newton": 1e-10, "most": 16_384}
        start = jnp.array([0.0, 1.0])
        return until(rate, start, gap, tolerance, solver=diffrax.Tsit5(), **how)

    solution = jax.jit(jax.vmap(one))(*map(jnp.asarray, _grid()))
    met = np.asarray(solution.result == diffrax.RESULTS.event_occurred)
    done = np.asarray(solution.result == diffrax.RESULTS.successful)
    e = np.where(met, -np.asarray(solution.ys[:, -1, 1]), np.where(done, 0.0, np.nan))
    duration = np.where(met, np.asarray(solution.ts[:, -1]), np.where(done, np.inf, np.nan))
    return e, duration


def run_all(known: dict[str, Any], only: str = "") -> dict[str, Any]:
    """`known` with the ways whose name contains `only` run again.

    Of every kind and way: error decades (rows: damping, columns: push) and counts.
    """
    damping, push = _grid()
    ways = dict.fromkeys(SCIPY, by_scipy) | dict.fromkeys(DIFFRAX, by_diffrax)
    found = {}
    for kind in KINDS_ASKED:
        problem = KINDS[kind].problem(damping, np.full(damping.size, EXPONENT), push)
        truth = functools.cache(functools.partial(solve, problem))
        for way, solver in ways.items():
            name = f"{kind}/{way}"
            if only.lower() in name.lower():
                start = time.perf_counter()
                found[name] = _compared(*solver(kind, way), truth())
                spent = f"{time.perf_counter() - start:.0f} s"
                print(name, found[name]["counts"], spent, flush=True)
            elif name in known:
                found[name] = known[name]
    return found


def _compared(e: Array, duration: Array, truth: Truth) -> dict[str, Any]:
    failed = np.isnan(e)
    settles = truth.status == SETTLED
    with np.errstate(all="ignore"):
        error = np.maximum(
            np.abs(e - truth.e) / np.maximum(truth.e, 1e-6), np.abs(duration / truth.duration - 1)
        ).astype(float)
    error = np.where(settles, np.where(np.isinf(duration), 0, 1), error)
    error = np.where(np.isfinite(error), error, 1)
    decade = np.where(failed, -99, np.ceil(np.log10(np.clip(error, 1e-16, 1)))).astype(int)
    shape = (DAMPINGS.size, PUSHES.size)
    counts = {"failed": int(failed.sum())}
    for bound in (1e-8, 1e-3):
        counts[f"within {bound:g}"] = int((~failed & (error <= bound)).sum())
    counts["wrong by more than 1e-3"] = int((~failed & (error > 1e-3)).sum())
    return {
        "counts": counts,
        "decade": decade.reshape(shape).tolist(),
        "flags": failed.astype(int).reshape(shape).tolist(),
        "total": np.ones(shape, int).tolist(),
    }
