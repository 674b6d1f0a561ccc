"""Mutation testing: plant faults in the package, one at a time, and record the tests that fail.

    python -m tests.mutate             runs all faults without a result; can be interrupted
    python -m tests.mutate --table     writes tests/mutations.md from the results

The faults are drawn once, by seed, over all rooms in proportion to their lines and evenly over five
kinds. None is replaced afterwards. A fault that changes no behaviour counts as a survivor and is
explained in `REASONS`. Each is planted in a copy of the tree. The tests of its room run first, then
those of the rooms that import it, up to the first failure. The copies share a compilation cache for
the duration of the run. Results are stored in build/mutations. A survivor is run again after the
tests have changed, everything after the package has changed.

The usual tools do not fit. mutmut imports once and forks for every fault, which fails with JAX's
threads, and it wraps each function in another, which changes the trace. cosmic-ray has one test
command for all faults and cannot sample over rooms.
"""

import argparse
import ast
import contextlib
import hashlib
import importlib.util
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.mutate_faults import KINDS, SCOPE, Fault, plant, room_of, sample

ROOT = Path(__file__).parents[1]
PACKAGE = "jaxcontact"
STATE = ROOT / "build" / "mutations"
TABLE = ROOT / "tests" / "mutations.md"

# Reasons why survivors are not gaps in the tests, by their change as listed in the table.
REASONS: dict[str, str] = {
    "jaxcontact/_contact.py, Contact: 1.5 → 1.65": "nothing reads the field's default: `__init__` "
    "always sets it, and the type checker asks for one",
    "jaxcontact/_impact/methods/phase.py, solve_phase.advance.rate: 1 → 2": "a divisor that only "
    "keeps lanes finite which are flagged in the same line",
    "jaxcontact/paper/_figures/impact_figures.py, module: 0 → 1": "where dashes of a line begin",
}


def importers(sources: dict[str, str]) -> dict[str, set[str]]:
    """The rooms that import a room themselves, for each room."""
    rooms = {room_of(path) for path in sources}
    direct: dict[str, set[str]] = {room: set() for room in rooms}
    for path, source in sources.items():
        depth = len(Path(path).parts) - 1  # packages around the file
        for node in ast.walk(ast.parse(source)):
            names: list[str] = []
            if isinstance(node, ast.ImportFrom) and node.level == depth:
                names = [node.module] if node.module else [x.name for x in node.names]
            for name in names:
                if (room := name.split(".")[0]) in rooms - {room_of(path)}:
                    direct[room].add(room_of(path))
    return direct


def above(room: str, direct: dict[str, set[str]]) -> set[str]:
    """The rooms that import a room, directly or through others."""
    reached, new = set(), {room}
    while new:
        new = set().union(*(direct.get(x, set()) for x in new)) - reached
        reached |= new
    return reached - {room}


def room_of_test(path: str, rooms: Iterable[str]) -> str:
    """The room that a test file is named after; "" for those of the whole house."""
    name = Path(path).parts[1].removesuffix(".py").removeprefix("test_")
    fits = [x for x in rooms if f"{name}_".startswith(f"{x.strip('_')}_") and x.strip("_")]
    return max(fits, key=len, default="")


def stages(
    fault: Fault,
    sources: dict[str, str],
    direct: dict[str, set[str]],
    tests: dict[str, str],
    seconds: Mapping[str, float],
) -> tuple[list[str], list[str]]:
    """The test files of the fault's room, and of the rooms above it; the likely and quick first.

    What stands on top and has no tests of its own has those of what it imports.
    """
    defined = {x.name for x in ast.walk(ast.parse(sources[fault.path])) if isinstance(x, SCOPE)}
    words = {path: set(re.findall(r"\w+", text)) for path, text in tests.items()}

    def order(path: str) -> tuple[bool, bool, float]:
        named = not words[path].isdisjoint(fault.scope.split("."))
        return not named, words[path].isdisjoint(defined), seconds.get(path, 0.0)

    home = {x: room_of_test(x, direct) for x in tests if Path(x).name.startswith("test_")}
    higher = above(fault.room, direct)
    if fault.room in home.values() or higher:
        own = [x for x in home if home[x] == fault.room]
    else:
        own = [x for x in home if fault.room in direct.get(home[x], ())]
    others = [x for x in home if home[x] in higher or (not home[x] and PACKAGE in words[x])]
    return sorted(own, key=order), sorted(others, key=order)


def read(root: Path, folder: str, pattern: str = "*.py") -> dict[str, str]:
    """The texts of the files below a folder, by path."""
    paths = sorted(x for x in (root / folder).rglob(pattern) if "__pycache__" not in x.parts)
    return {x.relative_to(root).as_posix(): x.read_text(encoding="utf-8") for x in paths}


def digest(texts: dict[str, str]) -> str:
    return hashlib.sha256(json.dumps(texts, sort_keys=True).encode()).hexdigest()[:16]


