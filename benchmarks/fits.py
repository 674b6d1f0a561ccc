"""Time of fits compared with scipy, and coverage of their intervals: `python benchmarks/fits.py`.

Fits by closed form and exact derivatives are repeated with the usual alternative:
`scipy.optimize.least_squares` over `solve_ivp`, with finite differences. Compile time is measured
separately. The coverage study fits 500 simulated tables and counts how often the 95 % intervals
contain the truth.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy import optimize, special, stats
from scipy.integrate import solve_ivp

import jaxcontact as jc
from jaxcontact.lab.calibration.calibrate import calibrate
from jaxcontact.lab.recordings import read_recording

POINTS = 100
REPEATS = 5
DRAWS = 500
CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8)
BETA, DAMPING = 2.3, 2e7
ASKED = np.linspace(0.1, 1, POINTS)
SPEED = np.linspace(0.1, 5, POINTS)


def scipy_restitution(alpha: float) -> float:
    """One scaled impact with an event."""
    end = solve_ivp(
        lambda t, y: (y[1], -(max(y[0], 0.0) ** 1.5) * (1 + alpha * y[1])),
        (0, 1e3),
        (0, 1),
        "DOP853",
        events=apart,
        rtol=1e-9,
        atol=1e-12,
    )
    return -end.y_events[0][0, 1]


def apart(t, y):
    return y[0]


apart.terminal, apart.direction = True, -1


def scipy_beta(data: np.ndarray) -> float:
    def off(p):
        ratio = 2.5 / p[0]
        integral = ratio * special.beta(ratio, 1.5) / 2.5
        alphas = (1 - ASKED) / ASKED / (2.5 * integral)
        return np.array([scipy_restitution(a) for a in alphas]) - data

    return optimize.least_squares(off, [2.0]).x[0]


def scipy_damping(data: np.ndarray) -> float:
    def off(p):
        alphas = np.exp(p[0]) * SPEED / 1.4e8
        return np.array([scipy_restitution(a) for a in alphas]) - data

    return float(np.exp(optimize.least_squares(off, [np.log(1e7)]).x[0]))


def our_beta(data: np.ndarray) -> float:
    return float(jc.fit_energy_loss(ASKED, data).params["beta"])


def our_damping(data: np.ndarray) -> float:
    return float(jc.fit_damping(CONTACT, SPEED, data).params["c"])


def compare(name: str, ours: Callable, theirs: Callable, data: np.ndarray, true: float) -> dict:
    """One fit both ways: seconds, and errors of the number."""
    start = time.perf_counter()
    ours(data)
    first = time.perf_counter() - start
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        found = ours(data)
        times.append(time.perf_counter() - start)
    start = time.perf_counter()
    other = theirs(data)
    spent = time.perf_counter() - start
    row = {
        "fit": name,
        "first_s": first,
        "seconds": min(times),
        "error": abs(found / true - 1),
        "scipy_s": spent,
        "scipy_error": abs(other / true - 1),
        "times_scipy": spent / min(times),
    }
    print(
        f"{name:24}first {first:5.1f} s, then {1e3 * min(times):6.1f} ms, error {row['error']:.0e};"
        f"  scipy {spent:6.1f} s, error {row['scipy_error']:.0e}: {row['times_scipy']:.0f} times"
    )
    return row


def real_data() -> dict:
    """The calibration of the command line, of the recording that ships with the package."""
    path = Path(jc.__file__).parent / "data" / "bounce_intervals.csv"
    recording = read_recording(path, ball="blue")
    times = []
    for _ in range(3):
        start = time.perf_counter()
        calibrate(recording)
        times.append(time.perf_counter() - start)
    print(f"{'calibrate, real ball':24}first {times[0]:5.1f} s, then {1e3 * min(times):6.1f} ms")
    return {"fit": "calibrate", "first_s": times[0], "seconds": min(times)}


def coverage() -> dict:
    """How often the 95 % interval holds the truth, for K, n and c from tables of e and of t_c."""
    random = np.random.default_rng(0)
    v = np.geomspace(0.3, 6, 20)
    contact = jc.Contact(mass=0.45, stiffness=2e7, exponent=np.array(1.6))
    law = jc.ConstantDamping(c=1.5e6)
    clean = jc.impact(law, contact, v)
    start = jc.Contact(mass=0.45, stiffness=1e7, exponent=np.array(1.5))
    true = {"law.c": 1.5e6, "contact.stiffness": 2e7, "contact.exponent": 1.6}
    held = dict.fromkeys(true, 0)
    converged = 0
    for _ in range(DRAWS):
        e = np.clip(np.asarray(clean.restitution) + 0.01 * random.normal(size=v.size), 0, 1)
        duration = np.asarray(clean.duration) * np.exp(0.01 * random.normal(size=v.size))
        found = jc.fit_impacts(
            jc.ConstantDamping(c=1e6), start, v, e=e, duration=duration,
            sigma_e=0.01, sigma_duration=0.01, throw=False,
        )  # fmt: skip
        converged += found.converged
        for name, value in zip(found.names, found.values, strict=True):
            error = found.standard_errors[name]
            held[name] += abs(value - true[name]) <= stats.norm.ppf(0.975) * error
    rates = {name: count / converged for name, count in held.items()}
    shown = ", ".join(f"{name} {100 * rate:.1f} %" for name, rate in rates.items())
    print(f"{'coverage of 95 %':24}{converged} of {DRAWS} fits converged: {shown}")
    return {"draws": DRAWS, "converged": converged, "coverage": rates}


def main() -> None:
    """Print the table; with --out also write it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    by_beta = np.asarray(jc.restitution(jc.EnergyLoss(e=ASKED, beta=BETA)))
    by_c = np.asarray(jc.restitution(jc.ConstantDamping(c=DAMPING), CONTACT, SPEED))
    rows = [
        compare("beta to e_out(e_in)", our_beta, scipy_beta, by_beta, BETA),
        compare("c to e(v)", our_damping, scipy_damping, by_c, DAMPING),
        real_data(),
    ]
    study = coverage()
    if arguments.out:
        machine = {"processor": platform.machine(), "device": jax.devices()[0].device_kind}
        arguments.out.write_text(
            json.dumps({"machine": machine, "rows": rows, "coverage": study}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
