"""Accuracy of plans of measurements: `python -m benchmarks fit_design`.

For each plan 500 measurements are simulated and fitted as a user would. The standard deviation of
each parameter over the fits is compared with the standard error expected by the plan.
"""

from __future__ import annotations

import jax
import numpy as np

import jaxcontact as jc
from benchmarks.study import Study

SEED = 1
SPEEDS = np.geomspace(0.05, 5, 30)
NOISE = {"e": 0.01, "duration": 0.02, "max_force": 0.03}
CONTACT = jc.Contact(mass=0.1, stiffness=1e8)
PLANS = {
    "constant c, all": (jc.ConstantDamping(c=2e7), NOISE, "all"),
    "constant c, its c": (jc.ConstantDamping(c=2e7), NOISE, "law.c"),
    "constant c, K from e and t_c": (
        jc.ConstantDamping(c=2e7),
        {"e": 0.01, "duration": 0.02},
        "contact.stiffness",
    ),
    "Hu and Guo's law, all": (jc.HuGuo(e=0.7), NOISE, "all"),
    "c as a power of v, all": (
        jc.PowerDamping(c=2e7, power=-0.3, reference=1.0),
        NOISE,
        "all",
    ),
}


def spread(name: str, draws: int) -> dict:
    """Expected standard errors, and what simulated fits show."""
    law, noise, goal = PLANS[name]
    fixed = ("mass", "reference") if isinstance(law, jc.PowerDamping) else ("mass",)
    how = {"sigma": noise, "candidates": SPEEDS, "readings": 8, "goal": goal, "fixed": fixed}
    plan = jc.design(law, CONTACT, **how)
    with jax.enable_x64(True):
        hit = jc.impact(law, CONTACT, plan.velocity)
    quantity = np.array(plan.quantity)
    random, values = np.random.default_rng(SEED), []
    for _ in range(draws):
        columns = {}
        for one, sigma in noise.items():
            off = sigma * random.normal(size=8)
            clean = np.asarray(hit.restitution if one == "e" else getattr(hit, one))
            read = clean + off if one == "e" else clean * np.exp(off)
            if (quantity == one).any():
                columns |= {one: np.where(quantity == one, read, np.nan), f"sigma_{one}": sigma}
        found = jc.fit_impacts(law, CONTACT, plan.velocity, fixed=fixed, throw=False, **columns)
        if found.converged:
            values.append(found.values)
    seen = dict(zip(plan.standard_errors, np.std(values, axis=0).tolist(), strict=True))
    return {
        "readings": [[q, v] for q, v in zip(plan.quantity, plan.velocity.tolist(), strict=True)],
        "expected": plan.standard_errors,
        "even": plan.even,
        "seen": seen,
        "converged": len(values) / draws,
    }


def measure(known: dict | None, draws: int) -> dict:
    result: dict = {"seed": SEED, "draws": draws, "plans": {}}
    for name in PLANS:
        result["plans"][name] = one = spread(name, draws)
        ratios = {p: round(one["seen"][p] / one["expected"][p], 3) for p in one["seen"]}
        print(f"{name}: seen/expected {ratios}", flush=True)
    return result


OPTIONS = {"--draws": {"type": int, "default": 500}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
