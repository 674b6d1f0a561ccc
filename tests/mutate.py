"""Mutation testing: plant faults in the package, one at a time, and record the tests that fail.

    python -m tests.mutate             runs all faults without a result; can be interrupted
    python -m tests.mutate --table     writes tests/mutations.md from the results

The faults are drawn once, by seed, over all rooms in proportion to their lines and evenly over five
kinds. None is replaced afterwards. A fault that changes no behaviour counts as a survivor and is
explained in `REASONS`. Each is planted in a copy of the tree. The tests of its room run first, then
those of the rooms that import it, up to the first failure, the quick ones of tests/times.md before
the others. Results are stored in build/mutations, with a compilation cache. A survivor is run again
after the tests have changed, everything after the package has changed.

The usual tools do not fit. mutmut imports once and forks for every fault, which fails with JAX's
threads, and it wraps each function in another, which changes the trace. cosmic-ray has one test
command for all faults and cannot sample over rooms.
"""

import argparse
import ast
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from tests.mutate_faults import KINDS, SCOPE, Fault, plant, room_of, sample

ROOT = Path(__file__).parents[1]
PACKAGE = "jaxcontact"
STATE = ROOT / "build" / "mutations"
TABLE, TIMES = (ROOT / "tests" / name for name in ("mutations.md", "times.md"))

# Reasons why survivors are not gaps in the tests, by their change as listed in the table.
REASONS: dict[str, str] = {
    "jaxcontact/_fit/posterior/density.py, find_mode: 1 → 2": "how damped the last step "
    "of a search may be",
    "jaxcontact/_program/compiled.py, quick_options: 0 → 1": "how long a program that runs once "
    "takes to compile",
    "jaxcontact/_contact.py, Contact: 1.5 → 1.65": "nothing reads the field's default: `__init__` "
    "always sets it, and the type checker asks for one",
    "jaxcontact/_impact/methods/phase.py, solve_phase.advance.rate: 1 → 2": "a divisor that only "
    "keeps lanes finite which are flagged in the same line",
    "jaxcontact/paper/_compression.py, module: 0 → 1": "where dashes of a line begin",
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
    # A test of another room may name what is faulty, as those of friction do with oblique impacts.
    outermost = fault.scope.split(".")[0]
    others += [x for x in home if x not in own + others and outermost in words[x] & defined]
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


STALL = 600
"""Seconds after which a test counts as hanging."""


def pytest_in(where: Path, *arguments: str) -> tuple[int, str]:
    """The exit status of tests of a copy of the tree on two workers, and what they printed."""
    cache = {"PYTHONPATH": str(where), "JAXCONTACT_TEST_CACHE": str(STATE / "cache")}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider", "--tb=no"]
    limits = f"faulthandler_timeout={STALL}", "faulthandler_exit_on_timeout=true"
    options = [part for limit in limits for part in ("-o", limit)]
    done = subprocess.run(
        [*command, *options, *arguments],
        cwd=where, env=os.environ | cache, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


def trial(
    fault: Fault,
    where: Path,
    files: Iterable[list[str]],
    pytest: Callable[..., tuple[int, str]] = pytest_in,
) -> tuple[str, str]:
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
    one: Callable[[Fault], tuple[str, str]],
) -> None:
    """Runs the faults that have no result with `one` and writes each result as it comes."""
    done = known(results, marks, drawn)
    for fault in (x for x in drawn if x.key not in done):
        start = time.monotonic()
        outcome, test = one(fault)
        seconds = round(time.monotonic() - start, 1)
        done[fault.key] = {"key": fault.key, "outcome": outcome, "test": test, "seconds": seconds}
        with open(results, "a", encoding="utf-8") as out:
            out.write(json.dumps(marks | done[fault.key]) + "\n")
        count = sum(x.key in done for x in drawn)
        print(f"{count}/{len(drawn)} {outcome} {test} in {seconds} s: {fault.key}", flush=True)


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


def seconds_of_files() -> dict[str, float]:
    """CPU seconds of the test files, as `.ci/times.py` has written them."""
    rows = re.findall(r"^\| (tests/\S+\.py) \| ([\d.]+) \|", TIMES.read_text(), re.MULTILINE)
    return {path: float(seconds) for path, seconds in rows}


def _cell(text: str, most: int = 90) -> str:
    text = " ".join(text.split()).replace("|", "\\|")
    return text if len(text) <= most else text[: most - 1] + "…"


def table(drawn: list[Fault], done: dict[str, dict[str, Any]], commit: str = "unknown") -> str:
    """The results as Markdown: counts, all faults, and why the survivors survive."""
    rows = sorted(
        ((x, done.get(x.key, {"outcome": "not run", "test": "", "seconds": 0})) for x in drawn),
        key=lambda row: (row[0].path, row[0].line),
    )
    counts = Counter((fault.kind, x["outcome"]) for fault, x in rows)
    total = Counter(x["outcome"] for _, x in rows)
    minutes = sum(x["seconds"] for _, x in rows) / 60
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
    parser.add_argument("--list", action="store_true", help="print the faults, run none")
    parser.add_argument("--table", action="store_true", help=f"write {TABLE.name}, run none")
    asked = parser.parse_args()
    sources = read(ROOT, PACKAGE)
    tests = {x: text for x, text in read(ROOT, "tests").items() if "mutate" not in x}
    marks = {"package": digest(sources), "tests": digest(tests)}
    drawn, results = sample(sources, asked.count, asked.seed), STATE / "results.jsonl"
    if asked.list:
        print("\n".join(x.key for x in drawn))
        return
    if asked.table:
        head = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(head, check=True, capture_output=True, text=True).stdout.strip()
        done = known(results, marks, drawn)
        TABLE.write_text(table(drawn, done, commit), encoding="utf-8")
        return
    STATE.mkdir(parents=True, exist_ok=True)
    seconds, direct, copy = seconds_of_files(), importers(sources), tree(STATE / "tree")
    try:
        if not known(results, marks, drawn):
            print("all tests without a fault", flush=True)
            status, printed = pytest_in(copy)
            if status != 0:
                sys.exit(f"The tests fail without a fault:\n{printed[-3000:]}")
        run(
            drawn, results, marks,
            lambda fault: trial(fault, copy, stages(fault, sources, direct, tests, seconds)),
        )  # fmt: skip
        shutil.rmtree(STATE / "cache", ignore_errors=True)
    except KeyboardInterrupt:
        sys.exit("stopped: the same command goes on from here")
    finally:
        shutil.rmtree(copy)


if __name__ == "__main__":
    main()