def tree(target: Path) -> Path:
    """A copy of the tree: what git tracks, and what it would."""
    shutil.rmtree(target, ignore_errors=True)
    command = ["git", "-C", str(ROOT), "ls-files", "-zco", "--exclude-standard"]
    for name in subprocess.run(command, check=True, capture_output=True, text=True).stdout.split(
        "\0"
    ):
        if name and (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


class Pytest:
    """Runs pytest in copies of the tree; setting `stop` ends all runs."""

    def __init__(self, state: Path, stall: float):
        self.state, self.stall, self.stop = state, stall, threading.Event()

    def __call__(self, where: Path, *arguments: str) -> tuple[int | None, str]:
        """The exit status, None where no test ended for `stall` seconds, and what was printed."""
        log, temporary = where.with_suffix(".log"), where.with_suffix(".tmp")
        temporary.mkdir(parents=True, exist_ok=True)
        environment = os.environ | {
            "PYTHONPATH": str(where),
            "TMPDIR": str(temporary),
            "JAXCONTACT_TEST_CACHE": str(self.state / "cache"),
        }
        # The trees are used for many runs.
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        command = [sys.executable, "-u", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no"]
        with open(log, "wb") as out:
            process = subprocess.Popen(
                [*command, *arguments],
                cwd=where,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            size, since = 0, time.monotonic()
            try:
                while process.poll() is None and not self.stop.wait(0.2):
                    if log.stat().st_size != size:
                        size, since = log.stat().st_size, time.monotonic()
                    if time.monotonic() - since > self.stall:
                        break
                status = process.poll()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                shutil.rmtree(temporary, ignore_errors=True)
        return status, log.read_text(encoding="utf-8", errors="replace")


def trial(
    fault: Fault, where: Path, files: Iterable[list[str]], pytest: Pytest
) -> tuple[str, str] | None:
    """Plants a fault, runs the tests stage by stage and takes the fault out: outcome and test."""
    path = where / fault.path
    source = path.read_text(encoding="utf-8")

    def write(text: str) -> None:
        path.write_text(text, encoding="utf-8")
        # Python accepts old byte code if the source has the same second and size.
        Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)

    write(plant(source, fault))
    try:
        for stage in filter(None, files):
            status, printed = pytest(where, "-x", *stage)
            if pytest.stop.is_set():
                return None
            if status is None:
                return "killed", f"no test ended for {pytest.stall:.0f} s"
            if status not in (0, 5):  # 5: nothing to run in these files
                failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", printed, re.MULTILINE)
                return "killed", failed[1] if failed else printed.strip().splitlines()[-1]
        return "survived", ""
    finally:
        write(source)


def run(
    drawn: list[Fault],
    results: Path,
    marks: dict[str, str],
    jobs: int,
    one: Callable[[Fault, int], tuple[str, str] | None],
    stop: threading.Event,
) -> None:
    """Runs the faults that have no result and writes each result as it comes.

    `one` runs a fault in a numbered tree, and gives None when it was stopped.
    """
    done = known(results, marks, drawn)
    trees: queue.Queue[int] = queue.Queue()
    for number in range(jobs):
        trees.put(number)
    lock = threading.Lock()

    def work(fault: Fault) -> None:
        number, start = trees.get(), time.monotonic()
        try:
            ended = one(fault, number)
        finally:
            trees.put(number)
        if ended is None:
            return
        seconds = round(time.monotonic() - start, 1)
        told = {"key": fault.key, "outcome": ended[0], "test": ended[1], "seconds": seconds}
        with lock:
            with open(results, "a", encoding="utf-8") as out:
                out.write(json.dumps(marks | told) + "\n")
            done[fault.key] = told
            count = sum(x.key in done for x in drawn)
            print(f"{count}/{len(drawn)} {' '.join(ended)} in {seconds} s: {fault.key}", flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(work, x) for x in drawn if x.key not in done]
        try:
            for future in futures:
                future.result()
        except BaseException:
            stop.set()
            pool.shutdown(cancel_futures=True)
            raise


def known(
    results: Path, marks: dict[str, str], drawn: Iterable[Fault]
) -> dict[str, dict[str, Any]]:
    """The results that still hold, by the key of the fault.

    All hold while the package is the same, those of survivors that no reason explains while the
    tests are, too.
    """
    explained = {x.key for x in drawn if x.change in REASONS}
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    found = {}
    for x in (json.loads(line) for line in lines if line.endswith("}")):
        final = x["outcome"] == "killed" or x["key"] in explained
        if x["package"] == marks["package"] and (final or x["tests"] == marks["tests"]):
            found[x["key"]] = x
    return found


def baseline(state: Path, marks: dict[str, str], jobs: int) -> dict[str, float]:
    """Seconds of each test without a fault; stops where one fails, and fills the cache."""
    kept = state / "baseline.json"
    if kept.exists() and (held := json.loads(kept.read_text()))["marks"] == marks:
        return held["seconds"]
    print("all tests without a fault", flush=True)
    report = state / "baseline.xml"
    status, printed = Pytest(state, 1800.0)(
        tree(state / "tree0"), f"-n{jobs}", f"--junitxml={report}", "-o", "junit_family=xunit1"
    )
    if status != 0:
        sys.exit(f"The tests fail without a fault:\n{printed[-3000:]}")
    seconds = {
        f"{x.get('file')}::{x.get('name')}": float(x.get("time", 0))
        for x in ElementTree.parse(report).iter("testcase")
    }
    kept.write_text(json.dumps({"marks": marks, "seconds": seconds}))
    return seconds


def _cell(text: str, most: int = 90) -> str:
    text = " ".join(text.split()).replace("|", "\\|")
    return text if len(text) <= most else text[: most - 1] + "…"


def table(
    drawn: list[Fault], done: dict[str, dict[str, Any]], minutes: float, commit: str = "unknown"
) -> str:
    """The results as Markdown: counts, all faults, and why the survivors survive."""
    rows = sorted(
        ((x, done.get(x.key, {"outcome": "not run", "test": "", "seconds": 0})) for x in drawn),
        key=lambda row: (row[0].path, row[0].line),
    )
    counts = Counter((fault.kind, x["outcome"]) for fault, x in rows)
    total = Counter(x["outcome"] for _, x in rows)
    lines = [
        "# Do the tests fail when the package is wrong?",
        "",
        f"{len(rows)} faults in the package of commit {commit}, drawn over all rooms by "
        "`python -m tests.mutate`, none exchanged: "
        f"{', '.join(f'{n} {outcome}' for outcome, n in total.most_common())}; "
        f"{minutes:.0f} minutes in all.",
        "",
        "| kind | killed | survived |",
        "|---|---|---|",
        *(f"| {x} | {counts[x, 'killed']} | {counts[x, 'survived']} |" for x in KINDS),
        "",
        "| room | line | fault | kind | killed by | s |",
        "|---|---|---|---|---|---|",
    ]
    for fault, x in rows:
        by = f"`{_cell(x['test'], 140)}`" if x["outcome"] == "killed" else f"**{x['outcome']}**"
        change = f"`{_cell(fault.old)}` → `{_cell(fault.new)}`"
        where = f"{fault.path.removeprefix(PACKAGE + '/')}:{fault.line}"
        lines.append(
            f"| {fault.room} | {where} | {change} | {fault.kind} | {by} | {x['seconds']:.0f} |"
        )
    survivors = [x for x in drawn if done.get(x.key, {}).get("outcome") == "survived"]
    if survivors:
        lines += ["", "## Survivors", ""]
    for x in survivors:
        lines.append(f"- `{_cell(x.change, 200)}`: {REASONS.get(x.change, 'no test fails yet')}")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=60, help="faults in all (60)")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("--jobs", type=int, default=2, help="faults at a time (2)")
    parser.add_argument("--first", type=int, help="run no more than the first of those drawn")
    parser.add_argument("--no-baseline", action="store_true", help="run no tests without a fault")
    parser.add_argument("--list", action="store_true", help="print the faults, run none")
    parser.add_argument("--table", action="store_true", help=f"write {TABLE.name}, run none")
    asked = parser.parse_args()
    # Stop the running pytest processes as well.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    begun = time.monotonic()
    sources = read(ROOT, PACKAGE)
    tests = {x: text for x, text in read(ROOT, "tests").items() if "mutate" not in x}
    marks = {"package": digest(sources), "tests": digest(tests)}
    drawn = sample(sources, asked.count, asked.seed)
    results, clock = STATE / "results.jsonl", STATE / "minutes.json"
    if asked.list:
        print("\n".join(x.key for x in drawn))
        return
    STATE.mkdir(parents=True, exist_ok=True)
    minutes = json.loads(clock.read_text()) if clock.exists() else {}
    spent = minutes.get(marks["package"], 0.0)
    if asked.table:
        head = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(head, check=True, capture_output=True, text=True).stdout.strip()
        done = known(results, marks, drawn)
        TABLE.write_text(table(drawn, done, spent, commit), encoding="utf-8")
        return
    try:
        each = {} if asked.no_baseline else baseline(STATE, marks, asked.jobs)
        seconds: dict[str, float] = defaultdict(float)
        for name, its in each.items():
            seconds[name.split("::")[0]] += its
        # A fault that makes one test this slow counts as a hang.
        pytest = Pytest(STATE, 300.0 + 2.0 * max(each.values(), default=0.0))
        direct = importers(sources)
        trees = [tree(STATE / f"tree{i}") for i in range(asked.jobs)]

        def one(fault: Fault, number: int) -> tuple[str, str] | None:
            return trial(
                fault, trees[number], stages(fault, sources, direct, tests, seconds), pytest
            )

        run(drawn[: asked.first], results, marks, asked.jobs, one, pytest.stop)
        if len(known(results, marks, drawn)) == len(drawn):
            shutil.rmtree(STATE / "cache", ignore_errors=True)
    except KeyboardInterrupt:
        sys.exit("stopped: the same command goes on from here")
    finally:
        for x in STATE.glob("tree*"):
            shutil.rmtree(x) if x.is_dir() else x.unlink()
        minutes[marks["package"]] = spent + (time.monotonic() - begun) / 60
        clock.write_text(json.dumps(minutes))


if __name__ == "__main__":
    main()
