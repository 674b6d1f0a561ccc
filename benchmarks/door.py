"""Waiting times of users without any computation: `python benchmarks/door.py`.

Each row runs in processes of its own, without a store of compiled programs. Two rows have a store
that an earlier process has filled: a calibration, and a soft scene after `jc.cache()`. Warm calls
are compared with a trivial compiled function of three numbers, the soft scene with `import jax`.
Its parts (tracing, lowering, loading) are printed below the row. First calls and the second process
are CPU seconds, since other work on the machine hardly changes these. Seconds belong to the machine
that is printed with them. `--out` also writes JSON, `--only` selects the rows whose name contains a
text.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from weight import CALLS as WEIGHED
from weight import OURS

REPEATS = 3

START = """
import time
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np

def best(call, count=300):
    jax.block_until_ready(call())
    times = []
    for _ in range(7):
        start = time.perf_counter()
        for _ in range(count):
            found = call()
        jax.block_until_ready(found)
        times.append((time.perf_counter() - start) / count)
    return min(times)

def seconds(call):
    start = time.process_time()
    jax.block_until_ready(call())
    return time.process_time() - start

def waited(call):
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start

trivial = jax.jit(lambda a, b, c: a + b * c)
"""

READY = (
    START
    + """
import jaxcontact as jc
law, contact = jc.HuGuo(e=.5), jc.Contact(1., 1.4e8)
jax.block_until_ready(trivial(1., 2., 3.))
"""
)

IMPORT = (
    START
    + """
start = time.process_time()
import jaxcontact as jc
jc.HuGuo, jc.Contact, jc.impact, jc.fit
print(time.process_time() - start)
"""
)

SWEEP = (
    READY
    + """
v = jnp.linspace(.5, 5, 1000)
def one(v):
    return jc.impact(law, contact, v).duration
bare = jax.jit(jax.vmap(one))
print({again})
"""
)

# The parts in percent of the call, then the call in units of `import jax`.
SECOND = f"""
import time
start = time.process_time()
import jax
unit = time.process_time() - start
{OURS}
import diffrax
jc.Scene, jc.Sphere, jc.Plane, jc.Vibration, jc.simulate
parts = {{"trace": 0., "mlir": 0., "backend": 0.}}

def count(event, seconds, **_):
    for part in parts:
        parts[part] += seconds if part in event else 0.

jax.monitoring.register_event_duration_secs_listener(count)
jc.cache()
start = time.process_time(), time.perf_counter()
jax.block_until_ready({WEIGHED["scene of 3 discs and a plane, soft"]}.position)
spent, wall = time.process_time() - start[0], time.perf_counter() - start[1]
print(*(f"{{100 * part / wall:.0f}}" for part in parts.values()), spent / unit)
"""

# The row, its limit, its unit, and the program that prints it.
CALLS = {
    "jc.restitution(law), warm": (5, "x", "best(lambda: jc.restitution(law))"),
    "jc.impact(law, contact, v), warm": (
        8,
        "x",
        "best(lambda: jc.impact(law, contact, 4.2).duration)",
    ),
    "building a law and a contact": (
        9,
        "x",
        "best(lambda: (jc.HuGuo(e=.5).e, jc.Contact(1., 1.4e8).mass))",
    ),
}
FIRST = {
    "first call: exact": (0.4, "jc.impact(law, contact, 4.2)"),
    "first call: phase": (0.8, "jc.impact(law, contact, 4.2, method='phase')"),
    "first call: event": (1.8, "jc.impact(law, contact, 4.2, method='event')"),
    "first call: Kuwabara-Kono": (0.5, "jc.impact(jc.KuwabaraKono(A=1e-6), contact, 4.2)"),
    "first gradient: exact": (
        0.8,
        "jax.grad(lambda e: jc.impact(jc.HuGuo(e=e), contact, 4.2).duration)(.5)",
    ),
    "first gradient: event": (
        3.0,
        "jax.grad(lambda e: jc.impact(jc.HuGuo(e=e), contact, 4.2, method='event').duration)(.5)",
    ),
    "first choose_law on 25 points": (
        4.0,
        "jc.choose_law(contact, np.linspace(.5, 5, 25), .8 - .05 * np.linspace(.5, 5, 25)"
        " + .003 * np.sin(40 * np.arange(25))).best",
    ),
}
COMMANDS = {
    "jaxcontact --help": (0.4, ["--help"]),
    "jaxcontact laws": (1.5, ["laws"]),
    "jaxcontact impact": (
        1.2,
        "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2".split(),
    ),
    "jaxcontact calibrate": (6.0, ["calibrate", "--out", "{out}"]),
}
AGAIN = 2.5


def environment(**more: str) -> dict[str, str]:
    """Return that of this process, without a store of programs."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "JAXCONTACT_"))}
    return {**kept, "JAXCONTACT_CACHE": "", **more}


