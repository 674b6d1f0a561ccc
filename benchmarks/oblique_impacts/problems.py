"""Batches of oblique impacts in scaled numbers, and how errors are stated.

ψ = κu/(μ v0) of the slip speed u, χ = λκ/2, α of the normal force x^1.5 (1 + αx').

Calls are measured in turn, so that other work of the machine falls on all of them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jaxcontact as jc
from benchmarks.until_event import ending, until

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


ROUNDS = 7
LONG = 1.0
"""Seconds from which a call is made twice only."""
SHORT = 0.1
"""Seconds that a turn of a shorter call is filled up to."""


class Method(NamedTuple):
    """A method on some lanes: its name, setting, call, lanes, and errors of what it returns."""

    name: str
    setting: str
    call: Callable[[], Any]
    lanes: int
    errors: Callable[[Any], dict[str, float]] = lambda answer: {}


def side_by_side(case: str, methods: list[Method]) -> list[dict[str, Any]]:
    """Return a row for each method: µs a lane, the best by the clock and the mean of the processor.

    The first call, which compiles, does not count. The processor's time sums over threads; some
    systems count it in ticks of 10 ms, so that the least of short turns would be too small.
    """
    answers = [jax.block_until_ready(method.call()) for method in methods]
    wall, used = [float("inf")] * len(methods), [(0.0, 0)] * len(methods)
    for turn in range(ROUNDS):
        for k, method in enumerate(methods):
            if turn > 1 and wall[k] > LONG:
                continue
            calls = 1 if turn == 0 else max(1, int(SHORT / wall[k]))
            start, before = time.perf_counter(), time.process_time()
            for _ in range(calls):
                jax.block_until_ready(method.call())
            used[k] = used[k][0] + time.process_time() - before, used[k][1] + calls
            wall[k] = min(wall[k], (time.perf_counter() - start) / calls)
    rows = []
    for k, method in enumerate(methods):
        row = {"case": case, "method": method.name, "setting": method.setting}
        row |= {"lanes": method.lanes, "us": _short(1e6 * wall[k] / method.lanes)}
        row["cpu_us"] = _short(1e6 * used[k][0] / used[k][1] / method.lanes)
        rows.append(row | {name: _short(x) for name, x in method.errors(answers[k]).items()})
        print(rows[-1], flush=True)
    return rows


def _short(x: float) -> float:
    return float(f"{x:.3g}")


def by_diffrax(lanes: Lanes, rtol: float) -> Callable[[], jax.Array]:
    """Plain diffrax: the limit of friction is switched inside the right-hand side."""

    def right(s, y, args):
        (w, v, psi, phi), (chi, alpha) = y, args
        most = w**3 * (1 + alpha * v)
        slope = w * w * (1 + alpha * v) * (1.5 * v - alpha * w**5)
        grows, sign = 1.5 * w * w * psi, jnp.sign(phi)
        slips = (jnp.abs(phi) >= most) & (sign * grows > slope)
        rate = jnp.where(slips, sign * slope, grows)
        held = jnp.clip(phi, -jnp.abs(most), jnp.abs(most))
        return jnp.stack([v / 2, -(w**4) * (1 + alpha * v), -2 * chi * w * held, rate])

    def parts(t, y, args, **_):
        return y[0]

    def impact(psi, chi, alpha):
        start = jnp.stack([0 * psi, 1 + 0 * psi, psi, 0 * psi])
        how = {"args": (chi, alpha), "stop": 20.0, "first": 1e-3, "newton": 1e-12, "most": 4096}
        end = until(right, start, parts, rtol, **how)
        return end.ys[-1][2]

    program = jax.jit(jax.vmap(impact))
    given = [jnp.asarray(x) for x in (lanes.psi, lanes.chi, lanes.alpha)]
    return lambda: program(*given)


def _impact(psi: float, chi: float, alpha: float, rtol: float) -> float:
    """The motion in w = √x and dt = w ds, which is smooth at touch; its state is w, v, ψ, φ."""

    def force(y):
        return y[0] ** 3 * (1 + alpha * y[1])

    def pull(y, sign):
        return sign * y[2] - (1 + alpha * y[1]) * (y[1] - 2 / 3 * alpha * y[0] ** 5)

    parts = ending(lambda s, y: y[0])
    y, sign = np.array([0.0, 1.0, psi, 0.0]), 1.0
    slides = pull(y, sign) > 0
    for _ in range(12):

        def right(s, y, slides=slides, sign=sign):
            w, v, slip, phi = y
            phi = sign * force(y) if slides else phi
            grows = 0.0 if slides else 1.5 * w * w * slip
            return v / 2, -(w**4) * (1 + alpha * v), -2 * chi * w * phi, grows

        if slides:
            ends = ending(lambda s, y, sign=sign: pull(y, sign))
        else:
            ends = ending(lambda s, y: force(y) - abs(y[3]))
        go = solve_ivp(
            right, (0, 20), y, "DOP853", events=(parts, ends), rtol=rtol, atol=rtol * 1e-2
        )
        y = go.y[:, -1].copy()
        if len(go.t_events[0]) or y[0] < 1e-9:
            return y[2]
        y[3] = sign * force(y) if slides else y[3]
        sign, slides = (sign if slides else math.copysign(1.0, y[3])), not slides
    return math.nan


def by_scipy(lanes: Lanes, rtol: float) -> Callable[[], np.ndarray]:
    """SciPy with events: slip and stick by `solve_ivp`, restarted where one ends."""
    rows = list(zip(lanes.psi, lanes.chi, lanes.alpha, strict=True))
    return lambda: np.array([_impact(*row, rtol) for row in rows])
