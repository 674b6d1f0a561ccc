"""First derivatives of restitution and duration, compared with those of the oracles.

They are taken by the logarithms of damping and push, and by n if it is traced. An error is relative
to the derivative, or to 1e-6 of the quantity if the derivative is smaller than that. The limit is
README's bound, or ten tolerances of the method of the quantity or of its second derivative.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .free_table import ROUNDING, free
from .grid import Job, Lanes, lanes_of, law_of, scaled, units_of
from .kinds import KINDS, SEPARATED, Truth
from .motion_oracle import solve

ASKED = ("e", "duration")
BOUNDS = {("exact", "float64"): 1e-11, ("event", "float64"): 1e-7}
"""README's, for float64. It promises nothing for derivatives in float32."""
RTOL = {"exact": 2.3e-16, "event": 1e-11}
STEPS = (2e-3, 2.5e-4, 3e-5)
"""Of differences of order six: the error of the first is below 1e-13 where the outcome is smooth.

Near a threshold (the push that holds the bodies, critical damping) it is not smooth over it, and a
shorter one is taken.
"""
SMOOTH = 1e-6
"""By how much differences of order four and six may differ: then those of six are good to 1e-9."""
SMALLEST = 1e-6
NOISE = 4e-15
"""Of the oracle's outcomes: over a step that is what differences do not know. Measured 1.5e-15."""
_WEIGHTS = {1: (3 / 4, 2 / 3), 2: (-3 / 20, -1 / 12), 3: (1 / 60, 0)}
"""Of the differences over k steps each way: order six, and order four."""


def slope_jobs() -> list[Job]:
    """Derivative jobs are named by their method: it takes rtol 1e-11 by event."""
    jobs = []
    for kind, described in KINDS.items():
        exponents = (1.5,) if described.approach else (1.5, None)
        for n in exponents:
            if described.family != "kuwabara_kono" and kind != "hunt_crossley_tension":
                jobs.append(Job(kind, n, False, "exact", "float64", 4096))
            jobs.append(Job(kind, n, True, "event", "float64", 256))
        if kind != "hunt_crossley_tension":
            jobs.append(Job(kind, 1.5, False, "event", "float64", 256))
    return jobs


def _names(job: Job) -> list[str]:
    pushed = ["push"] if job.pushed else []
    return ["damping", *pushed, *(["n"] if job.exponent is None else [])]


def run_slopes(job: Job) -> dict[str, Any]:
    lanes = lanes_of(job)
    numbers = scaled(job, lanes)
    got, status = _package(job, lanes)
    want, second, blur, truth_status, value = _truth(job, numbers)
    rtol = RTOL[job.method]
    worst = np.zeros(job.lanes)
    error = np.zeros(job.lanes)
    for name in _names(job):
        for q in ASKED:
            scale = np.maximum(np.abs(want[name][q]), SMALLEST * np.abs(value[q]))
            # Near a threshold differences may be infinite; such lanes are not compared.
            with np.errstate(invalid="ignore"):
                off = np.abs(got[name][q] - want[name][q]) / scale
                bend = np.nan_to_num(10 * rtol * second[name][q] / scale, nan=0, posinf=np.inf)
                # Near a vanishing derivative neither the oracles nor a solve to this tolerance
                # resolve it.
                unknown = (blur[name] + 10 * rtol) * np.abs(value[q]) / scale
            allowed = np.maximum(BOUNDS[job.method, job.precision], np.maximum(bend, unknown))
            # At zero damping or push the logarithm has no derivative.
            moving = numbers[("damping", "n", "push").index(name)] != 0
            known = np.isfinite(want[name][q]) & moving
            off = np.where(known, np.where(np.isfinite(off), off, np.inf), 0)
            worst = np.maximum(worst, np.where(known, off / allowed, 0).astype(float))
            error = np.maximum(error, off.astype(float))
    asked = (truth_status == SEPARATED) & (value["e"] >= SMALLEST)
    flagged = status >= 2
    wrong = asked & ~flagged & (worst > 1)
    index = np.flatnonzero(wrong)[np.argsort(-worst[wrong])][:5]
    return {
        "lanes": int(asked.sum()),
        "right": int((asked & ~flagged & (worst <= 1)).sum()),
        "flagged": int((asked & flagged).sum()),
        "wrong": int(wrong.sum()),
        "median error": float(f"{np.median(error[asked & ~flagged]):.2g}"),
        "worst": [
            {
                "damping": float(numbers[0][i]),
                "n": float(numbers[1][i]),
                "push": float(numbers[2][i]),
                "e": float(value["e"][i]),
                "error": float(f"{error[i]:.3g}"),
                "times allowed": float(f"{worst[i]:.3g}"),
            }
            for i in index
        ],
    }


