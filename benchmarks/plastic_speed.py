"""Plastic and adhesive impacts beside plain diffrax: `python -m benchmarks plastic_speed`.

Ten thousand impacts under a small push, which no formula solves, and the same without it. Plain
diffrax solves (δ, δ') from touch to the turn and from there to the end, each with an event, by
`vmap` over a thousand lanes at a time. For every way the cheapest setting with an error of at most
1e-8 counts, of e and of the duration. The truth of nine lanes is SciPy's DOP853 at 1e-13.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jaxcontact as jc
from benchmarks.study import Study, lines
from benchmarks.time_and_error.measure import timed
from benchmarks.time_and_error.reading import number
from benchmarks.until_event import ending, until
from tests.oracle.neck_chain import Neck
from tests.oracle.plastic_chain import thornton, walton_braun

LANES, CHECKED = 10_000, 9
ENOUGH = 1e-8
PUSH = 0.05
"""In N, with a mass of 1 kg and a stiffness of 1 N/mⁿ."""
SPEEDS = 0.3, 3.0
NECK = Neck(work=0.05 / (1.5 * math.pi), radius=1.0, modulus=0.75)
EVENT = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
DIFFRAX = (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


class Force(NamedTuple):
    """A contact as each way needs it: its law and n; the force of δ, δ' and δ_m, where δ_m = 0 is
    that of loading, and the δ at which it ends, for diffrax; both for SciPy.
    """

    law: jc.AbstractLaw
    exponent: float
    force: Callable[[Any, Any, Any], Any]
    end: Callable[[Any], Any]
    known: Callable[[float, float, float], float]


def yielding() -> Force:
    first = (1.25 * 0.5**2) ** 0.4
    c = 0.1

    def load(x: Any) -> Any:
        beyond = jnp.maximum(x - first, 0)
        return jc.power(jnp.minimum(x, first), 1.5) + 1.5 * first**0.5 * beyond

    def back(most: Any) -> tuple[Any, Any]:
        inside = jnp.maximum(most, first)
        force = load(inside)
        way = jnp.where(most > first, force / jnp.sqrt(inside), most)
        return jnp.sqrt(inside**1.5 / force), most - way

    def force(x: Any, v: Any, most: Any) -> Any:
        factor, end = back(most)
        unloads = factor * jc.power(jnp.maximum(x - end, 0), 1.5)
        return jnp.where(most > 0, unloads, load(jnp.maximum(x, 0))) * (1 + c * v)

    scipy = thornton(1.0, 1.0, 0.5, c)
    law = jc.Viscoplastic(yield_speed=0.5, c=c)

    def known(x: float, v: float, most: float) -> float:
        return scipy.force(x, v, most, most == 0)

    return Force(law, 1.5, force, lambda most: back(most)[1], known)


def springs() -> Force:
    ratio, slope = 1.5, 0.5

    def end(most: Any) -> Any:
        return most * (1 - 1 / (ratio + slope * most))

    def force(x: Any, v: Any, most: Any) -> Any:
        unloads = (ratio + slope * most) * (x - end(most))
        return jnp.where(most > 0, unloads, x)

    scipy = walton_braun(1.0, ratio, slope)

    def known(x: float, v: float, most: float) -> float:
        return scipy.force(x, v, most, most == 0)

    return Force(jc.WaltonBraun(ratio=ratio, slope=slope), 1.0, force, end, known)


def neck() -> Force:
    pull = math.sqrt(2 * math.pi * NECK.work / NECK.modulus)

    def force(x: Any, v: Any, most: Any) -> Any:
        # δ = a² - c √a with R = 1 is a quartic in √a, and its resolvent a cubic.
        x = jnp.maximum(x, NECK.snap)
        half = pull**2 / 2
        root = jnp.sqrt(jnp.maximum(half**2 + (4 * x / 3) ** 3, 0))
        side = jnp.sqrt(jnp.cbrt(half + root) + jnp.cbrt(half - root))
        root = (side + jnp.sqrt(jnp.maximum(2 * pull / side - side**2, 0))) / 2
        a = root**2
        return 4 / 3 * NECK.modulus * a**3 - jnp.sqrt(8 * math.pi * NECK.work * NECK.modulus * a**3)

    law = jc.JKR(pull_off=NECK.pull_off)

    def known(x: float, v: float, most: float) -> float:
        return NECK.force(x)

    return Force(law, 1.5, force, lambda most: jnp.full_like(most, NECK.snap), known)


CASES = {"Viscoplastic": yielding, "WaltonBraun": springs, "JKR": neck}


def lanes(count: int) -> np.ndarray:
    """Return speeds, of which the first have a known truth."""
    others = np.random.default_rng(0).uniform(0, 1, max(count - CHECKED, 0))
    places = np.concatenate([np.linspace(0, 1, CHECKED), others])[:count]
    return SPEEDS[0] * (SPEEDS[1] / SPEEDS[0]) ** places


def truth(case: Force, push: float) -> np.ndarray:
    """Return e and duration of the checked lanes."""
    found = []
    for speed in lanes(CHECKED):
        most, t, y = 0.0, 0.0, [0.0, speed]
        for leg in range(2):
            end = 0.0 if leg == 0 else float(case.end(jnp.asarray(most)))

            over = ending(lambda t, y, leg=leg, end=end: y[1] if leg == 0 else y[0] - end)
            run = solve_ivp(
                lambda t, y, most=most: [y[1], push - case.known(y[0], y[1], most)],
                (t, 1e3), y, method="DOP853", rtol=1e-13, atol=1e-16, events=over, max_step=0.1,
            )  # fmt: skip
            t, y = run.t_events[0][0], run.y_events[0][0]
            most = y[0] if case.law.remembers else 0.0
        found.append((-y[1] / speed, t))
    return np.array(found).T


def by_diffrax(case: Force, push: float, solver: Any) -> Callable[[Any, Any], Any]:
    def leg(y: Any, most: Any, rtol: Any, event: Callable[[Any], Any]) -> tuple[Any, Any, Any]:
        found = until(
            lambda t, y, args: jnp.stack([y[1], push - case.force(y[0], y[1], most)]), y,
            lambda t, y, args, **_: event(y), rtol, solver=solver(), atol=1.0, most=16_384,
        )  # fmt: skip
        ended = found.result == diffrax.RESULTS.event_occurred
        return found.ts[-1], found.ys[-1], ended

    def one(speed: Any, rtol: Any) -> tuple[Any, Any]:
        start = jnp.stack([0.0 * speed, speed])
        none = jnp.zeros_like(speed)
        turn, y, good = leg(start, none, rtol, lambda y: y[1])
        most = y[0] if case.law.remembers else none
        back, y, also = leg(y.at[1].set(0.0), most, rtol, lambda y: y[0] - case.end(most))
        good = good & also
        return jnp.where(good, -y[1] / speed, jnp.nan), jnp.where(good, turn + back, jnp.nan)

    @jax.jit
    def run(speeds: Any, rtol: Any) -> Any:
        return jax.lax.map(lambda speed: one(speed, rtol), speeds, batch_size=1000)

    return run


def ours(case: Force, push: float, method: Callable[[float], Any]) -> Callable[[Any, Any], Any]:
    contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=case.exponent)
    pushed = {} if push == 0 else {"external_force": push}

    def run(speeds: Any, setting: Any) -> Any:
        hit = jc.impact(case.law, contact, speeds, method=method(setting), **pushed)
        return hit.restitution, hit.duration

    return jax.jit(run, static_argnums=1)


def rows(count: int = LANES) -> list[dict[str, Any]]:
    """Measure each way on each case, with and without the push."""
    found, speeds = [], jnp.asarray(lanes(count))
    for name, make in CASES.items():
        case = make()
        for push in (PUSH, 0.0):
            want = truth(case, push)
            ways = {
                f"diffrax {solver.__name__}": (by_diffrax(case, push, solver), DIFFRAX)
                for solver in (diffrax.Tsit5, diffrax.Dopri8)
            }
            ways["event"] = ours(case, push, lambda rtol: jc.Event(rtol=rtol)), EVENT
            if push == 0 and (name != "JKR"):
                ways["exact"] = ours(case, push, lambda setting: "exact"), (0.0,)
            for way, (run, settings) in ways.items():
                for setting in settings:
                    time, answer = timed(lambda run=run, s=setting: run(speeds, s), True)
                    got = np.array(answer)[:, :CHECKED]
                    error = float(np.max(np.abs(got / want - 1)))
                    row = {"law": name, "push": push, "way": way, "setting": setting}
                    row |= {"error": error, "us": 1e6 * time["seconds"] / count}
                    found.append(row | {"compile_s": time["compile_s"]})
                    print(row, flush=True)
                    if error <= ENOUGH / 10:
                        break
    return found


def cheapest(found: list[dict[str, Any]], law: str, push: float, way: str) -> dict[str, Any] | None:
    """Return the cheapest row with a sufficient error, of all ways whose name begins so."""
    good = [
        row
        for row in found
        if (row["law"], row["push"]) == (law, push)
        and row["way"].startswith(way)
        and row["error"] <= ENOUGH
    ]
    return min(good, key=lambda row: row["us"], default=None)


def table(found: list[dict[str, Any]]) -> str:
    """Return the table of docs/plastic.md: times of plain diffrax over ours, and both errors."""
    cells = []
    for law, push, way in itertools.product(CASES, (PUSH, 0.0), ("event", "exact")):
        other, mine = (cheapest(found, law, push, name) for name in ("diffrax", way))
        if mine is not None and other is not None:
            ratio = number(other["us"] / mine["us"])
            errors = f"{mine['error']:.0e}", f"{other['error']:.0e}"
            cells.append([f"`{law}`", "yes" if push else "no", way, ratio, *errors])
    heads = ["law", "push", "method", "diffrax over ours", "our error", "error of diffrax"]
    return lines(heads, cells, "---")


def measure(known: dict[str, Any] | None) -> dict[str, Any]:
    return {"lanes": LANES, "rows": rows()}


STUDY = Study(__file__, __doc__, measure, lambda found: table(found["rows"]), "plastic")
