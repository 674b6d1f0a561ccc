"""First derivatives of restitution and duration, beside those of the oracles.

By the logarithms of damping and push, and by n where it is traced. An error is relative to the
derivative, or to 1e-6 of the quantity where the derivative is smaller than that.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .free_table import free
from .grid import Job, Lanes, lanes_of, scaled, units_of
from .kinds import KINDS
from .motion import SEPARATED
from .motion_oracle import solve
from .package_lanes import law_of

ASKED = ("e", "duration")
BOUNDS = {("exact", "float64"): 1e-11, ("event", "float64"): 1e-7}
"""README's, for float64. It promises nothing for derivatives in float32."""
RTOL = {"exact": 2.3e-16, "event": 1e-11}
STEP = 2e-3
"""Of differences of order six: their error is below 1e-13 where the outcome is smooth."""
SMALLEST = 1e-6
_WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}


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
    want, second, truth_status, value = _truth(job, numbers)
    rtol = RTOL[job.method]
    worst = np.zeros(job.lanes)
    error = np.zeros(job.lanes)
    for name in _names(job):
        for q in ASKED:
            scale = np.maximum(np.abs(want[name][q]), SMALLEST * np.abs(value[q]))
            off = np.abs(got[name][q] - want[name][q]) / scale
            allowed = np.maximum(
                BOUNDS[job.method, job.precision], 10 * rtol * second[name][q] / scale
            )
            # Where the damping or the push is zero its logarithm has no derivative.
            moving = dict(zip(("damping", "n", "push"), numbers, strict=True))[name] != 0
            known = np.isfinite(want[name][q]) & moving
            off = np.where(known, np.where(np.isfinite(off), off, np.inf), 0)
            worst = np.maximum(worst, (off / allowed).astype(float))
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
            # The unit of time changes with n, too: d ln X/dn = -ln X/(n+1).
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
) -> tuple[Any, Any, Array, dict[str, Array]]:
    """First derivatives, the size of the second ones, the status and the values."""
    kind = KINDS[job.kind]
    damping, n, push = numbers

    def outcome(shift: dict[str, EXTENDED]) -> dict[str, Array]:
        d = damping * np.exp(shift.get("damping", EXTENDED(0)))
        g = push * np.exp(shift.get("push", EXTENDED(0)))
        truth = solve(kind.problem(d, n + shift.get("n", EXTENDED(0)), g))
        return {q: getattr(truth, q) for q in ASKED} | {"status": truth.status}

    if not job.pushed and kind.family != "kuwabara_kono":
        exponent = n if job.exponent is None else job.exponent
        table = free(job.kind, damping, exponent)
        moved = free(job.kind, damping * (1 + EXTENDED("1e-5")), exponent)
        want = {"damping": table.by_damping, "n": table.by_n}
        second = {
            name: {q: np.abs(b[q] - a[q]) / EXTENDED("1e-5") for q in ASKED}
            for name, a, b in (
                ("damping", table.by_damping, moved.by_damping),
                ("n", table.by_n, moved.by_n),
            )
        }
        return want, second, np.full(damping.size, SEPARATED), table.value
    centre = outcome({})
    want, second = {}, {}
    status = centre["status"]
    for name in _names(job):
        sums = {q: np.zeros(damping.size, EXTENDED) for q in ASKED}
        curve = {q: np.zeros(damping.size, EXTENDED) for q in ASKED}
        for k, weight in _WEIGHTS.items():
            up, down = (outcome({name: EXTENDED(s * k * STEP)}) for s in (1, -1))
            for q in ASKED:
                with np.errstate(invalid="ignore"):
                    sums[q] = sums[q] + EXTENDED(weight) * (up[q] - down[q]) / EXTENDED(STEP)
                    if k == 1:
                        curve[q] = np.abs(up[q] + down[q] - 2 * centre[q]) / EXTENDED(STEP) ** 2
        want[name], second[name] = sums, curve
    return want, second, status, centre