def _package(job: Job, lanes: Lanes) -> tuple[dict[str, dict[str, Array]], Array]:
    """Derivatives in scaled units, by forward mode."""
    scale = units_of(lanes)
    how = jc.Event(rtol=RTOL["event"]) if job.method == "event" else job.method
    fixed = [jnp.asarray(getattr(lanes, f)) for f in ("mass", "stiffness", "speed")]
    start = {f: jnp.asarray(getattr(lanes, f)) for f in _names(job)}

    def solve_(p):
        n = p.get("n", job.exponent)
        contact = jc.Contact(fixed[0], fixed[1], n)
        hit = jc.impact(
            law_of(job.kind, p["damping"]),
            contact,
            fixed[2],
            method=how,
            external_force=p.get("push"),
        )
        return (hit.restitution, hit.duration), hit.status

    found, status = {}, None
    for name in start:
        along = {f: (x if f == name else jnp.zeros_like(x)) for f, x in start.items()}
        if name == "n":
            along = _along_n(job, lanes, start)
        (_, duration), (de, dt), status = jax.jvp(solve_, (start,), (along,), has_aux=True)
        dt = np.asarray(dt).astype(EXTENDED) / scale.time
        if name == "n":
            # The unit of time also changes with n: d ln X/dn = -ln X/(n+1).
            drift = -np.log(scale.length) / (lanes.n.astype(EXTENDED) + 1)
            dt = dt - np.asarray(duration).astype(EXTENDED) / scale.time * drift
        found[name] = {"e": np.asarray(de).astype(EXTENDED), "duration": dt}
    return found, np.asarray(status)


def _along_n(job: Job, lanes: Lanes, start: dict[str, jax.Array]) -> dict[str, jax.Array]:
    """The direction in which n changes and the scaled damping and push do not."""
    drift = -np.log(units_of(lanes).length) / (lanes.n.astype(EXTENDED) + 1)
    along = {f: jnp.zeros_like(x) for f, x in start.items()} | {"n": jnp.ones_like(start["n"])}
    if KINDS[job.kind].family == "kuwabara_kono":
        along["damping"] = start["damping"] * jnp.asarray(drift.astype(float))
    if "push" in start:
        along["push"] = -start["push"] * jnp.asarray(drift.astype(float))
    return along


def _truth(
    job: Job, numbers: tuple[Array, Array, Array]
) -> tuple[Any, Any, dict[str, Array], Array, dict[str, Array]]:
    """First derivatives, the size of the second ones, what rounding leaves unknown of the first
    in units of the value, the status and the values.
    """
    kind = KINDS[job.kind]
    damping, n, push = numbers

    def outcome(name: str, shift: float, k: Array | slice = slice(None)) -> Truth:
        by = {name: EXTENDED(shift)}
        d = damping[k] * np.exp(by.get("damping", EXTENDED(0)))
        g = push[k] * np.exp(by.get("push", EXTENDED(0)))
        return solve(kind.problem(d, n[k] + by.get("n", EXTENDED(0)), g))

    if not job.pushed and kind.family != "kuwabara_kono":
        exponent = n if job.exponent is None else job.exponent
        table = free(job.kind, damping, exponent)
        moved = free(job.kind, damping * (1 + EXTENDED("1e-5")), exponent)
        want = {"damping": table.by_damping, "n": table.by_n}
        # The e of these forces is independent of n, so the table contains rounding.
        want["n"]["e"] = np.zeros(damping.size, EXTENDED)
        moved.by_n["e"] = want["n"]["e"]
        second = {
            name: {q: np.abs(b[q] - a[q]) / EXTENDED("1e-5") for q in ASKED}
            for name, a, b in (
                ("damping", table.by_damping, moved.by_damping),
                ("n", table.by_n, moved.by_n),
            )
        }
        blur = {name: np.full(damping.size, size) for name, size in ROUNDING.items()}
        return want, second, blur, np.full(damping.size, SEPARATED), table.value
    centre = outcome("damping", 0)
    value = {q: getattr(centre, q) for q in ASKED}
    want, second, blur = {}, {}, {}
    for name in _names(job):
        blur[name] = np.full(damping.size, NOISE / STEPS[0])
        want[name], second[name], gap = _differences(outcome, name, STEPS[0], value)
        for step in STEPS[1:]:
            k = np.flatnonzero(np.max(np.stack(list(gap.values())), 0) > SMOOTH)
            if k.size == 0:
                break
            of = {q: value[q][k] for q in ASKED}
            finer, bend, rest = _differences(functools.partial(outcome, k=k), name, step, of)
            for q in ASKED:
                better = rest[q] < gap[q][k]
                want[name][q][k] = np.where(better, finer[q], want[name][q][k])
                second[name][q][k] = np.where(better, bend[q], second[name][q][k])
                gap[q][k] = np.where(better, rest[q], gap[q][k])
                blur[name][k] = np.where(better, NOISE / step, blur[name][k])
    return want, second, blur, centre.status, value


def _differences(
    outcome: Callable[[str, float], Truth], name: str, step: float, value: dict[str, Array]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """First and second derivatives, and how far those of order four are from those of six."""
    six, four, bend, gap = {}, {}, {}, {}
    for k, (weight, lower) in _WEIGHTS.items():
        up, down = (outcome(name, s * k * step) for s in (1, -1))
        for q in ASKED:
            with np.errstate(invalid="ignore"):
                slope = (getattr(up, q) - getattr(down, q)) / EXTENDED(step)
                six[q] = six.get(q, 0) + EXTENDED(weight) * slope
                four[q] = four.get(q, 0) + EXTENDED(lower) * slope
                if k == 1:
                    second = getattr(up, q) + getattr(down, q) - 2 * value[q]
                    bend[q] = np.abs(second) / EXTENDED(step) ** 2
    for q in ASKED:
        with np.errstate(invalid="ignore"):
            scale = np.maximum(np.abs(six[q]), SMALLEST * np.abs(value[q]))
            ratio = np.abs(six[q] - four[q]) / np.where(scale > 0, scale, 1)
        # If a neighbour settles no difference exists yet; a shorter step may have one.
        gap[q] = np.where(np.isfinite(ratio), ratio, np.where(np.isfinite(value[q]), np.inf, 0))
    return six, bend, gap