def printed_by(program: str, **variables: str) -> list[str]:
    """Return the words that a program prints."""
    command = [sys.executable, "-c", program]
    run = subprocess.run(
        command, env=environment(**variables), capture_output=True, text=True, check=True
    )
    return run.stdout.split()


def printed(program: str) -> float:
    """Return the number that a program prints, the least of a few processes."""
    return min(float(printed_by(program)[-1]) for _ in range(REPEATS))


def second_process() -> float:
    """Return the time of a soft scene whose programs are stored, in units of `import jax`."""
    with tempfile.TemporaryDirectory() as store:
        runs = [printed_by(SECOND, JAXCONTACT_CACHE=store) for _ in range(1 + REPEATS)]
    trace, lower, load, spent = min(runs[1:], key=lambda run: float(run[-1]))
    print(f"  tracing {trace} %, lowering {lower} %, loading {load} % of")
    return float(spent)


def child_seconds() -> float:
    """Return the CPU seconds of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def command_time(arguments: list[str], **variables: str) -> float:
    """Return the CPU seconds of a command, with its interpreter."""
    start = child_seconds()
    with tempfile.TemporaryDirectory() as folder:
        words = [word.format(out=folder) for word in arguments]
        done = subprocess.run(
            [sys.executable, "-m", "jaxcontact", *words],
            env=environment(**variables),
            capture_output=True,
        )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{words}: {done.stderr.decode()}")
    return child_seconds() - start


def rows() -> Iterator[tuple[str, Callable[[], float], float, str]]:
    """Yield name, measurement, limit and unit."""
    yield "import of what an impact needs, beyond jax", lambda: printed(IMPORT), 0.35, "s"
    for name, (wanted, unit, call) in CALLS.items():
        program = f"{READY}\nunit = best(lambda: trivial(1., 2., 3.))\nprint({call} / unit)"
        yield name, lambda program=program: printed(program), wanted, unit
    sweep = "min({}) - best(lambda: bare(v), 20)"
    same = "[waited(lambda: jc.sweep(one, v=v)) for _ in range(6)]"
    typed = same.replace("one,", "lambda v: jc.impact(law, contact, v).duration,")
    for name, times, wanted in (
        ("a sweep of 1000, the same function", same, 0.002),
        ("a sweep of 1000, a lambda typed again", typed, 0.010),
    ):
        program = SWEEP.format(again=sweep.format(times + "[1:]"))
        yield name, lambda program=program: printed(program), wanted, "s"
    for name, (wanted, call) in FIRST.items():
        program = f"{READY}\nprint(seconds(lambda: {call}))"
        yield name, lambda program=program: printed(program), wanted, "s"
    for name, (wanted, words) in COMMANDS.items():
        yield (
            name,
            lambda words=words: min(command_time(words) for _ in range(REPEATS)),
            wanted,
            "s",
        )
    yield "jaxcontact calibrate, the second time", calibrate_again, AGAIN, "s"
    yield "second process: soft scene, in import jax", second_process, 2, "x"


def calibrate_again() -> float:
    """Return the time of a calibration whose programs are stored."""
    words = COMMANDS["jaxcontact calibrate"][1]
    with tempfile.TemporaryDirectory() as store:
        times = [command_time(words, JAXCONTACT_CACHE=store) for _ in range(1 + REPEATS)]
    return min(times[1:])


def main() -> None:
    """Print the table; with --out also write it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    arguments = parser.parse_args()
    found: list[dict[str, Any]] = []
    print(f"{'':44}{'measured':>12}{'wanted':>12}")
    for name, measure, wanted, unit in rows():
        if arguments.only not in name:
            continue
        value = measure()
        found.append({"row": name, "measured": value, "wanted": wanted, "unit": unit})
        print(f"{name:44}{value:10.4g} {unit:2}{wanted:9.4g} {unit}", flush=True)
    machine = {
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "python": sys.version.split()[0],
    }
    print(machine)
    if arguments.out:
        arguments.out.write_text(json.dumps({"machine": machine, "rows": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
