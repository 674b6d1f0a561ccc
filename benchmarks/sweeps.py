"""Lanes per second of sweeps, compared with scipy and diffrax: `python benchmarks/sweeps.py`.

Each method runs in its own processes, on one core and on all. The number of lanes increases, so
that the largest memory so far belongs to the current number. Only the ratios are meaningful; the
times belong to the machine that is printed with them. Compile time is measured separately. Errors
are relative to the forty digits of the tests' oracle, which shares no formula with the library.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COUNTS = [10**k for k in range(8)]
LONGEST = 12.0
"""Seconds: a count that would take longer is left out."""
REPEATS = 3
CHECKED = 40
"""Lanes that are compared with the oracle."""

OURS = ("restitution", "summary", "gradient", "phase", "event", "event gradient")
PEERS = ("diffrax Tsit5 1e-9", "diffrax Dopri8 1e-9", "diffrax Dopri8 1e-12", "scipy DOP853 1e-9")


def draw(count: int) -> dict:
    """Restitutions from 0.1 to 1, stiffnesses, masses and speeds, one of each for a lane."""
    import numpy as np

    random = np.random.default_rng(0)
    return {
        "e": random.uniform(0.1, 1.0, count),
        "K": 10 ** random.uniform(5, 11, count),
        "m": 10 ** random.uniform(-3, 1, count),
        "v": 10 ** random.uniform(-2, 1, count),
    }


def units_of_time(lanes: dict):
    """X/v0 of each lane, with X = (m v0²/K)^(2/5)."""
    return (lanes["m"] * lanes["v"] ** 2 / lanes["K"]) ** 0.4 / lanes["v"]


def our_function(way: str) -> Callable:
    """What `jc.sweep` is given."""
    import jax

    import jaxcontact as jc

    def hit(e, K, m, v, method="exact"):
        return jc.impact(jc.HuGuo(e=e), jc.Contact(mass=m, stiffness=K), v, method=method)

    def outcome(method: str) -> Callable:
        def both(e, K, m, v):
            found = hit(e, K, m, v, method)
            return {"restitution": found.restitution, "duration": found.duration}

        return both

    def slopes(method: str) -> Callable:
        def both(e, K, m, v):
            def duration(e):
                found = hit(e, K, m, v, method)
                return found.duration, found.restitution

            by_e, restitution = jax.grad(duration, has_aux=True)(e)
            return {"restitution": restitution, "by_e": by_e}

        return both

    return {
        "restitution": lambda e: jc.restitution(jc.HuGuo(e=e)),
        "summary": hit,
        "gradient": slopes("exact"),
        "phase": outcome("phase"),
        "event": outcome("event"),
        "event gradient": slopes("event"),
    }[way]


def ours(way: str, mesh) -> Callable:
    """A sweep over samples; a dictionary of arrays comes back."""
    import jaxcontact as jc

    function = our_function(way)

    def run(lanes: dict) -> dict:
        if way == "restitution":
            return {"restitution": jc.sweep(function, samples={"e": lanes["e"]}).value}
        table = jc.sweep(function, samples=lanes, mesh=mesh)
        names = ("restitution", "duration", "by_e")
        return {name: getattr(table, name) for name in names if hasattr(table, name)}

    return run


def plain_diffrax(solver: str, tolerance: float) -> Callable:
    """diffrax in (x, v), scaled by hand, one `vmap` over the lanes: what most people write."""
    import diffrax
    import jax
    import jax.numpy as jnp
    import numpy as np
    import optimistix as optx

    def one(alpha):
        def rate(t, y, args):
            x = jnp.where(y[0] > 0, y[0], 1)
            power = jnp.where(y[0] > 0, x * jnp.sqrt(x), 0)
            return jnp.stack([y[1], -power * (1 + alpha * y[1])])

        end = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            getattr(diffrax, solver)(),
            0.0,
            1e3,
            0.01,
            jnp.array([0.0, 1.0]),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            event=diffrax.Event(
                lambda t, y, args, **_: y[0], optx.Newton(1e-10, 1e-10), direction=False
            ),
            max_steps=4096,
            throw=False,
        )
        return -end.ys[-1, 1], end.ts[-1]

    solve = jax.jit(jax.vmap(one))

    def run(lanes: dict) -> dict:
        e, duration = solve(1.5 * (1 - lanes["e"]) / lanes["e"])
        return {
            "restitution": np.asarray(e),
            "duration": np.asarray(duration) * units_of_time(lanes),
        }

    return run


def scipy_solver() -> Callable:
    """`solve_ivp` with an event, one impact after another."""
    import numpy as np
    from scipy.integrate import solve_ivp

    def run(lanes: dict) -> dict:
        found = []
        for alpha in 1.5 * (1 - lanes["e"]) / lanes["e"]:

            def rate(t, y, alpha=alpha):
                return (y[1], -(max(y[0], 0.0) ** 1.5) * (1 + alpha * y[1]))

            def apart(t, y):
                return y[0]

            apart.terminal, apart.direction = True, -1
            end = solve_ivp(rate, (0, 1e3), (0, 1), "DOP853", events=apart, rtol=1e-9, atol=1e-12)
            found.append((-end.y_events[0][0, 1], end.t_events[0][0]))
        e, duration = np.array(found).T
        return {"restitution": e, "duration": duration * units_of_time(lanes)}

    return run


def errors(run: Callable) -> dict[str, float]:
    """The largest relative errors of e, of the duration and of its derivative by e, if known."""
    import numpy as np
    from mpmath import mp

    sys.path.insert(0, str(ROOT))
    from tests import oracle

    lanes = draw(CHECKED)
    found = run(lanes)
    true: dict[str, list[float]] = {"restitution": [], "duration": [], "by_e": []}
    for e in lanes["e"]:
        with mp.workdps(50):
            asked = mp.mpf(float(e))
            alpha = 3 * (1 - asked) / (2 * asked)
            case = oracle.hunt_crossley(alpha, 1.5)
            true["restitution"].append(float(case.e))
            true["duration"].append(float(case.duration))
            if "by_e" in found:
                slope = oracle.derivative(oracle.hunt_crossley, (alpha, 1.5), 0)["duration"]
                true["by_e"].append(float(-slope * 3 / (2 * asked**2)))
    unit = {"restitution": 1.0, "duration": units_of_time(lanes), "by_e": units_of_time(lanes)}
    return {
        name: float(np.max(np.abs(np.asarray(found[name]) / unit[name] / true[name] - 1)))
        for name in true
        if name in found
    }


def work(way: str, most: int) -> None:
    """In a process of its own: print a line of JSON for each count of lanes."""
    import jax

    jax.config.update("jax_enable_x64", True)
    devices = jax.devices()
    mesh = jax.sharding.Mesh(devices, ("lanes",)) if len(devices) > 1 else None
    if way.startswith("diffrax"):
        _, solver, tolerance = way.split()
        run = plain_diffrax(solver, float(tolerance))
    else:
        run = scipy_solver() if way.startswith("scipy") else ours(way, mesh)
    rate = 0.0
    checked = errors(run)
    for count in COUNTS:
        if count > most or (rate and count / rate > LONGEST):
            break
        lanes = draw(count)
        start = time.perf_counter()
        run(lanes)
        first = time.perf_counter() - start
        times = [first] if way.startswith("scipy") else []
        while len(times) < REPEATS and (not times or sum(times) < LONGEST / 2):
            start = time.perf_counter()
            run(lanes)
            times.append(time.perf_counter() - start)
        rate = count / min(times)
        line = {
            "way": way,
            "lanes": count,
            "seconds": min(times),
            "first_s": first,
            "lanes_per_s": rate,
            "peak_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
            "errors": checked,
            "device": devices[0].device_kind,
            "devices": len(devices),
        }
        print(json.dumps(line), flush=True)


def start(way: str, workers: str, most: int) -> list[dict]:
    """Run one way in a new process, on one core, on all, or on all with a device for each."""
    environment = dict(os.environ)
    cores = sorted(os.sched_getaffinity(0))
    if workers == "devices":
        environment["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={len(cores)}"
    command = [sys.executable, __file__, "--work", way, "--most", str(most)]

    def pin() -> None:
        if workers == "one core":
            os.sched_setaffinity(0, cores[:1])

    done = subprocess.run(
        command, env=environment, preexec_fn=pin, stdout=subprocess.PIPE, text=True, check=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    for row in rows:
        row["workers"] = workers
        shown = "  ".join(f"{key} {value:.0e}" for key, value in row["errors"].items())
        print(
            f"{way:22}{workers:10}{row['lanes']:10}{row['first_s']:9.2f}{row['seconds']:11.5f}"
            f"{row['lanes_per_s']:12.3g}{row['peak_gib']:7.2f}  {shown}",
            flush=True,
        )
    return rows


def best_rate(rows: list[dict], way: str) -> float:
    """The highest rate of a way on all cores, at any count."""
    return max(r["lanes_per_s"] for r in rows if r["way"] == way and r["workers"] != "one core")


def draw_figure(rows: list[dict], path: Path) -> None:
    """Lanes per second against lanes, one line for each way, on all cores."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    _, ax = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    for way in dict.fromkeys(row["way"] for row in rows):
        line = [r for r in rows if r["way"] == way and r["workers"] == "all cores"]
        if line:
            style = "-o" if way in OURS else "--s"
            ax.loglog(
                [r["lanes"] for r in line],
                [r["lanes_per_s"] for r in line],
                style,
                markersize=3,
                label=way,
            )
    ax.set(xlabel="lanes", ylabel="lanes per second")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7, loc="upper left")
    ax.figure.savefig(path, dpi=110)


