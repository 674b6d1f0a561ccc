"""Many balls fitted at once beside a loop over `jc.fit`: `python -m benchmarks fit_many`.

Tables of e(v) with noise of 0.01, each of its own ball and speeds, to which the damping c (v/v_r)^p
is fitted. Loop and `fit_many` take turns on the same tables, both after their first call. The
difference of their parameters is in standard errors.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.study import Study, lines, machine

BALLS, POINTS, NOISE, REPEATS = 1000, 20, 0.01, 3
START = {"c": 3e4, "power": 0.0}
HOW = {"sigma": NOISE, "transforms": {"c": jc.Positive()}}

Row = dict[str, Any]


def predict(p: dict[str, jax.Array], v: jax.Array) -> jax.Array:
    """e(v) of one ball."""
    contact = jc.Contact(mass=0.05, stiffness=1e6)
    return jc.restitution(jc.PowerDamping(p["c"], p["power"], jnp.asarray(1.0)), contact, v)


def tables(balls: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return speeds and e (balls, POINTS), and the true c and p (balls, 2)."""
    random = np.random.default_rng(seed)
    v = np.sort(np.exp(random.uniform(np.log(0.3), np.log(5), (balls, POINTS))), axis=1)
    c = np.exp(random.uniform(np.log(5e3), np.log(1e5), balls))
    power = random.uniform(-0.4, 0.2, balls)
    e = jax.jit(jax.vmap(predict))({"c": c, "power": power}, v)
    return v, np.asarray(e) + NOISE * random.normal(size=v.shape), np.stack([c, power], axis=1)


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def compare(balls: int, repeats: int = REPEATS) -> Row:
    """Return the seconds of both ways, the largest differences, and how often the truth is held."""
    v, e, true = tables(balls)

    def loop() -> list[jc.Fit]:
        pairs = zip(v, e, strict=True)
        return [jc.fit(predict, y, START, x=x, throw=False, **HOW) for x, y in pairs]

    def at_once() -> jc.Fits:
        return jc.fit_many(predict, e, START, x=v, **HOW)

    # First calls, which compile.
    first_one, _ = timed(lambda: jc.fit(predict, e[0], START, x=v[0], throw=False, **HOW))
    first_many, _ = timed(at_once)
    spent = [(timed(loop), timed(at_once)) for _ in range(repeats)]
    alone, many = spent[-1][0][1], spent[-1][1][1]
    ok = np.array([fit.converged for fit in alone])
    assert np.array_equal(ok, np.asarray(many.ok))
    values = np.array([fit.values for fit in alone])
    errors = np.array([fit.errors for fit in alone])
    known = ok & np.isfinite(errors).all(axis=1)
    away, ours = (
        np.abs(many.values - values) / errors,
        np.stack([*many.standard_errors.values()], 1),
    )
    held = np.mean(np.abs(many.values - true)[known] < 1.96 * ours[known], axis=0)
    seconds = {"loop_s": min(a[0] for a, _ in spent), "many_s": min(b[0] for _, b in spent)}
    return {
        "balls": balls,
        "points": POINTS,
        "first_fit_s": first_one,
        "first_many_s": first_many,
        **seconds,
        "ratio": seconds["loop_s"] / seconds["many_s"],
        "converged": int(ok.sum()),
        "away": float(np.max(away[known])),
        "held": dict(zip(many.names, held.tolist(), strict=True)),
    }


def table(row: Row) -> str:
    """Return the table of the page."""
    balls = row["balls"]
    return lines(
        ["", "loop over `jc.fit`", "`jc.fit_many`"],
        [
            ("first call", f"{row['first_fit_s']:.2g} s", f"{row['first_many_s']:.2g} s"),
            (f"{balls:,} balls", f"{row['loop_s']:.2g} s", f"{row['many_s']:.2g} s"),
            ("one ball", *(f"{1e3 * row[name] / balls:.2g} ms" for name in ("loop_s", "many_s"))),
        ],
    )


def measure(known: Row | None, balls: int) -> Row:
    row = compare(balls)
    return {"machine": {name: machine()[name] for name in ("processor", "cores", "jax")}, **row}


OPTIONS = {"--balls": {"type": int, "default": BALLS}}
STUDY = Study(__file__, __doc__, measure, table, "calibrate", OPTIONS)