def main() -> None:
    """Print the table; with --out also write it as JSON, with --plot as a figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--plot", type=Path, help="PNG file to write")
    parser.add_argument("--ways", nargs="+", default=[*OURS, *PEERS], help="which ways to run")
    parser.add_argument("--most", type=int, default=COUNTS[-1], help="the most lanes")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.work:
        work(arguments.work, arguments.most)
        return
    print(
        f"{'way':22}{'workers':10}{'lanes':>10}{'first/s':>9}{'then/s':>11}{'lanes/s':>12}"
        f"{'GiB':>7}  errors"
    )
    rows = []
    for way in arguments.ways:
        most = arguments.most
        if way in PEERS:
            # A plain vmap keeps all lanes at once.
            most = min(most, 100 if way.startswith("scipy") else 10**5)
        kinds = ("one core", "all cores", "devices") if way in OURS else ("one core", "all cores")
        for kind in kinds:
            rows += start(way, kind, most)
    summary = {way: best_rate(rows, way) for way in arguments.ways}
    for way, rate in summary.items():
        line = f"{way:22}{rate:12.3g} lanes/s"
        for peer in set(PEERS) & set(summary):
            line += f"  {rate / summary[peer]:9.3g} x {peer}"
        print(line)
    machine = {"processor": platform.machine(), "cores": len(os.sched_getaffinity(0))}
    if arguments.out:
        arguments.out.write_text(
            json.dumps({"machine": machine, "best": summary, "rows": rows}, indent=1) + "\n"
        )
    if arguments.plot:
        draw_figure(rows, arguments.plot)


if __name__ == "__main__":
    main()
